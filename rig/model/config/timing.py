"""Sections of timing instruments, and of the time origin."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from rig.model.config.section import DeviceSection, Section
from rig.model.quantities import Seconds


class TcspcConfig(DeviceSection):
    """What all timing instruments have."""

    readout_time_s: Seconds = Field(0.005, ge=0)
    """Time to clear, read and restart; used only to estimate how long a scan takes."""


class PlaybackConfig(TcspcConfig):
    """A scan file in place of a timing instrument: its counts, step by step, for rehearsals."""

    kind: Literal["playback"] = "playback"
    file: Path
    """The scan file that is played; a relative path starts at the working directory."""
    readout_time_s: Seconds = Field(0.0, ge=0)
    """Time to read a histogram; used only to estimate how long a scan takes."""


class TimingConfig(Section):
    """The time origin."""

    electronics_delay_s: Seconds = 12.3e-9
    """Delay from the sync pulse to the light leaving the mirror, plus delay from a detection to the timing
    input."""
    instrument_response_s: Seconds = Field(65e-12, gt=0)
    """Full width at half maximum of laser pulse and timing jitter together."""
