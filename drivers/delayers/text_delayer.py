"""What gate delayers share that are spoken to in lines of text, over a serial port or a network socket.

A delayer is triggered by the laser's sync pulse, and gives the detector's gate input a pulse some time later.
It is deaf while a delay or a pulse lasts, and a little longer: a pulse that ends too late for the next sync
pulse would make it leave out every other gate, and half the photons would be missing without a word.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import isfinite
from types import TracebackType
from typing import Literal, Self

from drivers.errors import LimitError, LinkError, ProtocolError, RefusedError
from drivers.leaving import insist, leave
from drivers.lines.serial import SerialLine

BEWARE = "Treat the detector's gate as RUNNING: pull the cable from the delayer's output."


@dataclass(frozen=True)
class DelayRange:
    """What a model of delayer can do.

    Attributes
    ----------
    longest_s, step_s
        Its delays go from 0 to this, in these steps.
    rearm_s
        After the end of a pulse it takes no trigger for so long.
    fastest_hz
        It takes no triggers that come faster.
    """

    longest_s: float
    step_s: float
    rearm_s: float
    fastest_hz: float

    def objection(self, delay_s: float, width_s: float, repetition_hz: float) -> str:
        """Return why no gate pulse can be made so; empty if one can."""
        if not (isfinite(delay_s) and 0 <= delay_s <= self.longest_s):
            return f"its delay goes from 0 to {self.longest_s:g} s"
        if not (isfinite(width_s) and self.step_s <= width_s <= self.longest_s):
            return f"its pulses last {self.step_s:g} to {self.longest_s:g} s"
        if not 0 < repetition_hz <= self.fastest_hz:
            return f"it accepts triggers of up to {self.fastest_hz / 1e6:g} MHz"
        return self.late(delay_s + width_s, repetition_hz)

    def late(self, end_s: float, repetition_hz: float) -> str:
        """Return in words that a pulse ends too late for the next trigger; empty if it does not."""
        left_s = 1 / repetition_hz - self.rearm_s
        if end_s <= left_s + 1e-15:  # rounding
            return ""
        return (
            f"its pulse ends {end_s * 1e9:.4g} ns after the trigger, and to be ready for the next one it "
            f"must end within {max(left_s, 0) * 1e9:.4g} ns at {repetition_hz / 1e6:g} MHz"
        )


@dataclass(frozen=True, kw_only=True)
class GatePulse:
    """The gate pulse, and what triggers it, as all of these delayers are set.

    Attributes
    ----------
    pulse_width_s, polarity
        What a gate pulse is like.
    trigger_edge
        Which edge of the sync pulse triggers it.
    repetition_hz, divider
        Sync pulses a second; a gate pulse is given for the first of so many.
    """

    pulse_width_s: float
    polarity: Literal["positive", "negative"] = "positive"
    trigger_edge: Literal["rising", "falling"] = "rising"
    repetition_hz: float
    divider: int = 1

    @property
    def triggers_hz(self) -> float:
        """Sync pulses a second that trigger it."""
        return self.repetition_hz / self.divider


class TextDelayer(ABC):
    """A gate delayer on a line of text; a context manager that leaves its output off.

    Connecting changes nothing: what the box does for others goes on until `enable`.

    Parameters
    ----------
    line
        Where it is, not yet open.
    delays
        What it can do.
    width_s, repetition_hz
        How long a gate pulse lasts, and how often it is triggered.

    Attributes
    ----------
    identity
        Maker, model and serial number, as far as it tells them; empty before.
    """

    def __init__(self, line: SerialLine, delays: DelayRange, *, width_s: float, repetition_hz: float) -> None:
        self.name = line.name
        self.identity = ""
        self._line = line
        self._delays = delays
        self._width_s = width_s
        self._repetition_hz = repetition_hz
        self._delay_s: float | None = None
        self._connected = False

    @abstractmethod
    def settings(self) -> dict[str, str | int | float | bool]:
        """Return what is set, and whether the output is on, as read back."""

    @abstractmethod
    def _recognise(self) -> str:
        """Return what is there; raise if it is not this delayer."""

    @abstractmethod
    def _send_delay(self, delay_s: float) -> float:
        """Set the delay, and return what was kept."""

    @abstractmethod
    def _prepare(self) -> None:
        """Set trigger and pulse as configured, and read them back; the output is off."""

    @abstractmethod
    def _ends_s(self) -> dict[str, float]:
        """Return when the pulses of all outputs in use end, by their names."""

    @abstractmethod
    def _switch(self, on: bool) -> None:
        """Switch the output, and read it back."""

    def __enter__(self) -> Self:
        self._line.open()
        try:
            self.identity = self._recognise()
            self._connected = True
        except BaseException as problem:
            leave([self._hang_up], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.disable, self._hang_up], problem)

    def set_delay(self, delay_s: float) -> None:
        """Set the delay from trigger to gate pulse, without what the box adds by itself.

        Raises
        ------
        LimitError
            It has no such delay, or the pulse would end too late for the next trigger; nothing was sent.
        RefusedError
            It kept another delay.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        self._require_connection()
        if objection := self._delays.objection(delay_s, self._width_s, self._repetition_hz):
            raise self._outside(f"delay by {delay_s * 1e9:.4g} ns", objection)
        wanted_s = round(delay_s / self._delays.step_s) * self._delays.step_s
        kept_s = self._send_delay(wanted_s)
        if abs(kept_s - wanted_s) > self._delays.step_s / 2:
            raise self._kept(f"delay by {wanted_s * 1e9:.6g} ns", f"{kept_s * 1e9:.6g} ns")
        self._delay_s = wanted_s

    def enable(self) -> None:
        """Set trigger and pulse, switch the output on, and return when that is confirmed.

        Raises
        ------
        LimitError
            Another output's pulse ends too late for the next trigger. The output is off.
        RefusedError
            No delay was set, or the box kept another setting. The output was told to go off.
        LinkError, ProtocolError
            No answer, or none that makes sense. The output was told to go off.
        """
        self._require_connection()
        if self._delay_s is None:
            raise RefusedError(self.name, "give gate pulses", "no delay was set", "Set the delay first.")
        try:
            self._switch(False)
            self._prepare()
            for output, end_s in self._ends_s().items():
                if late := self._delays.late(end_s, self._repetition_hz):
                    raise self._outside(f"be triggered with output {output} as it is set", late)
            self._switch(True)
        except BaseException as problem:
            leave([self.disable], problem)
            raise

    def disable(self) -> None:
        """Switch the output off and verify it; safe to call at any time.

        Raises
        ------
        RefusedError
            The box says that its output is still on.
        LinkError, ProtocolError
            It was told to switch off, and whether it did cannot be known.
        """
        if not self._connected:
            return
        insist(lambda: self._switch(False), name=self.name, asked="switch its output off", beware=BEWARE)

    def _require_connection(self) -> None:
        if not self._connected:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the delayer inside its with block."
            )

    def _outside(self, asked: str, objection: str) -> LimitError:
        return LimitError(
            self.name,
            asked,
            objection,
            "Nothing was sent. Correct gate delay and pulse width, use a slower laser rate, "
            "or a delay that is one laser period shorter.",
        )

    def _kept(self, asked: str, kept: str) -> RefusedError:
        return RefusedError(
            self.name, asked, f"it kept {kept}", "Check its front panel, and that nothing else changes it."
        )

    def _nonsense(self, question: str, answer: str) -> ProtocolError:
        self._line.lost_step()
        return ProtocolError(
            self.name,
            f"answer {question!r}",
            f"{answer[:200]!r} came",
            "Check line speed and firmware; connect again.",
        )

    def _hang_up(self) -> None:
        self._connected = False
        self._delay_s = None
        self._line.close()
