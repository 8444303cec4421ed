"""Frames of an Optotune board's Pro mode, as its firmware takes and sends them.

    7E  slave 00  command  length  payload  CRC (2 bytes)  7E ,

with 7D 5E and 7D 5D in place of 7E and 7D between the flags. The checksum is CRC-16/ARC, low byte first; the
host may leave it at 0. Source: the maker's Python SDK as published with other programs. That a flag both ends
a frame and begins the next is unconfirmed, as is what becomes of a frame that is too long (it is dropped).
"""

from collections.abc import Iterator
from typing import NamedTuple

FLAG = 0x7E

#: No frame has more bytes, escapes included: 5 and 255 of payload, each of them escaped.
LONGEST = 2 * 260


class Request(NamedTuple):
    """A frame from the host.

    Attributes
    ----------
    command
        What it asks for.
    payload
        What belongs to it; None if length or checksum is wrong.
    checked
        Whether the checksum is right or left at 0.
    """

    command: int
    payload: bytes | None
    checked: bool


class Deframer:
    """Cuts bytes into frames; what is not between two flags is thrown away."""

    def __init__(self) -> None:
        self._body: bytearray | None = None

    def take(self, data: bytes) -> Iterator[tuple[Request, bytes]]:
        """Yield each frame as it ends, and the bytes of ``data`` after it."""
        for place, byte in enumerate(data):
            if byte != FLAG:
                if self._body is not None:
                    self._body.append(byte)
                    if len(self._body) > LONGEST:
                        self._body = None
                continue
            body, self._body = self._body, bytearray()
            request = _request(bytes(body)) if body else None
            if request:
                yield request, data[place + 1 :]


def answer(command: int, payload: bytes) -> bytes:
    """Return the frame that the board sends."""
    content = bytes([0, command, len(payload)]) + payload
    content += _crc(content).to_bytes(2, "little")
    return b"\x7e" + content.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e") + b"\x7e"


def _request(body: bytes) -> Request | None:
    content = body.replace(b"\x7d\x5e", b"\x7e").replace(b"\x7d\x5d", b"\x7d")
    if len(content) < 2:
        return None  # not even a command that could be answered
    if len(content) < 5 or len(content) != content[2] + 5:
        return Request(content[1], None, checked=True)
    told = int.from_bytes(content[-2:], "little")
    return Request(content[1], content[3:-2], checked=told in (0, _crc(content[:-2])))


def _crc(content: bytes) -> int:
    crc = 0
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc
