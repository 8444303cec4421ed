"""A configuration as a file: TOML that `rig.model.config.load` reads back to the same values."""

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from rig.model.config import RigConfig

#: Unit with which a number is written, by the ending of its field's name.
_UNITS = {"_s": "s", "_m": "m", "_hz": "Hz", "_rad": "rad", "_v": "V", "_w": "W"}


def as_toml(config: RigConfig) -> str:
    """Return the text of a file with all values of ``config`` that differ from the defaults.

    Numbers are written in SI units with all their digits.
    """
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
            own.append(f"{key} = {_value(value, field)}")
    return own, inner


def _table(section: BaseModel, head: str, path: str) -> list[str]:
    own, inner = _lines(section, path)
    return ["", head, *own, *inner]


def _value(value: Any, field: str) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_value(one, field) for one in value)}]"
    unit = next((unit for ending, unit in _UNITS.items() if field.endswith(ending)), None)
    if isinstance(value, float) and unit:
        value = f"{value!r} {unit}"
    text = json.dumps(str(value) if isinstance(value, Path) else value, ensure_ascii=False)
    return text.replace("\x7f", "\\u007f")  # else JSON's strings, numbers, true and false are also TOML's
