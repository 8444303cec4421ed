"""Time zero: when the pulse is on the wall, from first bounces all over it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.calibrate import Floats, figures, require
from rig.calibrate.geometry_fit import Arrivals, RigGeometry, Spots, fit_geometry
from rig.calibrate.raw import Raw, origin, reading
from rig.calibrate.timing.first_bounce import FirstBounceRoutine, first_bounces, mirror_rad
from rig.calibrate.timing.peaks import Peaks
from rig.model.calibrations.kinds import TimeZero
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
    delays, delay_error_s
        Delay and heads, and the standard error of the delay alone, which trades with the heads.
    rectified_error_s
        (N,) standard error of what is subtracted from recorded time at each spot.
    spots_m, moved_m
        (N, 2) where the model of the mirror puts the beam, and by how much the arrivals move it.
    residual_s, chi2
        (N,) residuals, and their mean square by their errors, corrected for what was fitted; about 1.
    """

    delays: PathDelays
    delay_error_s: float
    rectified_error_s: Floats
    spots_m: Floats
    moved_m: Floats
    residual_s: Floats
    chi2: float


@dataclass(frozen=True)
class Drift:
    """How arrivals drift: seconds a second, its standard error, and where each arrival is in time."""

    rate: float
    error: float
    after_s: list[Floats]


@dataclass(frozen=True)
class TimeZeroRoutine(FirstBounceRoutine[TimeZero]):
    """Measures first bounces on a coarse grid, twice one after the other so that a drift is seen."""

    makes, files = TimeZero, ("time-zero-1.h5", "time-zero-2.h5")

    def fit(self, files: Sequence[Path], state: RigState) -> TimeZero:
        """Return delay and heads; see `fit_path_delays`."""
        with reading(files, whole=False) as (scans, passes):
            visits = [first_bounces(raw) for raw in passes]
            drift = _drift(passes, visits)
            found = _fitted(passes, visits, drift, state)
            return TimeZero(
                **origin(TimeZero, scans),
                **in_common(found.delays, found.rectified_error_s, passes[0]),
                electronics_delay_error_s=found.delay_error_s,
                residual_s=float(np.sqrt((found.residual_s**2).mean())),
                chi2=found.chi2,
                positions=len(np.unique(found.spots_m, axis=0)),
                drift_per_minute_s=None if drift is None else 60 * drift.rate,
                drift_per_minute_error_s=None if drift is None else 60 * drift.error,
                spots_m=[(round(x_m, 6), round(y_m, 6)) for x_m, y_m in found.spots_m.tolist()],
                residuals_s=[round(residual_s, 16) for residual_s in found.residual_s.tolist()],
                warnings=_warnings(found, drift, state),
            )

    def figure(self, files: Sequence[Path], found: TimeZero) -> Figure:
        """Draw one first bounce with its fit, residuals over the wall, and one after the other."""
        with reading(files, whole=False) as (_, passes):
            visits = [first_bounces(raw) for raw in passes]
        figure, axes = figures.panels(
            f"time zero: delay {show(found.electronics_delay_s, 's', 6)}, rectified time known to "
            f"{show(found.rectified_error_s, 's', 2)} (worst {show(found.rectified_error_worst_s, 's', 2)}), "
            f"residuals {show(found.residual_s or 0.0, 's', 2)}, chi² {found.chi2:.2f}",
            [["peak", "wall", "order"]], (13, 4), width_ratios=(1, 1.2, 1.2),
        )  # fmt: skip
        draw_peak(axes["peak"], visits[0], int(visits[0].counts.argmax()), "arrival")
        axes["peak"].set(title="a first bounce", ylim=(0.5, None), yscale="log")
        ends = np.cumsum([len(one.index) for one in visits])
        residuals_ps = np.split(1e12 * np.array(found.residuals_s), ends[:-1])
        label = "measured less fitted (ps)"
        figures.wall_map(
            axes["wall"], found.spots_m[: ends[0]], residuals_ps[0], label,
            reach=1e12 * max(map(abs, found.residuals_s)),
        )  # fmt: skip
        axes["wall"].set_title("over the wall")
        start = 0
        for number, (one, residual_ps) in enumerate(zip(visits, residuals_ps, strict=True)):
            figures.residuals(
                axes["order"], start + one.index, residual_ps, 1e12 * one.centre_error_s,
                color=figures.SERIES[number], label=f"visit {number + 1}",
            )  # fmt: skip
            start += int(one.index.max()) + 1
        axes["order"].set(title="one after the other", xlabel="position", ylabel=label)
        axes["order"].margins(y=0.2)
        axes["order"].legend(frameon=False, ncols=len(visits), loc="upper right")
        return figure


def draw_peak(axes: Axes, found: Peaks, number: int, what: str) -> None:
    """Draw the counts of one peak with the fit, and what its centre is."""
    time_ns, live = found.time_s[number] * 1e9, found.live[number]
    axes.plot(time_ns, found.observed[number] / live, ".", color=figures.GREY, markersize=4, label="counts")
    axes.plot(time_ns, found.model[number] / live, color=figures.BLUE, linewidth=1.4, label="fit")
    axes.axvline(found.centre_s[number] * 1e9, color=figures.RED, linewidth=1, label=what)
    axes.set(xlabel="time after sync (ns)", ylabel="counts a bin")
    axes.legend(frameon=False)


def in_common(delays: PathDelays, rectified_error_s: Floats, raw: Raw) -> dict[str, Any]:
    """Return what every calibration of time zero holds, with (N,) errors of rectified time."""
    return {
        "valid_days": 30,
        "electronics_delay_s": delays.electronics_delay_s,
        "laser_head_m": tuple(delays.laser_head_m.tolist()),
        "detector_head_m": tuple(delays.detector_head_m.tolist()),
        "detector_spot_m": tuple(raw.detector_spot_m.tolist()),
        "rectified_error_s": float(np.median(rectified_error_s)),
        "rectified_error_worst_s": float(rectified_error_s.max()),
    }


def _drift(passes: Sequence[Raw], visits: Sequence[Peaks]) -> Drift | None:
    """Compare two visits of the same positions; None where there were none.

    Within one visit a drift cannot be told from a pivot that stands higher, since lines follow each other
    upwards. The time between visits is that of exposures, settling and readout; the pause between two files
    is not in it.
    """
    angles = [raw.mirror_rad for raw in passes]
    if len(passes) != 2 or angles[0] is None or angles[1] is None:
        return None
    if angles[0].shape != angles[1].shape or np.abs(angles[0] - angles[1]).max() > 1e-6:
        return None
    (first, second), config = visits, passes[0].config
    _, i, j = np.intersect1d(first.index, second.index, return_indices=True)
    step_s = float(np.nanmedian(passes[0].live_s)) + config.galvo.settle_time_s + config.tcspc.readout_time_s
    between_s = len(passes[0].live_s) * step_s
    variance = first.centre_error_s[i] ** 2 + second.centre_error_s[j] ** 2
    later_s = float(np.average(second.centre_s[j] - first.centre_s[i], weights=1 / variance))
    middle_s = between_s - step_s / 2
    starts_s = ((first, -middle_s), (second, between_s - middle_s))
    after_s = [np.asarray(one.index * step_s + start_s, dtype=np.float64) for one, start_s in starts_s]
    return Drift(later_s / between_s, float((1 / variance).sum() ** -0.5) / between_s, after_s)


def _fitted(
    passes: Sequence[Raw], visits: Sequence[Peaks], drift: Drift | None, state: RigState
) -> FittedDelays:
    name = passes[0].label
    angles = np.concatenate([mirror_rad(raw)[one.index] for raw, one in zip(passes, visits, strict=True)])
    positions = len(np.unique(angles.round(6), axis=0))
    require(
        positions >= MIN_POSITIONS,
        f"{name}: {positions} positions with a first bounce are too few, at least {MIN_POSITIONS} are "
        "needed: measure a grid of about 11 x 9 over the whole wall",
    )
    arrival_s = np.concatenate([one.centre_s for one in visits])
    if drift is not None:
        arrival_s = arrival_s - drift.rate * np.concatenate(drift.after_s)
    arrivals = Arrivals(angles, arrival_s, np.concatenate([one.centre_error_s for one in visits]))
    found = fit_path_delays(arrivals, passes[0].detector_spot_m, state)
    for what, head_m in (("galvo", found.delays.laser_head_m), ("detector", found.delays.detector_head_m)):
        require(
            np.isfinite(head_m).all() and head_m[2] > 0,
            f"{name}: the arrivals put the {what} behind the wall: these are not first bounces of this rig, "
            "or its positions in the configuration are wrong",
        )
    return found


def fit_path_delays(arrivals: Arrivals, detector_spot_m: Floats, state: RigState) -> FittedDelays:
    """Fit delay, mirror and detector to the arrivals of N first bounces; the detector looks at x_c.

    Mirror and detector are nearly exchangeable, and the delay trades with both, so that they are not well
    known one by one: what was known before, with its errors, keeps them in place. What imaging needs, the
    delay T0 + |g - x_p| / c + |x_c - h| / c, hardly depends on it. A calibrated mirror takes part as its
    spots, as well as they are known.
    """
    galvo, angles = state.calibrations.galvo, arrivals.mirror_rad
    spots_m = state.pointing.spots_m(angles)
    calibrated = []
    if galvo:
        # that many spots with such errors know as much as the model's twelve numbers do
        error_m = max(galvo.spot_error_m, MIN_SPOT_ERROR_M) * np.sqrt(len(angles) / 12)
        calibrated = [Spots(angles, spots_m[:, :2], float(error_m))]
    fit = fit_geometry(state.config, [arrivals], calibrated, robust=True)
    delays, at_m = fit.rig.delays, detector_spot_m[None]

    def rectified_s(rig: RigGeometry) -> Floats:
        return rig.delays.delay_s(rig.pointing.spots_m(angles), at_m)

    # a scan puts the spots where the model has them: what the arrivals move them by stays an error of its own
    remains_s = rectified_s(fit.rig) - delays.delay_s(spots_m, at_m)
    delay_variance = fit.covariance_of(lambda rig: np.array([rig.delays.electronics_delay_s]))
    return FittedDelays(
        delays=delays,
        delay_error_s=float(np.sqrt(delay_variance[0, 0])),
        rectified_error_s=np.sqrt(np.diag(fit.covariance_of(rectified_s)) + remains_s**2),
        spots_m=spots_m[:, :2],
        moved_m=(fit.rig.pointing.spots_m(angles) - spots_m)[:, :2],
        residual_s=arrivals.residuals(fit.rig) * arrivals.error_s,
        chi2=fit.chi2,
    )


def _warnings(found: FittedDelays, drift: Drift | None, state: RigState) -> list[str]:
    warnings, galvo = [], state.calibrations.galvo
    if galvo is None:
        moved_m = float(np.sqrt((found.moved_m**2).sum(axis=1).mean()))
        worst = show(float(found.rectified_error_s.max()), "s", 2)
        warnings.append(
            f"the galvo is not calibrated: arrivals put the spots {show_length(moved_m, 2)} from their "
            f"assumed places, and rectified time is known only to {worst}. Run rig calibrate galvo, and "
            "this again"
        )
    if found.chi2 > MAX_CHI2:
        reason = (
            "the calibration of the galvo does not hold (rig calibrate galvo)"
            if galvo
            else "the mirror is mounted in another way than is configured"
        )
        warnings.append(
            f"residuals are {np.sqrt(found.chi2):.1f} times their errors, which are increased to that value: "
            f"{reason}, or something other than the wall reflects"
        )
    if drift is not None and abs(drift.rate) > SURE * drift.error:
        warnings.append(
            f"arrivals drift by {show(60 * drift.rate, 's', 2)} a minute: "
            "time zero is valid for the middle of the measurement. Let the rig warm up"
        )
    return warnings
