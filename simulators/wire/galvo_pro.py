"""Pro mode of an Optotune board's firmware: registers, the memory of patterns, and the trigger input.

Source: the maker's Python SDK as published with other programs: commands, registers, types and error numbers.
Unconfirmed, and so a choice made here: the size of the memory (as much as the 16-bit byte index of a command
reaches), that settings are answered with an empty payload, and what `simulators.wire.galvo_pattern` says.
Patterns that go on by themselves, without a trigger, are not built in.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, radians, tan

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Bench
from simulators.wire.galvo_frames import Deframer, Request, answer
from simulators.wire.galvo_pattern import PatternUnit

SET_COMM_MODE, SET_VALUE, GET_VALUE, SET_MULTIPLE, GET_MULTIPLE, SET_VECTOR, GET_VECTOR = (
    0x06,
    *range(0x10, 0x16),
)

FRAME_INVALID, COMMAND_UNKNOWN, LENGTH_MISMATCH, CRC_FAIL, NOT_IMPLEMENTED = range(1, 6)
NO_SUCH_REGISTER, OUT_OF_RANGE, READ_ONLY = 0x0101, 0x0103, 0x0106
VECTOR_OUT_OF_RANGE, NOT_ALIGNED, NO_SUCH_INPUT = 0x0107, 0x0108, 0x0202

#: Samples that the memory holds.
MEMORY = 0x10000 // 4

#: Longest payload [bytes].
LONGEST = 50

STATIC, PATTERN = 0x50, 0x68
STATUS, MEASURED, VECTOR = 0x1007, 0x3B00, 0x2600

#: Registers of a pattern unit: attribute, and whether it is a float.
UNIT_REGISTERS = {
    0x00: ("unit", False),
    0x01: ("run", False),
    0x02: ("start", False),
    0x03: ("end", False),
    0x04: ("speed_hz", True),
    0x07: ("cycles", False),
    0x08: ("trigger", False),
}

TAN_PER_UNIT = tan(radians(50.0))


class RefusalError(Exception):
    """Raised to answer with an error's number."""

    def __init__(self, number: int) -> None:
        super().__init__(hex(number))
        self.number = number


@dataclass
class Axis:
    """What one axis follows.

    Attributes
    ----------
    input
        The system that it follows.
    static
        The position that is set.
    pattern
        Its pattern unit.
    """

    input: int
    static: float
    pattern: PatternUnit

    def follows_pattern(self) -> bool:
        """Return whether the pattern unit moves it."""
        return self.input >> 3 == PATTERN >> 3


class ProFirmware:
    """Frames in, frames out, and the mirror that follows.

    Parameters
    ----------
    bench
        Its mirror is commanded; its point clock is wired to the trigger input.
    status
        Gives the board's status bits.
    steer
        Commands the mirror to X and Y, trimmed to the unit circle.
    memory
        How many samples the memory holds.
    """

    def __init__(
        self,
        bench: Bench,
        status: Callable[[], int],
        steer: Callable[[float, float], None],
        memory: int = MEMORY,
    ) -> None:
        self._bench, self._status, self._steer = bench, status, steer
        self._memory = np.zeros(memory, np.float32)
        self._pulses_s = np.empty(0)
        self._reset()
        bench.tick_listeners.append(self._ticks_begin)
        bench.stop_listeners.append(self._ticks_end)

    def enter(self, x: float, y: float) -> None:
        """Begin Pro mode with the axes where they stand commanded."""
        self._deframer = Deframer()
        for axis, value in zip(self._axes, (x, y), strict=True):
            if not axis.follows_pattern():
                axis.static = value

    def simple(self) -> None:
        """Let the axes follow what Simple mode commands: no pattern."""
        self._reset()

    def _reset(self) -> None:
        self._deframer = Deframer()
        self._axes = [Axis(STATIC + number, 0.0, PatternUnit()) for number in (0, 1)]

    def receive(self, data: bytes) -> tuple[list[bytes], bytes | None]:
        """Take bytes; return the answers to the frames in them, and what follows the one that ends Pro mode.

        That is None while Pro mode goes on.
        """
        answers: list[bytes] = []
        for request, rest in self._deframer.take(data):
            try:
                answers.append(answer(request.command, self._obey(request)))
            except RefusalError as refusal:
                answers.append(answer(request.command | 0x80, refusal.number.to_bytes(4, "big")))
                continue
            if request.command == SET_COMM_MODE and request.payload == bytes(2):
                return answers, rest
        return answers, None

    def _obey(self, request: Request) -> bytes:
        command, payload, checked = request
        if payload is None:
            raise RefusalError(FRAME_INVALID)
        if not checked:
            raise RefusalError(CRC_FAIL)
        obey = {
            SET_COMM_MODE: self._set_mode,
            SET_VALUE: self._set_value,
            GET_VALUE: self._get_value,
            SET_MULTIPLE: self._set_multiple,
            GET_MULTIPLE: self._get_multiple,
            SET_VECTOR: self._set_vector,
            GET_VECTOR: self._get_vector,
        }.get(command)
        if obey is None:
            raise RefusalError(COMMAND_UNKNOWN)
        if len(payload) > LONGEST:
            raise RefusalError(LENGTH_MISMATCH)
        try:
            return obey(payload)
        except struct.error:
            raise RefusalError(LENGTH_MISMATCH) from None

    def _set_mode(self, payload: bytes) -> bytes:
        (mode,) = struct.unpack(">H", payload)
        if mode > 1:
            raise RefusalError(OUT_OF_RANGE)
        return b""

    def _set_value(self, payload: bytes) -> bytes:
        register, value = struct.unpack(">H4s", payload)
        self._write({register: value})
        return b""

    def _get_value(self, payload: bytes) -> bytes:
        return self._read(*struct.unpack(">H", payload))

    def _set_multiple(self, payload: bytes) -> bytes:
        (number,) = struct.unpack_from(">H", payload)
        fields = struct.unpack(f">H{number}H" + "4s" * number, payload)
        self._write(dict(zip(fields[1 : 1 + number], fields[1 + number :], strict=True)))
        return b""

    def _get_multiple(self, payload: bytes) -> bytes:
        (number,) = struct.unpack_from(">H", payload)
        _, *registers = struct.unpack(f">H{number}H", payload)
        return b"".join(self._read(register) for register in registers)

    def _set_vector(self, payload: bytes) -> bytes:
        register, place, length = struct.unpack_from(">HHB", payload)
        part = self._part(register, place, length)
        samples = struct.unpack_from(f">{length // 4}f", payload, 5)
        if len(payload) != 5 + length:
            raise RefusalError(LENGTH_MISMATCH)
        self._fold()
        self._memory[part] = samples
        if self._patterned():
            self._follow()
        return b""

    def _get_vector(self, payload: bytes) -> bytes:
        part = self._part(*struct.unpack(">HHB", payload))
        return bytes(self._memory[part].astype(">f4").tobytes())

    def _part(self, register: int, place: int, length: int) -> slice:
        if register != VECTOR:
            raise RefusalError(NO_SUCH_REGISTER)
        if place % 4 or length % 4:
            raise RefusalError(NOT_ALIGNED)
        if place + length > 4 * len(self._memory):
            raise RefusalError(VECTOR_OUT_OF_RANGE)
        return slice(place // 4, (place + length) // 4)

    def _read(self, register: int) -> bytes:
        self._fold()
        if register == STATUS:
            return self._status().to_bytes(4, "big")
        if register in (MEASURED, MEASURED + 1):
            position = self._bench.position_rad[register - MEASURED]
            return struct.pack(">f", tan(position) / TAN_PER_UNIT)
        axis, name, is_float = self._place(register)
        return struct.pack(">f" if is_float else ">i", getattr(_owner(axis, name), name))

    def _place(self, register: int) -> tuple[Axis, str, bool]:
        """Return the axis, attribute and type of a register."""
        system, which = divmod(register, 0x100)
        axis = self._axes[system & 1]
        known: Mapping[int, Mapping[int, tuple[str, bool]]] = {
            0x40: {0x00: ("input", False)},
            STATIC: {0x02: ("static", True)},
            PATTERN: {**UNIT_REGISTERS, 0x0A: ("index", False)},
        }
        found = known.get(system & ~1, {}).get(which)
        if found is None:
            raise RefusalError(NO_SUCH_REGISTER)
        return axis, *found

    def _write(self, values: Mapping[int, bytes]) -> None:
        """Check all, then set all, then let the mirror follow."""
        parsed = [(*self._place_to_set(register), value) for register, value in values.items()]
        settings = [
            (
                axis,
                name,
                _number(name, struct.unpack(">f" if is_float else ">i", value)[0], len(self._memory)),
            )
            for axis, name, is_float, value in parsed
        ]
        if any(name == "run" and value and not axis.pattern.trigger for axis, name, value in settings):
            raise RefusalError(NOT_IMPLEMENTED)
        self._fold()
        for axis, name, value in settings:
            setattr(_owner(axis, name), name, value)
            if name == "run":
                axis.pattern.edges = 0
        self._follow()

    def _place_to_set(self, register: int) -> tuple[Axis, str, bool]:
        if register in (STATUS, MEASURED, MEASURED + 1) or register & 0xFEFF == (PATTERN << 8 | 0x0A):
            raise RefusalError(READ_ONLY)
        return self._place(register)

    def _fold(self) -> None:
        """Count the edges that have come until now."""
        number = int(np.searchsorted(self._pulses_s, self._bench.clock.now_s(), "right"))
        if number:
            for axis in self._axes:
                axis.pattern.edges += number * axis.pattern.edges_a_pulse
            self._pulses_s = self._pulses_s[number:]

    def _follow(self) -> None:
        """Command the mirror to what the axes follow now, and at each pulse that is still to come."""
        self._steer(*(float(one[0]) for one in self._positions(np.zeros(1, np.int64))))
        if len(self._pulses_s) and self._patterned():
            places = np.column_stack(self._positions(1 + np.arange(len(self._pulses_s))))
            places /= np.maximum(np.hypot(*places.T), 1.0)[:, None]
            self._bench.follow(self._pulses_s, np.arctan(TAN_PER_UNIT * places))

    def _positions(self, pulses: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return X and Y (n,) after so many further pulses (n,)."""
        x, y = (self._positions_of(axis, pulses) for axis in self._axes)
        return x, y

    def _positions_of(self, axis: Axis, pulses: NDArray[np.int64]) -> NDArray[np.float64]:
        if not axis.follows_pattern():
            return np.full(len(pulses), axis.static)
        places = axis.pattern.places(pulses * axis.pattern.edges_a_pulse)
        return self._memory[places].astype(np.float64)

    def _ticks_begin(self, times_s: NDArray[np.float64]) -> None:
        self._fold()
        self._pulses_s = times_s
        if self._patterned():
            self._follow()

    def _ticks_end(self, now_s: float) -> None:
        self._fold()
        self._pulses_s = np.empty(0)
        if self._patterned():
            self._bench.stop_following(now_s)

    def _patterned(self) -> bool:
        return any(axis.follows_pattern() for axis in self._axes)


def _owner(axis: Axis, name: str) -> Axis | PatternUnit:
    return axis if name in ("input", "static") else axis.pattern


def _number(name: str, value: float, memory: int) -> float:
    """Return a register's new value, or refuse it."""
    allowed = {
        "unit": value == 2,
        "run": value in (0, 1),
        "start": 0 <= value < memory,
        "end": 0 <= value < memory,
        "trigger": value in (0, 1, 2),
        "static": isfinite(value) and abs(value) <= 1,
        "speed_hz": isfinite(value) and value > 0,
    }
    if name == "input":
        if value not in (STATIC, STATIC + 1, PATTERN, PATTERN + 1):
            raise RefusalError(NO_SUCH_INPUT)
        return value
    if not allowed.get(name, True):
        raise RefusalError(OUT_OF_RANGE)
    return value
