"""A shutter on the RTS or DTR output of a serial port.

An RS-232 output is about +-6 V, that of a USB adapter for microcontrollers 0 and 3.3 or 5 V: a TTL shutter
needs the right one, or a level converter. The system drops both outputs when a port is closed, also that of a
program that was killed; so a shutter that opens at the high level closes then. But it also raises both for a
moment while a port is opened: the laser has to be dark then.
"""

from typing import Any, Literal

import serial

from drivers.clock import Clock
from drivers.errors import LinkError
from drivers.lines.serial import cannot_open
from drivers.shutters.line_shutter import LineShutter


class SerialShutter(LineShutter):
    """A shutter on an output of a serial port.

    Parameters
    ----------
    address
        Serial port or pyserial URL.
    line
        The output that moves it.
    read_back
        The input that tells where it is, at the level of its output; None where none does.
    clock, opens_high, moving_time_s
        See `LineShutter`.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        line: Literal["rts", "dtr"] = "rts",
        read_back: Literal["cts", "dsr"] | None = None,
        opens_high: bool = True,
        moving_time_s: float = 20e-3,
    ) -> None:
        super().__init__(
            f"shutter at {address} {line.upper()}",
            clock=clock,
            opens_high=opens_high,
            moving_time_s=moving_time_s,
        )
        self._address = address
        self._line = line
        self._read_back = read_back
        self._port: Any = None

    def _open_line(self) -> str:
        try:
            port = serial.serial_for_url(self._address, do_not_open=True, exclusive=True)
            setattr(port, self._line, not self._opens_high)  # before it is open: closed as soon as can be
            port.open()
        except (OSError, ValueError) as problem:
            raise cannot_open(self.name, problem) from problem
        self._port = port
        told = f", read back at {self._read_back.upper()}" if self._read_back else ""
        return f"shutter on {self._line.upper()} of {self._address}{told}"

    def _close_line(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _set(self, level: bool) -> None:
        try:
            setattr(self._port, self._line, level)
        except OSError as problem:  # SerialException is one
            raise self._broken(f"set {self._line.upper()}", problem) from problem

    def _level(self) -> bool | None:
        if self._read_back is None:
            return None
        try:
            return bool(getattr(self._port, self._read_back))
        except OSError as problem:
            raise self._broken(f"tell {self._read_back.upper()}", problem) from problem

    def _broken(self, asked: str, problem: OSError) -> LinkError:
        return LinkError(
            self.name,
            asked,
            f"the connection broke: {problem}",
            "Check the cable, and that it has this line.",
        )
