"""Time zero from one known target before the wall: light that went to it and back says when it started."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.acquire.acquisition import Watch, record
from rig.acquire.connect import Station
from rig.acquire.preflight import check
from rig.calibrate import peaks
from rig.calibrate.counts import counts_of
from rig.calibrate.first_bounce import WINDOW_S, highest
from rig.calibrate.geometry_fit import TAPE_ERROR_M, TILT_ERROR_RAD
from rig.calibrate.routine import Routine, origin
from rig.errors import CalibrationError, UsageError
from rig.files.scan import ScanFile
from rig.model.calibrations.kinds import TimeZero
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.quantities import parse, show, show_length
from rig.model.state import RigState

Point = tuple[float, float, float]

#: How well the place of the target is known, on each axis.
TARGET_ERROR_M = 2e-3
#: Target and first bounces give the same delay but for errors of places: no more than this.
NEAR_S = 0.9e-9


def place(text: str) -> Point:
    """Read ``10cm,-5cm,1m``, or a distance alone straight before the wall's centre.

    Raises
    ------
    UsageError
        If it is neither, or not before the wall.
    """
    parts = [parse(part, "length") for part in text.split(",")]
    if len(parts) == 1:
        parts = [0.0, 0.0, *parts]
    if len(parts) != 3 or parts[2] <= 0:
        raise UsageError(f"--target {text}: give x,y,z before the wall, e.g. 10cm,-5cm,1m, or a distance")
    return parts[0], parts[1], parts[2]


@dataclass(frozen=True)
class TargetRoutine(Routine[TimeZero]):
    """Scans one small target at a known place; nothing else near may be as bright."""

    target_m: Point
    columns: int = 9
    rows: int = 7
    exposure_s: float = 0.5

    makes = TimeZero

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the configuration as it is: gated, as for a scan."""
        return config

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Scan a coarse grid."""
        station.operator.prepare(Preparation.MEASURE)
        config = state.config
        spacing_m = min(
            config.scan.columns * config.scan.spacing_m / self.columns,
            config.scan.rows * config.scan.spacing_m / self.rows,
        )
        plan = ScanPlan.grid(
            config, columns=self.columns, rows=self.rows, spacing_m=spacing_m, exposure_s=self.exposure_s
        )
        path = folder / "time-zero-target.h5"
        check(plan, state, folder)
        record(plan, state, station.devices, path, watch)
        return [path]

    def fit(self, files: Sequence[Path], state: RigState) -> TimeZero:
        """Return the delay with which the target is where it is, the heads being as known.

        What an error of a head's place does to the delay, rectified time gets back at the wall's centre.
        """
        known = state.calibrations
        with ScanFile(files[0]) as scan:
            legs = state.nominal.delays
            head_m = np.array(known.galvo.mirror_m) if known.galvo else legs.laser_head_m
            spots_m = _spots_m(scan, state)
            found = self._stack(scan, spots_m, head_m, legs.detector_head_m)
            head_error_m = TAPE_ERROR_M
            if known.galvo is None:
                head_error_m = float(np.hypot(TAPE_ERROR_M, TILT_ERROR_RAD * np.linalg.norm(head_m)))
            towards = spots_m - head_m
            towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
            aside = np.linalg.norm(towards - towards.mean(axis=0), axis=1) * head_error_m / C_M_PER_S
            own_s = float(np.hypot(found.fit.centre_error_s[0], 2 * TARGET_ERROR_M / C_M_PER_S))
            errors_s = np.hypot(own_s, aside)
            return TimeZero(
                **origin(TimeZero, [scan]),
                valid_days=30,
                electronics_delay_s=float(found.fit.centre_s[0]),
                electronics_delay_error_s=float(np.hypot(own_s, 2**0.5 * head_error_m / C_M_PER_S)),
                laser_head_m=_point(head_m),
                detector_head_m=_point(legs.detector_head_m),
                detector_spot_m=_point(scan.detector_m[0, 0]),
                rectified_error_s=float(np.median(errors_s)),
                rectified_error_worst_s=float(errors_s.max()),
                residual_s=None,
                chi2=found.chi2,
                positions=len(spots_m),
                drift_per_minute_s=None,
                drift_per_minute_error_s=None,
                spots_m=[(x_m, y_m) for x_m, y_m, _ in spots_m.tolist()],
                residuals_s=[],
                warnings=_warnings(state, float(errors_s.max())),
            )

    def figure(self, files: Sequence[Path], found: TimeZero) -> Figure:
        """Draw the stacked counts about the delay."""
        with ScanFile(files[0]) as scan:
            spots_m = np.pad(np.array(found.spots_m), ((0, 0), (0, 1)))
            heads_m = np.array(found.laser_head_m), np.array(found.detector_head_m)
            stacked = self._stack(scan, spots_m, *heads_m)
        figure = Figure(figsize=(8, 4), layout="constrained")
        axes = figure.subplots()
        time_ns = (stacked.edges_s[:-1] + stacked.edges_s[1:]) / 2 * 1e9
        axes.plot(time_ns, stacked.counts, ".", color="0.6", markersize=4, label="counts of all positions")
        axes.plot(time_ns, stacked.fit.model[0], color="#20639b", label="fit")
        axes.axvline(stacked.fit.centre_s[0] * 1e9, color="#c8553d", linewidth=1, label="delay")
        axes.set(xlabel="time less the way over the target (ns)", ylabel="counts a bin")
        axes.set_title(f"target at {', '.join(map(show_length, self.target_m))}")
        axes.legend(frameon=False)
        return figure

    def _stack(
        self, scan: ScanFile, spots_m: NDArray[np.float64], *heads_m: NDArray[np.float64]
    ) -> "_Stacked":
        """Put all counts on one time axis, that of the delay, and fit the peak there.

        Where first bounces pass the gate, or there is none, they are far brighter. They come together on an
        axis of their own, which says where on the target's axis to look.
        """
        counts = counts_of(scan)
        galvo_m, detector_m = heads_m
        over_target = _way_m(galvo_m, spots_m, np.array(self.target_m), scan.detector_m[0, 0], detector_m)
        total, start_s = _aligned(scan, counts, over_target)
        direct, direct_start_s = _aligned(scan, counts, _way_m(galvo_m, spots_m, detector_m))
        width_s = scan.bin_width_s
        looked_at = total.copy()
        if direct.max() > total.max():
            middle = round((direct_start_s - start_s) / width_s) + int(direct.argmax())
            near = round(NEAR_S / width_s)
            looked_at[: max(middle - near, 0)] = looked_at[max(middle + near, 0) :] = 0
        try:
            peak = highest(looked_at, width_s, np.inf)
        except CalibrationError as error:
            raise CalibrationError(
                f"{scan.path}: light of the target at {', '.join(map(show_length, self.target_m))}, all "
                f"positions together: {error}"
            ) from None
        first, last = (max(peak + round(limit_s / width_s), 0) for limit_s in WINDOW_S)
        bins = np.arange(first, min(last, len(total)) + 1)
        edges_s = np.asarray(start_s + bins * width_s, dtype=np.float64)
        fit = peaks.fit(edges_s[None], total[None, bins[:-1]], np.ones((1, len(bins) - 1)))
        model = fit.model[0]
        chi2 = float(((total[bins[:-1]] - model) ** 2 / model).sum() / (len(model) - 6))
        return _Stacked(edges_s, total[bins[:-1]], fit, chi2)


@dataclass(frozen=True)
class _Stacked:
    """Counts of all positions by the delay that they would mean, and the peak fitted there."""

    edges_s: NDArray[np.float64]
    counts: NDArray[np.float64]
    fit: peaks.Fit
    chi2: float


def _aligned(
    scan: ScanFile, counts: NDArray[np.float64], path_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Add up histograms by the delay that each bin would mean; return it with its first edge [s].

    Counts are shared between the two bins that they fall in, so that their time is kept.
    """
    early = path_m / C_M_PER_S / scan.bin_width_s
    whole = np.floor(early).astype(np.int64)
    total = np.zeros(scan.bins + int(np.ptp(whole)) + 1)
    for row, at, share in zip(counts, whole.max() - whole, early - whole, strict=True):
        total[at : at + scan.bins] += share * row
        total[at + 1 : at + 1 + scan.bins] += (1 - share) * row
    return total, scan.first_bin_s - (int(whole.max()) + 1) * scan.bin_width_s


def _spots_m(scan: ScanFile, state: RigState) -> NDArray[np.float64]:
    if scan.mirror_rad is None:
        return scan.laser_m[scan.done]
    return state.pointing.spots_m(scan.mirror_rad[scan.done])


def _warnings(state: RigState, worst_s: float) -> list[str]:
    if state.calibrations.galvo:
        return []
    return [
        "the galvo is not calibrated: time is right at the wall's centre if the target is where you say "
        f"it is, but may be wrong by {show(worst_s, 's', 2)} at the rim: run rig calibrate galvo, then this"
    ]


def _way_m(*points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) length of the way from point to point, each (3,) or (P, 3)."""
    return np.asarray(sum(np.linalg.norm(there - here, axis=-1) for here, there in pairwise(points_m)))


def _point(place_m: NDArray[np.float64]) -> Point:
    x_m, y_m, z_m = place_m.tolist()
    return x_m, y_m, z_m
