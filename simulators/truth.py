"""What a perfect picture of a scene would show: the first surface that the wall sees along +z."""

from dataclasses import dataclass

import numpy as np
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
    depth_m = np.full((len(y_m), len(x_m)), np.inf)
    mesh = np.full(depth_m.shape, -1)
    for corners, index in zip(triangles_m, mesh_index, strict=True):
        columns = np.flatnonzero((x_m >= corners[:, 0].min()) & (x_m <= corners[:, 0].max()))
        rows = np.flatnonzero((y_m >= corners[:, 1].min()) & (y_m <= corners[:, 1].max()))
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
        twice_area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if twice_area == 0:  # seen edge on
            continue
        px, py = x_m[columns][None, :] - ax, y_m[rows][:, None] - ay
        b = (px * (cy - ay) - py * (cx - ax)) / twice_area
        c = (py * (bx - ax) - px * (by - ay)) / twice_area
        z = az + b * (bz - az) + c * (cz - az)
        block = np.ix_(rows, columns)
        nearer = (b >= 0) & (c >= 0) & (b + c <= 1) & (z > 0) & (z < depth_m[block])
        depth_m[block] = np.where(nearer, z, depth_m[block])
        mesh[block] = np.where(nearer, index, mesh[block])
    depth_m[mesh < 0] = np.nan
    return Truth(depth_m, mesh)
