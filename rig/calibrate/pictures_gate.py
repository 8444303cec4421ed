"""The picture of the gate's edge and of the earliest opening over the wall."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.calibrate.gate_edge import fitted_at, part_error
from rig.calibrate.gate_sweep import Sweep
from rig.model.calibrations.kinds import GateOpening
from rig.model.quantities import show, show_length

_BLUE, _RED, _GREY = "#20639b", "#c1440e", "0.6"


def gate_figure(sweep: Sweep, found: GateOpening) -> Figure:
    """Draw what passes against the gate's lateness with the fit and its residuals, and the wall."""
    figure = Figure(figsize=(13, 7.5), dpi=100, facecolor="white", layout="constrained")
    axes = figure.subplot_mosaic(
        [["edge", "wall"], ["residuals", "wall"]], width_ratios=(1, 1.25), height_ratios=(2, 1)
    )
    figure.suptitle(
        f"gate opens at {show(found.gate_delay_s, 's', 5)} ± {show(found.gate_delay_error_s, 's', 2)}, "
        f"{show(found.gate_width_s, 's', 4)} wide; edge {show(found.edge_s, 's')} ± "
        f"{show(found.edge_error_s, 's', 2)} from 20 to 80 %"
    )
    _draw_edge(axes["edge"], axes["residuals"], sweep)
    _draw_wall(figure, axes["wall"], found)
    return figure


def _draw_edge(axes: Axes, below: Axes, sweep: Sweep) -> None:
    late_ps, edge = 1e12 * sweep.late_s, sweep.edge
    good = ~sweep.failed
    axes.plot(late_ps[:, good].ravel(), sweep.part[:, good].ravel(), ".", markersize=3, color=_BLUE,
              label="first bounce that passes, all positions")  # fmt: skip
    if sweep.failed.any():
        axes.plot(late_ps[:, ~good].ravel(), sweep.part[:, ~good].ravel(), "x", markersize=4, color=_RED,
                  label="where the gate fails")  # fmt: skip
    middle_ps, rise_ps = 1e12 * edge.offset_s, 1e12 * edge.rise_s
    grid_ps = np.linspace(middle_ps - 1.5 * rise_ps, middle_ps + 1.5 * rise_ps, 400)
    axes.plot(grid_ps, edge.passed(1e-12 * grid_ps), color="black", linewidth=1, label="fitted edge")
    shown = (middle_ps - 2.5 * rise_ps, middle_ps + 2.5 * rise_ps)
    axes.set(xlim=shown, ylabel="part of the first bounce", title="the edge meets the light")
    axes.legend(loc="upper right", fontsize="small")

    due = edge.passed(sweep.late_s)
    used = fitted_at(due) & good
    below.plot(
        late_ps[used],
        ((sweep.part - due)[used] / part_error(due, sweep.whole)[used]),
        ".",
        markersize=4,
        color=_BLUE,
    )
    below.axhline(0, color="0.5", linewidth=0.8)
    below.set(xlim=shown, xlabel="gate half open after the light's arrival (ps)",
              ylabel="residual (standard errors)")  # fmt: skip


def _draw_wall(figure: Figure, axes: Axes, found: GateOpening) -> None:
    spots = np.array(found.spots_m)
    earliest_ns = np.array([np.nan if one is None else 1e9 * one for one in found.earliest_s])
    can = np.isfinite(earliest_ns)
    drawn = axes.scatter(
        spots[can, 0], spots[can, 1], c=earliest_ns[can], s=900, marker="s", cmap="viridis", edgecolors="none"
    )
    figure.colorbar(drawn, ax=axes, label="earliest opening that blocks the first bounce (ns)", shrink=0.7)
    failed = np.array(found.failed)
    for where, colour, label in (
        (failed, _RED, "gate fails: first bounce not blocked"),
        (~can & ~failed, _GREY, f"blocked only too late for {show_length(found.nearest_m)}"),
    ):
        if where.any():
            axes.plot(*spots[where].T, "X", color=colour, markersize=13, linestyle="none", label=label)
    axes.set(
        aspect="equal",
        xlabel="x (m), as one faces the wall",
        ylabel="y (m)",
        title=f"{can.sum()} of {len(can)} positions blocked",
    )
    if not can.all():
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), fontsize="small", frameon=False)
