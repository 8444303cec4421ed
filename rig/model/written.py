"""A configuration as a file: TOML that `rig.model.config.load` reads back to the same values."""

from pydantic import BaseModel

from rig.model.config import RigConfig
from rig.model.spelled import spelled


def as_toml(config: RigConfig) -> str:
    """Return the text of a file with all values of ``config`` that differ from the defaults."""
    top, tables = _lines(config, "")
    return "\n".join([*top, *tables]).lstrip() + "\n"


def _lines(section: BaseModel, name: str) -> tuple[list[str], list[str]]:
    """Return the lines of a section's own keys, and those of the sections inside it."""
    own: list[str] = []
    inner: list[str] = []
    for field, about in type(section).model_fields.items():
        value, key = getattr(section, field), about.alias or field
        if about.exclude or value is None or (value == about.get_default() and field != "kind"):
            continue
        path = f"{name}.{key}" if name else key
        if isinstance(value, BaseModel):
            inner += _table(value, f"[{path}]", path)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            for one in value:
                inner += _table(one, f"[[{path}]]", path)
        else:
            own.append(f"{key} = {spelled(value, field)}")
    return own, inner


def _table(section: BaseModel, head: str, path: str) -> list[str]:
    own, inner = _lines(section, path)
    return ["", head, *own, *inner]
