"""Patches gathered into few large clusters, between which light goes to and fro."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.parallel import parallel_for
from simulators.transport.patches import Patches
from simulators.transport.visibility import Occluders, shade

#: Points that a cluster is spread over for its neighbours, and how near those are: r^2 < NEAR (A_j + A_k).
POINTS, NEAR = 16, 10.0

#: By what fraction the light that arrives from a cluster may at most exceed what leaves it.
SLACK = 1e-3

#: How far apart [m] two surfaces count as being for one unit between their normals, so that both sides of a
#: board, and the faces of a corner, do not end up in one cluster.
NORMAL_M = 0.3


class Clusters(NamedTuple):
    """M places, each for all light that reaches a neighbourhood of similar patches.

    Attributes
    ----------
    centre_m, normal
        (M, 3) where each is [m] and its unit normal: those of one of its patches.
    points_m, normals
        (M, S, 3) points spread over each, and unit normals there, for what is near.
    area_m2
        (M,) area of all its patches [m^2].
    reflecting_m2
        (M,) area times albedo of all its patches [m^2].
    member
        (K,) which cluster each patch belongs to.
    flipped
        (K,) whether the patch's normal points the other way than its cluster's.
    """

    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    area_m2: NDArray[np.float64]
    reflecting_m2: NDArray[np.float64]
    member: NDArray[np.int64]
    flipped: NDArray[np.bool_]


def gather(patches: Patches, number: int) -> Clusters:
    """Gather patches around ``number`` of them, or all if there are fewer, spread evenly over the area.

    Evenly means at equal steps of area along a Morton curve through the patches of one main direction after
    another. Each patch joins the nearest of the chosen, in place and direction.
    """
    from scipy.spatial import cKDTree

    if not len(patches.area_m2):
        none, nowhere, points = np.empty(0), np.empty((0, 3)), np.empty((0, POINTS, 3))
        no_member = np.empty(0, np.int64)
        return Clusters(nowhere, nowhere, points, points, none, none, no_member, np.empty(0, bool))
    place_on_curve = _morton(patches.centre_m)
    order = np.lexsort((place_on_curve, np.abs(patches.normal).argmax(axis=1)))
    reached = np.cumsum(patches.area_m2[order])
    levels = (np.arange(number) + 0.5) / number * reached[-1]
    chosen = np.unique(order[np.searchsorted(reached, levels)])
    place = np.concatenate([patches.centre_m, NORMAL_M * patches.normal], axis=1)
    _, member = cKDTree(place[chosen]).query(place)
    by_member = np.lexsort((place_on_curve, member))
    reached = np.cumsum(patches.area_m2[by_member])
    area_m2 = np.bincount(member, patches.area_m2, len(chosen)).astype(np.float64)
    levels = (area_m2.cumsum() - area_m2)[:, None] + area_m2[:, None] * (np.arange(POINTS) + 0.5) / POINTS
    spread = by_member[np.minimum(np.searchsorted(reached, levels), len(reached) - 1)]
    return Clusters(
        centre_m=patches.centre_m[chosen],
        normal=patches.normal[chosen],
        points_m=patches.centre_m[spread],
        normals=patches.normal[spread],
        area_m2=area_m2,
        reflecting_m2=np.bincount(member, patches.area_m2 * patches.albedo, len(chosen)).astype(np.float64),
        member=member,
        flipped=(patches.normal * patches.normal[chosen][member]).sum(axis=1) < 0,
    )


def with_wall(clusters: Clusters, size_m: tuple[float, float], pitch_m: float, albedo: float) -> Clusters:
    """Add squares of the relay wall, of width and height ``size_m`` [m], as clusters without patches."""
    axes = [(np.arange(round(size / pitch_m)) + 0.5) * pitch_m - size / 2 for size in size_m]
    x_m, y_m = (axis.ravel() for axis in np.meshgrid(*axes))
    centre_m = np.stack([x_m, y_m, np.zeros_like(x_m)], axis=1)
    area_m2 = np.full(len(x_m), pitch_m**2)
    offset_m = (np.arange(4) - 1.5) / 4 * pitch_m
    offsets_m = np.array([[x, y, 0.0] for x in offset_m for y in offset_m])
    normals = np.tile([0.0, 0.0, 1.0], (len(x_m), POINTS, 1))
    return clusters._replace(
        centre_m=np.concatenate([clusters.centre_m, centre_m]),
        normal=np.concatenate([clusters.normal, normals[:, 0]]),
        points_m=np.concatenate([clusters.points_m, centre_m[:, None] + offsets_m]),
        normals=np.concatenate([clusters.normals, normals]),
        area_m2=np.concatenate([clusters.area_m2, area_m2]),
        reflecting_m2=np.concatenate([clusters.reflecting_m2, albedo * area_m2]),
    )


def form_factors(clusters: Clusters, blockers: Occluders) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (M, M) form factors between clusters [1/m^2] and the distances (M, M) that light goes [m].

    Both are symmetric; a form factor is 0 where something stands between the centres. From centre to centre
    it is cos cos / (pi r^2); for clusters near each other, cos cos / (pi r^2 + a) averaged over their points.
    The mean area a of what a point stands for keeps those that almost touch from exchanging more than
    there is (a disk seen from over its middle: pi r^2 + a exactly). What is left of that in corners is scaled
    down until from no side of a cluster more light arrives than leaves it, so that bounces only lose light.
    """
    forms, distances_m = (np.zeros((len(clusters.area_m2),) * 2) for _ in range(2))
    _, _, points_m, normals, area_m2, *_ = clusters

    def row(j: int) -> None:
        _forms(j, clusters.centre_m, clusters.normal, points_m, normals, area_m2, forms[j], distances_m[j])
        shade(blockers, clusters.centre_m[j], clusters.centre_m[:j], forms[j, :j])

    parallel_for(row, len(forms))
    forms += forms.T
    distances_m += distances_m.T
    facing = _facing(clusters)
    while True:
        front, back = (np.where(side, forms, 0.0) @ area_m2 for side in (facing, ~facing))
        if max(front.max(initial=0.0), back.max(initial=0.0)) <= 1 + SLACK:
            return forms, distances_m
        excess = np.maximum(np.where(facing, front[:, None], back[:, None]), 1.0)
        forms /= np.sqrt(excess * excess.T)


def _facing(clusters: Clusters) -> NDArray[np.bool_]:
    """Return (M, M) whether each cluster has each other one on the side that its normal points to."""
    along = clusters.normal @ clusters.centre_m.T
    return np.asarray(along > np.diagonal(along)[:, None], dtype=bool)


@njit(cache=True, error_model="numpy", nogil=True)
def _forms(j, centre, normal, points, normals, area, forms, distances):  # type: ignore[no-untyped-def]
    """Fill form factors and distances of cluster j with those before it."""
    for k in range(j):
        at_j, at_k, r2 = _ray(centre[j], normal[j], centre[k], normal[k])
        if r2 == 0.0:
            continue
        size = (area[j] + area[k]) / 2
        if r2 > 2 * NEAR * size:
            forms[k] = abs(at_j * at_k) / (np.pi * r2 * r2)
            distances[k] = np.sqrt(r2)
            continue
        total, path = 0.0, 0.0
        for m in range(POINTS):
            # a normal may be flipped against its cluster's: count the side that the cluster's would be
            here = np.sign(normals[j, m] @ normal[j]) * np.sign(at_j)
            for n in range(POINTS):
                there = np.sign(normals[k, n] @ normal[k]) * np.sign(at_k)
                from_j, to_k, s2 = _ray(points[j, m], normals[j, m], points[k, n], normals[k, n])
                if s2 > 0.0 and from_j * here > 0.0 and to_k * there > 0.0:
                    form = abs(from_j * to_k) / (s2 * (np.pi * s2 + size / POINTS))
                    total += form
                    path += form * np.sqrt(s2)
        forms[k] = total / POINTS**2
        distances[k] = path / total if total > 0.0 else np.sqrt(r2)


@njit(cache=True, error_model="numpy", nogil=True)
def _ray(a, normal_a, b, normal_b):  # type: ignore[no-untyped-def]
    """Components of b - a along both normals, and its length squared."""
    at_a, at_b, r2 = 0.0, 0.0, 0.0
    for axis in range(3):
        d = b[axis] - a[axis]
        r2 += d * d
        at_a += d * normal_a[axis]
        at_b += d * normal_b[axis]
    return at_a, at_b, r2


def _morton(points_m: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Return places along a Morton curve of 2^30 cells: the bits of x, y and z in turn."""
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    cells = ((points_m - low) / max(float((high - low).max()), 1e-9) * 1023).astype(np.uint64)
    place = np.zeros(len(points_m), np.uint64)
    for bit in range(10):
        for axis in range(3):
            place |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return place
