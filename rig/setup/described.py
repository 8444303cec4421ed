"""What the sections of a configuration say of their keys: the sentences below each in the source."""

import ast
import inspect
import textwrap

from pydantic import BaseModel


def headline(section: type[BaseModel]) -> str:
    """Return the first paragraph of a section's own description."""
    return _plain((section.__doc__ or "").split("\n\n")[0])


def descriptions(section: type[BaseModel]) -> dict[str, str]:
    """Return what is said of each field, by its name; nothing where no source is at hand."""
    found: dict[str, str] = {}
    for one in reversed(section.__mro__):
        if issubclass(one, BaseModel) and one is not BaseModel:
            found |= _of_class(one)
    said = {name: field.description for name, field in section.model_fields.items() if field.description}
    return {**found, **{name: _plain(text) for name, text in said.items()}}


def _of_class(section: type[BaseModel]) -> dict[str, str]:
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(section))).body
    except (OSError, TypeError, SyntaxError, ValueError):  # installed without its source
        return {}
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        is_field = isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name)
        if is_field and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            found[before.target.id] = _plain(str(after.value.value))  # type: ignore[attr-defined]
    return found


def _plain(text: str) -> str:
    """Return text of the source on one line, without its marks for code."""
    return " ".join(text.replace("``", "`").replace("None:", "Not set:").split())
