"""When the first bounce arrives at each position of a scan: measured on a coarse grid, found and fitted."""

from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path
from typing import ClassVar

import numpy as np

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, require
from rig.calibrate.raw import Raw
from rig.calibrate.routine import K, Routine, changed, histogram_limits, histogram_settings, recorded
from rig.calibrate.timing import peaks
from rig.errors import CalibrationError
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.state import RigState

#: Detections for each pulse above which a peak through the wide open gate is refused.
MAX_GATED_PER_PULSE = 0.2


def free_running(config: RigConfig) -> RigConfig:
    """Return a configuration in which the detector runs free and the histogram holds the whole period."""
    period_s = 1 / config.laser.repetition_hz
    most = histogram_limits(config).max_bins
    bins = min(ceil(period_s / histogram_settings(config).bin_width_s - 1e-6), most)
    return changed(config, detector={"gated": False}, tcspc={"offset_s": 0.0, "bins": bins})


@dataclass(frozen=True)
class FirstBounceRoutine(Routine[K]):
    """Measures first bounces on a coarse grid over the scan's area, the laser attenuated.

    Attributes
    ----------
    columns, rows, exposure_s
        Of the grid, and at each position.
    files
        A visit of the grid for each.
    """

    columns: int = 11
    rows: int = 9
    exposure_s: float = 0.1

    files: ClassVar[tuple[str, ...]]

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the detector free running, and a histogram of the whole period."""
        return free_running(config)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Record each visit of the grid."""
        scan = state.config.scan
        fits = (scan.columns - 1) / max(self.columns - 1, 1), (scan.rows - 1) / max(self.rows - 1, 1)
        plan = ScanPlan.grid(
            state.config,
            columns=self.columns,
            rows=self.rows,
            spacing_m=scan.spacing_m * min(fits),
            exposure_s=self.exposure_s,
            skip_m=0.0,
            preparation=Preparation.ATTENUATE,
        )
        return [recorded(folder / name, plan, state, station, watch) for name in self.files]


def first_bounces(raw: Raw, *, gated: bool = False, min_counts: int = peaks.MIN_COUNTS) -> peaks.Peaks:
    """Find and fit the first bounce at each measured position.

    Raises CalibrationError if more than a few positions have no good peak, or the detector was gated though
    it should not be.
    """
    require(raw.done.any(), f"{raw.label} holds no measured position: measure again")
    if not gated:
        raw.refuse_gated()
        require(raw.alone, f"{raw.label} is one of several passes: it is raw data of another calibration")
    pulses = raw.live_s[raw.done] * raw.config.laser.repetition_hz
    counts = raw.counts[raw.done]
    return peaks.find(
        counts,
        pulses,
        _live(raw, counts, pulses),
        raw.edges_s,
        name=raw.label,
        max_per_pulse=MAX_GATED_PER_PULSE if gated else peaks.MAX_PER_PULSE,
        min_counts=min_counts,
    )


def mirror_rad(raw: Raw) -> Floats:
    """Return (P, 2) commanded angles of the measured positions.

    Raises CalibrationError if the file does not say.
    """
    if raw.mirror_rad is None:
        raise CalibrationError(
            f"{raw.label} does not hold where the mirror pointed (/geometry/mirror_rad is missing): measure "
            "with rig calibrate, or scan again with this version"
        )
    return raw.mirror_rad[raw.done]


def _live(raw: Raw, counts: Floats, pulses: Floats) -> Floats:
    """(P, bins) for what part of the pulses the detector is ready at that time after them.

    A free-running detector with a dead time that is not extended is off at a time exactly if it made one
    detection (it cannot make two) in the hold-off before; so the histogram itself, folded by the period,
    tells how often it was (Isbaner et al., Opt. Express 24, 9429, 2016). A hold-off of one period costs all
    times alike.
    """
    period = round(1 / (raw.config.laser.repetition_hz * raw.bin_width_s))
    hold = raw.config.detector.hold_off_s / raw.bin_width_s
    whole, rest = floor(hold / period + 1e-9), round(hold % period) % period
    per_pulse = np.zeros((len(counts), max(period, raw.bins)))
    per_pulse[:, : raw.bins] = counts / pulses[:, None]
    before = np.cumsum(np.concatenate([per_pulse[:, len(per_pulse[0]) - rest :], per_pulse], axis=1), axis=1)
    before = np.insert(before, 0, 0.0, axis=1)
    bins = np.arange(raw.bins)
    off = before[:, bins + rest] - before[:, bins] + whole * per_pulse.sum(axis=1, keepdims=True)
    return np.clip(1 - off, 1e-3, 1)
