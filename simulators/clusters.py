"""Patches gathered into few large clusters, between which light goes to and fro."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.geometry import Patches
from simulators.threads import each
from simulators.visibility import Occluders, shade

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
    area_m2
        (M,) area of all its patches [m^2].
    reflecting_m2
        (M,) area times albedo of all its patches [m^2].
    member
        (K,) which cluster each patch belongs to.
    turned
        (K,) whether the patch's normal points the other way than its cluster's.
    """

    centre_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    area_m2: NDArray[np.float64]
    reflecting_m2: NDArray[np.float64]
    member: NDArray[np.int64]
    turned: NDArray[np.bool_]


def gather(patches: Patches, number: int) -> Clusters:
    """Gather patches around ``number`` of them, or all if there are fewer, spread evenly over the area.

    Evenly means at equal steps of area along a Morton curve through the patches of one main direction after
    another. Each patch joins the nearest of the chosen, in place and direction.
    """
    from scipy.spatial import cKDTree

    if not len(patches.area_m2):
        none, nowhere = np.empty(0), np.empty((0, 3))
        return Clusters(nowhere, nowhere, none, none, np.empty(0, np.int64), np.empty(0, bool))
    order = np.lexsort((_morton(patches.centre_m), np.abs(patches.normal).argmax(axis=1)))
    reached = np.cumsum(patches.area_m2[order])
    levels = (np.arange(number) + 0.5) / number * reached[-1]
    chosen = np.unique(order[np.searchsorted(reached, levels)])
    place = np.concatenate([patches.centre_m, NORMAL_M * patches.normal], axis=1)
    _, member = cKDTree(place[chosen]).query(place)
    return Clusters(
        centre_m=patches.centre_m[chosen],
        normal=patches.normal[chosen],
        area_m2=np.bincount(member, patches.area_m2, len(chosen)).astype(np.float64),
        reflecting_m2=np.bincount(member, patches.area_m2 * patches.albedo, len(chosen)).astype(np.float64),
        member=member,
        turned=(patches.normal * patches.normal[chosen][member]).sum(axis=1) < 0,
    )


def with_wall(clusters: Clusters, size_m: tuple[float, float], pitch_m: float, albedo: float) -> Clusters:
    """Add squares of the relay wall, of width and height ``size_m`` [m], as clusters without patches."""
    axes = [(np.arange(round(size / pitch_m)) + 0.5) * pitch_m - size / 2 for size in size_m]
    x_m, y_m = (axis.ravel() for axis in np.meshgrid(*axes))
    centre_m = np.stack([x_m, y_m, np.zeros_like(x_m)], axis=1)
    area_m2 = np.full(len(x_m), pitch_m**2)
    return clusters._replace(
        centre_m=np.concatenate([clusters.centre_m, centre_m]),
        normal=np.concatenate([clusters.normal, np.tile([0.0, 0.0, 1.0], (len(x_m), 1))]),
        area_m2=np.concatenate([clusters.area_m2, area_m2]),
        reflecting_m2=np.concatenate([clusters.reflecting_m2, albedo * area_m2]),
    )


def form_factors(clusters: Clusters, blockers: Occluders) -> NDArray[np.float64]:
    """Return (M, M) form factors between clusters [1/m^2], symmetric, 0 where something stands between.

    cos cos / (pi r^2 + (A_j + A_k) / 2): the area keeps near neighbours, whose light is spread over more than
    a point, from exchanging more than there is (a disk seen from over its middle: pi r^2 + A exactly). Where
    clusters meet in a corner it is still up to a quarter too much: those are scaled down until from none more
    light arrives than leaves it, so that bounces can only lose light.
    """
    forms = np.zeros((len(clusters.area_m2),) * 2)

    def row(j: int) -> None:
        _forms(j, clusters.centre_m, clusters.normal, clusters.area_m2, forms[j])
        shade(blockers, clusters.centre_m[j], clusters.centre_m[:j], forms[j, :j])

    each(row, len(forms))
    forms += forms.T
    while (excess := np.maximum(forms @ clusters.area_m2, 1.0)).max(initial=1.0) > 1 + SLACK:
        forms /= np.sqrt(excess[:, None] * excess)
    return forms


@njit(cache=True, error_model="numpy", nogil=True)
def _forms(j, centre, normal, area, forms):  # type: ignore[no-untyped-def]
    """Fill the form factors of cluster j with those before it."""
    for k in range(j):
        at_j, at_k, r2 = 0.0, 0.0, 0.0
        for axis in range(3):
            d = centre[k, axis] - centre[j, axis]
            r2 += d * d
            at_j += d * normal[j, axis]
            at_k += d * normal[k, axis]
        if r2 > 0.0:
            forms[k] = abs(at_j * at_k) / (r2 * (np.pi * r2 + (area[j] + area[k]) / 2))


def _morton(points_m: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Return places along a Morton curve of 2^30 cells: the bits of x, y and z in turn."""
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    cells = ((points_m - low) / max(float((high - low).max()), 1e-9) * 1023).astype(np.uint64)
    place = np.zeros(len(points_m), np.uint64)
    for bit in range(10):
        for axis in range(3):
            place |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return place
