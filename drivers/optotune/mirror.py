"""The Optotune MR-15-30 beam-steering mirror on its MR-E-2 or MR-E-3 board.

It points in "Simple" ASCII mode, and follows a trajectory in binary "Pro" mode.

Source: Optotune MR-E-2 / MR-E-3 operation manual as used by the maker's Python SDK and by two independent
drivers; not yet run on the hardware.
"""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import DeviceNotFoundError, LinkError, ProtocolError, RefusedError
from drivers.leaving import leave
from drivers.lines.serial import SerialLine
from drivers.optotune import registers
from drivers.optotune.frames import FLAG
from drivers.optotune.limits import OptotuneLimits
from drivers.optotune.pro_mode import ProMode
from drivers.optotune.status import FAULTS, LATCHED, OVERLOADS, MirrorStatus

#: Takes a board from the binary "Pro" mode back to Simple mode: SET_COMM_MODE 0, checksum left out.
LEAVE_PRO_MODE = bytes.fromhex("7E 00 06 02 00 00 00 00 7E")

# asked thousands of times a second while the mirror settles; plain numbers are ten times as fast as flags
_CANNOT_HOLD = int(FAULTS | OVERLOADS | MirrorStatus.TRIMMED)
_NOT_STABLE = int(MirrorStatus.NOT_STABLE)
_STATUS = re.compile(r"(0[xX])?[0-9a-fA-F]{1,8}")


class OptotuneMirror:
    """A two-axis mirror; a context manager that leaves the mirror at rest.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyACM0`` (USB 0483:A31E).
    clock
        The time to wait by.
    limits
        A position outside is refused unsent.
    expected_identity
        Text that the board's identification, its serial number included, must contain, to tell two boards
        apart; None takes any.
    timeout_s
        Longest wait for one answer.
    poll_interval_s
        Time between two looks at the status while the mirror settles.

    Attributes
    ----------
    limits
        As given.
    identity
        What the board answered to GETID, and to GETSN where it knows that.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        limits: OptotuneLimits | None = None,
        expected_identity: str | None = None,
        timeout_s: float = 0.5,
        poll_interval_s: float = 1e-3,
    ) -> None:
        self._line = SerialLine(
            address,
            device="steering mirror",
            baudrate=registers.BAUD,
            terminator=b"\r\n",
            timeout_s=timeout_s,
        )
        self._clock = clock
        self.limits = replace(limits or OptotuneLimits(), device=self._line.name)
        self._expected_identity = expected_identity
        self._poll_interval_s = poll_interval_s
        self._target_rad = (0.0, 0.0)
        self._pro: ProMode | None = None
        self._positions = 0
        self.identity = ""

    def __enter__(self) -> Self:
        self._line.open()
        try:
            self._shake_hands()
            self._identify()
            self._start_clean()
        except BaseException as problem:
            leave([self._line.close], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        # After a failure the mirror stays where it is: what failed may be what puts the light out.
        rest = [] if problem is not None else [lambda: self.point(0.0, 0.0)]
        leave([*rest, self._line.close], problem)

    def point(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Steer the beam to these optical angles (right and up, facing the wall), without waiting.

        It ends a trajectory.

        Parameters
        ----------
        angle_x_rad, angle_y_rad
            Optical deflection, twice the mechanical one.

        Raises
        ------
        LimitError
            The position is outside the limits or the unit circle; nothing was sent.
        RefusedError
            The board moved to its own limit instead.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        x, y = self.limits.units(angle_x_rad, angle_y_rad)
        if self._pro:
            self._stand_still(self._pro, x, y)
        # Nine decimals are about 1 nrad, and 31 bytes of the 64 that the board takes.
        answer = self._line.ask(f"XY={x:.9f};{y:.9f}")
        if answer != "OK":
            self._not_ok(f"point to XY={x:.9f};{y:.9f}", answer)
        self._target_rad = (angle_x_rad, angle_y_rad)

    @property
    def longest_trajectory(self) -> int:
        """How many positions `trajectory` takes at most."""
        return self.limits.longest_trajectory

    def loading_s(self, positions: int) -> float:
        """Estimate how long `trajectory` takes with so many positions."""
        return self.limits.loading_s(positions)

    def trajectory(
        self,
        angles_rad: NDArray[np.float64],
        tick_s: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        """Load positions that the mirror takes one after the other, one at each rising edge of its trigger.

        It goes to the first at once, and stays at the last; `point` ends it at any time. Until then the board
        is in Pro mode, where its status can be asked for as before.

        Parameters
        ----------
        angles_rad
            (n, 2) optical angles, as of `point`; all are checked before anything is sent.
        tick_s
            Time between two edges.
        meanwhile
            Called between the frames that carry them, hundreds of times a second; it may raise.

        Raises
        ------
        LimitError
            A position is outside the limits, or there are too many, or the edges come too fast.
        RefusedError
            The board answered with an error.
        LinkError, ProtocolError
            No answer, or none that makes sense; also if what is read back is not what was sent.
        """
        samples = self.limits.trajectory_units(angles_rad, tick_s).astype(np.float32)
        self.point(*angles_rad[0].tolist())
        answer = self._line.ask("GOPRO")
        if answer != "OK":
            self._not_ok("GOPRO", answer)
        self._pro = ProMode(self._line)
        # whether a pattern ends with or before its end is unconfirmed: the last sample is there twice
        memory = np.concatenate([np.append(axis, axis[-1]) for axis in samples.T])
        self._upload(self._pro, memory, meanwhile)
        for axis in (0, 1):
            first = axis * len(memory) // 2
            self._set_and_check(
                self._pro,
                {
                    registers.pattern(axis, registers.UNIT): registers.XY,
                    registers.pattern(axis, registers.START): first,
                    registers.pattern(axis, registers.END): first + len(samples),
                    registers.pattern(axis, registers.CYCLES): 1,
                    registers.pattern(axis, registers.EXTERNAL_TRIGGER): registers.RISING_EDGE,
                },
            )
        running = {registers.pattern(axis, registers.RUN): 1 for axis in (0, 1)}
        followed = {registers.input_of(axis): registers.pattern_unit(axis) for axis in (0, 1)}
        self._set_and_check(self._pro, running | followed)
        self._positions = len(samples)

    def wait_settled(self, timeout_s: float) -> None:
        """Return when two looks at the status, one poll interval apart, find the mirror stable.

        Raises
        ------
        RefusedError
            The mirror is not stable after ``timeout_s``, reports a fault, or stands trimmed to its limit.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        deadline_s = self._clock.now_s() + timeout_s
        looks_stable = 0
        while looks_stable < 2:
            status = self._status_word()
            if status & _CANNOT_HOLD:
                self._refuse_on(MirrorStatus(status), MirrorStatus(_CANNOT_HOLD), "hold a position")
            looks_stable = 0 if status & _NOT_STABLE else looks_stable + 1
            if looks_stable < 2:
                # an answer that was long in coming must not make a mirror that stands one that moves
                if not looks_stable and self._clock.now_s() >= deadline_s:
                    raise RefusedError(
                        self._line.name,
                        f"settle within {timeout_s:g} s",
                        "it is still moving",
                        "Allow more time, or check that nothing shakes or blocks the mirror.",
                    )
                self._clock.sleep(self._poll_interval_s)

    def status(self) -> MirrorStatus:
        """Return the board's status bits.

        Raises
        ------
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        return MirrorStatus(self._status_word())

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the last accepted position (there is no read-back), the limits and the status.

        While a trajectory is loaded the position is its first; how many positions it has, and at which of
        them the mirror is, come with it.
        """
        followed = {"trajectory_positions": self._positions, "trajectory_index": self._index()}
        return {
            "identity": self.identity,
            "angle_x_rad": self._target_rad[0],
            "angle_y_rad": self._target_rad[1],
            "max_angle_x_rad": self.limits.max_angle_rad[0],
            "max_angle_y_rad": self.limits.max_angle_rad[1],
            "status": int(self.status()),
            **(followed if self._pro else {}),
        }

    def _upload(self, pro: ProMode, samples: NDArray[np.float32], meanwhile: Callable[[], None]) -> None:
        """Fill the memory of patterns, and hold what is read back against it."""
        some, vector = registers.SAMPLES_A_FRAME, registers.PATTERN_MEMORY
        pieces = [(first, samples[first : first + some].tolist()) for first in range(0, len(samples), some)]
        for first, piece in pieces:
            meanwhile()
            pro.set_vector(vector, first, piece)
        for first, piece in pieces:
            meanwhile()
            told = list(pro.vector(vector, first, len(piece)))
            if told != piece:
                self._reads_otherwise(f"keep samples {first} to {first + len(piece) - 1}", told)

    def _set_and_check(self, pro: ProMode, values: dict[int, int]) -> None:
        pro.set(values)
        for register, value in values.items():
            told = pro.value(register)
            if told != value:
                self._reads_otherwise(f"set register {register:04X} to {value}", told)

    def _reads_otherwise(self, asked: str, told: object) -> None:
        raise ProtocolError(
            self._line.name, asked, f"it reads back {told}", "Check the cable; the command may be repeated."
        )

    def _index(self) -> int:
        return self._pro.value(registers.pattern(0, registers.INDEX)) if self._pro else 0

    def _stand_still(self, pro: ProMode, x: float, y: float) -> None:
        """End a trajectory at a position, and go back to Simple mode."""
        # in this order the axes never follow anything that has not been set
        places = {registers.static_xy(axis): value for axis, value in enumerate((x, y))}
        followed = {registers.input_of(axis): registers.static_input(axis) for axis in (0, 1)}
        stopped = {registers.pattern(axis, registers.RUN): 0 for axis in (0, 1)}
        pro.set(places | followed | stopped)
        with suppress(LinkError):  # whether this is answered is unconfirmed; START tells whether it was done
            pro.leave()
        self._pro, self._positions = None, 0
        if (answer := self._start()) != "OK":
            self._not_ok("START after Pro mode", answer)

    def _status_word(self) -> int:
        if self._pro:
            return self._pro.value(registers.STATUS)
        answer = self._line.ask("STATUS").rstrip(" ")
        if answer == "OK":  # which one public driver expects where the manual has a number without a bit
            return 0
        if not _STATUS.fullmatch(answer):
            self._not_ok("report its STATUS", answer)
        return int(answer, 16)

    def _shake_hands(self) -> None:
        try:
            answer = self._start()
        except LinkError:
            answer = "nothing"
        if answer == "OK":
            return
        # Silence or garbage: the board was left in Pro mode, perhaps in the middle of a frame. The first flag
        # ends that frame; a board that does not also begin a frame with it understands the second attempt.
        for ended in (b"", bytes([FLAG])):
            self._line.lost_step()
            self._line.send(ended + LEAVE_PRO_MODE)
            self._line.lost_step()
            try:
                answer, problem = self._start(), None
            except LinkError as silence:
                answer, problem = silence.answered, silence
            if answer == "OK":
                return
        raise self._not_a_mirror("START", answer if problem else f"{answer!r} came") from problem

    def _start(self) -> str:
        answer = self._line.ask("START")
        return self._line.ask("START") if answer == "NO" else answer  # NO is normal right after a mode switch

    def _identify(self) -> None:
        identity = self._line.ask("GETID")
        if not _is_a_name(identity):
            raise self._not_a_mirror("GETID", f"{identity!r} came")
        # that every board and firmware knows GETSN, and in what form it answers, is unconfirmed
        with suppress(LinkError):
            serial = self._line.ask("GETSN").strip()
            if _is_a_name(serial):
                identity = f"{identity}, serial {serial}"
        if self._expected_identity is not None and self._expected_identity not in identity:
            raise DeviceNotFoundError(
                self._line.name,
                f"be {self._expected_identity!r}",
                f"it is {identity!r}",
                "Another board has this address: check galvo.address and galvo.serial.",
            )
        self.identity = identity

    def _start_clean(self) -> None:
        status = self.status()
        self._refuse_on(status, FAULTS, "be ready")
        if status & LATCHED:
            answer = self._line.ask("ACKNOWLEDGE")
            if answer != "OK":
                self._not_ok("ACKNOWLEDGE its past errors", answer)

    def _refuse_on(self, status: MirrorStatus, bits: MirrorStatus, asked: str) -> None:
        wrong = status & bits
        if wrong:
            remedy = "Check the cable to the mirror head and let it cool down; then connect again."
            if wrong & OVERLOADS:
                remedy = (
                    "It was asked for more than its current limit allows: use smaller or slower steps, and "
                    "check that nothing touches the mirror; then connect again."
                )
            names = ", ".join(bit.name.lower().replace("_", " ") for bit in wrong if bit.name)
            raise RefusedError(
                self._line.name,
                asked,
                f"its status says: {names} (0x{status:08X})",
                remedy,
            )

    def _not_ok(self, asked: str, answer: str) -> None:
        """Raise what an answer other than the expected one means."""
        if answer in ("OL", "OU"):
            side = "lower" if answer == "OL" else "upper"
            raise RefusedError(
                self._line.name,
                asked,
                f"{answer} came: it stopped at its {side} limit",
                "Choose a smaller grid: the beam is not where it was asked to be.",
            )
        if answer == "ERROR":
            raise RefusedError(self._line.name, asked, "ERROR came", "Check its status; connect it again.")
        self._line.lost_step()
        raise ProtocolError(
            self._line.name, asked, f"{answer!r} came", "Check the cable; the command may be repeated."
        )

    def _not_a_mirror(self, asked: str, answered: str) -> DeviceNotFoundError:
        remedy = "Check the address: another device is there, or none."
        if f"{asked!r} came" in answered:
            remedy = "It returns what is sent to it: switch the echo of this line or adapter off."
        elif "\\x" in answered:
            remedy = (
                f"The answer is not text: the line's speed is not {registers.BAUD} baud, "
                "or another device is at this address. Check both."
            )
        return DeviceNotFoundError(
            self._line.name, f"answer {asked} like an Optotune MR-E board", answered, remedy
        )


def _is_a_name(answer: str) -> bool:
    return answer not in ("", "NO", "OK", "ERROR") and answer.isprintable()
