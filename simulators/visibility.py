"""What hides what: whether any triangle stands between two points.

`shade` is the only question asked of `Occluders`, so a tree of boxes can replace the list behind it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Part of a segment left out at each end, so that the surfaces it joins do not hide it.
END = 1e-6


class Occluders(NamedTuple):
    """T triangles that block light, sorted by the depth at which they begin.

    Attributes
    ----------
    corner_m, edge1_m, edge2_m
        (T, 3) first corner, and the two edges that start from it [m].
    low_m, high_m
        (T, 3) bounding boxes [m].
    """

    corner_m: NDArray[np.float64]
    edge1_m: NDArray[np.float64]
    edge2_m: NDArray[np.float64]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]


def occluders(triangles_m: NDArray[np.float64]) -> Occluders:
    """Prepare (T, 3, 3) triangles [m] for `shade`."""
    ordered = triangles_m[np.argsort(triangles_m[:, :, 2].min(axis=1), kind="stable")]
    corner = np.ascontiguousarray(ordered[:, 0])
    return Occluders(
        corner, ordered[:, 1] - corner, ordered[:, 2] - corner, ordered.min(axis=1), ordered.max(axis=1)
    )


@njit(cache=True, error_model="numpy")
def _hidden(blockers: Occluders, ox: float, oy: float, oz: float, px: float, py: float, pz: float) -> bool:
    """Whether any triangle cuts the open segment from o to p [m].

    Moller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2 (1997),
    after a comparison of bounding boxes. A triangle seen edge on hides nothing.
    """
    dx, dy, dz = px - ox, py - oy, pz - oz
    front, back = min(oz + END * dz, pz - END * dz), max(oz + END * dz, pz - END * dz)
    for i in range(len(blockers.low_m)):
        if blockers.low_m[i, 2] > back:
            return False  # this triangle and all that follow begin behind the segment
        if (
            blockers.high_m[i, 2] < front
            or blockers.low_m[i, 0] > max(ox, px)
            or blockers.high_m[i, 0] < min(ox, px)
            or blockers.low_m[i, 1] > max(oy, py)
            or blockers.high_m[i, 1] < min(oy, py)
        ):
            continue
        ux, uy, uz = blockers.edge1_m[i, 0], blockers.edge1_m[i, 1], blockers.edge1_m[i, 2]
        vx, vy, vz = blockers.edge2_m[i, 0], blockers.edge2_m[i, 1], blockers.edge2_m[i, 2]
        nx, ny, nz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
        determinant = ux * nx + uy * ny + uz * nz
        if determinant == 0.0:
            continue
        scale = 1.0 / determinant
        sx, sy, sz = ox - blockers.corner_m[i, 0], oy - blockers.corner_m[i, 1], oz - blockers.corner_m[i, 2]
        b = (sx * nx + sy * ny + sz * nz) * scale
        if b < 0.0 or b > 1.0:
            continue
        qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
        c = (dx * qx + dy * qy + dz * qz) * scale
        if c < 0.0 or b + c > 1.0:
            continue
        if END < (vx * qx + vy * qy + vz * qz) * scale < 1.0 - END:
            return True
    return False


@njit(cache=True, error_model="numpy")
def shade(
    blockers: Occluders,
    spot_m: NDArray[np.float64],
    points_m: NDArray[np.float64],
    light: NDArray[np.float64],
) -> None:
    """Set ``light`` to zero at the points that ``spot_m`` does not see.

    Parameters
    ----------
    blockers
        What may stand between.
    spot_m
        (3,) where the light comes from or goes to [m].
    points_m
        (K, 3) points that it may reach [m].
    light
        (K,) changed in place; points without light are not looked at.
    """
    for k in range(len(points_m)):
        if light[k] != 0.0 and _hidden(
            blockers, spot_m[0], spot_m[1], spot_m[2], points_m[k, 0], points_m[k, 1], points_m[k, 2]
        ):
            light[k] = 0.0
