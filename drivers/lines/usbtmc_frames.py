"""The frames of USBTMC: 12-byte headers, tags, and padding to four bytes.

Source: USB Test and Measurement Class specification 1.0, bulk-OUT and bulk-IN headers.
"""

import struct
from dataclasses import dataclass

HEADER_SIZE = 12

DEV_DEP_MSG_OUT = 1
DEV_DEP_MSG_IN = 2

END_OF_MESSAGE = 0x01

_HEADER = struct.Struct("<BBBxIB3x")


class FrameError(ValueError):
    """Raised when bytes are not the frame they should be; the text says what is wrong."""


@dataclass(frozen=True)
class Answer:
    """One bulk-in frame: its payload, and whether the message ends with it."""

    payload: bytes
    end_of_message: bool


def next_tag(tag: int) -> int:
    """Return the tag after ``tag``: 1 to 255, then 1 again."""
    return tag % 255 + 1


def message_out(tag: int, payload: bytes, *, end_of_message: bool = True) -> bytes:
    """Frame ``payload`` for the bulk-out endpoint."""
    attributes = END_OF_MESSAGE if end_of_message else 0
    header = _HEADER.pack(DEV_DEP_MSG_OUT, tag, ~tag & 0xFF, len(payload), attributes)
    return header + payload + bytes(-len(payload) % 4)


def request_in(tag: int, most: int) -> bytes:
    """Frame the request for at most ``most`` bytes of answer."""
    return _HEADER.pack(DEV_DEP_MSG_IN, tag, ~tag & 0xFF, most, 0)


def announced_size(frame: bytes) -> int:
    """Return the payload size that the header of a bulk-in frame announces.

    Raises
    ------
    FrameError
        The bytes are too few for a header.
    """
    if len(frame) < HEADER_SIZE:
        raise FrameError(f"{len(frame)} bytes are too few for a header")
    return int(_HEADER.unpack_from(frame)[3])


def parse_answer(frame: bytes, tag: int) -> Answer:
    """Take a whole bulk-in frame apart.

    Parameters
    ----------
    frame
        Header, payload and any padding.
    tag
        Tag of the request that it answers.

    Raises
    ------
    FrameError
        It is cut short, or it answers another request.
    """
    size = announced_size(frame)
    kind, came, inverted, _, attributes = _HEADER.unpack_from(frame)
    if kind != DEV_DEP_MSG_IN:
        raise FrameError(f"message type {kind} came instead of {DEV_DEP_MSG_IN}")
    if inverted != ~came & 0xFF:
        raise FrameError(f"tag {came} came with {inverted} for its inverse")
    if came != tag:
        raise FrameError(f"it answers request {came} instead of {tag}")
    if len(frame) < HEADER_SIZE + size:
        raise FrameError(f"it announces {size} bytes and has {len(frame) - HEADER_SIZE}")
    return Answer(frame[HEADER_SIZE : HEADER_SIZE + size], bool(attributes & END_OF_MESSAGE))
