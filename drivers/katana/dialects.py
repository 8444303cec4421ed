"""What the Katana lasers call their settings: the same wire, other names and units for each model."""

import re
from dataclasses import dataclass
from math import inf, isfinite


@dataclass(frozen=True)
class Dialect:
    """Names of one model. A setting is written ``name=value`` and asked for as ``name?``.

    Attributes
    ----------
    model
        The laser, for people.
    kind
        What a configuration calls it.
    recognised_by
        A question that this model answers, and the other does not; it changes nothing.
    emission, power, repetition, trigger, remote
        Names of the settings; ``remote`` takes the power from the front knob to the serial line.
    modes
        Settings that have to be made before the power means what it says, and their values.
    measured
        Name of the laser's own measurement of its light; empty where it has none.
    power_unit
        What the power is counted in, as it ends the name of a setting that is read back.
    power_digits
        Digits after the point with which a power is written.
    power_range
        Lowest and highest power that is asked for.
    repetition_range_hz
        Lowest and highest repetition rate.
    triggers
        Numbers of the trigger sources.
    """

    model: str
    kind: str
    recognised_by: str
    emission: str
    power: str
    repetition: str
    trigger: str
    remote: str
    triggers: dict[str, int]
    power_unit: str
    power_digits: int
    power_range: tuple[float, float]
    repetition_range_hz: tuple[float, float]
    modes: tuple[tuple[str, int], ...] = ()
    measured: str = ""

    def written_power(self, power: float) -> str:
        """Return a power as the laser takes it."""
        return f"{power:.{self.power_digits}f}"

    @property
    def power_rounding(self) -> float:
        """By how much the laser's rounding may change a power."""
        return 0.51 * 10.0**-self.power_digits


#: Green, 532 nm. Source: help listing of the unit itself, kept in a published MATLAB class.
KATANA_05 = Dialect(
    model="Katana 05 (532 nm)",
    kind="katana",
    recognised_by="leg",
    emission="leg",
    power="lp",
    repetition="ltg_freq",
    trigger="ltg",
    remote="lps",
    triggers={"internal": 0, "external": 1},
    power_unit="setpoint",
    power_digits=2,
    power_range=(0.0, 10.0),
    repetition_range_hz=(1.0, inf),
)

#: 775 nm. Source: three published Python drivers (a class OneFiveLaser, a lantz driver, ImSwitch), which
#: agree: power in watt with three decimals, held to at most 3.1 W by one and 0.8 W by another; ``lps=1``,
#: ``lip=0`` for constant power; trigger 0 internal, 1 a level at Tr-1, 2 TTL at Tr-2; 18 to 80 MHz. Two of
#: them ask ``lip?``, ``lp?`` and ``lpa?`` (the light that the laser measures); none asks whether it emits.
#: UNCONFIRMED: that ``le?``, ``lps?``, ``lts?`` and ``lx_freq?`` are answered.
KATANA_08HP = Dialect(
    model="Katana 08HP (775 nm)",
    kind="katana-08hp",
    recognised_by="lip",
    emission="le",
    power="lp",
    repetition="lx_freq",
    trigger="lts",
    remote="lps",
    triggers={"internal": 0, "level": 1, "ttl": 2},
    power_unit="w",
    power_digits=3,
    power_range=(0.0, 3.1),
    repetition_range_hz=(18e6, 80e6),
    modes=(("lip", 0),),
    measured="lpa",
)

DIALECTS = (KATANA_05, KATANA_08HP)

#: Light that an 08HP measures above this is light [W]; 5 mW are the limit of class 3R. UNCONFIRMED: what the
#: laser measures while it is dark.
MEASURED_DARK_W = 0.005

#: A rate without a unit below this is in MHz: no Katana pulses so slowly.
SLOWEST_HZ = 1000.0

_REFUSAL = re.compile(r"\(Error\s+([0-9]{1,9})\)")
_NUMBER = r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)[ \t]*([kM]?Hz)?"
_STATUS = re.compile(rf"(?:\b([A-Za-z_]\w*)[ \t]+)?\bstatus:[ \t]*{_NUMBER}")
_HERTZ = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}
_NAMES = {
    name
    for one in DIALECTS
    for name in (one.emission, one.power, one.repetition, one.trigger, one.remote, one.recognised_by)
}


def parse_value(name: str, text: str) -> float | None:
    """Return the number in an answer ``name=number`` or ``status: number``, or None.

    Stray bytes around it do not matter; a number that is too large for one is none, and so is the status of
    another setting.
    """
    return _number(name, text)[0]


def parse_rate(name: str, text: str) -> float | None:
    """Return the rate [Hz] in an answer, which may be in Hz or in MHz, or None."""
    value, unit = _number(name, text)
    if value is None:
        return None
    if unit:
        return value * _HERTZ[unit]
    return value * 1e6 if abs(value) < SLOWEST_HZ else value


def parse_emission(name: str, text: str) -> bool | None:
    """Return what an answer says about emission, or None if it says nothing."""
    value = parse_value(name, text)
    return bool(value) if value in (0.0, 1.0) else None


def parse_measured(name: str, text: str) -> bool | None:
    """Return whether the light that an answer tells [W] is more than a dark laser's, or None."""
    value = parse_value(name, text)
    return None if value is None else value > MEASURED_DARK_W


def parse_refusal(text: str) -> int | None:
    """Return the number of an ``(Error n)`` in an answer, or None."""
    match = _REFUSAL.search(text)
    return int(match[1]) if match else None


def _number(name: str, text: str) -> tuple[float | None, str]:
    """Return the number that an answer gives for a setting, and its unit if it has one."""
    match = re.search(rf"(?<![A-Za-z0-9_]){name}\s*=\s*{_NUMBER}", text)
    if match is None:
        status = _STATUS.search(text)
        if status is None or status[1] in _NAMES - {name}:
            return None, ""
        number, unit = status[2], status[3]
    else:
        number, unit = match[1], match[2]
    value = float(number)
    return (value if isfinite(value) else None), unit or ""
