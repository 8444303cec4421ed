"""What a perfect picture of a scene would show: the first surface that the wall sees along +z."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray


@dataclass(frozen=True)
class Truth:
    """The first surface on given axes, seen orthographically from the wall.

    Attributes
    ----------
    depth_m
        (ny, nx) distance from the wall [m], NaN where there is nothing.
    mesh
        (ny, nx) which mesh it is, -1 where there is nothing.
    """

    depth_m: NDArray[np.float64]
    mesh: NDArray[np.int64]


def first_surface(
    triangles_m: NDArray[np.float64],
    mesh_index: NDArray[np.int64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
) -> Truth:
    """Cast a ray along +z from every point (x, y, 0) and keep the nearest triangle in front of the wall.

    Parameters
    ----------
    triangles_m
        (T, 3, 3) corners [m].
    mesh_index
        (T,) which mesh each triangle belongs to.
    x_m, y_m
        (nx,), (ny,) axes [m], in any order.
    """
    columns, rows = np.argsort(x_m), np.argsort(y_m)
    depth_m = np.full((len(y_m), len(x_m)), np.inf)
    mesh = np.full(depth_m.shape, -1, dtype=np.int64)
    sorted_x_m, sorted_y_m = np.asarray(x_m, float)[columns], np.asarray(y_m, float)[rows]
    _draw(triangles_m, mesh_index.astype(np.int64), sorted_x_m, sorted_y_m, depth_m, mesh)
    depth_m[mesh < 0] = np.nan
    back = np.ix_(np.argsort(rows), np.argsort(columns))
    return Truth(depth_m[back], mesh[back])


@njit(cache=True, error_model="numpy")
def _draw(triangles, mesh_index, x, y, depth, mesh):  # type: ignore[no-untyped-def]
    """Draw every triangle over the points inside its box; ``x`` and ``y`` ascend."""
    for t in range(len(triangles)):
        ax, ay, az = triangles[t, 0, 0], triangles[t, 0, 1], triangles[t, 0, 2]
        bx, by, bz = triangles[t, 1, 0], triangles[t, 1, 1], triangles[t, 1, 2]
        cx, cy, cz = triangles[t, 2, 0], triangles[t, 2, 1], triangles[t, 2, 2]
        twice_area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if twice_area == 0.0:  # seen edge on
            continue
        for row in range(np.searchsorted(y, min(ay, by, cy)), len(y)):
            if y[row] > max(ay, by, cy):
                break
            for column in range(np.searchsorted(x, min(ax, bx, cx)), len(x)):
                if x[column] > max(ax, bx, cx):
                    break
                px, py = x[column] - ax, y[row] - ay
                b = (px * (cy - ay) - py * (cx - ax)) / twice_area
                c = (py * (bx - ax) - px * (by - ay)) / twice_area
                z = az + b * (bz - az) + c * (cz - az)
                if b >= 0.0 and c >= 0.0 and b + c <= 1.0 and 0.0 < z < depth[row, column]:
                    depth[row, column] = z
                    mesh[row, column] = mesh_index[t]
