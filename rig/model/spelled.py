"""Values as a person would write them in a configuration."""

import json
from math import degrees
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.model.quantities import KINDS, parse, show

#: For each ending of a field's name: the kind of quantity.
_KINDS = {f"_{unit.lower()}": kind for kind, (unit, _) in KINDS.items()}
#: Digits that are tried, until the text gives the same number again.
_DIGITS = (3, 4, 6, 9, 12)


def spelled(value: Any, field: str) -> str:
    """Return a value as TOML, which `rig.model.config.load` reads back to the same value.

    Parameters
    ----------
    value
        A number, text, path, truth, or a tuple of such.
    field
        The field's name, which has the unit.
    """
    if isinstance(value, tuple):
        return f"[{', '.join(spelled(one, field) for one in value)}]"
    if isinstance(value, float) and (ending := next((one for one in _KINDS if field.endswith(one)), None)):
        value = _quantity(value, ending)
    text = json.dumps(str(value) if isinstance(value, Path) else value, ensure_ascii=False)
    return text.replace("\x7f", "\\u007f")  # else JSON's strings, numbers, true and false are also TOML's


def _quantity(value: float, ending: str) -> str:
    kind = _KINDS[ending]
    for text in _tried(value, ending, KINDS[kind][0]):
        try:
            if parse(text, kind) == value:
                return text
        except UsageError:  # such as of what is too large for the unit
            continue
    return f"{value!r} {KINDS[kind][0]}"


def _tried(value: float, ending: str, unit: str) -> list[str]:
    """Return spellings, the shortest first."""
    if ending == "_m":
        units = (("m", 1.0),) if abs(value) >= 1 else (("cm", 0.01), ("mm", 0.001))
        return [f"{value / size:.{digits}g}{name}" for digits in _DIGITS for name, size in units]
    if ending == "_rad":
        return [f"{degrees(value):.{digits}g}deg" for digits in _DIGITS]
    return [show(value, unit, digits).replace(" ", "").replace("µ", "u") for digits in _DIGITS]
