"""Frames of the board's binary "Pro" mode: bytes in, bytes out, no wire.

    7E  slave 00  command  length  payload  CRC (2 bytes)  7E ,

where each 7D or 7E between the flags is sent as 7D and the byte with bit 5 turned over. Values are
big-endian. An answer repeats the command, or has the command with bit 7 set and an error's number as payload.

Source: the maker's Python SDK as published with other programs. Its longest payload is 50 bytes, and it
leaves the checksum of what it sends at 0. That of answers is CRC-16/ARC over slave to payload, low byte
first: found from the answer 7E 00 11 04 00 00 00 00 F2 81 7E in its documentation, which none of the other
usual checksums gives.
"""

from typing import NamedTuple

FLAG, ESCAPE, TURNED = 0x7E, 0x7D, 0x20

#: Bytes of a frame beside its payload.
AROUND = 7

#: Set in the command of an answer that tells an error.
ERROR = 0x80

#: Longest payload [bytes].
LONGEST = 50


class FrameError(ValueError):
    """Raised when bytes are no frame."""


class Frame(NamedTuple):
    """What stands between two flags.

    Attributes
    ----------
    command
        Which, `ERROR` included.
    payload
        What belongs to it.
    """

    command: int
    payload: bytes


def crc16(data: bytes) -> int:
    """Return CRC-16/ARC: polynomial 0x8005, bits mirrored, beginning with 0."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def framed(command: int, payload: bytes) -> bytes:
    """Return a whole frame to send, its checksum left at 0.

    Raises
    ------
    ValueError
        If the payload is longer than the board takes.
    """
    if len(payload) > LONGEST:
        raise ValueError(f"a payload of {len(payload)} bytes; the board takes {LONGEST}")
    return bytes([FLAG, *_escaped(bytes([0, command, len(payload)]) + payload + b"\0\0"), FLAG])


def parsed(body: bytes) -> Frame:
    """Return what a frame says, given what stands between its flags.

    Raises
    ------
    FrameError
        If it is no whole frame, or its checksum is wrong.
    """
    content = _plain(body)
    if len(content) < 5 or len(content) != content[2] + 5:
        raise FrameError("its length is wrong")
    if crc16(content[:-2]) != int.from_bytes(content[-2:], "little"):
        raise FrameError("its checksum is wrong")
    return Frame(content[1], content[3:-2])


def _escaped(content: bytes) -> bytes:
    return content.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")


def _plain(body: bytes) -> bytes:
    content, pieces = bytearray(), iter(body)
    for byte in pieces:
        if byte == ESCAPE:
            following = next(pieces, None)
            if following is None:
                raise FrameError("it ends in an escape")
            byte = following ^ TURNED
        content.append(byte)
    return bytes(content)
