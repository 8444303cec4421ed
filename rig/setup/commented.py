"""A configuration as a file for people: each key with what it means, and defaults as comments."""

import textwrap
from collections.abc import Iterator

from pydantic import BaseModel, SecretStr

from rig.model.config import RigConfig
from rig.model.spelled import spelled
from rig.setup.described import descriptions, headline

#: Longest line of a comment.
WIDTH = 100


def commented(config: RigConfig, head: str) -> str:
    """Return the text of a file that `rig.model.config.load` reads to the same configuration.

    Keys that have their default stand there as comments, so that a file says what is special of a rig.

    Parameters
    ----------
    config
        The rig.
    head
        What the file says first, as a comment.
    """
    said = descriptions(RigConfig)
    lines = [*_comment(head), "", *_comment(said.get("name", "")), f"name = {spelled(config.name, 'name')}"]
    for name in RigConfig.model_fields:
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            lines += ["", *_section(value, name, said.get(name, ""))]
        elif isinstance(value, tuple):
            for one in value:
                lines += ["", *_comment(said.get(name, "")), f"[[{name}]]", *_keys(one, name)]
        elif value is None:
            lines += ["", *_comment(f"There is no section [{name}]. {said.get(name, '')}")]
    return "\n".join(lines) + "\n"


def _section(section: BaseModel, path: str, said: str) -> Iterator[str]:
    yield from _comment(f"{headline(type(section))} {said}")
    yield f"[{path}]"
    yield from _keys(section, path)


def _keys(section: BaseModel, path: str) -> Iterator[str]:
    """Return the keys of a section, and then the sections inside it."""
    said = descriptions(type(section))
    inner: list[tuple[str, BaseModel, str]] = []
    for field, about in type(section).model_fields.items():
        value, key = getattr(section, field), about.alias or field
        if isinstance(value, SecretStr):
            value = value.get_secret_value()
        if isinstance(value, BaseModel):
            inner.append((f"{path}.{key}", value, said.get(field, "")))
            continue
        yield from _comment(said.get(field, ""))
        if value is None:
            yield f"# {key} is not set"
        else:
            usual = field != "kind" and value == about.get_default(call_default_factory=True)
            yield f"{'# ' if usual else ''}{key} = {spelled(value, field)}"
    for name, one, words in inner:
        yield ""
        yield from _section(one, name, words)


def _comment(text: str) -> list[str]:
    return textwrap.wrap(
        text.strip(), WIDTH, initial_indent="# ", subsequent_indent="# ", break_long_words=False
    )
