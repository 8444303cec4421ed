"""Telegrams of NKT Photonics' register protocol (NKTP, Interbus), to bytes and back.

A telegram is start, destination, source, type, register, data, CRC, end. Inside it, start, end and escape are
written as escape and the byte plus 0x40. The CRC is CCITT's with polynomial 0x1021 from 0 (XMODEM), high byte
first, over the bytes before they are escaped. Source: the vendor's SDK manual, chapter 2, as three published
implementations quote it (QMI, golaborate, NKTcontrol), which agree.
"""

from binascii import crc_hqx
from dataclasses import dataclass
from enum import IntEnum

START, END, ESCAPE, SHIFT = 0x0D, 0x0A, 0x5E, 0x40
_SPECIAL = (START, END, ESCAPE)

#: Destination, source, type, register and CRC.
_SHORTEST = 6


class Kind(IntEnum):
    """Types of telegrams."""

    NACK = 0
    CRC_ERROR = 1
    BUSY = 2
    ACK = 3
    READ = 4
    WRITE = 5
    DATAGRAM = 8


class TelegramError(ValueError):
    """Raised for bytes that are no telegram."""


@dataclass(frozen=True)
class Telegram:
    """What is said, without its frame.

    Attributes
    ----------
    destination, source
        Addresses: modules have 1 to 160, computers 161 to 255.
    kind
        A `Kind`, as a number: others may come.
    register
        What it is about.
    data
        Little-endian.
    """

    destination: int
    source: int
    kind: int
    register: int
    data: bytes = b""


def encoded(telegram: Telegram) -> bytes:
    """Return a telegram as it goes over the line."""
    body = bytes([telegram.destination, telegram.source, telegram.kind, telegram.register]) + telegram.data
    body += crc_hqx(body, 0).to_bytes(2, "big")
    escaped = b"".join(bytes([ESCAPE, one + SHIFT]) if one in _SPECIAL else bytes([one]) for one in body)
    return bytes([START]) + escaped + bytes([END])


def decoded(line: bytes) -> Telegram:
    """Return the telegram in what came before an end; what was before its start is left out.

    Raises
    ------
    TelegramError
        There is none, or it is damaged.
    """
    _, start, escaped = line.rpartition(bytes([START]))
    if not start:
        raise TelegramError("the start of a telegram is missing")
    body = _plain(escaped)
    if len(body) < _SHORTEST:
        raise TelegramError(f"a telegram of {len(body)} bytes is too short")
    if crc_hqx(body, 0):  # over its own CRC it is 0
        raise TelegramError("the CRC is wrong")
    return Telegram(body[0], body[1], body[2], body[3], body[4:-2])


def _plain(escaped: bytes) -> bytes:
    plain, rest = bytearray(), iter(escaped)
    for one in rest:
        if one == ESCAPE:
            one = next(rest, 0) - SHIFT
            if one not in _SPECIAL:
                raise TelegramError("an escape is followed by a byte that needs no escape")
        plain.append(one)
    return bytes(plain)
