"""When the first bounce arrives at each position of a free-running scan: recorded, found and fitted."""

from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.hydraharp.limits import LIMITS
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.acquire.preflight import check
from rig.calibrate import peaks
from rig.calibrate.counts import settings_of
from rig.calibrate.routine import changed, histogram_settings
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.state import RigState

#: What is fitted, from the highest point on: too short for light of a hidden scene, long enough for a tail.
WINDOW_S = (-0.4e-9, 0.8e-9)
#: Counts are smoothed over this time before the highest point is looked for.
SMOOTHED_S = 60e-12
#: Detections for each pulse above which a peak is refused; far below it the losses are corrected for.
LARGEST_PER_PULSE = 0.1
#: Fewest counts above the background in a peak: it is then known to 3 ps or so, and surely is one.
FEWEST_COUNTS = 100
#: So far from the highest point nothing of its peak is left that could be taken for a second one.
PEAK_S = 0.25e-9
#: A second peak so high in parts of the first makes the first doubtful.
SECOND_PEAK = 0.5
#: Largest part of the positions without a good peak.
MOST_LEFT_OUT = 0.25
#: So many bins with the largest count of all are no chance: the counter was full.
FULL_BINS = 5
FULL_COUNTERS = (2**16 - 1, 2**32 - 1)
#: Below this expectation counts are too skew for a sum of squares.
ENOUGH_FOR_CHI2 = 5


@dataclass(frozen=True)
class FirstBounces:
    """First bounces of N positions.

    Attributes
    ----------
    index
        (N,) which of the file's measured positions they belong to.
    laser_m, mirror_rad
        (N, 3) spots as the file has them, (N, 2) commanded mirror angles.
    arrival_s, error_s
        (N,) when the Gaussian core is centred, in the file's time, and its standard error.
    counts
        (N,) detections in the peak, those lost to the hold-off added.
    background
        (N,) counts a bin beside the peak.
    shape, shape_error, shape_covariance
        Of all peaks, its standard errors, and the (3, 3) covariance of its parameters.
    time_s, rate
        (N, W) bins' centres and counts a bin in the windows fitted, the lost ones added.
    model
        (N, W) what the fit has there.
    chi2
        Pearson's, of the bins with enough counts, by their number; about 1 where the shape is right.
    bin_width_s
        Of the record.
    per_pulse
        Detections for each pulse at the brightest position.
    left_out
        Reason for each measured position that has no good peak.
    """

    index: NDArray[np.int64]
    laser_m: NDArray[np.float64]
    mirror_rad: NDArray[np.float64]
    arrival_s: NDArray[np.float64]
    error_s: NDArray[np.float64]
    counts: NDArray[np.float64]
    background: NDArray[np.float64]
    shape: peaks.Shape
    shape_error: peaks.Shape
    shape_covariance: NDArray[np.float64]
    time_s: NDArray[np.float64]
    rate: NDArray[np.float64]
    model: NDArray[np.float64]
    chi2: float
    bin_width_s: float
    per_pulse: float
    left_out: dict[int, str]


def free_running(config: RigConfig) -> RigConfig:
    """Return a configuration in which the detector runs free and the histogram holds the whole period."""
    period_s = 1 / config.laser.repetition_hz
    bins = min(ceil(period_s / histogram_settings(config).bin_width_s - 1e-6), LIMITS.max_bins)
    return changed(config, detector={"gated": False}, tcspc={"offset_s": 0.0, "bins": bins})


def record_first_bounces(
    station: Station,
    state: RigState,
    path: Path,
    watch: Watch,
    *,
    columns: int = 11,
    rows: int = 9,
    exposure_s: float = 0.1,
) -> None:
    """Measure first bounces on a coarse grid over the scan's area, the laser attenuated.

    Parameters
    ----------
    state
        With the configuration that `free_running` gave, and the devices were opened with.

    Raises
    ------
    RefusedError
        If the mirror does not reach the grid.
    """
    station.operator.prepare(Preparation.ATTENUATE)
    scan = state.config.scan
    spacing_m = min(
        (scan.columns - 1) * scan.spacing_m / max(columns - 1, 1),
        (scan.rows - 1) * scan.spacing_m / max(rows - 1, 1),
    )
    plan = ScanPlan.grid(
        state.config, columns=columns, rows=rows, spacing_m=spacing_m, exposure_s=exposure_s, skip_m=0.0
    )
    check(plan, state, path.parent)
    record(plan, state, station.devices, path, watch)


def first_bounces(scan: ScanFile) -> FirstBounces:
    """Find and fit the first bounce of each measured position.

    The counts of a bin are Poisson distributed about live (a CDF difference of the peak + background):
    ``live`` is the part of the pulses for which the detector is not held off at that time, see `_live`. All
    peaks have one shape (`peaks.Shape`); all are fitted together by maximum likelihood.

    Raises
    ------
    CalibrationError
        If more than a few positions have no peak, a full counter, too high a rate, or two equal peaks.
    DataFileError
        If the file is damaged, or lacks what is needed.
    """
    if scan.mirror_rad is None:
        raise CalibrationError(
            f"{scan.path} does not say where the mirror pointed (/geometry/mirror_rad is missing): measure "
            "with rig calibrate, or scan again with this version"
        )
    if scan.gate_start_s is not None:
        raise CalibrationError(
            f"{scan.path} was measured through the gate, which keeps the first bounce out: let the detector "
            "run freely and attenuate the laser, as rig calibrate does"
        )
    counts = np.concatenate([block for _, block in scan.capture().histograms.blocks()])
    pulses = scan.live_time_s[scan.done].astype(float) * settings_of(scan).laser.repetition_hz
    live, left_out = _live(scan, counts, pulses), {}
    starts = np.zeros(len(counts), np.int64)
    size = round((WINDOW_S[1] - WINDOW_S[0]) / scan.bin_width_s)
    for position, histogram in enumerate(counts):
        try:
            peak = highest(histogram, scan.bin_width_s, pulses[position])
            starts[position] = peak + round(WINDOW_S[0] / scan.bin_width_s)
            if not 0 <= starts[position] <= scan.bins - size:
                raise CalibrationError("its first bounce is cut off by the end of the histogram")
        except CalibrationError as error:
            left_out[position] = str(error)
    _refuse_many(scan, left_out, len(counts))
    good = np.setdiff1d(np.arange(len(counts)), list(left_out))
    inside = starts[good, None] + np.arange(size)
    seen, live = counts[good[:, None], inside].astype(np.float64), live[good[:, None], inside]
    edges_s = scan.first_bin_s + np.append(inside, inside[:, -1:] + 1, axis=1) * scan.bin_width_s
    fit = peaks.fit(np.asarray(edges_s, dtype=np.float64), seen, live)
    where = np.flatnonzero(scan.done)[good]
    return FirstBounces(
        index=good,
        laser_m=scan.laser_m[where],
        mirror_rad=scan.mirror_rad[where],
        arrival_s=fit.centre_s,
        error_s=fit.centre_error_s,
        counts=fit.counts,
        background=fit.background,
        shape=fit.shape,
        shape_error=fit.shape_error,
        shape_covariance=fit.shape_covariance,
        time_s=(edges_s[:, :-1] + edges_s[:, 1:]) / 2,
        rate=seen / live,
        model=fit.model / live,
        chi2=_chi2(seen, fit.model),
        bin_width_s=scan.bin_width_s,
        per_pulse=float((counts.sum(axis=1) / pulses).max()),
        left_out=left_out,
    )


def _chi2(seen: NDArray[np.float64], model: NDArray[np.float64]) -> float:
    many = model >= ENOUGH_FOR_CHI2
    squares = (seen - model)[many] ** 2 / model[many]
    free = len(squares) - 2 * len(seen) - 3
    return float(squares.sum() / free) if free > 0 else 1.0


def _live(
    scan: ScanFile, counts: NDArray[np.unsignedinteger], pulses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(P, bins) for what part of the pulses the detector is ready at that time after them.

    A free-running detector with a dead time that is not extended is off at a time exactly if it made one
    detection (it cannot make two) in the hold-off before; so the histogram itself, folded by the period,
    tells how often it was (Isbaner et al., Opt. Express 24, 9429, 2016). A hold-off of one period costs all
    times alike.
    """
    period = round(1 / (settings_of(scan).laser.repetition_hz * scan.bin_width_s))
    hold = settings_of(scan).detector.hold_off_s / scan.bin_width_s
    whole, rest = floor(hold / period + 1e-9), round(hold % period) % period
    per_pulse = np.zeros((len(counts), max(period, scan.bins)))
    per_pulse[:, : scan.bins] = counts / pulses[:, None]
    before = np.cumsum(np.concatenate([per_pulse[:, len(per_pulse[0]) - rest :], per_pulse], axis=1), axis=1)
    before = np.insert(before, 0, 0.0, axis=1)
    bins = np.arange(scan.bins)
    off = before[:, bins + rest] - before[:, bins] + whole * per_pulse.sum(axis=1, keepdims=True)
    return np.asarray(np.clip(1 - off, 1e-3, 1), dtype=np.float64)


def highest(histogram: NDArray, bin_width_s: float, pulses: float) -> int:
    """Return the bin of the one strong peak in what was counted in so many pulses.

    Raises
    ------
    CalibrationError
        If there is none, or not one, or it is saturated.
    """
    total, largest = int(histogram.sum()), int(histogram.max(initial=0))
    full = int((histogram == largest).sum()) >= FULL_BINS and largest >= FEWEST_COUNTS
    if full or largest in FULL_COUNTERS:
        raise CalibrationError(f"its bins are full at {largest} counts: attenuate more, or measure shorter")
    if total > LARGEST_PER_PULSE * pulses:
        raise CalibrationError(
            f"its peak is saturated, {total / pulses:.2g} detections a pulse, {LARGEST_PER_PULSE:g} at "
            "most: attenuate the laser more"
        )
    width = max(round(SMOOTHED_S / bin_width_s), 1)
    smooth = np.convolve(histogram, np.ones(width), "same")
    peak = int(smooth.argmax())
    around = slice(max(peak + round(WINDOW_S[0] / bin_width_s), 0), peak + round(WINDOW_S[1] / bin_width_s))
    elsewhere, near = smooth.copy(), round(PEAK_S / bin_width_s)
    elsewhere[max(peak - near, 0) : peak + near] = 0
    background = float(np.median(smooth))
    inside = float(histogram[around].sum()) - background / width * (around.stop - around.start)
    if inside < FEWEST_COUNTS or smooth[peak] < background + 8 * np.sqrt(background + 1):
        raise CalibrationError(
            f"it has no peak: {inside:.0f} counts above the background at its highest point, "
            f"{FEWEST_COUNTS} are needed. Measure longer, attenuate less, and see that the detector runs free"
        )
    if elsewhere.max() - background > SECOND_PEAK * (smooth[peak] - background):
        later_s = (int(elsewhere.argmax()) - peak) * bin_width_s
        raise CalibrationError(
            f"it has two strong peaks, {abs(later_s) * 1e9:.2f} ns apart: find and cover what reflects"
        )
    return peak


def _refuse_many(scan: ScanFile, left_out: dict[int, str], positions: int) -> None:
    if len(left_out) <= MOST_LEFT_OUT * positions:
        return
    first = min(left_out)
    raise CalibrationError(
        f"{scan.path}: {len(left_out)} of {positions} positions cannot be used. Position {first}: "
        f"{left_out[first]}"
    )
