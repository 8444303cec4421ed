"""Sections of detectors, and of their channels."""

from typing import ClassVar, Literal

from pydantic import Field

from rig.model.config.section import DeviceSection, Point, Section
from rig.model.quantities import Hertz, Seconds


class DetectorConfig(DeviceSection):
    """What all detectors have."""

    address: str | None = None
    """Its address; None if its driver finds it."""
    position_m: Point = (0.15, 0.0, 2.5)
    """Position of the detector's lens."""
    gated: bool = True
    """False: free-running; the first bounce is detected, too."""
    gate_delay_s: Seconds = Field(31.5e-9, ge=0)
    """Opening edge of the gate after the sync pulse."""
    gate_width_s: Seconds = Field(40e-9, gt=0)
    """Time the gate stays open."""
    hold_off_s: Seconds = Field(100e-9, ge=0)
    """Time after a detection during which the detector stays off."""
    max_count_rate_hz: Hertz | None = Field(None, gt=0)
    """Counts a second in one channel above which the bias is switched off; None: half of the highest
    possible rate."""


class Id120Config(DetectorConfig):
    """An ID Quantique ID120, which has no gate that a public command sets: it is free-running."""

    kind: Literal["id120"] = "id120"
    serial: str | None = None
    """Serial number, when several detectors are connected."""
    address: str | None = None
    """Pseudo-terminal of a simulated detector from ``rig sim serve``; None: a detector on USB."""
    gated: bool = False
    """Must be false. Scans of earlier versions may have another value."""
    hold_off_s: Seconds = Field(120e-9, ge=0)
    """Time after a detection during which the detector stays off, in steps of 40 ns."""


class ExternalDetectorConfig(DetectorConfig):
    """A detector without a data interface: a person sets bias, gate and hold-off as it is written here."""

    kind: Literal["external"] = "external"
    model: str = "detector"
    """Name of the product, for people to read."""


class MpdConfig(DetectorConfig):
    """An MPD Fast-Gated SPAD; bias and hold-off are set by hand, in MPD's program."""

    needs_address: ClassVar[bool] = True

    kind: Literal["mpd"] = "mpd"
    address: str | None = None
    """Serial port or pyserial URL."""


class ChannelConfig(Section):
    """One pixel of the detector: what it looks at, and where its pulses go."""

    name: str = "spad"
    """Name of the channel."""
    input: int = Field(0, ge=0)
    """Input of the timing instrument, counted from 0."""
    spot_m: Point = (0.0, 0.0, 0.0)
    """The spot on the relay wall that it looks at."""
    delay_s: Seconds = 0.0
    """Extra delay of its pulses, added to timing.electronics_delay."""
