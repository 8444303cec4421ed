"""What the Katana lasers call their settings: the same wire, other names for each model."""

import re
from dataclasses import dataclass, field
from math import inf, isfinite


@dataclass(frozen=True)
class Dialect:
    """Names of one model. A setting is written ``name=value`` and asked for as ``name?``.

    Attributes
    ----------
    model
        The laser, for people.
    emission, power, repetition, trigger
        Names of the settings.
    power_format
        How a power set point is written.
    power_range
        Lowest and highest power set point, in the laser's own scale.
    repetition_range_hz
        Lowest and highest repetition rate; None where it is not known.
    remote
        Name of the setting that takes the power from the front knob to the serial line; None where the model
        has none.
    triggers
        Numbers of the trigger sources.
    """

    model: str
    emission: str
    power: str
    repetition: str
    trigger: str
    power_format: str = "{:.2f}"
    power_range: tuple[float, float] = (0.0, 10.0)
    repetition_range_hz: tuple[float, float] | None = None
    remote: str | None = None
    triggers: dict[str, int] = field(default_factory=lambda: {"internal": 0, "external": 1})


#: Green, 532 nm. Source: help listing of the unit itself, kept in a published MATLAB class.
KATANA_05 = Dialect(
    model="Katana 05 (532 nm)",
    emission="leg",
    power="lp",
    repetition="ltg_freq",
    trigger="ltg",
    remote="lps",
)

#: 775 nm. Source: two published Python drivers, which disagree in places. Unconfirmed: that emission is asked
#: for as ``le?`` and answers like the green one, the numbers of the trigger sources, the power scale.
KATANA_08HP = Dialect(
    model="Katana 08HP (775 nm)",
    emission="le",
    power="lp",
    repetition="lx_freq",
    trigger="lts",
    repetition_range_hz=(18e6, 80e6),
)

DIALECTS = (KATANA_05, KATANA_08HP)

_EMISSION = re.compile(r"status:\s*([01])")
_REFUSAL = re.compile(r"\(Error\s+([0-9]{1,9})\)")


def parse_emission(text: str) -> bool | None:
    """Return what an answer says about emission, or None if it says nothing."""
    match = _EMISSION.search(text)
    return match[1] == "1" if match else None


def parse_value(name: str, text: str) -> float | None:
    """Return the number in an answer ``name=number``, or None; stray bytes around it do not matter.

    A number that is too large for one is none.
    """
    match = re.search(rf"(?<![A-Za-z0-9_]){name}\s*=\s*([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)", text)
    value = float(match[1]) if match else inf
    return value if isfinite(value) else None


def parse_refusal(text: str) -> int | None:
    """Return the number of an ``(Error n)`` in an answer, or None."""
    match = _REFUSAL.search(text)
    return int(match[1]) if match else None
