"""The conversation in the board's binary Pro mode: registers and vectors over a serial line."""

import struct
from collections.abc import Mapping, Sequence

from drivers.errors import LinkError, ProtocolError, RefusedError
from drivers.lines.serial import SerialLine
from drivers.optotune.frames import ERROR, FLAG, Frame, FrameError, framed, parsed
from drivers.optotune.registers import ERRORS, Command

#: So many pieces between flags may be no answer: empty, garbage, or late answers to earlier questions.
MAX_PIECES = 16


class ProMode:
    """Registers and vectors of a board that is in Pro mode.

    Every method raises `LinkError` if no answer comes, `ProtocolError` if none that makes sense, and
    `RefusedError` if the board answers with an error.

    Parameters
    ----------
    line
        The open line to it.
    """

    def __init__(self, line: SerialLine) -> None:
        self._line = line

    def leave(self) -> None:
        """Go back to Simple mode."""
        self._ask(Command.SET_COMM_MODE, bytes(2), "leave Pro mode")

    def set(self, values: Mapping[int, int | float]) -> None:
        """Set several registers at once, in this order."""
        payload = struct.pack(f">{len(values) + 1}H", len(values), *values)
        payload += b"".join(_packed(value) for value in values.values())
        names = ", ".join(f"{register:04X} to {value}" for register, value in values.items())
        self._ask(Command.SET_MULTIPLE, payload, f"set {names}")

    def value(self, register: int) -> int:
        """Return a register that holds a whole number."""
        asked = f"report register {register:04X}"
        answer = self._ask(Command.GET_VALUE, register.to_bytes(2, "big"), asked)
        if len(answer) != 4:
            raise self._nonsense(asked, f"{answer!r} came")
        return int.from_bytes(answer, "big")

    def set_vector(self, register: int, first: int, samples: Sequence[float]) -> None:
        """Set numbers of a vector, from its number ``first`` on."""
        data = struct.pack(f">{len(samples)}f", *samples)
        place = struct.pack(">HHB", register, 4 * first, len(data))
        self._ask(Command.SET_VECTOR, place + data, f"store {len(samples)} samples from number {first} on")

    def vector(self, register: int, first: int, number: int) -> tuple[float, ...]:
        """Return numbers of a vector."""
        asked = f"report {number} samples from number {first} on"
        answer = self._ask(Command.GET_VECTOR, struct.pack(">HHB", register, 4 * first, 4 * number), asked)
        if len(answer) != 4 * number:
            raise self._nonsense(asked, f"{len(answer)} bytes came")
        return struct.unpack(f">{number}f", answer)

    def _ask(self, command: Command, payload: bytes, asked: str) -> bytes:
        self._line.send(framed(command, payload))
        answer = self._answer(command, asked)
        if not answer.command & ERROR:
            return answer.payload
        number = int.from_bytes(answer.payload, "big")
        raise RefusedError(
            self._line.name,
            asked,
            f"it reports: {ERRORS.get(number, 'an unknown error')} (0x{number:04X})",
            "Check its status; connect it again.",
        )

    def _answer(self, command: Command, asked: str) -> Frame:
        """Return the frame that answers a command; what else comes between flags is passed over."""
        wrong = ""
        for _ in range(MAX_PIECES):
            try:
                piece = self._line.receive(f"answer when asked to {asked}", terminator=bytes([FLAG]))
            except LinkError as problem:
                if not wrong:
                    raise
                raise self._nonsense(asked, wrong) from problem
            if not piece:
                continue
            try:
                frame = parsed(piece)
            except FrameError as problem:
                wrong = f"{piece!r} came, and {problem}"
                continue
            if frame.command & ~ERROR == command:
                return frame
            wrong = f"an answer to command {frame.command:02X} came"
        raise self._nonsense(asked, wrong)

    def _nonsense(self, asked: str, answered: str) -> ProtocolError:
        self._line.lost_step()
        return ProtocolError(
            self._line.name, asked, answered, "Check the cable; the command may be repeated."
        )


def _packed(value: int | float) -> bytes:
    return struct.pack(">f" if isinstance(value, float) else ">i", value)
