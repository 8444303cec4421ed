"""MPD Picosecond Delayer (PSD): a USB box that sends a pulse a set time after each pulse of its input.

Source: two published drivers that are in use (gSTED-sFCS for commands, ranges and the frame; PYME for the
errors, the steps and the echo); not yet run by us on the hardware. The pulse's width is the coarse delay, in
steps of 3 or 4 ns, where what comes after is triggered by the pulse's END; the fine delay comes before the
pulse. UNCONFIRMED, one source only: that ``EO`` answers the state in effect, ``RMD``, ``RT``, and that local
mode answers ``ERR2``.
"""

from dataclasses import dataclass
from math import isfinite
from types import TracebackType
from typing import Self

from drivers.clock import Clock, wait_until
from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.leaving import insist, leave
from drivers.lines.serial import SerialLine

BAUD = 115200

#: Pulse widths [ns], and fine delays [ps]. PYME: the fine delay begins at 0; gSTED-sFCS asks for 1 at least.
WIDTHS_NS = (1, 250)
FINE_PS = (0, 49_090)
FINE_STEP_PS = 10

#: The coarse delay is asked for in these steps, so that a small move is one of the fine delay alone; and it
#: stays so far below the whole, for the unit rounds it, and a long pulse leaves no room before the next.
COARSE_STEP_NS, RESERVE_NS = 10, 20
#: No shorter pulse is asked for without need, and none longer than this part of the time between two pulses
#: of the input. UNCONFIRMED: which pulses trigger a detector well, and which the unit can still send.
SHORT_NS, ROUNDED_BY_NS, LONGEST_PART = 5, 4, 0.8

TRIGGER_V = (-2.0, 2.0)
TRIGGER_STEP_V = 0.01

DIVIDERS = (1, 999)

POLL_S = 0.01


#: What comes for ``ERRn``, after PYME.
ERRORS = {
    1: "it does not know this command",
    2: "it is in local mode, where only its front panel sets it",
    3: "the divider is above 999",
    4: "the divider is below 1",
    5: "the trigger level is above 2 V",
    6: "the trigger level is below -2 V",
    7: "the delay is above its maximum",
    8: "the delay is below 0 ps",
    9: "the pulse is longer than 250 ns",
    10: "the pulse is shorter than 1 ns",
}
LOCAL = 2

BEWARE = "Treat the gate as OPEN: switch the delayer off by hand."


@dataclass(frozen=True, kw_only=True)
class PsdSettings:
    """What is set on connecting.

    Attributes
    ----------
    trigger_level_v
        Level at the input at which a pulse counts; None leaves what is set at the unit.
    repetition_hz
        Pulses a second that come to the input.
    divider
        A pulse is sent for the first of so many.

    Raises
    ------
    LimitError
        No such level or divider is possible.
    """

    trigger_level_v: float | None = None
    repetition_hz: float = 10e6
    divider: int = 1

    @property
    def longest_ns(self) -> int:
        """The longest pulse that is asked for."""
        period_ns = 1e9 * self.divider / self.repetition_hz
        return max(min(WIDTHS_NS[1], int(LONGEST_PART * period_ns)), WIDTHS_NS[0])

    def __post_init__(self) -> None:
        level = self.trigger_level_v
        if level is not None and not TRIGGER_V[0] <= level <= TRIGGER_V[1]:
            raise LimitError(
                "PSD delayer",
                f"set a trigger level of {level:g} V",
                f"the range is {TRIGGER_V[0]:g} to {TRIGGER_V[1]:g} V",
                "Nothing was sent. Correct the configuration.",
            )
        if not DIVIDERS[0] <= self.divider <= DIVIDERS[1]:
            raise LimitError(
                "PSD delayer",
                f"send one pulse for {self.divider} triggers",
                f"the range is {DIVIDERS[0]} to {DIVIDERS[1]}",
                "Nothing was sent. Correct the configuration.",
            )


class Psd:
    """A Picosecond Delayer; a context manager that leaves its output off.

    Connecting leaves the output off too.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB1``.
    clock
        The time to wait by.
    settings
        What it is set to.
    timeout_s
        Longest wait for one answer.

    Attributes
    ----------
    identity
        What it was recognised as; empty before.
    """

    def __init__(
        self, address: str, *, clock: Clock, settings: PsdSettings | None = None, timeout_s: float = 0.3
    ) -> None:
        self._line = SerialLine(
            address, device="gate delayer", baudrate=BAUD, terminator=b"#", timeout_s=timeout_s
        )
        self.name = self._line.name
        self.identity = ""
        self._clock = clock
        self._settings = settings or PsdSettings()
        self._timeout_s = timeout_s
        self._connected = False

    def __enter__(self) -> Self:
        self._line.open()
        try:
            self._identify()
            self._connected = True
            self.disable()
            self._set("SV", self._settings.divider)
            if self._settings.trigger_level_v is not None:
                self._set("SH", round(self._settings.trigger_level_v / TRIGGER_STEP_V) * 10)
        except BaseException as problem:
            leave([self._hang_up], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.disable, self._give_back, self._hang_up], problem)

    def set_delay(self, delay_s: float) -> None:
        """Let the pulse end so long after that of the input, the box's own delay left out.

        The coarse delay is what the unit makes of what it is asked for; the fine one makes up the rest.

        Raises
        ------
        LimitError
            No such delay is possible; nothing was sent.
        RefusedError
            The unit kept another delay, or is in local mode.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        total_ps = self._checked_ps(delay_s)
        width_ns = self._ask("SP", self._coarse_ns(total_ps // 1000))
        fine_ps = total_ps - 1000 * width_ns
        if not FINE_PS[0] <= fine_ps <= FINE_PS[1]:
            raise self._refused(
                f"delay by {total_ps / 1000:g} ns", f"with a pulse of {width_ns} ns this is not possible"
            )
        self._set("SD", fine_ps, within=FINE_STEP_PS)
        kept_ps = self._delay_ps()
        if abs(kept_ps - total_ps) > FINE_STEP_PS:
            raise self._refused(f"delay by {total_ps / 1000:g} ns", f"it delays by {kept_ps / 1000:g} ns")

    def enable(self) -> None:
        """Switch the output on.

        Raises
        ------
        RefusedError
            It stays off.
        LinkError, ProtocolError
            No answer, or none that makes sense; it was told to go off.
        """
        self._require_connection()
        try:
            self._set("EO", 1)
        except BaseException as problem:
            leave([self.disable], problem)
            raise

    def disable(self) -> None:
        """Switch the output off, so that no gate opens any more; safe to call at any time.

        Raises
        ------
        RefusedError
            It says that it is still on.
        LinkError, ProtocolError
            It was told to go off, and whether it did cannot be known.
        """
        if not self._connected:
            return
        insist(lambda: self._set("EO", 0), name=self.name, asked="send no pulses", beware=BEWARE)

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the delay and the pulse's width as read back."""
        self._require_connection()
        width_ns, fine_ps = self._ask("RP"), self._ask("RD")
        return {
            "identity": self.identity,
            "delay_s": (1000 * width_ns + fine_ps) / 1e12,
            "pulse_width_s": width_ns / 1e9,
            "fine_delay_s": fine_ps / 1e12,
        }

    def _coarse_ns(self, total_ns: int) -> int:
        """Return the coarse delay to ask for: always the same one for the same delay."""
        coarse_ns = total_ns // COARSE_STEP_NS * COARSE_STEP_NS - RESERVE_NS
        if coarse_ns < SHORT_NS:
            coarse_ns = min(SHORT_NS, max(total_ns - ROUNDED_BY_NS, WIDTHS_NS[0]))
        return min(coarse_ns, self._settings.longest_ns)

    def _checked_ps(self, delay_s: float) -> int:
        lowest_ps = 1000 * WIDTHS_NS[0] + FINE_PS[0]
        highest_ps = 1000 * self._settings.longest_ns + FINE_PS[1]
        if not isfinite(delay_s) or not lowest_ps <= round(delay_s * 1e12) <= highest_ps:
            raise LimitError(
                self.name,
                f"delay by {delay_s * 1e9:g} ns",
                f"it delays by {lowest_ps / 1000:g} to {highest_ps / 1000:g} ns",
                "It was not sent. Change the cable's length, delayer.insertion_delay or detector.gate_delay.",
            )
        self._require_connection()
        return round(delay_s * 1e12 / FINE_STEP_PS) * FINE_STEP_PS

    def _identify(self) -> None:
        """Switch the echo off, and find out whether a delayer answers; nothing else is set."""
        self._line.tell("EM0")
        came = bytearray()

        def answered() -> bool:
            """Return whether echo and answer have come; without an echo there is only one of them."""
            came.extend(self._line.pending().encode("ascii", "replace"))
            return came.count(b"#") == 2

        wait_until(self._clock, answered, timeout_s=self._timeout_s, every_s=POLL_S)
        try:
            longest_ps = self._ask("RMD", unknown=FINE_PS[1])
            self._delay_ps()
        except DeviceError as problem:
            raise DeviceNotFoundError(
                self.name,
                "answer like a PSD delayer",
                problem.answered,
                f"{problem.remedy} Perhaps another device is at this address, "
                "or MPD's own program has the port.",
            ) from None
        self.identity = f"MPD Picosecond Delayer, fine delay up to {longest_ps / 1000:g} ns"

    def _delay_ps(self) -> int:
        return 1000 * self._ask("RP") + self._ask("RD")

    def _give_back(self) -> None:
        """Switch the echo on again, which MPD's own program needs."""
        if self._connected:
            self._line.tell("EM1")

    def _hang_up(self) -> None:
        self._connected = False
        self._line.close()

    def _set(self, command: str, value: int, *, within: int = 0) -> None:
        kept = self._ask(command, value)
        if abs(kept - value) > within:
            raise self._refused(f"set {command}{value}", f"it kept {kept}")

    def _ask(self, command: str, value: int | None = None, *, unknown: int | None = None) -> int:
        """Return the number that a command is answered with, or ``unknown`` where it knows no such command.

        With the echo on, the command itself comes first.
        """
        sent = command if value is None else f"{command}{value}"
        answer = self._line.ask(sent)
        if answer.strip() == sent:
            answer = self._line.receive(f"answer {sent!r}").decode("ascii", "backslashreplace")
        answer = answer.strip()
        if answer.startswith("ERR") and answer[3:].isdecimal() and len(answer) < 6:
            return self._failed(sent, int(answer[3:]), unknown)
        digits = answer.removeprefix("-")
        if not digits.isdecimal() or not digits.isascii() or len(digits) > 9:
            self._line.lost_step()
            raise ProtocolError(
                self.name,
                f"answer {sent!r}",
                f"{answer[:80]!r} came",
                f"Check that the line runs at {BAUD} baud, and that a PSD delayer is connected.",
            )
        return int(answer)

    def _failed(self, sent: str, error: int, unknown: int | None) -> int:
        if error == 1 and unknown is not None:
            return unknown
        told = ERRORS.get(error, f"it answers error {error}")
        remedy = "Correct the configuration."
        if error == LOCAL:
            remedy = "Set it to remote mode at its front panel."
        raise RefusedError(self.name, f"do {sent!r}", told, remedy)

    def _refused(self, asked: str, answered: str) -> RefusedError:
        return RefusedError(
            self.name, asked, answered, "Check what is set at its front panel; connect again."
        )

    def _require_connection(self) -> None:
        if not self._connected:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the delayer inside its with block."
            )
