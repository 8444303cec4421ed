"""The device's side of USBTMC: frames in, frames out, class requests.

Source: USBTMC specification 1.0 and its USB488 subclass 1.0.
"""

import struct
from typing import Protocol

from simulators.clock import BenchClock

DEV_DEP_MSG_OUT = 1
REQUEST_DEV_DEP_MSG_IN = 2

_HEADER = struct.Struct("<BBBBIBBH")

BULK_OUT, BULK_IN = 0x01, 0x82

SUCCESS, FAILED, NOT_IN_PROGRESS = 0x01, 0x80, 0x81

#: USBTMC and USB488 version 1.00; accepts triggers and no TermChar.
CAPABILITIES = bytes([SUCCESS, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0x04, 0]) + bytes(8)


class StallError(Exception):
    """Raised when the device answers a transfer by stalling the endpoint."""


class Identity(Protocol):
    """What an instrument says of itself on the bus, and the clock that passes while it is waited for."""

    vendor_id: int
    product_id: int
    manufacturer: str
    product: str
    serial_number: str
    clock: BenchClock


class Instrument(Identity, Protocol):
    """What stands behind a USBTMC interface: messages in, bytes of answer out."""

    output: bytearray

    def receive(self, data: bytes) -> None:
        """Take one whole message."""
        ...


class Interface(Protocol):
    """What a bus does to a USBTMC interface; see `TmcInterface`."""

    def bulk_out(self, transfer: bytes) -> None:
        """Take one bulk-out transfer."""
        ...

    def bulk_in(self, most: int) -> bytes | None:
        """Return at most ``most`` bytes, or None if there is nothing to say."""
        ...

    def control(self, request_type: int, request: int, value: int, index: int, length: int) -> bytes:
        """Answer a class request."""
        ...

    def clear_halt(self) -> None:
        """End a stall."""
        ...


class TmcInterface:
    """One USBTMC interface in front of an instrument."""

    def __init__(self, instrument: Instrument) -> None:
        self.instrument = instrument
        self.halted = False
        self._message = bytearray()
        self._frame = bytearray()
        self._request: tuple[int, int] | None = None

    def bulk_out(self, transfer: bytes) -> None:
        """Take one bulk-out transfer, which is one frame.

        Raises
        ------
        StallError
            It is no frame; the endpoint stays halted until cleared.
        """
        if self.halted or len(transfer) < _HEADER.size:
            self._stall()
        kind, tag, inverted, _, size, attributes, _, _ = _HEADER.unpack_from(transfer)
        if tag == 0 or inverted != tag ^ 0xFF:
            self._stall()
        if kind == REQUEST_DEV_DEP_MSG_IN and len(transfer) == _HEADER.size and size > 0:
            self._request = (tag, size)
        elif kind == DEV_DEP_MSG_OUT and len(transfer) == _HEADER.size + size + -size % 4 and size > 0:
            # A new command breaks off an answer that nobody read to its end.
            self._request = None
            self._frame.clear()
            self._message += transfer[_HEADER.size : _HEADER.size + size]
            if attributes & 1:
                message, self._message = bytes(self._message), bytearray()
                self.instrument.output.clear()
                self.instrument.receive(message)
        else:
            self._stall()

    def bulk_in(self, most: int) -> bytes | None:
        """Return at most ``most`` bytes, or None if there is nothing to say."""
        output = self.instrument.output
        if not self._frame and self._request and output:
            tag, size = self._request
            self._request = None
            payload = bytes(output[:size])
            del output[:size]
            ends = 0 if output else 1
            self._frame += _HEADER.pack(2, tag, tag ^ 0xFF, 0, len(payload), ends, 0, 0)
            self._frame += payload + bytes(-len(payload) % 4)
        if not self._frame:
            return None
        piece = bytes(self._frame[:most])
        del self._frame[:most]
        return piece

    def clear_halt(self) -> None:
        """End a stall."""
        self.halted = False

    def control(self, request_type: int, request: int, value: int, index: int, length: int) -> bytes:
        """Answer a class request.

        Raises
        ------
        StallError
            The request is not one of this class.
        """
        if request_type == 0xA1 and request == 7:
            answer = CAPABILITIES
        elif request_type == 0xA1 and request == 5:
            self._forget()
            answer = bytes([SUCCESS])
        elif request_type == 0xA1 and request == 6:
            answer = bytes([SUCCESS, 0])
        elif request_type == 0xA2 and request == 3 and index == BULK_IN:
            in_progress = self._request is not None or bool(self._frame)
            self._request = None
            self._frame.clear()
            answer = bytes([SUCCESS if in_progress else FAILED, value & 0xFF])
        elif request_type == 0xA2 and request == 1 and index == BULK_OUT:
            in_progress = bool(self._message)
            self._message.clear()
            answer = bytes([SUCCESS if in_progress else FAILED, value & 0xFF])
        elif request_type == 0xA2 and (request, index) in ((2, BULK_OUT), (4, BULK_IN)):
            answer = bytes([SUCCESS]) + bytes(7)
        elif request_type == 0xA1 and request == 128:  # READ_STATUS_BYTE: nothing to report
            answer = bytes([SUCCESS, value & 0xFF, 0])
        else:
            raise StallError
        return answer[:length]

    def _forget(self) -> None:
        self._message.clear()
        self._frame.clear()
        self._request = None
        self.instrument.output.clear()

    def _stall(self) -> None:
        self.halted = True
        raise StallError
