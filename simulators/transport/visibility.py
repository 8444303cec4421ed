"""What hides what: whether any triangle stands between two points, found through a tree of boxes."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Part of a segment left out at each end, so that the surfaces it joins do not hide it.
END = 1e-6

#: Points that are looked at together; neighbours in the row of points should be neighbours in space.
PACKET = 32

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


# A tree is built once for a scene, in array operations: compiling it would take longer than a scan's wait.


def _half_areas(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the surface of the box around the first n, for every n."""
    d = np.maximum.accumulate(high) - np.minimum.accumulate(low)
    return np.asarray(d[:, 0] * d[:, 1] + d[:, 1] * d[:, 2] + d[:, 2] * d[:, 0])


def _best_cut(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[float, int]:
    """Where to cut a row of boxes so that a segment meets fewest: by number times surface of both parts.

    The surface area heuristic of Goldsmith and Salmon, IEEE Comput. Graph. Appl. 7 (1987).
    """
    total = len(low)
    least = max(total // SHARE, 1)
    before, after = _half_areas(low, high), _half_areas(low[::-1], high[::-1])[::-1]
    cuts = np.arange(least, total - least + 1)
    costs = cuts * before[cuts - 1] + (total - cuts) * after[cuts]
    best = int(costs.argmin())
    return float(costs[best]), int(cuts[best])


def _tree(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray, ...]:
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
    while waiting:
        start, stop, parent = waiting.pop()
        node = used
        used += 1
        if parent >= 0:
            first[parent] = node
        part = order[start:stop].copy()
        node_low[node] = low[part].min(axis=0, initial=np.inf)
        node_high[node] = high[part].max(axis=0, initial=-np.inf)
        if stop - start <= LEAF:
            first[node], count[node] = start, stop - start
            continue
        rankings = [part[np.argsort(middle[part, axis], kind="stable")] for axis in range(3)]
        cuts = [_best_cut(low[ranked], high[ranked]) for ranked in rankings]
        axis = min(range(3), key=lambda across: cuts[across][0])
        order[start:stop] = rankings[axis]
        half = start + cuts[axis][1]
        waiting.append((half, stop, node))
        waiting.append((start, half, -1))  # taken next, so that it follows its parent
    return order, node_low[:used] - MARGIN_M, node_high[:used] + MARGIN_M, first[:used], count[:used]


@njit(cache=True, error_model="numpy", nogil=True)
def _seen_from(blockers, spot):  # type: ignore[no-untyped-def]
    """Return what of each triangle is the same for all segments from the spot, (T, 10) for `_cuts`.

    Moller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2 (1997), with
    the triple products turned so that the segment is the last factor of each: with edges u and v, and s
    from the first corner to the spot, these are v x u, v x s, s x u and v . (s x u).
    """
    ox, oy, oz = spot[0], spot[1], spot[2]
    rows = np.empty((len(blockers.corner_m), 10))
    for i in range(len(rows)):
        ux, uy, uz = blockers.edge1_m[i, 0], blockers.edge1_m[i, 1], blockers.edge1_m[i, 2]
        vx, vy, vz = blockers.edge2_m[i, 0], blockers.edge2_m[i, 1], blockers.edge2_m[i, 2]
        sx, sy, sz = ox - blockers.corner_m[i, 0], oy - blockers.corner_m[i, 1], oz - blockers.corner_m[i, 2]
        rows[i, 0], rows[i, 1], rows[i, 2] = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
        rows[i, 3], rows[i, 4], rows[i, 5] = vy * sz - vz * sy, vz * sx - vx * sz, vx * sy - vy * sx
        rows[i, 6], rows[i, 7], rows[i, 8] = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
        rows[i, 9] = vx * rows[i, 6] + vy * rows[i, 7] + vz * rows[i, 8]
    return rows


@njit(cache=True, error_model="numpy", nogil=True)
def _cuts(row, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Whether a triangle, a row of `_seen_from`, cuts the open segment d [m] from there.

    Nothing is divided: place along the segment and on the triangle are compared as multiples of the
    determinant. A triangle seen edge on hides nothing. No branches, so that many segments are done at once.
    """
    determinant = row[0] * dx + row[1] * dy + row[2] * dz
    sign = -1.0 if determinant < 0.0 else 1.0
    whole = determinant * sign
    b = (row[3] * dx + row[4] * dy + row[5] * dz) * sign
    c = (row[6] * dx + row[7] * dy + row[8] * dz) * sign
    along = row[9] * sign
    on_triangle = (b >= 0.0) & (c >= 0.0) & (b + c <= whole)
    return on_triangle & (along > END * whole) & (along < (1.0 - END) * whole)


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
    lit = np.flatnonzero(light)
    if not len(blockers.corner_m) or not len(lit):
        return
    rows = _seen_from(blockers, spot_m)
    low, high = blockers.low_m - spot_m, blockers.high_m - spot_m
    stack, hidden = np.empty(STACK, np.int64), np.empty(PACKET, np.bool_)
    nearest, furthest = np.empty(3), np.empty(3)
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    for begin in range(0, len(lit), PACKET):
        packet = lit[begin : begin + PACKET]
        count = len(packet)
        low_x, low_y, low_z, high_x, high_y, high_z = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
        for n in range(count):  # all six at once: one after the other takes as long as all the rest
            point = points_m[packet[n]]
            x[n], y[n], z[n] = point[0] - spot_m[0], point[1] - spot_m[1], point[2] - spot_m[2]
            low_x, low_y, low_z = min(low_x, x[n]), min(low_y, y[n]), min(low_z, z[n])
            high_x, high_y, high_z = max(high_x, x[n]), max(high_y, y[n]), max(high_z, z[n])
        hidden[:] = False
        nearest[0], nearest[1], nearest[2] = _per(low_x), _per(low_y), _per(low_z)
        furthest[0], furthest[1], furthest[2] = _per(high_x), _per(high_y), _per(high_z)
        stack[0] = 0
        depth = 1
        while depth > 0:
            depth -= 1
            node = stack[depth]
            if not _passes(low[node], high[node], nearest, furthest):
                continue
            if blockers.size[node] == 0:
                stack[depth] = blockers.first[node]
                stack[depth + 1] = node + 1
                depth += 2
                continue
            for i in range(blockers.first[node], blockers.first[node] + blockers.size[node]):
                row = rows[i]
                for n in range(count):
                    hidden[n] |= _cuts(row, x[n], y[n], z[n])
            if hidden[:count].all():
                break
        for n in range(count):
            if hidden[n]:
                light[packet[n]] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def _per(x):  # type: ignore[no-untyped-def]
    return 1.0 / (x if abs(x) > TINY else TINY)


@njit(cache=True, error_model="numpy", nogil=True)
def _passes(low, high, per_nearest, per_furthest):  # type: ignore[no-untyped-def]
    """Whether any segment of a packet may pass a box (both relative to where the segments start).

    After a part t of their ways the segments are between t times ``nearest`` and t times ``furthest`` on each
    axis, given inverted; that meets the box for an interval of t, if for any. What is met at a segment's end
    alone hides nothing: so the boxes of the surface that the points are on are not opened.
    """
    enter, leave = END, 1.0 - END
    for axis in range(3):
        t = low[axis] * per_furthest[axis]  # t furthest >= low
        if per_furthest[axis] > 0.0:
            enter = max(enter, t)
        else:
            leave = min(leave, t)
        t = high[axis] * per_nearest[axis]  # t nearest <= high
        if per_nearest[axis] > 0.0:
            leave = min(leave, t)
        else:
            enter = max(enter, t)
    return enter <= leave
