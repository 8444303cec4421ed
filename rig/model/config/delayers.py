"""Sections of gate delayers, between the laser's sync pulse and the detector's gate."""

from typing import ClassVar, Literal

from pydantic import Field

from rig.model.config.section import DeviceSection
from rig.model.quantities import Seconds, Volts


class DelayerConfig(DeviceSection):
    """What all gate delayers have."""

    needs_address: ClassVar[bool] = True

    address: str | None = None
    """Where it is reached."""
    insertion_delay_s: Seconds = Field(0.0, ge=0)
    """What cables and delayer add by themselves: that much less is asked of it, so that detector.gate_delay
    is the gate's opening edge after the sync pulse."""


class PsdConfig(DelayerConfig):
    """An MPD Picosecond Delayer."""

    kind: Literal["psd"] = "psd"
    address: str | None = None
    """Serial port or pyserial URL."""
    trigger_level_v: Volts | None = Field(None, ge=-2, le=2)
    """Level at its input at which a sync pulse counts; None: what is set at its front panel."""
