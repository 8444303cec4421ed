"""Quantities with units at the border: text such as ``10ms`` in, SI numbers inside, text out again."""

import re
from functools import cache
from math import isfinite, pi
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, ValidationInfo

from rig.errors import UsageError

if TYPE_CHECKING:
    from pint import UnitRegistry

#: For each kind of quantity: the SI unit that numbers inside have, and a spelling to show when one is wrong.
KINDS = {
    "time": ("s", "10ms"),
    "length": ("m", "4cm"),
    "frequency": ("Hz", "10MHz"),
    "angle": ("rad", "20deg"),
    "voltage": ("V", "50mV"),
    "power": ("W", "0.8W"),
    "memory": ("byte", "2GB"),
}
#: By power of ten, as they are written.
_PREFIXES = {-12: "p", -9: "n", -6: "\N{MICRO SIGN}", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_SCALES = {
    **{prefix: float(f"1e{power}") for power, prefix in _PREFIXES.items()},
    **dict.fromkeys(("u", "\N{GREEK SMALL LETTER MU}"), 1e-6),
}


def _scaled(unit: str, least: float, most: float) -> dict[str, float]:
    return {f"{prefix}{unit}": scale for prefix, scale in _SCALES.items() if least <= scale <= most}


#: Units that are read at once, in the kind's SI unit. All others are read by the library of units, which
#: takes half a second to get ready: longer than most verbs.
USUAL = {
    "time": {**_scaled("s", 1e-12, 1.0), "min": 60.0, "h": 3600.0},
    "length": {**_scaled("m", 1e-12, 1e3), "cm": 1e-2},
    "frequency": _scaled("Hz", 1.0, 1e9),
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180},
    "voltage": _scaled("V", 1e-12, 1e3),
    "power": _scaled("W", 1e-12, 1e3),
    "memory": _scaled("B", 1.0, 1e9),
}
_UNIT = re.compile(r"[A-Za-zµμ]+")
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")


@cache
def _registry() -> "UnitRegistry":
    from pint import UnitRegistry  # imported on first use: it takes a noticeable part of a second

    return UnitRegistry(cache_folder=None)


def parse(text: str, kind: str) -> float:
    """Read a quantity.

    Parameters
    ----------
    text
        Number and unit, e.g. ``"10ms"`` or ``"10 ms"``.
    kind
        A key of `KINDS`.

    Returns
    -------
    float
        The value in the kind's SI unit.

    Raises
    ------
    UsageError
        If there is no number, no unit, or a unit of another kind.
    """
    _, example = KINDS[kind]
    number = _NUMBER.match(text)
    if number is None:
        raise UsageError(f"'{text}' is not a {kind}; write a number and a unit, e.g. {example}")
    symbol = text[number.end() :].strip()
    if not symbol:
        raise UsageError(
            f"'{text}' has no unit; write a {kind} with its unit, e.g. {text.strip()}{example_unit(kind)}"
        )
    magnitude = float(number.group().strip())
    if symbol in USUAL[kind]:
        magnitude *= USUAL[kind][symbol]
    else:
        magnitude = _in_any_unit(text, magnitude, symbol, kind)
    value = float(f"{magnitude:.15g}")  # 10 us is 1e-05, not 9.999999999999999e-06
    if not isfinite(value):
        raise UsageError(f"'{text}' is too large; write a {kind} such as {example}")
    return value


def _in_any_unit(text: str, magnitude: float, symbol: str, kind: str) -> float:
    """Return a quantity in the kind's SI unit, by the library of units; raises as `parse`."""
    import pint

    unit, example = KINDS[kind]
    unknown = UsageError(f"'{text}' has an unknown unit '{symbol}'; write a {kind} such as {example}")
    if not _UNIT.fullmatch(symbol):  # a whole expression would be taken, and fail on some in its own ways
        raise unknown
    try:
        found: float = (magnitude * _registry().Unit(symbol)).to(unit).magnitude
    except pint.DimensionalityError:
        raise UsageError(
            f"'{text}' is not a {kind}; write it with a unit of {kind}, e.g. {example}"
        ) from None
    except (pint.PintError, AttributeError, OverflowError, TypeError):  # such as of logarithmic units
        raise unknown from None
    return found


def si(value: str | float | None, kind: str) -> float | None:
    """Return a quantity in the kind's SI unit: of text, or of a number that is in it already; None is none.

    Raises
    ------
    UsageError
        If text is no such quantity, or the number is not finite.
    """
    if value is None or isinstance(value, str):
        return parse(value, kind) if value else None
    if not isfinite(value):
        raise UsageError(f"{value} is not a {kind}; write a number of {KINDS[kind][0]}, or text")
    return float(value)


def si_range(
    value: str | tuple[float, float, float] | None, kind: str, example: str
) -> tuple[float, float, float] | None:
    """Return from, to and step in the kind's SI unit: of text such as ``0.5m:3m:2cm``, or of three numbers.

    Parameters
    ----------
    value
        What was asked; None is none.
    kind
        A key of `KINDS`.
    example
        How it is spelled, for the message.

    Raises
    ------
    UsageError
        If it is no range.
    """
    if value is None or value == "":
        return None
    parts = value.split(":") if isinstance(value, str) else tuple(value)
    if len(parts) != 3:
        raise UsageError(f"'{value}' is not a range; write from, to and step, e.g. {example}")
    start, stop, step = (si(part, kind) or 0.0 for part in parts)
    return start, stop, step


def depths(value: str | tuple[float, float, float] | None) -> tuple[float, float, float] | None:
    """Return the nearest and the farthest depth and the step, as `si_range`.

    Raises
    ------
    UsageError
        If these are no depths.
    """
    found = si_range(value, "length", "--depth 0.5m:3m:2cm")
    if found is None:
        return None
    start_m, stop_m, step_m = found
    if not (0 < start_m <= stop_m and step_m > 0):
        raise UsageError(
            f"'{value}': depths must start in front of the wall (above 0) and increase in steps above 0"
        )
    return found


def example_unit(kind: str) -> str:
    """Return the unit of the kind's example spelling, e.g. ``ms`` for a time."""
    return KINDS[kind][1].lstrip("0123456789.")


def show(value: float, unit: str, digits: int = 3) -> str:
    """Write an SI number with an engineering prefix, e.g. ``show(0.01, "s") == "10 ms"``."""
    if value == 0 or value != value or abs(value) == float("inf"):
        return f"{value:g} {unit}"
    exponent = 0
    magnitude = abs(value)
    for power in sorted(_PREFIXES):
        # rounding first, so that 999.9 ms is shown as 1 s rather than as 1000 ms
        if float(f"{magnitude / 10.0**power:.{digits}g}") >= 1:
            exponent = power
    if magnitude < 1e-12:
        exponent = -12
    return f"{value / 10.0**exponent:.{digits}g} {_PREFIXES[exponent]}{unit}"


def show_length(value_m: float, digits: int = 3) -> str:
    """Write a length as a person in the lab would: metres, centimetres, millimetres; kilometres, too."""
    if not isfinite(value_m):
        return f"{value_m:g} m"
    unit, size = "mm", 1e-3
    for larger in (("cm", 1e-2), ("m", 1.0), ("km", 1e3)):
        # rounding first, so that 999.9 m is shown as 1 km rather than as 1e+03 m
        if float(f"{abs(value_m) / larger[1]:.{digits}g}") >= 1:
            unit, size = larger
    text = f"{value_m / size:.{digits}g}"
    return f"{float(text):,.0f} {unit}" if "e+" in text else f"{text} {unit}"


def show_bytes(count: float) -> str:
    """Write a number of bytes in the unit that suits it, e.g. ``15.4 MB`` or ``812 kB``."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= 0.9995 * size:
            return f"{count / size:.3g} {unit}"
    return f"{count:.0f} bytes"


#: Longer than any clock goes: 30 million years.
_CLOCK_S = 1e15


def show_duration(duration_s: float) -> str:
    """Write a duration as hours, minutes and seconds, e.g. ``4 min 12 s``, or seconds beyond any clock."""
    if duration_s < 60 or not duration_s < _CLOCK_S:
        return f"{duration_s:.3g} s"
    minutes, seconds = divmod(round(duration_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s"


#: Validation context that takes SI numbers, for configurations that the program itself wrote.
FROM_RECORD = {"si_numbers": True}


def _reader(kind: str) -> BeforeValidator:
    def read(value: Any, info: ValidationInfo) -> Any:
        if info.context == FROM_RECORD:
            return value
        if isinstance(value, str):
            try:
                return parse(value, kind)
            except UsageError as error:
                raise ValueError(str(error)) from None
        if isinstance(value, int | float) and not isinstance(value, bool) and -1e15 < value < 1e15:
            raise ValueError(f'a {kind} needs a unit: write it as text, e.g. "{value}{example_unit(kind)}"')
        raise ValueError(f'a {kind} is written as text with a unit, e.g. "{KINDS[kind][1]}"')

    return BeforeValidator(read)


Seconds = Annotated[float, _reader("time")]
Metres = Annotated[float, _reader("length")]
Hertz = Annotated[float, _reader("frequency")]
Radians = Annotated[float, _reader("angle")]
Volts = Annotated[float, _reader("voltage")]
Watts = Annotated[float, _reader("power")]
