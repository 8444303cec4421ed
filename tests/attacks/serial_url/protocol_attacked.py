"""pyserial's handler for ``attacked://`` addresses: the simulated port, with faults put into it."""

import errno

import serial
from serial.serialutil import SerialException

from attacks.taps import Tap
from simulators.wire.serial_url import protocol_sim

SCHEME = "attacked://"

#: The tap in the wire of each address.
taps: dict[str, Tap] = {}


def attach(name: str, device: str, firmware: protocol_sim.Firmware, clock: object, tap: Tap) -> str:
    """Plug firmware in behind a tap; return its address."""
    package = __name__.rpartition(".")[0]
    if package not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(package)
    address = f"{SCHEME}{name}/{device}"
    protocol_sim.attach(address, firmware, clock)
    taps[address] = tap
    return address


def detach(address: str) -> None:
    """Pull the plug."""
    protocol_sim.detach(address)
    taps.pop(address, None)


class Serial(protocol_sim.Serial):
    """A port with a tap in its wire."""

    def open(self) -> None:
        """Open the port."""
        super().open()
        self._tap = taps[str(self.port)]
        self._device = str(self.port).rpartition("/")[2]

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read at once."""
        kind = self._tap.at(self._device, "in_waiting")
        if kind in ("raise", "time out"):
            raise _broken()
        if kind in ("drop", "empty"):
            self._plugged().output.clear()
        return super().in_waiting

    def read(self, size: int = 1) -> bytes:
        """Read at most ``size`` bytes."""
        kind = self._tap.at(self._device, "read")
        if kind == "raise":
            raise _broken()
        if kind == "empty":
            return b""
        if kind in ("time out", "drop"):
            self._plugged().output.clear()
        data = super().read(size)
        if kind == "twice":
            self._plugged().output[:0] = data
        return self._tap.flipped(data) if kind == "flip" else data

    def write(self, data: bytes) -> int:
        """Hand bytes to the device."""
        kind = self._tap.at(self._device, "write")
        if kind == "raise":
            raise _broken()
        if kind == "time out":
            raise serial.SerialTimeoutException("Write timeout")
        if kind in ("drop", "empty"):
            return len(data)
        if kind == "twice":
            super().write(data)
        return super().write(self._tap.flipped(bytes(data)) if kind == "flip" else data)


def _broken() -> SerialException:
    return SerialException(errno.EIO, "input/output error")
