"""The firmware of an Optotune MR-E-2 board, steering the bench's mirror: Simple mode, and what both share.

Source: Optotune MR-E-2 / MR-E-3 operation manual, as quoted by two independent drivers. Unconfirmed, and so a
choice made here: which of OL and OU answers a position outside the unit circle (the axis that is cut most
decides).
"""

import re
from math import atan, hypot, radians, tan

from simulators.bench import Bench
from simulators.wire.galvo_frames import FLAG
from simulators.wire.galvo_pro import MEMORY, ProFirmware
from simulators.wire.lines import LineFirmware

HEAD_DISCONNECTED = 1 << 0
HEAD_TEMPERATURE = 1 << 1
MIRROR_TEMPERATURE = 1 << 2
EEPROM_INVALID = 1 << 3
NOT_STABLE = 1 << 4
OUTPUT_LIMIT = 1 << 5
AVERAGE_OUTPUT_LIMIT = 1 << 6
TRIMMED = 1 << 7

#: Which bit of the status is remembered by which "was" bit; EEPROM and stability are not remembered.
LATCHES = {1 << now: 1 << was for now, was in ((0, 8), (1, 9), (2, 10), (5, 11), (6, 12), (7, 13))}

#: Optical deflection of one unit of X or Y, as a tangent (MR-15-30: the unit circle is 50 degrees).
TAN_PER_UNIT = tan(radians(50.0))

REBOOT_S = 1.5

_NUMBER = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*"
_MOVE = re.compile(rf"(?:XY={_NUMBER};{_NUMBER}|X={_NUMBER}|Y={_NUMBER})", re.IGNORECASE)


class GalvoBoard(LineFirmware):
    """The board as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its mirror is steered, its clock is followed.
    identity
        The answer to GETID.
    serial
        The answer to GETSN (its form is unconfirmed); None: a firmware that does not know this command.
    memory
        How many samples the memory of patterns holds.

    Attributes
    ----------
    faults
        Status bits that hold because something is broken; set by whoever breaks it, see `break_down`.
    drop_answers, garble_answers
        So many of the next answers are lost, or arrive with a flipped bit.
    echoes
        Whether the line sends back what it is sent, before the answer.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        identity: str = "MR-E-2 simulated",
        serial: str | None = "SIM0001",
        memory: int = MEMORY,
    ) -> None:
        super().__init__(terminator=b"\r\n", longest=64)
        self.identity = identity
        self.serial = serial
        self.echoes = False
        self.faults = 0
        self.drop_answers = 0
        self.garble_answers = 0
        self._bench = bench
        self._deaf_until_s = 0.0
        self._pro_mode = False
        self._just_switched = False
        self._trimmed = False
        self._latched = 0
        self._commanded = (0.0, 0.0)
        self._pro = ProFirmware(bench, self._status, self._steer_trimmed, memory)

    def break_down(self, bits: int) -> None:
        """Let the status ``bits`` hold from now on, and be remembered by their latches."""
        self.faults |= bits
        self._latch(bits)

    def repair(self) -> None:
        """End all faults; the latches remember them until acknowledged."""
        self.faults = 0

    def receive(self, data: bytes) -> None:
        """Take bytes from the wire."""
        if self.echoes:
            self.output += data
        if self._bench.clock.now_s() < self._deaf_until_s:
            return
        if not self._pro_mode:
            super().receive(data)
            return
        answers, after = self._pro.receive(data)
        for one in answers:
            self.output += self._sent(one)
        if after is not None:
            self._pro_mode, self._just_switched = False, True
            super().receive(after)

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command."""
        command = line.decode("ascii", "replace").strip()
        answer = self._obey(command)
        return b"" if answer is None else self._sent(answer.encode("ascii") + b"\r\n")

    def junk(self) -> bytes:
        """Answer what is too long to be a command."""
        return b"NO\r\n"

    def _sent(self, answer: bytes) -> bytes:
        """Return what arrives of an answer."""
        if self.drop_answers:
            self.drop_answers -= 1
            return b""
        if self.garble_answers:
            self.garble_answers -= 1
            place = len(answer) // 2 if answer[0] == FLAG else 0  # a frame's content rather than its flag
            return answer[:place] + bytes([answer[place] ^ 0x10]) + answer[place + 1 :]
        return answer

    def _reboot(self) -> None:
        self._just_switched = self._trimmed = False
        self._latched = 0
        self._input.clear()
        self._pro.simple()
        self._steer(0.0, 0.0)
        self._deaf_until_s = self._bench.clock.now_s() + REBOOT_S

    def _obey(self, command: str) -> str | None:
        verb = command.upper()
        just_switched, self._just_switched = self._just_switched, False
        if verb == "START":
            return "NO" if just_switched else "OK"
        if verb == "GETID":
            return self.identity
        if verb == "GETSN" and self.serial is not None:
            return self.serial
        if verb == "STATUS":
            return f"{self._status():08X}"
        if verb == "ACKNOWLEDGE":
            self._latched = 0
            self._latch(self._status())
            return "OK"
        if verb == "RESET":
            self._reboot()
            return None
        if verb in ("GOPRO", "GOPROCRC"):
            self._pro_mode = True
            self._pro.enter(*self._commanded)
            return "OK"
        move = _MOVE.fullmatch(command)
        return self._move(move) if move else "NO"

    def _move(self, match: re.Match[str]) -> str:
        both_x, both_y, only_x, only_y = (None if g is None else float(g) for g in match.groups())
        x, y = self._commanded
        x = next((value for value in (both_x, only_x) if value is not None), x)
        y = next((value for value in (both_y, only_y) if value is not None), y)
        # Squares of huge numbers overflow, and an edge point far away is the edge point of a nearer one.
        x, y = max(min(x, 1e9), -1e9), max(min(y, 1e9), -1e9)
        self._pro.simple()
        self._steer_trimmed(x, y)
        if not self._trimmed:
            return "OK"
        return "OU" if (x if abs(x) >= abs(y) else y) > 0 else "OL"

    def _steer_trimmed(self, x: float, y: float) -> None:
        """Command the mirror to (x, y), or the nearest point of the unit circle."""
        radius = hypot(x, y)
        self._trimmed = radius > 1.0
        if self._trimmed:
            self._latch(TRIMMED)
            x, y = x / radius, y / radius
        self._steer(x, y)

    def _steer(self, x: float, y: float) -> None:
        """Command the mirror to (x, y) in the board's units."""
        self._commanded = (x, y)
        self._bench.steer(atan(TAN_PER_UNIT * x), atan(TAN_PER_UNIT * y))

    def _status(self) -> int:
        stable = self._bench.settled
        status = self.faults | (0 if stable else NOT_STABLE) | (TRIMMED if self._trimmed else 0)
        return status | self._latched

    def _latch(self, bits: int) -> None:
        for bit, latch in LATCHES.items():
            if bits & bit:
                self._latched |= latch
