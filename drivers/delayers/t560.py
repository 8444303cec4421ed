"""The Highland Technology T560 and T564 digital delay generators as gate delayers.

Lines of text over a serial port (38400 baud) or TCP (``socket://HOST:PORT``; a published driver of the older
ones sends datagrams, which this one does not). Source: chapter 4 of the maker's manual for how lines are
built and answered; two published drivers for the commands. Not yet run on the hardware. UNCONFIRMED, for one
source has it or none: what ``ID``, ``TRIGGER`` and ``TDIV`` answer, that steps are 10 ps, that the trigger
level goes from 0.25 to 3.3 V, and that it is deaf until 60 ns after the end of the longest pulse. Whether the
trigger input is terminated stays as it is.
"""

import re
from dataclasses import dataclass
from math import isfinite
from typing import Literal, NamedTuple

from drivers.delayers.text_delayer import DelayRange, GatePulse, TextDelayer
from drivers.errors import DeviceError, DeviceNotFoundError, LimitError, RefusedError
from drivers.lines.serial import SerialLine

BAUD = 38400

RANGE = DelayRange(longest_s=10.0, step_s=10e-12, rearm_s=60e-9, fastest_hz=16e6)
SHORTEST_PULSE_S = 2e-9
TRIGGER_LEVEL_V = (0.25, 3.3)
#: UNCONFIRMED: by how much it divides at most.
LARGEST_DIVIDER = 999

CHANNELS = ("A", "B", "C", "D")
POLARITIES = {"positive": "POS", "negative": "NEG"}
EDGES = {"rising": "POS", "falling": "NEG"}

#: The answer to everything that it does not understand or cannot do.
NO = "??"

#: A channel as it tells it: ``Ch A  POS  ON     Dly  00.000,000,000,000  Wid  00.000,002,000,000``.
_CHANNEL = re.compile(
    r"Ch\s+([A-D])\s+(POS|NEG)\s+(ON|OFF?)\s+Dly\s+([\d.]{1,20})\s+Wid\s+([\d.]{1,20})", re.IGNORECASE
)


class Channel(NamedTuple):
    """What the delayer tells of one of its channels."""

    polarity: str
    on: bool
    delay_s: float
    width_s: float


@dataclass(frozen=True, kw_only=True)
class T560Settings(GatePulse):
    """All settings but the delay, checked when they are made: no delayer is needed to be refused.

    Attributes
    ----------
    output
        The output that the detector's gate input is connected to; its level is fixed.
    trigger_level_v
        Level of the sync pulse that triggers it.

    Raises
    ------
    LimitError
        If there is no such output or pulse, or it cannot be triggered so.
    """

    output: Literal["A", "B", "C", "D"] = "A"
    trigger_level_v: float = 1.25

    def __post_init__(self) -> None:
        if objection := self.objection(0.0):
            raise LimitError(
                "T560",
                f"give pulses of {self.pulse_width_s * 1e9:.4g} ns at output {self.output}, triggered by "
                f"{self.repetition_hz / 1e6:g} MHz at {self.trigger_level_v:g} V",
                objection,
                "Nothing was sent. Correct the configuration.",
            )

    def objection(self, delay_s: float) -> str:
        """Return why no T560 gives pulses so; empty if one does."""
        if self.output not in CHANNELS:
            return f"its outputs are {', '.join(CHANNELS)}"
        if self.polarity not in POLARITIES or self.trigger_edge not in EDGES:
            return "a polarity is positive or negative, an edge rising or falling"
        low, high = TRIGGER_LEVEL_V
        if not (isfinite(self.trigger_level_v) and low <= self.trigger_level_v <= high):
            return f"its trigger level goes from {low:g} to {high:g} V"
        if not self.pulse_width_s >= SHORTEST_PULSE_S:
            return f"its shortest pulse lasts {SHORTEST_PULSE_S * 1e9:g} ns"
        if not 1 <= self.divider <= LARGEST_DIVIDER:
            return f"it divides triggers by 1 to {LARGEST_DIVIDER}"
        return RANGE.objection(delay_s, self.pulse_width_s, self.triggers_hz)


class T560(TextDelayer):
    """A T560 or T564; a context manager that leaves its output off.

    Parameters
    ----------
    address
        A serial port, or ``socket://HOST:PORT``.
    settings
        What it is set to.
    timeout_s
        Longest wait for one answer; it takes half a second for its longest.
    """

    def __init__(self, address: str, *, settings: T560Settings, timeout_s: float = 1.0) -> None:
        line = SerialLine(
            address, device="delay generator", baudrate=BAUD, terminator=b"\r\n", timeout_s=timeout_s
        )
        super().__init__(line, RANGE, width_s=settings.pulse_width_s, repetition_hz=settings.triggers_hz)
        self._settings = settings
        self._output = settings.output

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return identity, delay, pulse, trigger and whether the output is on, as read back."""
        self._require_connection()
        channel = self._ask_channel(self._output)
        return {
            "identity": self.identity,
            "output": self._output,
            "delay_s": channel.delay_s,
            "pulse_width_s": channel.width_s,
            "positive": channel.polarity == "POS",
            "trigger": self._ask("TRIGGER"),
            "trigger_level_v": self._ask_number("TLEVEL"),
            "divider": round(self._divider()),
            "enabled": channel.on,
        }

    def _recognise(self) -> str:
        asked = "answer like a T560"
        try:
            self._ask_channel("A")
            said = self._ask("ID")
        except DeviceError as problem:
            raise DeviceNotFoundError(
                self.name,
                asked,
                problem.answered,
                f"{problem.remedy} Its serial port runs at {BAUD} baud. "
                "Perhaps another device is at this address.",
            ) from None
        return "Highland T560" if said == NO else said

    def _send_delay(self, delay_s: float) -> float:
        self._tell("AUTOINSTALL 1")  # what is set holds from the end of its line on
        self._tell(f"{self._output}DELAY {delay_s * 1e9:.2f}n")
        return self._ask_channel(self._output).delay_s

    def _prepare(self) -> None:
        """Set pulse and trigger."""
        wanted, output = self._settings, self._output
        self._tell(f"{output}WIDTH {wanted.pulse_width_s * 1e9:.2f}n")
        self._tell(f"{output}SET {POLARITIES[wanted.polarity]}")
        kept = self._ask_channel(output)
        if kept.polarity != POLARITIES[wanted.polarity]:
            raise self._kept(f"give {wanted.polarity} pulses", kept.polarity)
        if abs(kept.width_s - wanted.pulse_width_s) > RANGE.step_s:
            raise self._kept(f"give pulses of {wanted.pulse_width_s:g} s", f"{kept.width_s:g} s")
        self._tell(f"TLEVEL {wanted.trigger_level_v:.2f}")
        level_v = self._ask_number("TLEVEL")
        if abs(level_v - wanted.trigger_level_v) > 0.05:  # coarser than its converter
            raise self._kept(f"trigger at {wanted.trigger_level_v:g} V", f"{level_v:g} V")
        self._tell(f"TRIGGER {EDGES[wanted.trigger_edge]}")
        trigger = self._ask("TRIGGER")
        if EDGES[wanted.trigger_edge] not in re.findall(r"[A-Z]+", trigger.upper()):
            raise self._kept(f"trigger by the {wanted.trigger_edge} edge", repr(trigger[:80]))
        if self._divider() != wanted.divider:
            self._tell(f"TDIV {wanted.divider}")
            if (divider := self._divider()) != wanted.divider:
                raise self._kept(f"divide triggers by {wanted.divider}", f"{divider:g}")

    def _divider(self) -> float:
        return max(1.0, self._ask_number("TDIV"))  # 0 divides as 1 does

    def _ends_s(self) -> dict[str, float]:
        """Return when the pulses of this output, and of others that are on, end."""
        told = {name: self._ask_channel(name) for name in CHANNELS}
        return {
            name: one.delay_s + one.width_s for name, one in told.items() if one.on or name == self._output
        }

    def _switch(self, on: bool) -> None:
        self._tell(f"{self._output}SET {'ON' if on else 'OFF'}")
        if self._ask_channel(self._output).on != on:
            raise self._kept(f"switch output {self._output} {'on' if on else 'off'}", "the old state")

    def _tell(self, command: str) -> None:
        answer = self._ask(command)
        if answer == NO:
            raise RefusedError(
                self.name, f"obey {command!r}", f"it answers {NO}", "Check its model, and its manual."
            )
        if answer != "OK":
            raise self._nonsense(command, answer)

    def _ask(self, question: str) -> str:
        self._line.send(question.encode("ascii") + b"\r")
        answer = self._line.receive(f"answer {question!r}").decode("ascii", "backslashreplace").strip()
        if not answer.isprintable():
            raise self._nonsense(question, answer)
        return answer

    def _ask_number(self, question: str) -> float:
        answer = self._ask(question)
        if not re.fullmatch(r"[+-]?[\d,]{1,20}(?:\.[\d,]{0,20})?", answer):
            raise self._nonsense(question, answer)
        return float(answer.replace(",", ""))  # in its verbose mode it puts commas between digits

    def _ask_channel(self, name: str) -> Channel:
        question = f"{name}SET"
        answer = self._ask(question)
        told = _CHANNEL.fullmatch(answer.replace(",", ""))
        if told is None or told[1].upper() != name:
            raise self._nonsense(question, answer)
        try:
            return Channel(told[2].upper(), told[3].upper() == "ON", float(told[4]), float(told[5]))
        except ValueError:
            raise self._nonsense(question, answer) from None
