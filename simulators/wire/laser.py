"""The firmware of Katana lasers, lighting the bench: the green 05, and the 08HP of 775 nm.

Source: the unit's own help listing in a published driver (05); three published drivers (08HP). UNCONFIRMED,
and so choices made here: the text around ``(Error 100)``, what an accepted setting is answered, which bytes
follow the emission status, and whether an 08HP knows ``le?``, ``lps?``, ``lts?`` and ``lx_freq?``. Where
drivers leave it open, an attribute chooses.
"""

import re
from dataclasses import dataclass

from simulators.bench import Bench
from simulators.wire.laser_head import LaserHead

_SETTING = re.compile(r"([a-z_]+)=\s*([+-]?\d{1,12}(?:\.\d{0,6})?)\s*")


@dataclass(frozen=True)
class _Names:
    """What a model calls its settings, and their ranges."""

    emission: str
    rate: str
    rates_hz: tuple[float, float]
    full_power: float
    digits: int
    switches: dict[str, int]
    """Settings of a few numbers, from 0 up to this."""
    numbers: tuple[str, ...]
    """Settings that change nothing on the bench."""
    help: str


_GREEN = _Names(
    emission="leg",
    rate="ltg_freq",
    rates_hz=(1, 1e9),
    full_power=10.0,
    digits=2,
    switches={"ltg": 1, "lps": 1},
    numbers=("ltlg", "let"),
    help="""leg=<0|1>, leg? : emission
ltg=<0|1>, ltg? : trigger source, internal or external
ltlg=<xx.xxx>, ltlg? : external trigger level
ltg_freq=<Hz>, ltg_freq? : repetition rate
lp=<xx.xx>, lp? : power, 0 to 10
lps=<0|1>, lps? : power control, knob or RS232
let=<xx.xx>, let? : SHG temperature set point
lestg : store configuration
""",
)

_RED = _Names(
    emission="le",
    rate="lx_freq",
    rates_hz=(18e6, 80e6),
    full_power=3.1,
    digits=3,
    switches={"lts": 2, "lps": 1, "lip": 1},
    numbers=("ltll", "li"),
    help="""le=<0|1> : emission
lp=<x.xxx>, lp? : power, watt
lpa? : measured power, watt
lps=<0|1> : power control, knob or RS232
lip=<0|1>, lip? : constant power or constant current
lts=<0|1|2> : trigger, internal, Tr-1 (level) or Tr-2 (TTL)
lx_freq=<Hz> : repetition rate
""",
)


class KatanaHead(LaserHead):
    """A Katana 05 as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its light is switched and dimmed.
    knob
        Position of the power knob on the front panel, 0 to 10; it rules until the serial line takes over.

    Attributes
    ----------
    answers_settings
        Whether a setting that is accepted is answered.
    says_status
        Whether a setting that is asked for is told as ``status: n``, not as ``name=n``.
    says_megahertz
        Whether the repetition rate is told in MHz.
    echo
        Whether all that is received is sent back, as terminals want it.
    """

    _names = _GREEN

    def __init__(self, bench: Bench, *, knob: float = 0.0) -> None:
        super().__init__(bench)
        self.answers_settings = True
        self.says_status = False
        self.says_megahertz = False
        self.echo = False
        self._knob = knob
        self._power = 0.0
        self._numbers = dict.fromkeys([*self._names.switches, *self._names.numbers], 0.0)
        self._apply_power()

    def turn_knob(self, power: float) -> None:
        """Turn the power knob on the front panel, 0 to 10."""
        self._knob = power
        self._apply_power()

    def obey(self, line: bytes) -> bytes:
        """Do what a command says, and return the answer."""
        answer = self._obey(line.decode("ascii", "replace").strip()).encode("ascii")
        return line + b"\n" + answer if self.echo else answer

    def junk(self) -> bytes:
        """Answer what is no command."""
        return b"unknown command, h for help\n"

    def _obey(self, command: str) -> str:
        if command == "h":
            return self._names.help
        if command == "lestg" and self._names is _GREEN:
            return ""
        if command.endswith("?"):
            return self._tell(command[:-1])
        match = _SETTING.fullmatch(command)
        return self._change(match[1], float(match[2])) if match else self.junk().decode("ascii")

    def _tell(self, name: str) -> str:
        names, light = self._names, self._bench.light
        if name == names.emission:
            return self._tell_emission()
        if name == "lp":
            return self._told(name, f"{names.full_power * light.power:.{names.digits}f}")
        if name == names.rate:
            megahertz = f"{light.repetition_hz / 1e6:.6f} MHz"
            return self._told(name, megahertz if self.says_megahertz else f"{light.repetition_hz:.0f}")
        if name in self._numbers:
            return self._told(name, f"{self._numbers[name]:g}")
        return self.junk().decode("ascii")

    def _tell_emission(self) -> str:
        # The real unit sends more bytes after the status.
        return f"{self._names.emission} status: {int(self._bench.light.emitting)}\n\r\n"

    def _told(self, name: str, value: str) -> str:
        return f"status: {value}\n" if self.says_status else f"{name}={value}\n"

    def _change(self, name: str, value: float) -> str:
        names = self._names
        if name == names.emission and value in (0, 1):
            if refusal := self._switch(bool(value)):
                return refusal
        elif name == "lp" and 0 <= value <= names.full_power:
            self._power = round(value, names.digits)
            self._apply_power()
        elif name == names.rate and names.rates_hz[0] <= value <= names.rates_hz[1]:
            self._bench.change_light(repetition_hz=value)
        elif name in names.switches and value in range(names.switches[name] + 1):
            self._numbers[name] = value
            self._apply_power()
        elif name in names.numbers:
            self._numbers[name] = value
        else:
            return "value not possible (Error 1)\n"
        return f"{name}={value:.10g}\n" if self.answers_settings else ""

    def _switch(self, on: bool) -> str:
        """Follow an emission command; return why it is refused, if it is."""
        if on and not self._key_on and not self.emission_stuck:
            return "emission not possible, key switch is off (Error 100)\n"
        self.switch_light(on)  # an open interlock is not told: the light just does not come
        return ""

    def _apply_power(self) -> None:
        ruled = self._numbers["lps"] and not self._numbers.get("lip", 0.0)
        fraction = self._power / self._names.full_power if ruled else self._knob / 10
        self._bench.change_light(power=fraction)


class Katana08Head(KatanaHead):
    """A Katana 08HP as bytes in and bytes out; it begins in constant current, ruled by its knob.

    Attributes
    ----------
    knows_emission
        Whether ``le?`` is answered; no published driver ever asks it.
    dark_w
        What it measures while it is dark.
    """

    _names = _RED

    def __init__(self, bench: Bench, *, knob: float = 0.0) -> None:
        super().__init__(bench, knob=knob)
        self.knows_emission = False
        self.dark_w = 0.0
        self._numbers["lip"] = 1.0

    def _tell(self, name: str) -> str:
        if name == "lpa":
            light = self._bench.light
            measured = self._names.full_power * light.power if light.emitting else self.dark_w
            return self._told(name, f"{measured:.3f}")
        return super()._tell(name)

    def _tell_emission(self) -> str:
        return super()._tell_emission() if self.knows_emission else self.junk().decode("ascii")
