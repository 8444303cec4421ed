"""Counts over the relay wall, drawn."""

from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from rig.show.volume import NO_SURFACE, X_LABEL, draw_front

COUNT_COLOURS = "viridis"
#: The colours go from this percentile of the counts to that one: single hot positions would darken the rest.
COUNTS_PERCENT = (0.5, 99.5)
#: Positions closer than this along an axis are on one line of it [m].
_SAME_M = 1e-6
#: Spots are pixels of an image if at least this part of its pixels is measured; else they are dots.
_LATTICE = 0.25


def counts_of_spots(
    laser_m: NDArray[np.float64], photons: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (n, 3) different spots of steps that were measured, and (n,) all photons counted there.

    Parameters
    ----------
    laser_m
        (S, 3) spots of all steps.
    photons
        (S,) of each step, NaN where it was not measured.
    """
    done = np.isfinite(photons)
    rounded = np.round(laser_m[done] / _SAME_M) * _SAME_M
    spots_m, spot = np.unique(rounded, axis=0, return_inverse=True)
    return spots_m, np.bincount(spot.ravel(), photons[done], len(spots_m)).astype(np.float64)


def draw_counts(axes: Axes, spots_m: NDArray[np.float64], photons: NDArray[np.float64]) -> ScalarMappable:
    """Draw counts where they were measured, seen as the virtual camera sees the scene: x grows to the left.

    Parameters
    ----------
    axes
        Where to draw.
    spots_m, photons
        As `counts_of_spots` returns them, one at least.
    """
    low, high = np.percentile(photons, COUNTS_PERCENT)
    scale = Normalize(low, max(high, low + 1))
    axes.set_facecolor(NO_SURFACE)
    x_m, column = np.unique(spots_m[:, 0], return_inverse=True)
    y_m, row = np.unique(spots_m[:, 1], return_inverse=True)
    if min(len(x_m), len(y_m)) < 2 or len(spots_m) < _LATTICE * len(x_m) * len(y_m):
        dots = axes.scatter(spots_m[:, 0], spots_m[:, 1], c=photons, s=9, cmap=COUNT_COLOURS, norm=scale)
        axes.invert_xaxis()
        axes.set(aspect="equal", xlabel=X_LABEL, ylabel="y (m)")
        return cast("ScalarMappable", dots)
    image = np.full((len(y_m), len(x_m)), np.nan)
    image[row.ravel(), column.ravel()] = photons
    return draw_front(axes, image, x_m, y_m, COUNT_COLOURS, scale)
