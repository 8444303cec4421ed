"""Time zero: when the pulse is on the wall, from first bounces all over it."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate.first_bounce import FirstBounces, first_bounces, free_running, record_first_bounces
from rig.calibrate.legs_fit import Belief, LegsFit, fit_legs
from rig.calibrate.routine import origin
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import TimeZero
from rig.model.config import RigConfig
from rig.model.quantities import show, show_length
from rig.model.state import RigState

#: Fewest positions: two for each parameter of delay, detector and mirror.
FEWEST_POSITIONS = 28
#: Residuals so many times their errors (squared) are no chance with a few dozen positions.
LARGEST_CHI2 = 2.0
#: A drift is told where it is beyond so many standard errors.
SURE = 3.0


@dataclass(frozen=True)
class TimeZeroRoutine:
    """Measures first bounces on a coarse grid, twice one after the other so that a drift is seen."""

    columns: int = 11
    rows: int = 9
    exposure_s: float = 0.1
    kind: str = TimeZero.kind

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the detector free running, and a histogram of the whole period."""
        return free_running(config)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Record the grid twice, the laser attenuated."""
        paths = [folder / f"time-zero-{number}.h5" for number in (1, 2)]
        for path in paths:
            record_first_bounces(
                station,
                state,
                path,
                watch,
                columns=self.columns,
                rows=self.rows,
                exposure_s=self.exposure_s,
            )
        return paths

    def fit(self, files: Sequence[Path], state: RigState) -> Calibration:
        """Return delay and heads; see `legs_fit.fit_legs`."""
        with ExitStack() as stack:
            scans = [stack.enter_context(ScanFile(path)) for path in files]
            bounces = [first_bounces(scan) for scan in scans]
            drift = _drift(scans, bounces)
            found = _fitted(scans, bounces, drift, state)
            return TimeZero(
                **origin(TimeZero, scans),
                valid_days=30,
                electronics_delay_s=found.legs.electronics_delay_s,
                electronics_delay_error_s=found.delay_error_s,
                laser_head_m=_point(found.legs.laser_head_m),
                detector_head_m=_point(found.legs.detector_head_m),
                detector_spot_m=_point(scans[0].detector_m[0, 0]),
                rectified_error_s=float(np.median(found.rectified_error_s)),
                rectified_error_worst_s=float(found.rectified_error_s.max()),
                residual_s=float(np.sqrt((found.residual_s**2).mean())),
                chi2=found.chi2,
                positions=len(np.unique(found.spots_m, axis=0)),
                drift_per_minute_s=None if drift is None else 60 * drift.rate,
                drift_per_minute_error_s=None if drift is None else 60 * drift.error,
                spots_m=[(round(x_m, 6), round(y_m, 6)) for x_m, y_m in found.spots_m.tolist()],
                residuals_s=[round(left_s, 16) for left_s in found.residual_s.tolist()],
                warnings=_warnings(found, drift, state),
            )

    def figure(self, files: Sequence[Path], calibration: Calibration) -> Figure:
        """Draw arrivals and what the calibration leaves of them, over the wall and over the time."""
        from rig.calibrate.pictures import time_zero_figure

        assert isinstance(calibration, TimeZero)
        with ExitStack() as stack:
            scans = [stack.enter_context(ScanFile(path)) for path in files]
            return time_zero_figure([first_bounces(scan) for scan in scans], calibration)


@dataclass(frozen=True)
class Drift:
    """How arrivals drift: seconds a second, its standard error, and where each arrival is in time."""

    rate: float
    error: float
    after_s: list[NDArray[np.float64]]


def _drift(scans: Sequence[ScanFile], bounces: Sequence[FirstBounces]) -> Drift | None:
    """Compare two visits of the same positions; None where there were none.

    Within one visit a drift cannot be told from a pivot that stands higher, since lines follow each other
    upwards. The time between visits is that of exposures, settling and readout; the pause between two files
    is not in it.
    """
    if len(scans) != 2 or scans[0].mirror_rad is None or scans[1].mirror_rad is None:
        return None
    if scans[0].mirror_rad.shape != scans[1].mirror_rad.shape:
        return None
    if np.abs(scans[0].mirror_rad - scans[1].mirror_rad).max() > 1e-6:
        return None
    first, second = bounces
    _, i, j = np.intersect1d(first.index, second.index, return_indices=True)
    each_s, config = float(np.nanmedian(scans[0].live_time_s)), scans[0].config
    if config is not None:
        each_s += config.galvo.settle_time_s + config.tcspc.readout_time_s
    between_s = scans[0].steps * each_s
    variance = first.error_s[i] ** 2 + second.error_s[j] ** 2
    later_s = float(np.average(second.arrival_s[j] - first.arrival_s[i], weights=1 / variance))
    middle_s = between_s - each_s / 2
    after_s = [
        np.asarray(one.index * each_s + start_s - middle_s, dtype=np.float64)
        for one, start_s in ((first, 0.0), (second, between_s))
    ]
    return Drift(later_s / between_s, float((1 / variance).sum() ** -0.5) / between_s, after_s)


def _fitted(
    scans: Sequence[ScanFile],
    bounces: Sequence[FirstBounces],
    drift: Drift | None,
    state: RigState,
) -> LegsFit:
    positions = len(np.unique(np.concatenate([one.mirror_rad for one in bounces]).round(6), axis=0))
    if positions < FEWEST_POSITIONS:
        raise CalibrationError(
            f"{scans[0].path}: {positions} positions with a first bounce are too few, at least "
            f"{FEWEST_POSITIONS} are needed: measure a grid of 11 x 9 or so over the whole wall"
        )
    arrivals_s = [one.arrival_s for one in bounces]
    if drift is not None:
        arrivals_s = [
            at_s - drift.rate * after_s for at_s, after_s in zip(arrivals_s, drift.after_s, strict=True)
        ]
    found = fit_legs(
        np.concatenate(arrivals_s),
        np.concatenate([one.error_s for one in bounces]),
        np.concatenate([one.mirror_rad for one in bounces]),
        scans[0].detector_m[0, 0],
        belief(state),
    )
    for name, head_m in (("galvo", found.legs.laser_head_m), ("detector", found.legs.detector_head_m)):
        if not (np.isfinite(head_m).all() and head_m[2] > 0):
            raise CalibrationError(
                f"{scans[0].path}: the arrivals put the {name} behind the wall: these are no first bounces "
                "of this rig, or its positions in the configuration are wrong"
            )
    return found


def belief(state: RigState) -> Belief:
    """Return what configuration and galvo calibration say before arrivals are looked at."""
    galvo = state.calibrations.galvo
    return Belief(
        legs=state.nominal.delays,
        nominal=state.nominal.pointing,
        calibrated=galvo.pointing() if galvo else None,
        spot_error_m=galvo.spot_error_m if galvo else None,
    )


def _point(place_m: NDArray[np.float64]) -> tuple[float, float, float]:
    x_m, y_m, z_m = place_m.tolist()
    return x_m, y_m, z_m


def _warnings(found: LegsFit, drift: Drift | None, state: RigState) -> list[str]:
    warnings = []
    known = state.calibrations
    worst_s = show(float(found.rectified_error_s.max()), "s", 2)
    if known.galvo is None:
        moved_m = float(np.sqrt((found.moved_m**2).sum(axis=1).mean()))
        warnings.append(
            f"the galvo is not calibrated: arrivals put the spots {show_length(moved_m, 2)} from where they "
            f"are taken to be, and rectified time is known to {worst_s} only. Run rig calibrate galvo, and "
            "this again"
        )
    if found.chi2 > LARGEST_CHI2:
        reason = (
            "the calibration of the galvo does not hold (rig calibrate galvo)"
            if known.galvo
            else "the mirror is mounted in another way than is configured"
        )
        warnings.append(
            f"residuals are {np.sqrt(found.chi2):.1f} times their errors, which are raised to that: "
            f"{reason}, or something else than the wall reflects"
        )
    if drift is not None and abs(drift.rate) > SURE * drift.error:
        warnings.append(
            f"arrivals drift by {show(60 * drift.rate, 's', 2)} a minute: time zero is that of the middle of "
            "the measurement. Let the rig warm up"
        )
    return warnings
