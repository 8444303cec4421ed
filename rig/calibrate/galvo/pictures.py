"""Pictures of the calibrated mirror."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from recon.capture import C_M_PER_S
from rig.calibrate.geometry_fit import Floats
from rig.model.calibrations.kinds import GalvoModel

_MEASURED, _MODEL, _AREA = "#1f5fa8", "#c8502d", "0.55"


def spots_figure(model: GalvoModel) -> Figure:
    """Draw measured spots with what the model leaves, magnified, and how these residuals are distributed."""
    angles, spots_m = np.array(model.mirror_rad), np.array(model.spots_m)
    apart_m = spots_m - model.pointing().spots_m(angles)[:, :2]
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    wall, cloud = figure.subplots(1, 2, width_ratios=(1.9, 1))
    draw_wall(wall, model)
    largest_m = float(np.linalg.norm(apart_m, axis=1).max())
    magnified = _round(0.2 / max(largest_m, 1e-9))
    wall.plot(*spots_m.T, "o", color=_MEASURED, markersize=3, label="measured spot")
    wall.quiver(
        *spots_m.T, *(magnified * apart_m).T, angles="xy", scale_units="xy", scale=1, width=0.003,
        color=_MODEL, label=f"measured less modelled, {magnified:g} times",
    )  # fmt: skip
    wall.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)
    wall.set_title(
        f"{model.positions} spots by {model.method}: residual {model.residual_m * 1e3:.2f} mm, "
        f"standard error of a spot {model.spot_error_m * 1e3:.2f} mm"
    )
    cloud.axhline(0, color="0.8", linewidth=0.8)
    cloud.axvline(0, color="0.8", linewidth=0.8)
    cloud.plot(*(1e3 * apart_m).T, "o", color=_MODEL, markersize=4, alpha=0.8)
    reach = 1.2e3 * float(np.abs(apart_m).max())
    cloud.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    for axis in (cloud.xaxis, cloud.yaxis):
        axis.set_major_locator(MaxNLocator(5))
    cloud.set(xlabel="residual along x (mm)", ylabel="residual along y (mm)", title="residuals")
    return figure


def flight_figure(model: GalvoModel, angles_rad: Floats, arrival_s: Floats, error_s: Floats) -> Figure:
    """Draw what the fit leaves of the first bounces over the wall and over their paths, and the marks.

    Parameters
    ----------
    model
        What was fitted.
    angles_rad, arrival_s, error_s
        (N, 2) commanded angles, (N,) arrivals and their standard errors.
    """
    pointing = model.pointing()
    spots_m, marks_m = pointing.spots_m(angles_rad), np.array(model.spots_m)
    path_m = np.linalg.norm(spots_m - model.mirror_m, axis=1) + np.linalg.norm(
        spots_m - np.array(model.detector_head_m), axis=1
    )
    left_ps = 1e12 * (arrival_s - (model.electronics_delay_s or 0.0) - path_m / C_M_PER_S)
    missed_m = marks_m - pointing.spots_m(np.array(model.mirror_rad))[:, :2]
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    wall, over = figure.subplots(1, 2, width_ratios=(1.7, 1))
    draw_wall(wall, model)
    reach = float(np.abs(left_ps).max())
    drawn = wall.scatter(*spots_m.T[:2], c=left_ps, cmap="coolwarm", vmin=-reach, vmax=reach, s=30)
    figure.colorbar(drawn, ax=wall, label="arrival less modelled (ps)", shrink=0.8)
    wall.plot(*marks_m.T, "+", color="black", markersize=10, label="mark")
    magnified = _round(0.1 / max(float(np.linalg.norm(missed_m, axis=1).max()), 1e-9))
    wall.quiver(
        *marks_m.T, *(-magnified * missed_m).T, angles="xy", scale_units="xy", scale=1, width=0.003,
        color=_MODEL, label=f"modelled less mark, {magnified:g} times",
    )  # fmt: skip
    wall.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)
    wall.set_title(
        f"{model.positions} first bounces, {len(marks_m)} marks: standard error of a spot "
        f"{model.spot_error_m * 1e3:.2f} mm"
    )
    over.axhline(0, color="0.8", linewidth=0.8)
    over.errorbar(path_m, left_ps, 1e12 * error_s, fmt="o", markersize=3, linewidth=0.8, color=_MEASURED)
    over.set(
        xlabel="path mirror - wall - detector (m)", ylabel="arrival less modelled (ps)", title="residuals"
    )
    return figure


def draw_wall(axes: Axes, model: GalvoModel) -> None:
    """Draw the calibrated area as one who faces the wall sees it."""
    corners_m = np.array([*model.area_m, model.area_m[0]])
    axes.plot(*corners_m.T, "-", color=_AREA, linewidth=1, label="calibrated area")
    axes.margins(0.12)  # arrows reach beyond the spots
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")


def _round(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)) * power)
