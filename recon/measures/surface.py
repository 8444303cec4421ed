"""Depth maps against a truth: what the wall sees along +z, orthographically."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: "Within 5 cm" of `DepthError`.
CLOSE_M = 0.05


@dataclass(frozen=True)
class DepthError:
    """Found minus true depth [m], over the pixels where both are.

    Attributes
    ----------
    pixels
        How many.
    median_m, mean_m
        With their sign: positive is too far from the wall.
    median_absolute_m, mean_absolute_m, rms_m
        Without.
    close
        Fraction of the pixels within `CLOSE_M`.
    """

    pixels: int
    median_m: float
    mean_m: float
    median_absolute_m: float
    mean_absolute_m: float
    rms_m: float
    close: float


def depth_error(depth_m: NDArray, truth_m: NDArray) -> DepthError:
    """Compare two depth maps (y, x) with NaN where there is nothing; all NaN where they share no pixel.

    Examples
    --------
    >>> import numpy as np
    >>> from recon import measures
    >>> found = measures.depth_error(np.array([[1.01, 1.02, np.nan]]), np.array([[1.0, 1.0, 1.0]]))
    >>> found.pixels, round(found.median_m, 3)
    (2, 0.015)
    """
    both = np.isfinite(depth_m) & np.isfinite(truth_m)
    error_m = depth_m[both].astype(np.float64) - truth_m[both]
    if not len(error_m):
        return DepthError(0, *[float("nan")] * 6)
    absolute_m = np.abs(error_m)
    return DepthError(
        pixels=len(error_m),
        median_m=float(np.median(error_m)),
        mean_m=float(error_m.mean()),
        median_absolute_m=float(np.median(absolute_m)),
        mean_absolute_m=float(absolute_m.mean()),
        rms_m=float(np.sqrt((error_m**2).mean())),
        close=float((absolute_m <= CLOSE_M).mean()),
    )


def overlap(seen: NDArray[np.bool_], truth: NDArray[np.bool_]) -> float:
    """Return intersection over union (Jaccard's index, not Dice's) of two masks; NaN if both are empty.

    Examples
    --------
    >>> import numpy as np
    >>> from recon import measures
    >>> float(measures.overlap(np.array([True, True, False]), np.array([True, False, False])))
    0.5
    """
    union = np.count_nonzero(seen | truth)
    return np.count_nonzero(seen & truth) / union if union else float("nan")


def sampled_depth(
    depth_m: NDArray,
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    at_x_m: NDArray[np.float64],
    at_y_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Take a depth map at other points: the nearest pixel's value, NaN outside of the map.

    Nearest, since a mean of two depths across an edge is the depth of nothing.

    Parameters
    ----------
    depth_m
        (y, x) map, NaN where nothing.
    x_m, y_m
        Its axes, in any order.
    at_x_m, at_y_m
        Where to take it.

    Returns
    -------
    ndarray
        (len(at_y_m), len(at_x_m)).
    """
    columns, inside_x = _nearest(x_m, at_x_m)
    rows, inside_y = _nearest(y_m, at_y_m)
    taken = depth_m[np.ix_(rows, columns)].astype(np.float64)
    return np.where(inside_y[:, None] & inside_x, taken, np.nan)


def _nearest(axis_m: NDArray, at_m: NDArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    distance_m = np.abs(axis_m[:, None] - at_m)
    pitch_m = float(np.abs(np.diff(axis_m)).max()) if len(axis_m) > 1 else np.inf
    return distance_m.argmin(axis=0), distance_m.min(axis=0) <= pitch_m / 2 * (1 + 1e-6)


def surface_of_voxels(occupied: NDArray[np.bool_], z_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth (y, x) of the first occupied voxel (z, y, x) along ascending z, NaN where none is."""
    return np.where(occupied.any(axis=0), z_m[occupied.argmax(axis=0)], np.nan)


def surface_of_mesh(
    triangles_m: NDArray[np.float64], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the depth of the first triangle along +z from each point (x, y, 0).

    Parameters
    ----------
    triangles_m
        (T, 3, 3) corners, wound either way. Those behind the wall, and those seen edge on, are not seen.
    x_m, y_m
        Axes, ascending.

    Returns
    -------
    ndarray
        (y, x), NaN where the ray meets nothing.
    """
    depth_m = np.full((len(y_m), len(x_m)), np.inf)
    corners_m = np.ascontiguousarray(triangles_m, np.float64)
    first_x, last_x = (_edges(x_m, corners_m[:, :, 0], side) for side in ("left", "right"))
    first_y, last_y = (_edges(y_m, corners_m[:, :, 1], side) for side in ("left", "right"))
    _draw(
        corners_m, np.asarray(x_m, float), np.asarray(y_m, float), first_x, last_x, first_y, last_y, depth_m
    )
    return np.where(np.isfinite(depth_m), depth_m, np.nan)


def _edges(axis_m: NDArray, coordinates_m: NDArray, side: str) -> NDArray[np.intp]:
    """Return the first pixel that each triangle's box may hold, or the one after the last."""
    if side == "left":
        return np.searchsorted(axis_m, coordinates_m.min(axis=1), "left")
    return np.searchsorted(axis_m, coordinates_m.max(axis=1), "right")


@njit(cache=True)
def _draw(corners_m, x_m, y_m, first_x, last_x, first_y, last_y, depth_m):  # type: ignore[no-untyped-def]
    """Keep the nearest depth of every pixel, triangle by triangle, by the signs of three edge functions."""
    for t in range(len(corners_m)):
        a, b, c = corners_m[t, 0], corners_m[t, 1], corners_m[t, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        for j in range(first_y[t], last_y[t]):
            for i in range(first_x[t], last_x[t]):
                x, y = x_m[i], y_m[j]
                of_a = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                of_b = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                of_c = ((a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x)) / area
                if of_a >= 0 and of_b >= 0 and of_c >= 0:
                    z = of_a * a[2] + of_b * b[2] + of_c * c[2]
                    if 0 < z < depth_m[j, i]:
                        depth_m[j, i] = z
