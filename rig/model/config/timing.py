"""Sections of timing instruments, and of the time origin."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from rig.model.config.section import DeviceSection, Section
from rig.model.quantities import Seconds, Volts


class TcspcConfig(DeviceSection):
    """What all timing instruments have."""

    readout_time_s: Seconds = Field(0.005, ge=0)
    """Time to clear, read and restart; used only to estimate how long a scan takes."""


class HydraHarpConfig(TcspcConfig):
    """A PicoQuant HydraHarp 400, in histogram mode."""

    kind: Literal["hydraharp"] = "hydraharp"
    library: Path | None = None
    """The vendor's library; by default it is searched for in the usual places."""
    address: str | None = None
    """Socket of a bench that ``rig sim serve`` serves, to simulate the instrument on; None: a real one."""
    serial: str | None = None
    """Serial number, when several instruments are connected."""
    sync_divider: Literal[1, 2, 4, 8, 16] = 1
    sync_level_v: Volts = Field(0.05, ge=0)
    sync_zero_cross_v: Volts = Field(0.01, ge=0)
    input_level_v: Volts = Field(0.05, ge=0)
    """Of every input that a channel uses."""
    input_zero_cross_v: Volts = Field(0.01, ge=0)
    bin_width_s: Seconds = Field(4e-12, gt=0)
    bins: int = Field(15_000, ge=1)
    offset_s: Seconds = Field(28e-9, ge=0)
    """Start of the histogram after the sync pulse, whole nanoseconds."""


class PlaybackConfig(TcspcConfig):
    """A scan file in place of a timing instrument: its counts, step by step, for rehearsals."""

    kind: Literal["playback"] = "playback"
    file: Path
    """The scan file that is played; a relative path begins where the program is called."""
    readout_time_s: Seconds = Field(0.0, ge=0)
    """Time to read a histogram; used only to estimate how long a scan takes."""


class TimingConfig(Section):
    """The time origin."""

    electronics_delay_s: Seconds = 12.3e-9
    """Sync pulse to light leaving the mirror, plus detection to the timing input."""
    instrument_response_s: Seconds = Field(65e-12, gt=0)
    """Full width at half maximum of laser pulse and timing jitter together."""
