"""Commands, registers and errors of the board's Pro mode; axis 0 is X, 1 is Y.

Source: the maker's Python SDK as published with other programs. Unconfirmed by any of them: that each edge of
the trigger brings the pattern one sample further and the first edge brings the first sample, and whether a
pattern's end is its last sample or the one after.
"""

from enum import IntEnum


class Command(IntEnum):
    """What a frame asks for."""

    SET_COMM_MODE = 0x06
    SET_VALUE = 0x10
    GET_VALUE = 0x11
    SET_MULTIPLE = 0x12
    SET_VECTOR = 0x14
    GET_VECTOR = 0x15


#: The board's status, with the bits of the answer to STATUS.
STATUS = 0x1007

#: Memory of the patterns of both axes, in samples.
PATTERN_MEMORY = 0x2600

#: Its index in a command counts bytes in 16 bits, so that no more samples than these can be reached.
MOST_SAMPLES = 0x10000 // 4

#: The maker's SDK sends as many samples in a frame.
SAMPLES_A_FRAME = 10

#: Samples a second: an edge of the trigger must last longer, and so must the time between two.
SAMPLING_HZ = 10_000

#: Line speed (manual); on USB (CDC-ACM) the number has no effect.
BAUD = 256_000

#: Of `pattern(axis, UNIT)`, and of `EXTERNAL_TRIGGER`.
XY, RISING_EDGE = 2, 2

UNIT, RUN, START, END, CYCLES, EXTERNAL_TRIGGER, INDEX = 0x00, 0x01, 0x02, 0x03, 0x07, 0x08, 0x0A


def static_input(axis: int) -> int:
    """Return the system that holds a commanded position."""
    return 0x50 + axis


def pattern_unit(axis: int) -> int:
    """Return the system that plays a pattern."""
    return 0x68 + axis


def input_of(axis: int) -> int:
    """Return the register that says which system an axis follows."""
    return 0x4000 + (axis << 8)


def static_xy(axis: int) -> int:
    """Return the register of a commanded position."""
    return static_input(axis) << 8 | 0x02


def pattern(axis: int, which: int) -> int:
    """Return a register of the pattern of an axis, e.g. `RUN`."""
    return pattern_unit(axis) << 8 | which


#: What the number in an error's answer means.
ERRORS = {
    0x0001: "frame invalid",
    0x0002: "command unknown",
    0x0003: "command length mismatch",
    0x0004: "checksum failed",
    0x0005: "command not implemented",
    0x0101: "register does not exist",
    0x0102: "register write unsuccessful",
    0x0103: "register value out of range",
    0x0104: "register is not valid",
    0x0105: "register read unsuccessful",
    0x0106: "register is read-only",
    0x0107: "vector index out of range",
    0x0108: "vector index not aligned",
    0x0109: "register is locked",
    0x010A: "register is not readable",
    0x0201: "system does not exist",
    0x0202: "system is not a valid selection",
    0x0203: "chain construction error",
    0x0F0F: "communication error",
    0xFFFF: "wrong board mode for command",
}
