"""A pseudo-terminal with firmware behind it: a serial port for every program on this computer."""

import os
from contextlib import suppress

from simulators.wire.serial_url.protocol_sim import Firmware
from simulators.wire.served.system import pseudo_terminal

#: Bytes that are taken at a time.
PIECE = 65536


class Terminal:
    """One device at a pseudo-terminal.

    The far end is kept open here as well, so that the device stays when a program closes the port or is
    killed: as at a real serial port, nothing of that reaches the device.

    Parameters
    ----------
    firmware
        The device.

    Attributes
    ----------
    address
        What other programs open, e.g. ``/dev/pts/7``.
    """

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._near, self._far, self.address = pseudo_terminal()

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when a program has sent something."""
        return self._near

    def serve(self) -> None:
        """Hand to the device what has come, and send what it answers.

        What nobody reads is lost as soon as the line is full, about 4 kB: the server never waits for a
        program.
        """
        with suppress(BlockingIOError):
            self._firmware.receive(os.read(self._near, PIECE))
        output = self._firmware.output
        with suppress(BlockingIOError):
            while output:
                del output[: os.write(self._near, output)]
        output.clear()

    def close(self) -> None:
        """Close both ends; programs that have the port open see a broken line."""
        os.close(self._near)
        os.close(self._far)
