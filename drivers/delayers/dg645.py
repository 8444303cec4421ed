"""The Stanford Research Systems DG645 digital delay generator as a gate delayer.

Lines of text over TCP (``socket://HOST:5025``) or a serial port. Source: the command list of its manual and
its error numbers, as five published drivers quote them; the maker's own Python package for ranges. Not yet
run on the hardware. UNCONFIRMED, for one source has it or none: that it is deaf until 100 ns after the end
of the longest delay (10 MHz without any delay is confirmed), and the form in which it tells numbers.

It has no switch for its outputs, and the smallest amplitude is 0.5 V. Its output is off when nothing triggers
it: with the trigger source "single shot" a pulse comes only when somebody asks for one.
"""

import re
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from drivers.delayers.text_delayer import DelayRange, GatePulse, TextDelayer
from drivers.errors import DeviceError, DeviceNotFoundError, LimitError, RefusedError
from drivers.lines.serial import SerialLine

#: Speed of its serial port as it leaves the factory. It also asks for RTS, which an open port gives.
BAUD = 9600

RANGE = DelayRange(longest_s=2000.0, step_s=5e-12, rearm_s=100e-9, fastest_hz=10e6)

#: Numbers of the outputs, and of the two channels whose delays are an output's edges. T0 is channel 0.
OUTPUTS = {"AB": (1, 2, 3), "CD": (2, 4, 5), "EF": (3, 6, 7), "GH": (4, 8, 9)}
CHANNELS = dict(enumerate("ABCDEFGH", start=2))
EDGES = {"rising": 1, "falling": 2}
SINGLE_SHOT = 5
POLARITIES = {"negative": 0, "positive": 1}

#: UNCONFIRMED: how fast triggers may come that are divided.
DIVIDERS, FASTEST_DIVIDED_HZ = (1, 2**30 - 1), 100e6

AMPLITUDE_V = (0.5, 5.0)
TRIGGER_LEVEL_V = (-3.5, 3.5)

#: It remembers some twenty errors, and tells the last with each question.
MOST_ERRORS = 32

ERRORS = {
    10: "illegal value",
    11: "illegal mode",
    12: "illegal delay",
    13: "illegal link",
    15: "not allowed",
    30: "lost data",
    110: "illegal command",
    111: "undefined command",
    112: "illegal query",
    113: "illegal set",
    114: "no parameter",
    115: "too many parameters",
    116: "missing parameters",
    117: "parameter overflow",
    118: "invalid number",
    120: "invalid integer",
    121: "integer overflow",
    126: "syntax error",
    170: "communication error",
    171: "over run",
}

_NUMBER = r"\s*([+-]?\d{1,20}(?:\.\d{0,20})?(?:[eE][+-]?\d{1,3})?)\s*"


@dataclass(frozen=True, kw_only=True)
class Dg645Settings(GatePulse):
    """All settings but the delay, checked when they are made: no delayer is needed to be refused.

    Attributes
    ----------
    output
        The output that the detector's gate input is connected to.
    amplitude_v
        Of a gate pulse, into 50 ohm.
    trigger_level_v
        Level of the sync pulse that triggers it.

    Raises
    ------
    LimitError
        If there is no such output or pulse, or it cannot be triggered so.
    """

    output: Literal["AB", "CD", "EF", "GH"] = "AB"
    amplitude_v: float = 2.5
    trigger_level_v: float = 0.5

    def __post_init__(self) -> None:
        if objection := self.objection(0.0):
            raise LimitError(
                "DG645",
                f"give pulses of {self.pulse_width_s * 1e9:.4g} ns and {self.amplitude_v:g} V at output "
                f"{self.output}, triggered by {self.repetition_hz / 1e6:g} MHz",
                objection,
                "Nothing was sent. Correct the configuration.",
            )

    def objection(self, delay_s: float) -> str:
        """Return why no DG645 gives pulses so; empty if one does."""
        if self.output not in OUTPUTS:
            return f"its outputs are {', '.join(OUTPUTS)}"
        if self.polarity not in POLARITIES or self.trigger_edge not in EDGES:
            return "a polarity is positive or negative, an edge rising or falling"
        for what, value, (low, high) in (
            ("amplitude", self.amplitude_v, AMPLITUDE_V),
            ("trigger level", self.trigger_level_v, TRIGGER_LEVEL_V),
        ):
            if not (isfinite(value) and low <= value <= high):
                return f"its {what} goes from {low:g} to {high:g} V"
        if not DIVIDERS[0] <= self.divider <= DIVIDERS[1]:
            return f"it divides triggers by {DIVIDERS[0]} to {DIVIDERS[1]}"
        if self.repetition_hz > FASTEST_DIVIDED_HZ:
            return f"it divides triggers of up to {FASTEST_DIVIDED_HZ / 1e6:g} MHz"
        return RANGE.objection(delay_s, self.pulse_width_s, self.triggers_hz)


class Dg645(TextDelayer):
    """A DG645; a context manager that leaves it without a trigger.

    Parameters
    ----------
    address
        ``socket://HOST:5025``, or a serial port.
    settings
        What it is set to.
    timeout_s
        Longest wait for one answer.
    """

    def __init__(self, address: str, *, settings: Dg645Settings, timeout_s: float = 1.0) -> None:
        line = SerialLine(
            address, device="delay generator", baudrate=BAUD, terminator=b"\r\n", timeout_s=timeout_s
        )
        super().__init__(line, RANGE, width_s=settings.pulse_width_s, repetition_hz=settings.triggers_hz)
        self._settings = settings
        self._output, self._begins, self._ends = OUTPUTS[settings.output]

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return identity, delay, pulse, trigger and whether the output is on, as read back."""
        self._require_connection()
        source = self._ask_whole("TSRC?")
        return {
            "identity": self.identity,
            "output": self._settings.output,
            "delay_s": self._ask_delay(self._begins)[1],
            "pulse_width_s": self._ask_delay(self._ends)[1],
            "amplitude_v": self._ask_number(f"LAMP?{self._output}"),
            "offset_v": self._ask_number(f"LOFF?{self._output}"),
            "positive": bool(self._ask_whole(f"LPOL?{self._output}")),
            "trigger_source": source,
            "trigger_level_v": self._ask_number("TLVL?"),
            "divider": self._ask_whole("PRES?0") if self._ask_whole("ADVT?") else 1,
            "inhibit": self._ask_whole("INHB?"),
            "enabled": source in EDGES.values(),
        }

    def _recognise(self) -> str:
        asked = "answer like a DG645"
        try:
            identity = self._ask("*IDN?")
        except DeviceError as problem:
            raise DeviceNotFoundError(
                self.name,
                asked,
                problem.answered,
                f"{problem.remedy} Over the network it listens at port 5025; a serial port runs at {BAUD} "
                "baud. Perhaps another device is at this address.",
            ) from None
        if "DG645" not in identity.split(","):
            raise DeviceNotFoundError(
                self.name, asked, f"its identity is {identity[:200]!r}", "Another device is at this address."
            )
        for _ in range(MOST_ERRORS):  # what others did wrong before
            if not self._ask_whole("LERR?"):
                return " ".join(identity.split(","))
        raise RefusedError(
            self.name, "clear its old errors", "it still reports some", "Switch it off and on."
        )

    def _send_delay(self, delay_s: float) -> float:
        """Delay the leading edge from T0; raise if it kept another reference."""
        self._tell(f"DLAY {self._begins},0,{delay_s:.12f}")
        reference, kept_s = self._ask_delay(self._begins)
        if reference != 0:
            raise self._kept(f"delay output {self._settings.output} from T0", f"channel {reference}")
        return kept_s

    def _prepare(self) -> None:
        """Set pulse and trigger: no burst, and each trigger counts, or the first of so many."""
        wanted, output = self._settings, self._output
        self._tell(f"DLAY {self._ends},{self._begins},{wanted.pulse_width_s:.12f}")
        reference, width_s = self._ask_delay(self._ends)
        if reference != self._begins or abs(width_s - wanted.pulse_width_s) > RANGE.step_s:
            raise self._kept(f"give pulses of {wanted.pulse_width_s:g} s", f"{width_s:g} s")
        self._set("BURM", "0")
        if wanted.divider > 1:
            self._set("PRES", "0", f"{wanted.divider}")
        self._set("ADVT", "1" if wanted.divider > 1 else "0")
        self._set("LOFF", f"{output}", "0.00")
        self._set("LAMP", f"{output}", f"{wanted.amplitude_v:.2f}")
        self._set("LPOL", f"{output}", f"{POLARITIES[wanted.polarity]}")
        self._set("TLVL", f"{wanted.trigger_level_v:.2f}")

    def _ends_s(self) -> dict[str, float]:
        """Return when each channel's delay ends; it is deaf until the last of them."""
        told = {number: self._ask_delay(number) for number in CHANNELS}
        return {name: self._since_t0_s(number, told) for number, name in CHANNELS.items()}

    def _since_t0_s(self, number: int, told: dict[int, tuple[int, float]]) -> float:
        """Add up the delays of a channel and of those it is delayed from."""
        total_s = 0.0
        for _ in range(len(CHANNELS)):
            if number not in told:  # T0
                return total_s
            number, delay_s = told[number]
            total_s += delay_s
        raise self._nonsense(f"DLAY?{number}", "channels that are delayed from each other in a loop")

    def _switch(self, on: bool) -> None:
        self._set("TSRC", str(EDGES[self._settings.trigger_edge] if on else SINGLE_SHOT))

    def _set(self, command: str, *parameters: str) -> None:
        """Set something, and read it back; the last parameter is its value."""
        *which, value = parameters
        self._tell(f"{command} {','.join(parameters)}")
        kept = self._ask_number(f"{command}?{','.join(which)}")
        if abs(kept - float(value)) > 0.005:  # volts are told with two digits after the point
            raise self._kept(f"set {command} {','.join(parameters)}", f"{kept:g}")

    def _tell(self, command: str) -> None:
        """Send a setting, which is not answered, and ask whether it was an error."""
        self._line.send(command.encode("ascii") + b"\n")
        if error := self._ask_whole("LERR?"):
            raise RefusedError(
                self.name,
                f"obey {command!r}",
                f"it reports error {error}: {ERRORS.get(error, 'see its manual')}",
                "Check its front panel, and that nothing else changes it.",
            )

    def _ask(self, question: str) -> str:
        self._line.send(question.encode("ascii") + b"\n")
        answer = self._line.receive(f"answer {question!r}").decode("ascii", "backslashreplace").strip()
        if not answer.isprintable():
            raise self._nonsense(question, answer)
        return answer

    def _ask_number(self, question: str) -> float:
        answer = self._ask(question)
        if not re.fullmatch(_NUMBER, answer):
            raise self._nonsense(question, answer)
        return float(answer)

    def _ask_whole(self, question: str) -> int:
        number = self._ask_number(question)
        if number != int(number):
            raise self._nonsense(question, str(number))
        return int(number)

    def _ask_delay(self, channel: int) -> tuple[int, float]:
        """Return from which channel one is delayed, and by how much."""
        question = f"DLAY?{channel}"
        answer = self._ask(question)
        told = re.fullmatch(rf"\s*(\d)\s*,{_NUMBER}", answer)
        if told is None:
            raise self._nonsense(question, answer)
        return int(told[1]), float(told[2])
