"""The Optotune MR-15-30 beam-steering mirror on its MR-E-2 or MR-E-3 board, in "Simple" ASCII mode.

Source: Optotune MR-E-2 / MR-E-3 operation manual as used by the maker's Python SDK and by two independent
drivers; not yet run on the hardware.
"""

import re
from dataclasses import dataclass, replace
from enum import IntFlag
from math import hypot, isfinite, pi, radians, tan
from types import TracebackType
from typing import Self

from drivers.clock import Clock
from drivers.errors import DeviceNotFoundError, LimitError, LinkError, ProtocolError, RefusedError
from drivers.leaving import leave
from drivers.lines.serial import SerialLine

#: One unit of X or Y is this tangent of the optical angle: the unit circle is 50 degrees optical.
TAN_PER_UNIT = tan(radians(50.0))

#: Takes a board from the binary "Pro" mode back to Simple mode: SET_COMM_MODE 0, checksum left out.
LEAVE_PRO_MODE = bytes.fromhex("7E 00 06 02 00 00 00 00 7E")


class MirrorStatus(IntFlag):
    """Bits of the answer to STATUS; ``WAS_`` bits stay until acknowledged."""

    HEAD_DISCONNECTED = 1 << 0
    HEAD_TEMPERATURE = 1 << 1
    MIRROR_TEMPERATURE = 1 << 2
    EEPROM_INVALID = 1 << 3
    NOT_STABLE = 1 << 4
    OUTPUT_LIMIT = 1 << 5
    AVERAGE_OUTPUT_LIMIT = 1 << 6
    TRIMMED = 1 << 7
    WAS_DISCONNECTED = 1 << 8
    WAS_HEAD_TEMPERATURE = 1 << 9
    WAS_MIRROR_TEMPERATURE = 1 << 10
    WAS_OUTPUT_LIMIT = 1 << 11
    WAS_AVERAGE_OUTPUT_LIMIT = 1 << 12
    WAS_TRIMMED = 1 << 13


#: The mirror cannot be trusted to point anywhere.
FAULTS = (
    MirrorStatus.HEAD_DISCONNECTED
    | MirrorStatus.HEAD_TEMPERATURE
    | MirrorStatus.MIRROR_TEMPERATURE
    | MirrorStatus.EEPROM_INVALID
)
LATCHED = (
    MirrorStatus.WAS_DISCONNECTED
    | MirrorStatus.WAS_HEAD_TEMPERATURE
    | MirrorStatus.WAS_MIRROR_TEMPERATURE
    | MirrorStatus.WAS_OUTPUT_LIMIT
    | MirrorStatus.WAS_AVERAGE_OUTPUT_LIMIT
    | MirrorStatus.WAS_TRIMMED
)

# asked thousands of times a second while the mirror settles; plain numbers are ten times as fast as flags
_CANNOT_HOLD, _NOT_STABLE = int(FAULTS | MirrorStatus.TRIMMED), int(MirrorStatus.NOT_STABLE)
_STATUS = re.compile(r"(0[xX])?[0-9a-fA-F]{1,8}")


@dataclass(frozen=True)
class OptotuneLimits:
    """Where the beam may be steered to; can be asked without a mirror.

    Attributes
    ----------
    max_angle_rad
        Largest optical deflection to either side, for x and y.
    device
        Whose limits these are, for messages.
    """

    max_angle_rad: tuple[float, float] = (0.36, 0.28)
    device: str = "steering mirror"

    def check(self, angle_x_rad: float, angle_y_rad: float) -> None:
        """Raise `LimitError` unless the beam may be steered to these optical angles."""
        self.units(angle_x_rad, angle_y_rad)

    def units(self, angle_x_rad: float, angle_y_rad: float) -> tuple[float, float]:
        """Return optical angles in the board's units: X and Y within the unit circle.

        Raises
        ------
        LimitError
            If they are outside the largest deflections, or outside the unit circle.
        """
        angles = (angle_x_rad, angle_y_rad)
        for axis, angle, limit in zip("xy", angles, self.max_angle_rad, strict=True):
            if not isfinite(angle) or abs(angle) > min(limit, pi / 2):
                raise LimitError(
                    self.device,
                    f"point {axis} to {angle:.4f} rad",
                    f"the limit is {limit:.4f} rad to either side",
                    "Nothing was sent. Choose a smaller grid, or change the limit.",
                )
        # Adding zero turns -0.0 into 0.0, so that the wire never carries "-0.000000000".
        x, y = (round(tan(angle) / TAN_PER_UNIT, 9) + 0.0 for angle in angles)
        if hypot(x, y) > 1.0:
            raise LimitError(
                self.device,
                f"point to ({angle_x_rad:.4f}, {angle_y_rad:.4f}) rad",
                f"that is {hypot(x, y):.3f} of the mirror's range",
                "Nothing was sent. Choose a smaller grid.",
            )
        return x, y


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
        Text that the board's identification must contain, to tell two boards apart; None takes any.
    timeout_s
        Longest wait for one answer.
    poll_interval_s
        Time between two looks at the status while the mirror settles.

    Attributes
    ----------
    limits
        As given.
    identity
        What the board answered to GETID.
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
        # The manual says 256000 baud; on USB (CDC-ACM) the number has no effect.
        self._line = SerialLine(
            address, device="steering mirror", baudrate=256000, terminator=b"\r\n", timeout_s=timeout_s
        )
        self._clock = clock
        self.limits = replace(limits or OptotuneLimits(), device=self._line.name)
        self._expected_identity = expected_identity
        self._poll_interval_s = poll_interval_s
        self._target_rad = (0.0, 0.0)
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
        # Nine decimals are about 1 nrad, and 31 bytes of the 64 that the board takes.
        answer = self._line.ask(f"XY={x:.9f};{y:.9f}")
        if answer != "OK":
            self._not_ok(f"point to XY={x:.9f};{y:.9f}", answer)
        self._target_rad = (angle_x_rad, angle_y_rad)

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
                self._refuse_on(MirrorStatus(status), FAULTS | MirrorStatus.TRIMMED, "hold a position")
            looks_stable = 0 if status & _NOT_STABLE else looks_stable + 1
            if looks_stable < 2:
                if self._clock.now_s() >= deadline_s:
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
        """Return the last accepted position (this mode has no read-back), the limits and the status."""
        return {
            "identity": self.identity,
            "angle_x_rad": self._target_rad[0],
            "angle_y_rad": self._target_rad[1],
            "max_angle_x_rad": self.limits.max_angle_rad[0],
            "max_angle_y_rad": self.limits.max_angle_rad[1],
            "status": int(self.status()),
        }

    def _status_word(self) -> int:
        answer = self._line.ask("STATUS")
        if not _STATUS.fullmatch(answer):
            self._not_ok("tell its STATUS", answer)
        return int(answer, 16)

    def _shake_hands(self) -> None:
        try:
            answer = self._start()
        except LinkError:
            answer = "nothing"
        if answer == "OK":
            return
        # Silence or garbage: the board was left in Pro mode.
        self._line.lost_step()
        self._line.send(LEAVE_PRO_MODE)
        self._line.lost_step()
        try:
            answer = self._start()
        except LinkError as problem:
            raise self._not_a_mirror("START", problem.answered) from problem
        if answer != "OK":
            raise self._not_a_mirror("START", f"{answer!r} came")

    def _start(self) -> str:
        answer = self._line.ask("START")
        return self._line.ask("START") if answer == "NO" else answer  # NO is normal right after a mode switch

    def _identify(self) -> None:
        identity = self._line.ask("GETID")
        if identity in ("", "NO", "OK", "ERROR") or not identity.isprintable():
            raise self._not_a_mirror("GETID", f"{identity!r} came")
        if self._expected_identity is not None and self._expected_identity not in identity:
            raise DeviceNotFoundError(
                self._line.name,
                f"be {self._expected_identity!r}",
                f"it is {identity!r}",
                "Another board has this address: check the addresses in the configuration.",
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
            names = ", ".join(bit.name.lower().replace("_", " ") for bit in wrong if bit.name)
            raise RefusedError(
                self._line.name,
                asked,
                f"its status says: {names} (0x{status:08X})",
                "Check the cable to the mirror head and let it cool down; then connect again.",
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
            raise RefusedError(self._line.name, asked, "ERROR came", "Look at its status; reconnect it.")
        self._line.lost_step()
        raise ProtocolError(
            self._line.name, asked, f"{answer!r} came", "Check the cable; the command may be repeated."
        )

    def _not_a_mirror(self, asked: str, answered: str) -> DeviceNotFoundError:
        return DeviceNotFoundError(
            self._line.name,
            f"answer {asked} like an Optotune MR-E board",
            answered,
            "Check the address: another device, or none, is there.",
        )
