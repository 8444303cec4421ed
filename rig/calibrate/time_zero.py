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
from rig.calibrate.geometry_fit import Arrivals, RigGeometry, Spots, fit_geometry
from rig.calibrate.routine import Routine, origin
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.kinds import TimeZero
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.quantities import show, show_length
from rig.model.state import RigState

#: Fewest positions: two for each parameter of delay, detector and mirror.
MIN_POSITIONS = 28
#: Residuals so many times their errors (squared) are no chance with a few dozen positions.
MAX_CHI2 = 2.0
#: A drift is told where it is beyond so many standard errors.
SURE = 3.0
#: No spots are known better, whatever a calibration says.
MIN_SPOT_ERROR_M = 1e-5


@dataclass(frozen=True)
class FittedDelays:
    """What arrivals say of the paths outside the scene.

    Attributes
    ----------
    delays
        Delay and heads.
    delay_error_s
        Standard error of the delay alone, which trades with the heads.
    rectified_error_s
        (N,) standard error of what is subtracted from recorded time at each spot.
    spots_m
        (N, 2) where the model of the mirror puts the beam.
    residual_s
        (N,) what the fit leaves.
    chi2
        Mean square of residuals by their errors, corrected for what was fitted; about 1.
    moved_m
        (N, 2) by how much the arrivals move the spots from where the model of the mirror puts them.
    """

    delays: PathDelays
    delay_error_s: float
    rectified_error_s: NDArray[np.float64]
    spots_m: NDArray[np.float64]
    residual_s: NDArray[np.float64]
    chi2: float
    moved_m: NDArray[np.float64]


@dataclass(frozen=True)
class TimeZeroRoutine(Routine[TimeZero]):
    """Measures first bounces on a coarse grid, twice one after the other so that a drift is seen."""

    columns: int = 11
    rows: int = 9
    exposure_s: float = 0.1

    makes = TimeZero

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

    def fit(self, files: Sequence[Path], state: RigState) -> TimeZero:
        """Return delay and heads; see `fit_path_delays`."""
        with ExitStack() as stack:
            scans = [stack.enter_context(ScanFile(path)) for path in files]
            bounces = [first_bounces(scan) for scan in scans]
            drift = _drift(scans, bounces)
            found = _fitted(scans, bounces, drift, state)
            return TimeZero(
                **origin(TimeZero, scans),
                valid_days=30,
                electronics_delay_s=found.delays.electronics_delay_s,
                electronics_delay_error_s=found.delay_error_s,
                laser_head_m=_point(found.delays.laser_head_m),
                detector_head_m=_point(found.delays.detector_head_m),
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

    def figure(self, files: Sequence[Path], found: TimeZero) -> Figure:
        """Draw arrivals and what the calibration leaves of them, over the wall and over the time."""
        from rig.calibrate.pictures import time_zero_figure

        with ExitStack() as stack:
            scans = [stack.enter_context(ScanFile(path)) for path in files]
            return time_zero_figure([first_bounces(scan) for scan in scans], found)


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
) -> FittedDelays:
    positions = len(np.unique(np.concatenate([one.mirror_rad for one in bounces]).round(6), axis=0))
    if positions < MIN_POSITIONS:
        raise CalibrationError(
            f"{scans[0].path}: {positions} positions with a first bounce are too few, at least "
            f"{MIN_POSITIONS} are needed: measure a grid of 11 x 9 or so over the whole wall"
        )
    arrivals_s = [one.arrival_s for one in bounces]
    if drift is not None:
        arrivals_s = [
            at_s - drift.rate * after_s for at_s, after_s in zip(arrivals_s, drift.after_s, strict=True)
        ]
    found = fit_path_delays(
        Arrivals(
            np.concatenate([one.mirror_rad for one in bounces]),
            np.concatenate(arrivals_s),
            np.concatenate([one.error_s for one in bounces]),
        ),
        scans[0].detector_m[0, 0],
        state,
    )
    for name, head_m in (("galvo", found.delays.laser_head_m), ("detector", found.delays.detector_head_m)):
        if not (np.isfinite(head_m).all() and head_m[2] > 0):
            raise CalibrationError(
                f"{scans[0].path}: the arrivals put the {name} behind the wall: these are no first bounces "
                "of this rig, or its positions in the configuration are wrong"
            )
    return found


def fit_path_delays(
    arrivals: Arrivals, detector_spot_m: NDArray[np.float64], state: RigState
) -> FittedDelays:
    """Fit delay, mirror and detector to the arrivals of first bounces.

    Mirror and detector are nearly exchangeable, and the delay trades with both, so that they are not well
    known one by one: what was known before, with its errors, keeps them in place. What imaging needs, the
    delay T0 + |g - x_p| / c + |x_c - h| / c, hardly depends on it. A calibrated mirror takes part as its
    spots, as well as they are known.

    Parameters
    ----------
    arrivals
        Of N first bounces.
    detector_spot_m
        (3,) x_c.
    state
        The rig as it is known before.
    """
    galvo, mirror_rad = state.calibrations.galvo, arrivals.mirror_rad
    spots_m = state.pointing.spots_m(mirror_rad)
    calibrated = []
    if galvo:
        # that many spots with such errors know as much as the model's ten numbers do
        error_m = max(galvo.spot_error_m, MIN_SPOT_ERROR_M) * np.sqrt(len(mirror_rad) / 10)
        calibrated = [Spots(mirror_rad, spots_m[:, :2], float(error_m))]
    fit = fit_geometry(state.config, [arrivals], calibrated, robust=True)
    delays, at_m = fit.rig.delays, detector_spot_m[None]

    def rectified_s(rig: RigGeometry) -> NDArray[np.float64]:
        return rig.delays.delay_s(rig.pointing.spots_m(mirror_rad), at_m)

    # a scan puts the spots where the model has them: what the arrivals move them by stays an error of its own
    remains_s = rectified_s(fit.rig) - delays.delay_s(spots_m, at_m)
    delay_variance = fit.covariance_of(lambda rig: np.array([rig.delays.electronics_delay_s]))
    return FittedDelays(
        delays=delays,
        delay_error_s=float(np.sqrt(delay_variance[0, 0])),
        rectified_error_s=np.sqrt(np.diag(fit.covariance_of(rectified_s)) + remains_s**2),
        spots_m=spots_m[:, :2],
        residual_s=arrivals.residuals(fit.rig) * arrivals.error_s,
        chi2=fit.chi2,
        moved_m=(fit.rig.pointing.spots_m(mirror_rad) - spots_m)[:, :2],
    )


def _point(place_m: NDArray[np.float64]) -> tuple[float, float, float]:
    x_m, y_m, z_m = place_m.tolist()
    return x_m, y_m, z_m


def _warnings(found: FittedDelays, drift: Drift | None, state: RigState) -> list[str]:
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
    if found.chi2 > MAX_CHI2:
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
