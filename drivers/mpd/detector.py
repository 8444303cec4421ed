"""MPD Fast-Gated SPAD: the computer opens and closes its gate; a person sets bias and hold-off.

Source: one published driver, in use at 10 MHz (gSTED-sFCS): two-letter commands joined by ``;`` and ended by
``#``. Not yet run by us on the hardware. No command for bias, hold-off, excess bias or threshold is public:
they are set in MPD's own program, and read back here. UNCONFIRMED: what settings are answered, so that they
are read back instead; that the virtual serial port does as well as that driver's D2XX; widths at other rates.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isclose
from types import TracebackType
from typing import Self

from drivers.clock import Clock, wait_until
from drivers.errors import DeviceError, DeviceNotFoundError, LinkError, ProtocolError, RefusedError
from drivers.leaving import insist, leave
from drivers.lines.serial import SerialLine
from drivers.mpd.settings import WIDTHS_S, MpdSettings, checked_width_ps
from drivers.mpd.status import HOLD_OFF_STEP_S, NAMES, NEEDED, Status, parse_piece

BAUD = 115200

#: So long the published driver waits before it reads what a command was answered.
ANSWER_S = 0.3
POLL_S = 0.01

#: By how much the width in effect may be another one. UNCONFIRMED: the steps of the width.
WIDTH_WITHIN_S = 0.5e-9

#: The gate's rate is the laser's within this part.
RATE_WITHIN = 0.01

#: Pieces of an answer, those that are not known too; more are no answer.
MOST_PIECES = 40


PROGRAM = "MPD's program"
BEWARE = f"Treat the detector as SENSITIVE and BIASED: switch its bias off by hand, in {PROGRAM}."


class MpdSpad:
    """A Fast-Gated SPAD; a context manager that leaves its gate closed.

    Closed is: gated by the trigger input, and the gate as short as it can be. Where no trigger comes, it then
    never opens. The bias stays as a person has set it.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    settings
        What it is set to, and what a person has set.
    person
        Has a person set the hold-off [s] in MPD's program, and returns when that is done and the program is
        closed; it may raise. None: nobody is there.
    timeout_s
        Longest wait for one piece of an answer.

    Attributes
    ----------
    identity
        What it was recognised as; empty before.
    """

    #: What only a person can set; the delay is that of a cable, or of a delayer.
    by_hand = frozenset({"bias", "hold_off", "gate_delay"})

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        settings: MpdSettings | None = None,
        person: Callable[[float], None] | None = None,
        timeout_s: float = 0.5,
    ) -> None:
        self._line = SerialLine(
            address, device="detector", baudrate=BAUD, terminator=b"#", timeout_s=timeout_s
        )
        self.name = self._line.name
        self.identity = ""
        self._clock = clock
        self._person = person
        settings = settings or MpdSettings()
        self._gated = settings.gated
        self._width_s = settings.gate_width_s
        self._delay_s = settings.gate_delay_s
        self._hold_off_s = settings.hold_off_s
        self._trigger_hz = settings.trigger_hz
        self._connected = False
        self._enabled = False

    def __enter__(self) -> Self:
        self._open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.disable, self._hang_up], problem)

    def enable(self) -> None:
        """Open the configured gate, if a person has made the detector ready for it.

        While the laser is dark no gate may be triggered yet; a rate of 0 is not refused.

        Raises
        ------
        RefusedError
            It has no bias, reports an error, holds off for another time, is gated at another rate than the
            laser's, or did not take mode or width. The gate was closed.
        LinkError, ProtocolError
            No answer, or none that makes sense. It was told to close the gate.
        """
        self._require_connection()
        try:
            self._require_ready(self._status())
            self._require_rate(self._set(gated=self._gated, width_s=self._width_s))
            self._enabled = True
        except BaseException as problem:
            leave([self.disable], problem)
            raise

    def disable(self) -> None:
        """Close the gate as far as it can be, and verify that; safe to call at any time. The bias stays.

        Raises
        ------
        RefusedError
            It says that it is free running, or that its gate is longer.
        LinkError, ProtocolError
            It was told to close, and whether it did cannot be known.
        """
        self._enabled = False
        if not self._connected:
            return
        insist(
            lambda: self._set(gated=True, width_s=WIDTHS_S[0]),
            name=self.name,
            asked="close its gate",
            beware=BEWARE,
        )

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Choose how long the gate stays open; its delay is not the detector's to set.

        Raises
        ------
        LimitError
            It cannot be so wide; nothing was sent.
        RefusedError
            It keeps another width; or the delay is another one than it was said to be.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        checked_width_ps(self.name, width_s)
        if delay_s != self._delay_s:
            raise RefusedError(
                self.name,
                f"open its gate at {delay_s * 1e9:g} ns",
                f"its trigger cable opens it at {self._delay_s * 1e9:g} ns",
                "Put a delayer between laser and detector, and describe it in [delayer].",
            )
        self._width_s = width_s
        if self._enabled and self._gated:
            self._set(gated=True, width_s=width_s)

    def set_hold_off(self, hold_off_s: float) -> None:
        """Expect another hold-off; if it is not set yet, have a person set it, and verify that it is.

        The gate is closed then, and stays so until it is enabled again.

        Raises
        ------
        RefusedError
            The detector says another one.
        LinkError, ProtocolError
            No answer, or none that makes sense; or MPD's program still has the port.
        """
        self._hold_off_s = hold_off_s
        if self._person is not None and not self._holds_off_so_long(self._status()):
            with self._let_go():
                self._person(hold_off_s)
        self._require_hold_off(self._status())

    @contextmanager
    def _let_go(self) -> Iterator[None]:
        """Close the port, so that a person can use MPD's program, and open it again."""
        self.disable()
        self._hang_up()
        yield
        self._open()

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return bias, gate, rate, hold-off and temperature as read back.

        The hold-off is what a person is said to have set, if what is read back is that within a step: the fit
        is another module's.
        """
        self._require_connection()
        status = self._status()
        hold_off_s = self._hold_off_s if self._holds_off_so_long(status) else status.hold_off_s
        return {"identity": self.identity, **status.settings(), "hold_off_s": hold_off_s}

    def _open(self) -> None:
        try:
            self._line.open()
        except LinkError as problem:
            raise LinkError(
                self.name,
                problem.asked,
                problem.answered,
                f"{problem.remedy} Close {PROGRAM}: it holds the port.",
            ) from problem
        try:
            self._identify()
            self._connected = True
            self.disable()
        except BaseException as problem:
            leave([self._hang_up], problem)
            raise

    def _identify(self) -> None:
        try:
            try:
                self._status()
            except ProtocolError:  # what a program that was killed left half said has spoiled the question
                self._status()
        except DeviceError as problem:
            raise DeviceNotFoundError(
                self.name,
                "answer like a Fast-Gated SPAD",
                problem.answered,
                f"{problem.remedy} Perhaps another device is at this address.",
            ) from None
        self.identity = "MPD Fast-Gated SPAD"

    def _hang_up(self) -> None:
        self._connected = False
        self._line.close()

    def _require_ready(self, status: Status) -> None:
        if not status.biased:
            raise self._not_ready("have its bias on", "the bias is off", "switch the bias on")
        if status.error:
            raise self._not_ready(
                "report no error", f"it reports error {status.error}", "look up and clear its error"
            )
        self._require_hold_off(status)

    def _require_hold_off(self, status: Status) -> None:
        if not self._holds_off_so_long(status):
            raise self._not_ready(
                f"hold off for {self._hold_off_s * 1e9:g} ns",
                f"it holds off for about {status.hold_off_s * 1e9:g} ns",
                "set the hold-off, or correct detector.hold_off",
            )

    def _require_rate(self, status: Status) -> None:
        """Refuse a gate that follows something else than the laser."""
        if (
            self._gated
            and status.gate_hz
            and not isclose(status.gate_hz, self._trigger_hz, rel_tol=RATE_WITHIN)
        ):
            raise RefusedError(
                self.name,
                f"be gated at the laser's {self._trigger_hz / 1e6:g} MHz",
                f"its gate opens at {status.gate_hz / 1e6:g} MHz",
                f"Check the trigger cable, and the trigger's threshold and edge in {PROGRAM}.",
            )

    def _holds_off_so_long(self, status: Status) -> bool:
        return abs(status.hold_off_s - self._hold_off_s) <= HOLD_OFF_STEP_S * (1 + 1e-9)

    def _set(self, *, gated: bool, width_s: float) -> Status:
        """Set mode and width, verify both by what it then says of itself, and return that."""
        self._tell(f"TS0;{'GM' if gated else 'FR'};AD")
        if gated:
            self._tell(f"TO{checked_width_ps(self.name, width_s)};AD")
        status = self._status()
        if status.free_running is gated:
            raise RefusedError(
                self.name,
                "be gated by its trigger" if gated else "run freely",
                "it is free running" if gated else "it is gated",
                f"Check it in {PROGRAM}; connect again.",
            )
        if gated and abs(status.gate_width_s - width_s) > WIDTH_WITHIN_S:
            raise RefusedError(
                self.name,
                f"open its gate for {width_s * 1e9:g} ns",
                f"it keeps {status.gate_width_s * 1e9:g} ns",
                "Choose another detector.gate_width; connect again.",
            )
        return status

    def _tell(self, command: str) -> None:
        """Send settings, and wait until they are answered or the time for that is over.

        Whether they are, and what, is not known for all: it is thrown away.
        """
        self._line.tell(command)
        wait_until(self._clock, lambda: "#" in self._line.pending(), timeout_s=ANSWER_S, every_s=POLL_S)

    def _status(self) -> Status:
        """Ask for everything; the answer is as many pieces as there are names, or fewer and then silence."""
        codes: dict[str, int] = {}
        came: list[str] = []
        self._line.tell("AQ;DC")
        try:
            while len(codes) < len(NAMES) and len(came) < MOST_PIECES:
                came.append(self._line.receive("answer 'AQ;DC'").decode("ascii", "backslashreplace"))
                if piece := parse_piece(came[-1]):
                    codes[piece[0]] = piece[1]  # what came first may be a late answer to a setting
        except LinkError:
            if not came:
                raise
        missing = [name for name in NEEDED if name not in codes]
        if missing:
            self._line.lost_step()
            raise ProtocolError(
                self.name,
                "answer 'AQ;DC'",
                f"{', '.join(missing)} did not come, but {'#'.join(came)[:80]!r}",
                f"Check that the line runs at {BAUD} baud, and that a Fast-Gated SPAD is connected.",
            )
        return Status(codes)

    def _not_ready(self, asked: str, answered: str, by_hand: str) -> RefusedError:
        return RefusedError(
            self.name, asked, answered, f"In {PROGRAM}, {by_hand}; close it, and start again."
        )

    def _require_connection(self) -> None:
        if not self._connected:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the detector inside its with block."
            )
