"""How all figures of calibrations look: panels, colours, residuals, and maps of the wall."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from rig.show.volume import X_LABEL

BLUE, RED, GREY = "#20639b", "#c8553d", "0.6"
#: For several series beside each other.
SERIES = (BLUE, RED, "#3a7d44", "#7b4b94", "#8a6d3b")


def panels(
    title: str, mosaic: list[Any], size: tuple[float, float], **how: Any
) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with a title, and its panels by name; ``how`` as in ``Figure.subplot_mosaic``."""
    figure = Figure(figsize=size, dpi=100, facecolor="white", layout="constrained")
    figure.suptitle(title)
    return figure, figure.subplot_mosaic(mosaic, **how)


def residuals(axes: Axes, x: ArrayLike, y: ArrayLike, error: ArrayLike | None = None, **style: Any) -> None:
    """Draw what a fit leaves as points about a line at zero."""
    axes.axhline(0, color=GREY, linewidth=0.8)
    style = {"fmt": ".", "color": BLUE, "markersize": 4, "linewidth": 0.7, **style}
    axes.errorbar(x, y, error, **style)


def wall_map(
    axes: Axes,
    spots_m: ArrayLike,
    values: ArrayLike,
    label: str,
    *,
    reach: float | None = None,
    size: float = 70,
) -> None:
    """Draw a coloured square at each (N, 2) spot; with a ``reach``, in colours to either side of zero."""
    drawn = axes.scatter(
        *np.asarray(spots_m).T[:2],  # type: ignore[misc]
        c=values,
        s=size,
        marker="s",
        edgecolors="none",
        cmap="RdBu_r" if reach else "viridis",
        vmin=-reach if reach else None,
        vmax=reach,
    )
    axes.figure.colorbar(drawn, ax=axes, label=label, shrink=0.8)
    face_the_wall(axes)


def face_the_wall(axes: Axes) -> None:
    """Name the axes of the wall, give both the same scale, and let x grow to the left, as in all pictures."""
    axes.set(xlabel=X_LABEL, ylabel="y (m)", aspect="equal")
    axes.xaxis.set_inverted(True)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))  # more would touch in a narrow panel
    axes.margins(0.12)  # arrows reach beyond the spots


def outline(axes: Axes, corners_m: ArrayLike) -> None:
    """Draw the border of the calibrated area, whose (K, 2) corners go round."""
    corners_m = np.asarray(corners_m)
    axes.plot(
        *corners_m[[*range(len(corners_m)), 0]].T, "-", color=GREY, linewidth=1, label="calibrated area"
    )
    face_the_wall(axes)


def legend_below(axes: Axes) -> None:
    """Put the legend where it hides nothing of a map."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, fontsize="small", frameon=False)


def arrows(axes: Axes, spots_m: ArrayLike, by_m: ArrayLike, label: str, longest_m: float) -> None:
    """Draw how far spots are off, magnified so that no arrow is longer than ``longest_m``."""
    by_m = np.asarray(by_m)
    magnified = _round(longest_m / max(float(np.linalg.norm(by_m, axis=1).max()), 1e-9))
    axes.quiver(
        *np.asarray(spots_m).T, *(magnified * by_m).T, angles="xy", scale_units="xy", scale=1, width=0.003,
        color=RED, label=f"{label}, {magnified:g} times",
    )  # fmt: skip


def _round(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)) * power)
