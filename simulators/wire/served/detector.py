"""The detector of a served bench: what passes over its USB, as lines of text on a pseudo-terminal.

Each request is one line of JSON with a number, and so is its answer, with the same number; bytes are
hexadecimal:

    {"id": 1, "ask": "who"}                             {"id": 1, "vendor_id": 7644, "serial_number": ...}
    {"id": 2, "ask": "bulk_out", "data": "0101fe..."}   {"id": 2}
    {"id": 3, "ask": "bulk_in", "most": 4096}           {"id": 3, "data": "0201fe..."}, null: nothing to say
    {"id": 4, "ask": "control", "request": [161, 7, 0, 0, 24]}      {"id": 4, "data": "0100..."}
    {"id": 5, "ask": "clear_halt"}                      {"id": 5}

A stalled endpoint answers ``{"id": ..., "stall": true}``, what is no request is answered with ``error``.
Lines keep the two sides in step: what a killed program left half said ends with the next program's first
line, and answers to it have other numbers.
"""

import errno
import json
import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import serial
from usb.core import USBError

from simulators.clock import BenchClock
from simulators.wire.lines import LineFirmware
from simulators.wire.served import NO_REQUEST
from simulators.wire.tmc import Identity, StallError, TmcInterface
from simulators.wire.usb import UsbBackend

#: Longest line; a bulk transfer of 64 kB has twice as many digits.
LONGEST = 1 << 18

#: Longest wait for an answer [s]: the server may be drawing the photons of a long exposure.
ANSWER_S = 30.0

_IDENTITY = ("vendor_id", "product_id", "manufacturer", "product", "serial_number")


class DetectorLine(LineFirmware):
    """The served side: requests in, answers out.

    Parameters
    ----------
    tmc
        The instrument's USBTMC interface.
    """

    def __init__(self, tmc: TmcInterface) -> None:
        super().__init__(terminator=b"\n", longest=LONGEST)
        self._tmc = tmc

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one request."""
        try:
            request = json.loads(line)
            number = int(request["id"])
            told = self._obey(request)
        except StallError:
            told = {"stall": True}
        except NO_REQUEST:
            return self.junk()
        return json.dumps({"id": number, **told}).encode("ascii") + b"\n"

    def junk(self) -> bytes:
        """Answer what is no request."""
        return b'{"id": null, "error": "not a request"}\n'

    def _obey(self, request: dict[str, Any]) -> dict[str, Any]:
        ask = request["ask"]
        if ask == "who":
            return {name: getattr(self._tmc.instrument, name) for name in _IDENTITY}
        if ask == "bulk_out":
            self._tmc.bulk_out(bytes.fromhex(request["data"]))
            return {}
        if ask == "bulk_in":
            piece = self._tmc.bulk_in(int(request["most"]))
            return {"data": None if piece is None else piece.hex()}
        if ask == "control":
            kind, number, value, index, length = map(int, request["request"])
            return {"data": self._tmc.control(kind, number, value, index, length).hex()}
        if ask == "clear_halt":
            self._tmc.clear_halt()
            return {}
        raise ValueError(ask)


class _Link:
    """The other side's port: one request, one answer."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._number = random.randrange(1 << 30)  # so that no answer to another program is taken for ours
        port.write(b"\n")  # ends what another program may have left half said

    def ask(self, what: str, **values: Any) -> dict[str, Any]:
        """Return the answer to a request.

        Raises
        ------
        USBError
            As from a device that was unplugged, if the server is gone or talks nonsense.
        StallError
            The endpoint stalled.
        """
        self._number += 1
        try:
            self._port.write(json.dumps({"id": self._number, "ask": what, **values}).encode("ascii") + b"\n")
            answer = self._answer()
        except (OSError, ValueError) as problem:
            raise USBError(
                f"the connection to the served detector is lost ({problem})", -4, errno.ENODEV
            ) from problem
        if answer.get("stall"):
            raise StallError
        return answer

    def _answer(self) -> dict[str, Any]:
        while line := self._port.readline():
            answer = json.loads(line)
            if isinstance(answer, dict) and answer.get("id") == self._number:
                return answer
        raise TimeoutError(f"no answer in {ANSWER_S:g} s")


class _Detector:
    """Who is at the other end; satisfies `tmc.Identity`."""

    vendor_id: int
    product_id: int
    manufacturer: str
    product: str
    serial_number: str

    def __init__(self, told: dict[str, Any]) -> None:
        for name in _IDENTITY:
            setattr(self, name, told[name])
        self.clock = BenchClock(real_time=True)


class _ServedInterface:
    """A USBTMC interface in another process; satisfies `tmc.Interface`."""

    def __init__(self, link: _Link) -> None:
        self._link = link

    def bulk_out(self, transfer: bytes) -> None:
        self._link.ask("bulk_out", data=transfer.hex())

    def bulk_in(self, most: int) -> bytes | None:
        data = self._link.ask("bulk_in", most=most)["data"]
        return None if data is None else bytes.fromhex(data)

    def control(self, request_type: int, request: int, value: int, index: int, length: int) -> bytes:
        answer = self._link.ask("control", request=[request_type, request, value, index, length])
        return bytes.fromhex(answer["data"])

    def clear_halt(self) -> None:
        self._link.ask("clear_halt")


@contextmanager
def served_detector(address: str) -> Iterator[UsbBackend]:
    """Open the pseudo-terminal of a served detector; give a pyusb backend on whose bus only it is plugged in.

    Raises
    ------
    OSError
        If there is no such pseudo-terminal, another program uses it, or something else answers.
    """
    with serial.Serial(address, timeout=ANSWER_S, write_timeout=ANSWER_S, exclusive=True) as port:
        link = _Link(port)
        try:
            told: Identity = _Detector(link.ask("who"))
        except (USBError, LookupError) as problem:
            raise OSError(errno.ENODEV, f"no served detector answers ({problem})") from problem
        yield UsbBackend([told], interface=lambda _: _ServedInterface(link))
