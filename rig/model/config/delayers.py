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
    """Delay of the cables and of the delayer itself. It is subtracted from what is set, so that
    detector.gate_delay is the gate's opening edge after the sync pulse."""
    divider: int = Field(1, ge=1, le=999)
    """The gate opens once for this many sync pulses: for a laser that is too fast for detector or
    delayer. The number of photons falls by the same factor."""


class PsdConfig(DelayerConfig):
    """An MPD Picosecond Delayer."""

    kind: Literal["psd"] = "psd"
    address: str | None = None
    """Serial port or pyserial URL."""
    trigger_level_v: Volts | None = Field(None, ge=-2, le=2)
    """Level that a sync pulse must cross to trigger it; None: the level set at its front panel."""


class PulseConfig(DelayerConfig):
    """What delayers have that make a gate pulse of their own."""

    pulse_width_s: Seconds = Field(10e-9, gt=0)
    """Width of the gate pulse. It must end before the next sync pulse, with the pause that the box itself
    needs."""
    polarity: Literal["positive", "negative"] = "positive"
    """Polarity of the gate pulse."""
    trigger_edge: Literal["rising", "falling"] = "rising"
    """The edge of the sync pulse that triggers."""


class Dg645Config(PulseConfig):
    """A Stanford Research Systems DG645."""

    kind: Literal["dg645"] = "dg645"
    address: str | None = None
    """``socket://HOST:5025``, or a serial port of 9600 baud."""
    output: Literal["AB", "CD", "EF", "GH"] = "AB"
    """The output that the gate is connected to."""
    amplitude_v: Volts = Field(2.5, ge=0.5, le=5)
    """Amplitude of the gate pulse, into 50 ohm."""
    trigger_level_v: Volts = Field(0.5, ge=-3.5, le=3.5)
    """Level that a sync pulse must cross to trigger it."""


class T560Config(PulseConfig):
    """A Highland Technology T560 or T564."""

    kind: Literal["t560"] = "t560"
    address: str | None = None
    """Serial port of 38400 baud, or ``socket://HOST:PORT``."""
    output: Literal["A", "B", "C", "D"] = "A"
    """The output that the gate is connected to."""
    trigger_level_v: Volts = Field(1.25, ge=0.25, le=3.3)
    """Level that a sync pulse must cross to trigger it."""


class ExternalDelayerConfig(DelayerConfig):
    """A delayer without a data interface, or a cable: a person sets it."""

    needs_address: ClassVar[bool] = False

    kind: Literal["external"] = "external"
    model: str = "delayer"
    """Name of the product, for people to read."""
