"""When to open the gate: late enough to block the first bounce, early enough to see the nearest object.

The attenuated beam goes over a coarse grid, once with the gate wide open, and then once for each of a row of
delays. How many first-bounce counts a delay leaves depends only on how much later than the light the gate
opens: so all positions together show one edge, each at other points of it, and the arrival times say when it
meets the light of each position. Arrivals between the measured positions, and up to the scan's corners,
follow from the geometry, with a smooth correction fitted to what was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import Floats, figures, require
from rig.calibrate.gate.edge import MIDDLE, Edge, fitted_at, part_error
from rig.calibrate.gate.sweep import Sweep, nearest_after_s, open_gate_bounces, read_sweep, smooth_arrivals
from rig.calibrate.raw import origin, reading
from rig.calibrate.routine import Routine, changed, histogram_limits, histogram_settings, recorded
from rig.calibrate.timing.peaks import FWHM_PER_SIGMA
from rig.errors import UsageError
from rig.model.calibrations.kinds import GateOpening
from rig.model.config import RigConfig
from rig.model.devices import Preparation
from rig.model.plan import ScanPlan
from rig.model.quantities import show, show_length
from rig.model.state import RigState

#: Part of the first bounce that may pass where it comes latest. It is 1e4 to 1e5 times the hidden scene's
#: light, so that this position keeps about as much of it as there is hidden light, and those where it comes
#: earlier none.
MAY_PASS = 1e-4
#: Openings are given in whole steps, the later one [s].
STEP_S = 10e-12
#: Between the wide open gate's end and its beginning at the next pulse [s].
CLOSED_S = 10e-9
#: Most delays that are tried: a sweep of a second each takes half an hour.
MOST_DELAYS = 2000


@dataclass(frozen=True)
class GateRoutine(Routine[GateOpening]):
    """Finds the gate's opening over the scanned part of the wall.

    Attributes
    ----------
    nearest_m
        Distance from the wall of the nearest object that shall be seen.
    columns, exposure_s
        Of the coarse grid, with as many rows as fit; and at each position and delay.
    step_s, before_s, after_s
        Delays are tried in such steps from so long before the first light's arrival to after the last one's.
    pulse_fwhm_s
        Full width at half maximum of the laser's pulse.
    """

    nearest_m: float = 0.5
    columns: int = 9
    exposure_s: float = 0.03
    step_s: float = 200e-12
    before_s: float = 0.8e-9
    after_s: float = 1.0e-9
    pulse_fwhm_s: float = 35e-12

    makes = GateOpening

    @property
    def sigma_s(self) -> float:
        """Standard deviation of the pulse."""
        return self.pulse_fwhm_s / FWHM_PER_SIGMA

    def setup(self, config: RigConfig) -> RigConfig:
        """Return a gated detector, and bins over the whole time between pulses."""
        period = RigState(config).sync_period_s
        width_s = histogram_limits(config).bin_width_covering(period, finest_s=8e-12)
        return changed(
            config,
            detector={"gated": True, "gate_delay_s": 0.0, "gate_width_s": period - CLOSED_S},
            tcspc={"offset_s": 0.0, "bin_width_s": width_s, "bins": int(period / width_s + 1e-6)},
        )

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Measure with the gate wide open, and then at each delay about the arrivals that this shows."""
        # an earlier opening must not be set again
        state = RigState(state.config, state.calibrations.without(GateOpening.kind))
        grid = self._plan(state.config).passes[0]

        def sweep(name: str, delays_s: list[float], width_s: float) -> Path:
            passes = tuple(
                grid.model_copy(update={"name": show(delay_s, "s", 5), "gate_s": (delay_s, width_s)})
                for delay_s in delays_s
            )
            return recorded(folder / name, ScanPlan(passes=passes), state, station, watch)

        files = [sweep("gate-open.h5", [0.0], state.config.detector.gate_width_s)]
        if not watch.should_stop():
            with reading(files) as (_, (wide,)):
                delays_s = self._delays_s(open_gate_bounces(wide).centre_s)
            files.append(sweep("gate-sweep.h5", delays_s, CLOSED_S))
        return files

    def fit(self, files: Sequence[Path], state: RigState) -> GateOpening:
        """Return the opening; the file with the widest gate says what passes it when it is open."""
        with reading(files) as (scans, passes):
            sweep = read_sweep(passes, self.sigma_s)
            about = origin(GateOpening, scans)
        config, legs, edge = state.config, state.delays, sweep.edge
        spot_m = state.channels[0].spot_m
        blocked_s, open_s = edge.blocks_from_s(MAY_PASS), edge.open_until_s(MAY_PASS)
        wanted_m = ScanPlan.grid(config).spots_m
        spots_m = np.concatenate([sweep.spots_m, wanted_m])
        arrival_s, error_s = smooth_arrivals(sweep, spots_m, legs)
        measured = len(sweep.spots_m)
        earliest_s = arrival_s + blocked_s
        latest_s = arrival_s + open_s + nearest_after_s(spots_m, legs, spot_m, self.nearest_m)
        failed = np.append(sweep.failed, np.zeros(len(wanted_m), bool))
        limit_s = latest_s[~failed].min()
        can = ~failed & (earliest_s <= limit_s)
        require(
            can.any(),
            f"{files[0]}: no opening both blocks the first bounce somewhere and shows an object at "
            f"{show_length(self.nearest_m)}: the earliest that blocks is {show(earliest_s.min(), 's', 5)}, "
            f"the latest that shows it {show(limit_s, 's', 5)}. Give a larger --nearest, or scan less of "
            "the wall",
        )
        last = int(np.where(can, earliest_s, -np.inf).argmax())
        delay_s = float(np.ceil(earliest_s[last] / STEP_S - 1e-6) * STEP_S)
        return GateOpening(
            **about,
            valid_days=30,
            gate_delay_s=delay_s,
            gate_delay_error_s=float(np.hypot(edge.blocks_error_s(), error_s[last])),
            gate_width_s=_width_s(config, edge, delay_s, float(arrival_s.min())),
            nearest_m=self.nearest_m,
            passed=float(edge.passed(delay_s - arrival_s[last])),
            edge_s=MIDDLE * edge.rise_s,
            edge_error_s=MIDDLE * float(np.sqrt(edge.covariance[1, 1])),
            offset_s=edge.offset_s,
            residual=edge.residual,
            spots_m=[(float(x), float(y)) for x, y, _ in sweep.spots_m],
            earliest_s=[float(e) if c else None for e, c in zip(earliest_s, can[:measured], strict=False)],
            latest_s=latest_s[:measured].tolist(),
            failed=sweep.failed.tolist(),
        )

    def figure(self, files: Sequence[Path], found: GateOpening) -> Figure:
        """Draw what passes against the gate's lateness with its residuals, and the opening over the wall."""
        with reading(files) as (_, passes):
            sweep = read_sweep(passes, self.sigma_s)
        figure, axes = figures.panels(
            f"gate opens at {show(found.gate_delay_s, 's', 5)} ± {show(found.gate_delay_error_s, 's', 2)}, "
            f"{show(found.gate_width_s, 's', 4)} wide; edge {show(found.edge_s, 's')} ± "
            f"{show(found.edge_error_s, 's', 2)} from 20 to 80 %",
            [["edge", "wall"], ["residuals", "wall"]], (13, 7.5),
            width_ratios=(1, 1.25), height_ratios=(2, 1),
        )  # fmt: skip
        _draw_edge(axes["edge"], axes["residuals"], sweep)
        _draw_wall(axes["wall"], found)
        return figure

    def _plan(self, config: RigConfig) -> ScanPlan:
        """Return as coarse a grid as was asked for over the scan's, no larger than it."""
        scan = config.scan
        wide_m, high_m = (scan.columns - 1) * scan.spacing_m, (scan.rows - 1) * scan.spacing_m
        spacing_m = wide_m / max(self.columns - 1, 1)
        rows = int(high_m / spacing_m + 1e-9) + 1
        return ScanPlan.grid(
            config,
            columns=self.columns,
            rows=rows,
            spacing_m=spacing_m,
            exposure_s=self.exposure_s,
            preparation=Preparation.ATTENUATE,
        )

    def _delays_s(self, arrival_s: Floats) -> list[float]:
        """Return the delays to try, in whole picoseconds."""
        first_s, last_s = max(arrival_s.min() - self.before_s, 0.0), arrival_s.max() + self.after_s
        steps = (last_s - first_s) / self.step_s
        if not steps <= MOST_DELAYS:
            least = show((last_s - first_s) / MOST_DELAYS, "s")
            raise UsageError(
                f"--step {show(self.step_s, 's')} is too fine: {MOST_DELAYS} delays need {least} or more"
            )
        return np.arange(first_s, last_s + self.step_s, self.step_s).round(12).tolist()


def _width_s(config: RigConfig, edge: Edge, delay_s: float, first_arrival_s: float) -> float:
    """Return a width that ends with the histogram, but before the next pulse's first bounce."""
    harp = histogram_settings(config)
    end_s = harp.offset_s + harp.bins * harp.bin_width_s
    next_s = first_arrival_s + edge.open_until_s(MAY_PASS) + 1 / config.laser.repetition_hz
    require(
        end_s > delay_s,
        f"the histogram ends {show(end_s, 's', 4)} after the sync pulse, before the gate may open at "
        f"{show(delay_s, 's', 4)}: choose more bins or a later tcspc.offset",
    )
    return round(min(end_s, next_s) - delay_s, 11)


def _draw_edge(axes: Axes, below: Axes, sweep: Sweep) -> None:
    late_ps, edge = 1e12 * sweep.late_s, sweep.edge
    for where, marker, colour, label in (
        (~sweep.failed, ".", figures.BLUE, "first bounce that passes, all positions"),
        (sweep.failed, "x", figures.RED, "where the gate fails"),
    ):
        if where.any():
            parts = late_ps[:, where].ravel(), sweep.part[:, where].ravel()
            axes.plot(*parts, marker, markersize=4, color=colour, label=label)
    reach_ps = 1e12 * edge.rise_s * np.linspace(-2.5, 2.5, 600)
    grid_ps = 1e12 * edge.offset_s + reach_ps
    axes.plot(grid_ps, edge.passed(1e-12 * grid_ps), color="black", linewidth=1, label="fitted edge")
    axes.set(xlim=grid_ps[[0, -1]], ylabel="part of the first bounce", title="the edge meets the light")
    axes.legend(loc="upper right", fontsize="small")
    due = edge.passed(sweep.late_s)
    used = fitted_at(due) & ~sweep.failed
    error = part_error(due, sweep.whole)[used]
    figures.residuals(below, late_ps[used], (sweep.part - due)[used] / error)
    below.set(xlim=grid_ps[[0, -1]], xlabel="gate half open after the light's arrival (ps)",
              ylabel="residual (standard errors)")  # fmt: skip


def _draw_wall(axes: Axes, found: GateOpening) -> None:
    spots_m, failed = np.array(found.spots_m), np.array(found.failed)
    earliest_ns = 1e9 * np.array(found.earliest_s, dtype=float)
    can = np.isfinite(earliest_ns)
    label = "earliest opening that blocks the first bounce (ns)"
    figures.wall_map(axes, spots_m[can], earliest_ns[can], label, size=900)
    for where, colour, label in (
        (failed, figures.RED, "gate fails: first bounce not blocked"),
        (~can & ~failed, figures.GREY, f"blocked only too late for {show_length(found.nearest_m)}"),
    ):
        if where.any():
            axes.plot(*spots_m[where].T, "X", color=colour, markersize=13, label=label)
    axes.set_title(f"{can.sum()} of {len(can)} positions blocked")
    if not can.all():
        figures.legend_below(axes)
