"""Sections of shutters."""

from typing import Literal

from pydantic import Field

from rig.model.config.section import DeviceSection
from rig.model.quantities import Seconds


class ShutterConfig(DeviceSection):
    """What all shutters have."""

    address: str | None = None
    """Where it is reached; None where its driver finds it."""
    line: str
    """The line that moves it."""
    open_level: Literal["high", "low"] = "high"
    """Level of the line at which it is open; the other one has to be that of a line that is not driven."""
    moving_time_s: Seconds = Field(20e-3, ge=0)
    """How long it takes to open or to close."""

    @property
    def place(self) -> str:
        """Where it is, for people."""
        return f"{self.address} {self.line}"


class DaqShutterConfig(ShutterConfig):
    """A shutter on a digital output of a DAQ board."""

    kind: Literal["daq"] = "daq"
    address: str | None = None
    """Socket of a simulated board that ``rig sim serve`` serves; None: a board of NI-DAQmx."""
    device: str = "Dev1"
    """The board's name."""
    line: str = "port1/line0"
    """Its digital output; no line of the point clock."""

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
    """Its output."""
    read_back: Literal["cts", "dsr"] | None = None
    """The input that tells where the shutter is, at the level of its output; None where none does."""
