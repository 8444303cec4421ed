"""What hides what: whether any triangle stands between two points, found through a tree of boxes."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Part of a segment left out at each end, so that the surfaces it joins do not hide it.
END = 1e-6

#: Triangles in a leaf of the tree, at most.
LEAF = 4

#: Boxes are larger than their triangles by this much [m], so that rounding loses none.
MARGIN_M = 1e-9

#: Stands for a direction of exactly zero, so that no quotient is undefined.
TINY = 1e-30

#: Deepest path that a search can remember; halving at the median makes depth log2(T / 4).
STACK = 64


class Occluders(NamedTuple):
    """T triangles that block light, in a binary tree of N boxes stored in the order of a depth-first walk.

    Attributes
    ----------
    corner_m, edge1_m, edge2_m
        (T, 3) first corner, and the two edges that start from it [m], leaf by leaf.
    low_m, high_m
        (N, 3) bounding boxes [m] of what is in or below each node.
    first, size
        (N,) for a leaf, its first triangle and how many; for others ``size`` is 0 and ``first`` is the right
        child, while the left child is the next node.
    """

    corner_m: NDArray[np.float64]
    edge1_m: NDArray[np.float64]
    edge2_m: NDArray[np.float64]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    first: NDArray[np.int64]
    size: NDArray[np.int64]


def occluders(triangles_m: NDArray[np.float64]) -> Occluders:
    """Prepare (T, 3, 3) triangles [m] for `shade`."""
    triangles_m = np.ascontiguousarray(triangles_m, dtype=np.float64)
    low, high = triangles_m.min(axis=1), triangles_m.max(axis=1)
    order, *tree = _tree(low, high)
    corner, second, third = (np.ascontiguousarray(triangles_m[order, i]) for i in range(3))
    return Occluders(corner, second - corner, third - corner, *tree)


@njit(cache=True, error_model="numpy")
def _tree(low, high):  # type: ignore[no-untyped-def]
    """Halve the triangles, again and again, at the median of their middles along the longest axis."""
    total = len(low)
    order = np.arange(total)
    middle = (low + high) / 2
    nodes = max(2 * total, 1)
    node_low, node_high = np.full((nodes, 3), np.inf), np.full((nodes, 3), -np.inf)
    first, count = np.zeros(nodes, np.int64), np.zeros(nodes, np.int64)
    # what is still to be built: from, to, and whose right child it is
    waiting = [(0, total, -1)]
    used = 0
    while len(waiting):
        start, stop, parent = waiting.pop()
        node = used
        used += 1
        if parent >= 0:
            first[parent] = node
        spread_low, spread_high = np.full(3, np.inf), np.full(3, -np.inf)
        for i in order[start:stop]:
            for axis in range(3):
                node_low[node, axis] = min(node_low[node, axis], low[i, axis])
                node_high[node, axis] = max(node_high[node, axis], high[i, axis])
                spread_low[axis] = min(spread_low[axis], middle[i, axis])
                spread_high[axis] = max(spread_high[axis], middle[i, axis])
        if stop - start <= LEAF:
            first[node], count[node] = start, stop - start
            continue
        longest = np.argmax(spread_high - spread_low)
        part = order[start:stop]
        order[start:stop] = part[np.argsort(middle[part, longest])]
        half = (start + stop) // 2
        waiting.append((half, stop, node))
        waiting.append((start, half, -1))  # taken next, so that it follows its parent
    return order, node_low[:used] - MARGIN_M, node_high[:used] + MARGIN_M, first[:used], count[:used]


@njit(cache=True, error_model="numpy", nogil=True)
def _cuts(blockers, i, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Whether triangle i cuts the open segment from o to o + d [m].

    Moller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2 (1997). A
    triangle seen edge on hides nothing.
    """
    ux, uy, uz = blockers.edge1_m[i, 0], blockers.edge1_m[i, 1], blockers.edge1_m[i, 2]
    vx, vy, vz = blockers.edge2_m[i, 0], blockers.edge2_m[i, 1], blockers.edge2_m[i, 2]
    nx, ny, nz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    determinant = ux * nx + uy * ny + uz * nz
    if determinant == 0.0:
        return False
    scale = 1.0 / determinant
    sx, sy, sz = ox - blockers.corner_m[i, 0], oy - blockers.corner_m[i, 1], oz - blockers.corner_m[i, 2]
    b = (sx * nx + sy * ny + sz * nz) * scale
    if b < 0.0 or b > 1.0:
        return False
    qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
    c = (dx * qx + dy * qy + dz * qz) * scale
    if c < 0.0 or b + c > 1.0:
        return False
    return END < (vx * qx + vy * qy + vz * qz) * scale < 1.0 - END


@njit(cache=True, error_model="numpy", nogil=True)
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
    stack = np.empty(STACK, np.int64)
    ox, oy, oz = spot_m[0], spot_m[1], spot_m[2]
    if len(blockers.corner_m) == 0:
        return
    culprit = -1  # what hid the last point often hides the next
    for k in range(len(points_m)):
        if light[k] == 0.0:
            continue
        dx, dy, dz = points_m[k, 0] - ox, points_m[k, 1] - oy, points_m[k, 2] - oz
        if culprit >= 0 and _cuts(blockers, culprit, ox, oy, oz, dx, dy, dz):
            light[k] = 0.0
            continue
        rx = 1.0 / (dx if dx != 0.0 else TINY)
        ry = 1.0 / (dy if dy != 0.0 else TINY)
        rz = 1.0 / (dz if dz != 0.0 else TINY)
        stack[0] = 0
        depth = 1
        while depth > 0:
            depth -= 1
            node = stack[depth]
            # the part of the segment, from 0 to 1, that is inside the box
            a, b = (blockers.low_m[node, 0] - ox) * rx, (blockers.high_m[node, 0] - ox) * rx
            enter, leave = min(a, b), max(a, b)
            a, b = (blockers.low_m[node, 1] - oy) * ry, (blockers.high_m[node, 1] - oy) * ry
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            a, b = (blockers.low_m[node, 2] - oz) * rz, (blockers.high_m[node, 2] - oz) * rz
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            if enter > leave or enter > 1.0 or leave < 0.0:
                continue
            if blockers.size[node] == 0:
                stack[depth] = blockers.first[node]
                stack[depth + 1] = node + 1
                depth += 2
                continue
            for i in range(blockers.first[node], blockers.first[node] + blockers.size[node]):
                if _cuts(blockers, i, ox, oy, oz, dx, dy, dz):
                    light[k] = 0.0
                    culprit = i
                    break
            if light[k] == 0.0:
                break
