"""What a scan file says before its photons: geometry, channels, time axis, plan, the rig, devices."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rig.errors import UsageError
from rig.model.delays import PathDelays
from rig.model.plan import ScanPlan
from rig.model.state import Channel, RigState

#: The longest histogram: 16 times that of a timing instrument of this field. And so many histograms that
#: their places alone take 0.5 GB.
MOST_BINS, MOST_PAIRS = 2**20, 2**23
#: Of histograms no places are kept: 64 x 64 lasers by 64 x 64 pixels.
MOST_COUNTED = 2**24

#: A device's settings, as read back from it.
Settings = Mapping[str, str | int | float | bool]


@dataclass(frozen=True)
class ScanDescription:
    """All that is known of a scan before its first photon.

    Attributes
    ----------
    laser_m
        (S, 3) laser spot of each step, in the order of acquisition; metres.
    detector_m
        (1, 3) or (S, 3) detector spots of one channel, (1, C, 3) or (S, C, 3) of several; metres.
    bins, bin_width_s, first_bin_s
        Number and width of the bins, and the left edge of bin 0.
    delays
        None where t = 0 is the pulse on the wall (time origin ``wall``); the path delays where it is the
        pulse leaving the laser (time origin ``laser``).
    delay_s
        (S,) or (S, C) instead of these: what to subtract from each step's time, where that was measured.
    channels
        The detector's pixels, where known.
    plan
        What was asked for; None where the steps come from elsewhere.
    state
        The rig as it was; None where it is not known.
    simulated
        Whether the photons were computed rather than measured.
    command
        The command that makes the file.
    devices
        Settings by device name, ``identity`` among them.
    fade_from_s
        Rectified time before which the record holds the wall's own light.
    gate_start_s, gate_stop_s
        The detector's gate, in the file's time.
    instrument_response_s
        Full width at half maximum.
    imported
        Which file of another layout the photons come from; None where they were measured here.
    mirror_rad
        (S, 2) commanded mirror angles.
    dtype
        Type of the counts; a floating type says that they are expectations, not photons.
    tagged
        Whether the file is to hold the bin of each photon rather than histograms.
    """

    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    bins: int
    bin_width_s: float
    first_bin_s: float
    delays: PathDelays | None = None
    channels: tuple[Channel, ...] = ()
    plan: ScanPlan | None = None
    state: RigState | None = None
    simulated: bool = False
    command: str = ""
    devices: Mapping[str, Settings] = field(default_factory=dict)
    fade_from_s: float | None = None
    gate_start_s: float | None = None
    gate_stop_s: float | None = None
    instrument_response_s: float | None = None
    imported: Mapping[str, Any] | None = None
    dtype: DTypeLike = "<u4"
    delay_s: NDArray[np.float64] | None = None
    mirror_rad: NDArray[np.float64] | None = None
    tagged: bool = False

    def __post_init__(self) -> None:
        steps = len(self.laser_m)
        if self.laser_m.shape != (steps, 3) or steps == 0:
            raise ValueError(f"laser_m must be (steps, 3), not {self.laser_m.shape}")
        shape = self.detector_m.shape
        if len(shape) not in (2, 3) or shape[0] not in (1, steps) or shape[-1] != 3 or 0 in shape:
            raise ValueError(
                f"detector_m must be (1 or {steps}, 3) or (1 or {steps}, channels, 3), not {shape}"
            )
        if self.bins < 1 or not self.bin_width_s > 0:
            raise ValueError(f"{self.bins} bins of {self.bin_width_s} s: both must be positive")
        if self.tagged and np.dtype(self.dtype).kind == "f":
            raise ValueError("expectation values cannot be listed as photons; use histograms")
        if self.channels and len(self.channels) != self.channel_count:
            raise ValueError(f"{len(self.channels)} channels, but detector_m has {self.channel_count}")
        if self.delay_s is not None and self.delays is not None:
            raise ValueError("delay_s replaces the path delays; give only one of them")
        if self.delay_s is not None and self.delay_s.shape not in {(steps,), (steps, self.channel_count)}:
            raise ValueError(f"delay_s must be ({steps},) or ({steps}, {self.channel_count})")

    @property
    def steps(self) -> int:
        """Number of steps S."""
        return len(self.laser_m)

    @property
    def channel_count(self) -> int:
        """Number of channels C."""
        return 1 if self.detector_m.ndim == 2 else self.detector_m.shape[1]

    def require_readable(self, path: Path) -> None:
        """Refuse a file at ``path`` that would be larger than any that is read: UsageError."""
        pairs, most = self.steps * self.channel_count, most_pairs(tagged=self.tagged)
        if self.bins > MOST_BINS or pairs > most:
            raise UsageError(
                f"cannot write {path}: it would hold {pairs} pairs of step and channel with {self.bins} bins "
                f"each, but at most {most} and {MOST_BINS} are read; take fewer positions, fewer or wider "
                "bins, or several files"
            )

    @property
    def time_origin(self) -> str:
        """``wall`` or ``laser``."""
        return "wall" if self.delays is None and self.delay_s is None else "laser"

    def rectified_by_s(self) -> NDArray[np.float64] | None:
        """Return (S, C) what to subtract for rectified time; None where that is nothing."""
        if self.delay_s is not None:
            return np.broadcast_to(self.delay_s.reshape(self.steps, -1), (self.steps, self.channel_count))
        if self.delays is None:
            return None
        detector_m = self.detector_m.reshape(-1, self.channel_count, 3)
        return rectified_by_s(self.delays, self.channels, self.laser_m, detector_m)


def most_pairs(*, tagged: bool) -> int:
    """Return how many pairs of step and channel a file may have."""
    return MOST_PAIRS if tagged else MOST_COUNTED


def rectified_by_s(
    delays: PathDelays, channels: tuple[Channel, ...], laser_m: NDArray, detector_m: NDArray
) -> NDArray[np.float64]:
    """Return (S, C) what to subtract from recorded time for rectified time.

    Parameters
    ----------
    delays
        Of the paths.
    channels
        The C channels, each with its own delay; none where that is not known.
    laser_m, detector_m
        (S, 3) and (1 or S, C, 3) spots.
    """
    of_channel_s = np.array([channel.delay_s for channel in channels] or 0.0)
    return delays.delay_s(laser_m[:, None], detector_m) + of_channel_s
