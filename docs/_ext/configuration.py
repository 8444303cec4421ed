"""The page of all sections and keys of a configuration, from the models that read it."""

import inspect
from collections.abc import Iterator
from math import degrees
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pages_made import flat, table
from pydantic import BaseModel, SecretStr
from pydantic.fields import FieldInfo

from rig.model.config.kinds import ROLES
from rig.model.config.rig import RigConfig
from rig.model.config.section import Section
from rig.model.quantities import KINDS, show, show_length
from rig.setup.described import descriptions, headline

#: The ending of a field's name says which quantity it is.
QUANTITIES = {"s": "time", "m": "length", "hz": "frequency", "rad": "angle", "v": "voltage", "w": "power"}
#: What limits are called in pydantic's metadata.
LIMITS = {"gt": "above", "ge": "from", "lt": "below", "le": "to", "max_length": "letters: at most"}
_HEAD = """# Configuration: every key

A configuration is a TOML file. A value with a unit is text, `exposure = "10ms"`; a key that is not known is
an error that names the nearest one. What is left out has the default given here, which is that of the
built-in simulated rig.
[The built-in rig, written out with comments](../../configs/simulated.toml), is a good beginning.

Sections of devices have kinds: `kind` chooses one, and the section has the keys of that kind.
[An installed package](../plug-ins.md) can bring more.

## At the top
"""


def page() -> str:
    """Return the page of all sections and keys of a configuration."""
    parts = [_HEAD, _keys(RigConfig)]
    for name, field in RigConfig.model_fields.items():
        sections = _sections(field)
        if not sections:
            continue
        heading = f"[[{name}]]" if get_origin(field.annotation) is tuple else f"[{name}]"
        parts += [f"## `{heading}`\n", descriptions(RigConfig).get(name, "") + "\n"]
        if name in ROLES:
            for kind, section in ROLES[name].kinds.items():
                usual = ", where no kind is named" if section is ROLES[name].usual else ""
                parts += [
                    f'### `{name}.kind = "{kind}"`{usual}\n',
                    headline(section) + "\n",
                    _keys(section),
                ]
        else:
            parts += list(_section(sections[0], name))
    return "\n".join(parts)


def _section(section: type[BaseModel], name: str) -> Iterator[str]:
    """Yield a section and the sections within it."""
    yield headline(section) + "\n"
    yield _keys(section)
    for field in section.model_fields.values():
        for inner in _sections(field):
            place = f"{name}.{field.alias}"
            yield f"### `[{place}]`\n"
            yield from _section(inner, place)


def _sections(field: FieldInfo) -> list[type[Section]]:
    """Return the sections that a field has in place of a value."""
    return [one for one in flat(field.annotation) if inspect.isclass(one) and issubclass(one, Section)]


def _keys(section: type[BaseModel]) -> str:
    said = descriptions(section)
    rows = [
        (
            f"`{field.alias or name}`",
            _written(name, field),
            _usual(name, field),
            _limits(name, field),
            said.get(name, ""),
        )
        for name, field in section.model_fields.items()
        if name != "kind" and not _sections(field)
    ]
    return table(("key", "value", "by default", "limits", "what it is"), rows)


def _quantity(name: str) -> str | None:
    return QUANTITIES.get(name.rpartition("_")[2]) if "_" in name else None


def _written(name: str, field: FieldInfo) -> str:
    """Say how a value is written."""
    kind = _quantity(name)
    words = {
        int: "whole number",
        float: "number",
        str: "text",
        bool: "`true` or `false`",
        Path: "path",
        SecretStr: "text",
    }

    def words_of(hint: Any) -> str:
        origin, inner = get_origin(hint), [one for one in get_args(hint) if one is not NoneType]
        if origin is Annotated:
            return words_of(inner[0])
        if origin in (Union, UnionType):
            return " or ".join(dict.fromkeys(words_of(one) for one in inner))
        if origin is Literal:
            return ", ".join(f'`"{one}"`' if isinstance(one, str) else f"`{one}`" for one in inner)
        if origin is tuple:
            if Ellipsis in inner:
                return f"list of: {words_of(inner[0])}"
            return f"{len(inner)} of: {words_of(inner[0])}"
        if hint is float and kind:
            return f'{kind}, such as `"{KINDS[kind][1]}"`'
        return words.get(hint, str(hint))

    return words_of(field.annotation)


def _usual(name: str, field: FieldInfo) -> str:
    if field.is_required():
        return "has to be given"
    return _value_in_words(field.get_default(call_default_factory=True), _quantity(name))


def _value_in_words(value: Any, kind: str | None) -> str:
    if value is None:
        return "none"
    if isinstance(value, tuple):
        return "[" + ", ".join(_value_in_words(one, kind) for one in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if kind and isinstance(value, int | float):
        if kind == "length":
            return show_length(value, 6)
        return f"{degrees(value):g} deg" if kind == "angle" else show(value, KINDS[kind][0], 6)
    if isinstance(value, float):
        return f"{value:g}"
    return f'`"{value}"`' if isinstance(value, str | Path) else str(value)


def _limits(name: str, field: FieldInfo) -> str:
    found, kind = [], _quantity(name)
    for one in field.metadata:
        for bound, word in LIMITS.items():
            if (limit := getattr(one, bound, None)) is not None:
                found.append(f"{word} {_value_in_words(limit, kind) if limit else 0}")
    return ", ".join(found)
