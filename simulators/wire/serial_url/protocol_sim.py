"""pyserial's handler for ``sim://`` addresses: a port with simulated firmware behind it.

`attach` plugs firmware in and gives the address that `serial.serial_for_url` opens; `detach` pulls the plug,
also under an open port.
"""

import errno
from typing import Protocol, runtime_checkable

import serial
from serial.serialutil import PortNotOpenError, SerialBase, SerialException

from simulators.clock import BenchClock

SCHEME = "sim://"

#: The package in which pyserial finds this module.
PACKAGE = __name__.rpartition(".")[0]


class Firmware(Protocol):
    """A device as bytes in and bytes out.

    Attributes
    ----------
    output
        What the device has sent and nobody has read; the port takes from its front.
    """

    output: bytearray

    def receive(self, data: bytes) -> None:
        """Take bytes from the wire, whole commands or pieces of them."""
        ...


@runtime_checkable
class LinedFirmware(Firmware, Protocol):
    """A device that also has to do with the port's control lines."""

    def drive(self, line: str, level: bool) -> None:
        """Take the level of an output of the port, ``rts`` or ``dtr``."""
        ...

    def sense(self, line: str) -> bool:
        """Return the level of an input of the port, ``cts`` or ``dsr``."""
        ...


_attached: dict[str, tuple[Firmware, BenchClock]] = {}


def attach(path: str, firmware: Firmware, clock: BenchClock) -> str:
    """Plug ``firmware`` in at ``sim://path`` and return this address.

    Parameters
    ----------
    path
        Name of the bench and of the device, e.g. ``"bench1/galvo"``; letter case matters.
    firmware
        The device.
    clock
        The time that passes while a reader waits in vain.

    Raises
    ------
    ValueError
        Something is plugged in there already.
    """
    if path in _attached:
        raise ValueError(f"{SCHEME}{path} is in use; detach it first")
    if PACKAGE not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(PACKAGE)
    _attached[path] = (firmware, clock)
    return SCHEME + path


def detach(address: str) -> None:
    """Pull the plug at ``address``; safe to call twice."""
    _attached.pop(address.removeprefix(SCHEME), None)


class Serial(SerialBase):
    """A port whose far end is what was plugged in with `attach`."""

    def open(self) -> None:
        """Open the port.

        Raises
        ------
        serial.SerialException
            Nothing is plugged in at the address, with ENOENT as the real port has it.
        """
        path = str(self.port).removeprefix(SCHEME)
        if path not in _attached:
            raise SerialException(errno.ENOENT, f"could not open port {self.port}: nothing is plugged in")
        self._path = path
        self._firmware, self._clock = _attached[path]
        self._firmware.output.clear()
        self.is_open = True
        self._update_rts_state()
        self._update_dtr_state()

    def close(self) -> None:
        """Close the port; the system drops its outputs then."""
        if self.is_open and isinstance(self._firmware, LinedFirmware):
            for line in ("rts", "dtr"):
                self._firmware.drive(line, False)
        self.is_open = False

    @property
    def cts(self) -> bool:
        """Level of the input CTS."""
        firmware = self._plugged()
        return isinstance(firmware, LinedFirmware) and firmware.sense("cts")

    @property
    def dsr(self) -> bool:
        """Level of the input DSR."""
        firmware = self._plugged()
        return isinstance(firmware, LinedFirmware) and firmware.sense("dsr")

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read at once."""
        return len(self._plugged().output)

    def read(self, size: int = 1) -> bytes:
        """Read ``size`` bytes; with fewer there, let the timeout pass on the bench's clock and return those.

        Raises
        ------
        serial.SerialException
            The plug was pulled, or without a timeout the read would never return.
        """
        output = self._plugged().output
        if len(output) < size:
            if self._timeout is None:
                raise SerialException(f"{self.port}: reading without a timeout would wait forever")
            self._clock.sleep(self._timeout)
            output = self._plugged().output  # bytes may have come, or the plug been pulled, meanwhile
        data = bytes(output[:size])
        del output[:size]
        return data

    def write(self, data: bytes) -> int:
        """Hand ``data`` to the device; it takes everything at once."""
        self._plugged().receive(bytes(data))
        return len(data)

    def reset_input_buffer(self) -> None:
        """Throw away what was not read."""
        self._plugged().output.clear()

    def reset_output_buffer(self) -> None:
        """Do nothing: what is written has left already."""
        self._plugged()

    def _plugged(self) -> Firmware:
        if not self.is_open:
            raise PortNotOpenError()
        firmware, _ = _attached.get(self._path, (None, None))
        if firmware is not self._firmware:
            raise SerialException(errno.EIO, f"{self.port}: the device was unplugged")
        return self._firmware

    def _update_rts_state(self) -> None:
        self._drive("rts", self._rts_state)

    def _update_dtr_state(self) -> None:
        self._drive("dtr", self._dtr_state)

    def _drive(self, line: str, level: bool) -> None:
        firmware = self._plugged()
        if isinstance(firmware, LinedFirmware):
            firmware.drive(line, bool(level))

    def _reconfigure_port(self) -> None:
        """Accept any line setting: a simulated wire has no speed."""
