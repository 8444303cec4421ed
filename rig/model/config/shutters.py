"""Sections of shutters."""

from typing import Literal

from pydantic import Field

from rig.model.config.section import DeviceSection
from rig.model.quantities import Seconds


class ShutterConfig(DeviceSection):
    """What all shutters have."""

    address: str | None = None
    """Its address; None if its driver finds it."""
    line: str
    """The line that moves the shutter."""
    open_level: Literal["high", "low"] = "high"
    """Level of the line at which it is open; the other level must be that of a line that is not driven."""
    moving_time_s: Seconds = Field(20e-3, ge=0)
    """Time to open or to close."""

    @property
    def place(self) -> str:
        """Where it is, for people."""
        return f"{self.address} {self.line}"


class DaqShutterConfig(ShutterConfig):
    """A shutter on a digital output of a DAQ board."""

    kind: Literal["daq"] = "daq"
    address: str | None = None
    """Socket of a simulated board from ``rig sim serve``; None: a board of NI-DAQmx."""
    device: str = "Dev1"
    """The board's name."""
    line: str = "port1/line0"
    """Its digital output; it must not be a line of the point clock."""

    @property
    def place(self) -> str:
        """Where it is, for people."""
        return f"{self.address or self.device} {self.line}"


class SerialShutterConfig(ShutterConfig):
    """A shutter on an output of a serial port."""

    needs_address = True

    kind: Literal["serial"] = "serial"
    address: str | None = None
    """Serial port or pyserial URL."""
    line: Literal["rts", "dtr"] = "rts"
    """The output that moves the shutter."""
    read_back: Literal["cts", "dsr"] | None = None
    """The input that reads the shutter's position back, with the same level as the output; None: no
    read-back."""
