"""By how much the mirror trails its command: first bounces along lines there and back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures, require
from rig.calibrate.raw import Raw, origin, reading
from rig.calibrate.routine import Routine, changed, histogram_limits, recorded
from rig.calibrate.timing.first_bounce import first_bounces, free_running, mirror_rad
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.kinds import MirrorLag
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.quantities import show
from rig.model.state import RigState
from rig.model.sweep import Trajectories

#: Bins of the histograms, wide because there are many; the fit integrates over them.
BIN_WIDTH_S = 16e-12
#: Fewest counts of a first bounce: short exposures have few, and there are many of them.
MIN_COUNTS = 20
#: A critically damped servo trails a ramp by 2 / w, and what a turn leaves decays as (1 + w t) exp(-w t):
#: after so many lags it is 0.3 %.
SETTLED_LAGS = 4.0
#: What the path delays may be wrong by: a polynomial along x of this degree, and so along y to first order.
#: Errors of places a distance d away go with (x / d)^n: at 0.9 m of 2.5 m the next term is 1e-3 of the first.
DEGREE = 6
#: Steps from a lag of zero; each leaves the square of what was missing, and the third less than 1 ns.
NEWTON_STEPS = 4
#: Fewest positions: two for each number that is fitted.
MIN_POSITIONS = 2 * (2 * (DEGREE + 1) + 1)
#: Least part of the positions that is to be passed the other way.
MIN_BACK = 0.25
#: Largest mean square of residuals in their errors; with hundreds of positions chance makes it 0.8 to 1.2.
MAX_CHI2 = 2.0
#: A lag is known if its standard error is at most this part of a point's time.
MAX_ERROR = 0.1
#: A negative lag beyond so many standard errors is no chance.
SURE = 4.0
#: The lag is shown in at most so many parts of a line.
PARTS = 16


@dataclass(frozen=True)
class Swept:
    """N first bounces along lines.

    Attributes
    ----------
    spots_m, speed_m_per_s
        (N, 3) commanded spots, and how fast the command moves them.
    begins_s, ends_s
        (N,) when the photons of each point began after its line's first tick, and ended before its last
        point's end.
    arrival_s, error_s
        (N,) when first bounces arrived, and standard errors.
    reach_m
        How far from the wall's middle the lines reach.
    taken_s
        By how much the mirror was taken to trail.
    point_s
        Time of a point.
    """

    spots_m: Floats
    speed_m_per_s: Floats
    begins_s: Floats
    ends_s: Floats
    arrival_s: Floats
    error_s: Floats
    reach_m: float
    taken_s: float
    point_s: float

    def __getitem__(self, which: NDArray[np.bool_]) -> "Swept":
        names = ("spots_m", "speed_m_per_s", "begins_s", "ends_s", "arrival_s", "error_s")
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def even(self, lag_s: float) -> NDArray[np.bool_]:
        """(N,) where the mirror moved evenly, were this its lag: one turn is settled, the next to come."""
        tiny_s = 1e-3 * self.point_s
        settled = self.begins_s >= SETTLED_LAGS * lag_s - tiny_s
        return np.asarray(settled & (self.ends_s >= -tiny_s))

    def places_m(self, lag_s: float) -> Floats:
        """(N, 3) where the mirror was in the mean, were this its lag."""
        return self.spots_m + self.speed_m_per_s * (self.taken_s - lag_s)


@dataclass(frozen=True)
class FittedLag:
    """What first bounces say of the lag.

    Attributes
    ----------
    lag_s, error_s
        And standard error, raised where residuals are beyond their errors.
    chi2
        Mean square of the residuals in their errors, corrected for what was fitted; about 1.
    used
        (N,) where the mirror moved evenly, which was fitted.
    smooth_s
        By how much the path delays are wrong: coefficients of the polynomial.
    """

    lag_s: float
    error_s: float
    chi2: float
    used: NDArray[np.bool_]
    smooth_s: Floats

    def arrivals_s(self, seen: Swept, lag_s: float, delays: PathDelays) -> Floats:
        """(N,) when first bounces are to arrive with some lag."""
        return _arrivals_s(seen, lag_s, self.smooth_s, delays)


def fit_lag(seen: Swept, delays: PathDelays, name: str) -> FittedLag:
    """Fit the lag, and what is smooth and does not depend on the direction of motion.

    The mirror is at s - v lag when it is commanded to s with speed v, so that a first bounce arrives at
    A(s - v lag). A is what the path delays predict, and a polynomial for what is wrong with them.

    Raises CalibrationError if positions are too few, no line runs back, or one lag does not explain all.
    """
    used, lag_s = np.ones(len(seen.arrival_s), bool), seen.taken_s
    while True:
        part = seen[used]
        _require_lines_back(part, name)
        found = _fit(part, lag_s, delays)
        lag_s = found.lag_s
        even = used & seen.even(lag_s)
        if (even == used).all():
            break
        used = even
    require(
        found.chi2 <= MAX_CHI2,
        f"{name}: residuals are {np.sqrt(found.chi2):.1f} times their errors, "
        "one lag does not explain them: something other than the wall reflects, "
        "or the mirror does not follow its command evenly",
    )
    require(
        found.error_s <= MAX_ERROR * seen.point_s,
        f"{name}: the lag is known to {show(found.error_s, 's', 2)} only: measure more rows, attenuate less",
    )
    require(
        lag_s >= -SURE * found.error_s,
        f"{name}: the mirror seems to be {show(-lag_s, 's', 2)} ahead of its command: markers come too late, "
        "or rows are scanned in the direction opposite to the plan",
    )
    return replace(found, used=used)


def _require_lines_back(seen: Swept, name: str) -> None:
    positions, there = len(seen.arrival_s), int((seen.speed_m_per_s[:, 0] > 0).sum())
    require(
        positions >= MIN_POSITIONS,
        f"{name}: {positions} positions at which the mirror moves evenly are too few, at least "
        f"{MIN_POSITIONS} are needed: measure longer lines, or more rows",
    )
    require(
        min(there, positions - there) >= MIN_BACK * positions,
        f"{name}: {there} of {positions} positions were scanned to the right, the others to the left: "
        "a lag is seen only if lines run in both directions. Measure at least two rows, in the order snake",
    )


def _polynomials(places_m: Floats, reach_m: float) -> Floats:
    """(N, 2 (DEGREE + 1)) polynomials at (N, 3) places."""
    x, y, _ = (places_m / reach_m).T
    along_x = legvander(x, DEGREE)
    return np.concatenate([along_x, along_x * y[:, None]], axis=1)


def _arrivals_s(seen: Swept, lag_s: float, smooth_s: Floats, delays: PathDelays) -> Floats:
    places_m = seen.places_m(lag_s)
    return delays.delay_s(places_m, places_m) + _polynomials(places_m, seen.reach_m) @ smooth_s


def _slopes(seen: Swept, lag_s: float, smooth_s: Floats, delays: PathDelays) -> Floats:
    """(N,) by how much arrivals come later with each second of lag."""
    tiny_s = 1e-3 * seen.point_s
    later_s, earlier_s = (_arrivals_s(seen, lag_s + by_s, smooth_s, delays) for by_s in (tiny_s, -tiny_s))
    return (later_s - earlier_s) / (2 * tiny_s)


def _fit(seen: Swept, lag_s: float, delays: PathDelays) -> FittedLag:
    """Fit by Newton's method (Gauss); only the lag is not linear, and hardly."""
    smooth_s = np.zeros(2 * (DEGREE + 1))
    units_s = np.repeat([1e-3, 1e-12], [1, len(smooth_s)])  # so that lag and polynomials are alike in size
    for _ in range(NEWTON_STEPS):
        basis = _polynomials(seen.places_m(lag_s), seen.reach_m)
        slopes = _slopes(seen, lag_s, smooth_s, delays)
        design = np.column_stack([slopes, basis]) * units_s / seen.error_s[:, None]
        left = (seen.arrival_s - _arrivals_s(seen, lag_s, smooth_s, delays)) / seen.error_s
        step_s = np.linalg.lstsq(design, left)[0] * units_s
        lag_s, smooth_s = lag_s + float(step_s[0]), smooth_s + step_s[1:]
    left = (seen.arrival_s - _arrivals_s(seen, lag_s, smooth_s, delays)) / seen.error_s
    chi2 = float((left**2).sum() / (len(left) - len(units_s)))
    variance = np.linalg.inv(design.T @ design)[0, 0] * max(chi2, 1.0)
    return FittedLag(lag_s, float(np.sqrt(variance) * units_s[0]), chi2, np.ones(len(left), bool), smooth_s)


@dataclass(frozen=True)
class AlongLine:
    """The lag in parts of the lines: when after their first tick, the lag there, and its standard error."""

    after_s: Floats
    lag_s: Floats
    error_s: Floats


def lag_along(seen: Swept, found: FittedLag, delays: PathDelays) -> AlongLine:
    """Return the lag that each part of the lines has by itself, those that were not fitted among them.

    Of small changes: what is left of the arrivals, by what a change of the lag changes.
    """
    at_s = found.arrivals_s(seen, found.lag_s, delays)
    slope = _slopes(seen, found.lag_s, found.smooth_s, delays)
    after_s = seen.begins_s - seen.begins_s.min()
    point = np.rint(after_s / seen.point_s).astype(np.int64)
    # parts grow with the time since the turn, whose traces are short
    first = np.unique(np.geomspace(1, point.max() + 2, PARTS + 1).round().astype(np.int64)) - 1
    part = np.searchsorted(first, point, "right") - 1
    number, information, change, sum_s = (
        np.bincount(part, weights, PARTS)
        for weights in (
            np.ones(len(part)),
            (slope / seen.error_s) ** 2,
            slope * (seen.arrival_s - at_s) / seen.error_s**2,
            after_s,
        )
    )
    told = information > 0
    number, information, change, sum_s = (one[told] for one in (number, information, change, sum_s))
    return AlongLine(sum_s / number, found.lag_s + change / information, np.asarray(1 / np.sqrt(information)))


@dataclass(frozen=True)
class LagRoutine(Routine[MirrorLag]):
    """Sweeps over a few rows at the scan's spacing, there and back, the laser attenuated.

    Attributes
    ----------
    rows
        As far apart as positions; half of them are passed to the left.
    point_s
        Time of a point.
    """

    rows: int = 6
    point_s: float = 1e-3

    makes, tagged = MirrorLag, True

    def impossible(self, config: RigConfig) -> str:
        """Say that a point clock is missing."""
        return "" if config.point_clock else "the mirror of this rig always stops: it has no point clock"

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the detector free running, and a mirror that is taken to follow at once."""
        width_s = histogram_limits(config).bin_width_covering(0.0, finest_s=BIN_WIDTH_S)
        wide = changed(config, tcspc={"bin_width_s": width_s}, galvo={"lag_s": 0.0})
        return free_running(wide)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Record one sweep."""
        plan = ScanPlan.grid(
            state.config,
            rows=self.rows,
            exposure_s=self.point_s,
            skip_m=0.0,
            motion="continuous",
            preparation=Preparation.ATTENUATE,
        )
        without = RigState(state.config, state.calibrations.without(MirrorLag.kind))
        return [recorded(folder / "lag.h5", plan, without, station, watch)]

    def fit(self, files: Sequence[Path], state: RigState) -> MirrorLag:
        """Return the lag; see `fit_lag`."""
        with reading(files) as (scans, passes):
            seen, delays = swept(scans, passes)
            found = fit_lag(seen, delays, str(files[0]))
            along = lag_along(seen, found, delays)
            return MirrorLag(
                **origin(MirrorLag, scans),
                valid_days=180,
                lag_s=max(found.lag_s, 0.0),
                lag_error_s=found.error_s,
                point_s=seen.point_s,
                speed_m_per_s=float(np.median(np.abs(seen.speed_m_per_s[:, 0]))),
                chi2=found.chi2,
                positions=int(found.used.sum()),
                after_s=along.after_s.round(6).tolist(),
                lag_after_s=along.lag_s.round(9).tolist(),
                lag_after_error_s=along.error_s.round(9).tolist(),
            )

    def figure(self, files: Sequence[Path], found: MirrorLag) -> Figure:
        """Draw what the lag does to arrivals there and back, what the fit leaves, and the lag along lines."""
        with reading(files) as (scans, passes):
            seen, delays = swept(scans, passes)
        fit = fit_lag(seen, delays, str(files[0]))
        without_s = fit.arrivals_s(seen, seen.taken_s, delays)
        odd_ps, left_ps = (
            1e12 * (one_s - without_s) for one_s in (seen.arrival_s, fit.arrivals_s(seen, fit.lag_s, delays))
        )
        figure, axes = figures.panels(
            f"the mirror trails its command by {show(found.lag_s, 's', 4)} ± "
            f"{show(found.lag_error_s, 's', 2)} at {found.speed_m_per_s:.3g} m/s, chi² {found.chi2:.2f}",
            [["odd", "along"], ["left", "along"]], (13, 6), width_ratios=(1.6, 1), height_ratios=(2, 1),
        )  # fmt: skip
        there = seen.speed_m_per_s[:, 0] > 0
        for run, color, label in (
            (there, figures.BLUE, "to the right"),
            (~there, figures.RED, "to the left"),
        ):
            x_m, order = seen.spots_m[run, 0], np.argsort(seen.spots_m[run, 0])
            axes["odd"].plot(x_m, odd_ps[run], ".", color=color, markersize=3, alpha=0.5, label=label)
            axes["odd"].plot(x_m[order], left_ps[run][order], color=color, linewidth=1.4)
            used = run & fit.used
            figures.residuals(
                axes["left"], seen.spots_m[used, 0], (odd_ps - left_ps)[used], color=color, markersize=3
            )
        axes["odd"].set(title="arrivals, by their expected times without a lag", ylabel="later (ps)")
        axes["odd"].legend(frameon=False)
        axes["left"].set(xlabel="x (m)", ylabel="measured less\nfitted (ps)")
        figures.residuals(
            axes["along"], 1e3 * np.array(found.after_s), 1e3 * (np.array(found.lag_after_s) - found.lag_s),
            1e3 * np.array(found.lag_after_error_s),
        )  # fmt: skip
        axes["along"].set(
            title="lag in parts of the lines", ylabel="more than in the mean (ms)",
            xscale="symlog", xlabel="time after the line's first point (ms)",
            xticks=(0, 1, 10, 100), xticklabels=("0", "1", "10", "100"),
        )  # fmt: skip
        return figure


def swept(scans: Sequence[ScanFile], passes: Sequence[Raw]) -> tuple[Swept, PathDelays]:
    """Read first bounces along the lines of one scan, and the path delays that are to be expected.

    Raises CalibrationError if there is more than one pass, or its mirror stopped at each point.
    """
    (scan, *_), (raw, *_) = scans, passes
    plan, state = scan.plan, scan.state
    require(len(passes) == 1, f"{len(passes)} passes: the lag is measured in one, lag.h5")
    if plan is None or state is None or not plan.continuous:
        raise CalibrationError(
            f"{raw.label} was measured with a mirror that stops at each position: it does not show a lag"
        )
    found, angles = first_bounces(raw, min_counts=MIN_COUNTS), mirror_rad(raw)
    point_s, taken_s = plan.passes[0].exposure_s, state.mirror_lag_s
    paths = Trajectories(plan, angles, raw.config.galvo.turn_time_s)
    speed, begins_s, ends_s = np.zeros_like(raw.laser_m), *np.zeros((2, len(angles)))
    for line in (line for sweep in paths.sweeps(range(len(plan))) for line in sweep.lines):
        steps, at_s = slice(line.steps.start, line.steps.stop), (line.ticks - line.ticks[0]) * point_s
        require(len(at_s) > 1, f"{raw.label} has lines of one position: the mirror does not move along them")
        speed[steps] = np.gradient(raw.laser_m[steps], at_s, axis=0)
        begins_s[steps] = at_s + taken_s
        ends_s[steps] = at_s[-1] - at_s - taken_s
    at, reach_m = found.index, float(np.abs(raw.laser_m).max())
    seen = Swept(
        raw.laser_m[at], speed[at], begins_s[at], ends_s[at], found.centre_s, found.centre_error_s,
        reach_m, taken_s, point_s,
    )  # fmt: skip
    return seen, state.delays
