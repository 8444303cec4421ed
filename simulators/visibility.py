"""What hides what: whether any triangle stands between two points, found through a tree of boxes."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Part of a segment left out at each end, so that the surfaces it joins do not hide it.
END = 1e-6

#: Triangles in a leaf of the tree, at most.
LEAF = 2

#: Boxes are larger than their triangles by this much [m], so that rounding loses none.
MARGIN_M = 1e-9

#: Stands for a direction of exactly zero, so that no quotient is undefined.
TINY = 1e-30

#: Every cut leaves at least about 1 / SHARE on either side, so that no path is longer than the search's STACK
#: for up to (8/7)^128, some 10^7, triangles.
SHARE = 8
STACK = 128


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
def _half_areas(low, high):  # type: ignore[no-untyped-def]
    """Half the surface of the box around the first n, for every n."""
    areas, a, b = np.empty(len(low)), low[0].copy(), high[0].copy()
    for i in range(len(low)):
        a, b = np.minimum(a, low[i]), np.maximum(b, high[i])
        d = b - a
        areas[i] = d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    return areas


@njit(cache=True, error_model="numpy")
def _best_cut(low, high):  # type: ignore[no-untyped-def]
    """Where to cut a row of boxes so that a segment meets fewest: by number times surface of both parts.

    The surface area heuristic of Goldsmith and Salmon, IEEE Comput. Graph. Appl. 7 (1987).
    """
    total = len(low)
    before, after = _half_areas(low, high), _half_areas(low[::-1], high[::-1])[::-1]
    best, cut = np.inf, total // 2
    for n in range(max(total // SHARE, 1), total - max(total // SHARE, 1) + 1):
        cost = n * before[n - 1] + (total - n) * after[n]
        if cost < best:
            best, cut = cost, n
    return best, cut


@njit(cache=True, error_model="numpy")
def _tree(low, high):  # type: ignore[no-untyped-def]
    """Cut the triangles in two, again and again, across the axis and at the place of `_best_cut`."""
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
        for i in order[start:stop]:
            for axis in range(3):
                node_low[node, axis] = min(node_low[node, axis], low[i, axis])
                node_high[node, axis] = max(node_high[node, axis], high[i, axis])
        if stop - start <= LEAF:
            first[node], count[node] = start, stop - start
            continue
        part, best, half = order[start:stop].copy(), np.inf, start + 1
        for axis in range(3):
            ranked = part[np.argsort(middle[part, axis])]
            cost, cut = _best_cut(low[ranked], high[ranked])
            if cost < best:
                best, half = cost, start + cut
                order[start:stop] = ranked
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
