"""Three bounces of light: wall, hidden surface, wall.

For a laser spot x_p and a detector spot x_c on the wall (normal +z, Lambertian), a patch k of area A_k,
albedo rho_k and centre x_k sends from one to the other, for one photon that leaves x_p, per m^2 at x_c,

    w_k = F(x_p, k) rho_k A_k F(k, x_c) ,        F(x, k) = cos(theta_x) cos(theta_k) V(x, k) / (pi r^2) ,

the form factor of radiometry between two small Lambertian surfaces (e.g. Kajiya, "The rendering equation",
SIGGRAPH 1986), with r the distance and V 1 where nothing stands between. A patch reflects on the side it is
lit on, so both spots must be on the same side of it. A glossy patch sends pi times its reflectance as often,
see `simulators.transport.reflectance`. The wall's own albedo, spot areas and lenses are left
to whoever knows them. Light of patch k arrives after the path r_p + r_c.
"""

from math import pi

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.constants import C_M_PER_S
from simulators.transport.light_paths import Spot
from simulators.transport.patches import Patches
from simulators.transport.reflectance import gloss
from simulators.transport.visibility import Occluders, shade


class ThreeBounces:
    """Light from any laser spot to one detector spot; the second leg is computed once.

    Parameters
    ----------
    patches
        Surfaces of the scene, cut small.
    blockers
        What hides light; its triangles may be coarser than the patches.
    detector_spot_m
        Spot x_c on the wall [m].
    """

    def __init__(self, patches: Patches, blockers: Occluders, detector_spot_m: Spot) -> None:
        self.patches = patches
        self.detector_spot_m = np.array(detector_spot_m, dtype=np.float64)
        self._blockers = blockers
        form, self._distance_m = form_factors_from(patches, blockers, self.detector_spot_m)
        self._glossy = bool((patches.roughness < 1).any())
        self._reflecting = patches.area_m2 * patches.albedo * form  # its sign tells the side that is seen
        self._last: tuple[Spot, tuple[NDArray[np.float64], NDArray[np.float64]]] | None = None

    def from_spot(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what each patch sends from ``laser_spot_m`` to the detector spot; do not change it.

        The last spot is remembered, for exposures without movement.

        Returns
        -------
        weight_per_m2
            (K,) expected photons for one that leaves the laser spot, per m^2 at the detector spot [1/m^2].
        path_m
            (K,) length laser spot, patch centre, detector spot [m].
        """
        last = self._last  # taken once: other threads may replace it
        if last is None or last[0] != laser_spot_m:
            last = self._last = (laser_spot_m, self._weights(np.array(laser_spot_m, dtype=np.float64)))
        return last[1]

    def _weights(self, spot: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        centre_m, normal = self.patches.centre_m, self.patches.normal
        weight, path_m = _from_spot(spot, centre_m, normal, self._reflecting, self._distance_m)
        shade(self._blockers, spot, centre_m, weight)
        if self._glossy:
            looks = self.patches.roughness, self.patches.retro, self.patches.ggx
            gloss(weight, centre_m, normal, *looks, spot, self.detector_spot_m)
        return weight, path_m

    def flux(self, laser_spot_m: Spot) -> float:
        """Return expected photons per m^2 at the detector spot for one that leaves the laser spot [1/m^2]."""
        return float(self.from_spot(laser_spot_m)[0].sum())

    def sample(
        self,
        laser_spot_m: Spot,
        number: int,
        rng: np.random.Generator,
        from_m: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Draw (number,) paths [m] of photons that arrive, each through its own point of a patch.

        The paths come patch by patch; see `LightPaths` for ``from_m``.
        """
        if number == 0:
            return np.empty(0)
        spots = np.array([laser_spot_m], dtype=np.float64) if from_m is None else from_m
        weight, _ = self.from_spot(laser_spot_m)
        corners_m, last_m = self.patches.corners_m, self.detector_spot_m
        return np.asarray(_random_paths(number, weight, corners_m, spots, last_m, rng))

    def arrivals(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return all light per m^2 at the detector spot and its paths [m]: the same, patch by patch."""
        return self.from_spot(laser_spot_m)

    def transient(self, laser_spot_m: Spot, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B,) expected photons per m^2 between B + 1 ascending edges after the wall [s].

        Each patch's light is spread over the times that its surface really takes, with the path linear
        across the patch; what is left out is of the order of edge^2 / (8 r), some 50 um or 0.2 ps for
        patches of 2 cm.
        """
        weight, _ = self.from_spot(laser_spot_m)
        spot = np.array(laser_spot_m, dtype=np.float64)
        bins = np.zeros(len(edges_s) - 1)
        _deposit(weight, self.patches.corners_m, spot, self.detector_spot_m, edges_s * C_M_PER_S, bins)
        return bins


def form_factors_from(
    patches: Patches, blockers: Occluders, spot_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return form factors (K,) between a wall spot and the patches [1/m^2], and the distances (K,) [m].

    The sign of a form factor tells which side of the patch the spot sees: plus for the one that the normal
    points away from. It is 0 for a patch that the spot does not see.
    """
    form, distance_m = open_form_factors(spot_m, patches.centre_m, patches.normal)
    shade(blockers, spot_m, patches.centre_m, form)
    return form, distance_m


@njit(cache=True, error_model="numpy", nogil=True)
def open_form_factors(spot, centre, normal):  # type: ignore[no-untyped-def]
    """Form factors (K,) [1/m^2], signed by the side that is seen, and distances (K,) [m]; nothing hidden.

    Without a branch, and with columns in one piece each, eight patches are done at once.
    """
    forms, distances = np.empty(len(centre)), np.empty(len(centre))
    for k in range(len(centre)):
        dx, dy, dz = centre[k, 0] - spot[0], centre[k, 1] - spot[1], centre[k, 2] - spot[2]
        r2 = dx * dx + dy * dy + dz * dz
        distances[k] = np.sqrt(r2)
        along = dx * normal[k, 0] + dy * normal[k, 1] + dz * normal[k, 2]
        form = dz * along / (pi * r2 * r2)  # dz = r cos(theta_x), along = r cos(theta_k)
        forms[k] = form if dz > 0.0 else 0.0  # in front of the wall
    return forms, distances


@njit(cache=True, error_model="numpy", nogil=True)
def _from_spot(spot, centre, normal, reflecting, leg):  # type: ignore[no-untyped-def]
    """Weights (K,) before anything hides, and paths (K,): nothing passes from one side to the other."""
    weights, paths = open_form_factors(spot, centre, normal)
    for k in range(len(weights)):
        weights[k] = max(weights[k] * reflecting[k], 0.0)
        paths[k] += leg[k]
    return weights, paths


@njit(cache=True, error_model="numpy", nogil=True)
def _path(first, point, last):  # type: ignore[no-untyped-def]
    """Length from ``first`` through ``point`` to ``last`` [m], each (3,)."""
    a = (point[0] - first[0]) ** 2 + (point[1] - first[1]) ** 2 + (point[2] - first[2]) ** 2
    b = (point[0] - last[0]) ** 2 + (point[1] - last[1]) ** 2 + (point[2] - last[2]) ** 2
    return np.sqrt(a) + np.sqrt(b)


@njit(cache=True, error_model="numpy", nogil=True)
def _random_patches(number, weights, rng):  # type: ignore[no-untyped-def]
    """Choose patches (number,) in order, by merging sorted uniforms into the cumulative weight.

    Sums of n + 1 exponentials, divided by the last, are n sorted uniforms.
    """
    level, cumulative = np.empty(number + 1), np.empty(len(weights))
    reached, light = 0.0, 0.0
    for i in range(number + 1):
        reached += rng.standard_exponential()
        level[i] = reached
    for k in range(len(weights)):
        light += weights[k]
        cumulative[k] = light
    for i in range(number):
        level[i] = level[i] / reached * light
    level[number] = np.inf
    patch, i = np.empty(number, np.int64), 0
    for k in range(len(weights)):
        while level[i] <= cumulative[k]:
            patch[i] = k
            i += 1
    return patch


@njit(cache=True, error_model="numpy", nogil=True)
def _random_paths(number, weights, corners, first, last, rng):  # type: ignore[no-untyped-def]
    """Choose patches, and a point on each; ``first`` is (1, 3) for all, or (number, 3)."""
    patch, paths, point = _random_patches(number, weights, rng), np.empty(number), np.empty(3)
    for i in range(number):
        b, c = rng.random(), rng.random()
        beside = b + c > 1.0  # fold the parallelogram onto the triangle
        b, c = 1.0 - b if beside else b, 1.0 - c if beside else c
        a = 1.0 - b - c
        corner = corners[patch[i]]
        for axis in range(3):
            point[axis] = a * corner[0, axis] + b * corner[1, axis] + c * corner[2, axis]
        paths[i] = _path(first[min(i, len(first) - 1)], point, last)
    return paths


@njit(cache=True, error_model="numpy", nogil=True)
def _below(path, low, mid, high):  # type: ignore[no-untyped-def]
    """Fraction of a triangle's area where a linear function, low <= mid <= high at its corners, is < path."""
    if path <= low:
        return 0.0
    if path >= high:
        return 1.0
    if path < mid:
        return (path - low) ** 2 / ((mid - low) * (high - low))
    return 1.0 - (high - path) ** 2 / ((high - mid) * (high - low))


@njit(cache=True, error_model="numpy", nogil=True)
def _deposit(weights, corners, first, last, edges, bins):  # type: ignore[no-untyped-def]
    """Add every patch's weight to the bins that its paths cross; ``edges`` are path lengths [m]."""
    for k in range(len(weights)):
        if weights[k] == 0.0:
            continue
        a = _path(first, corners[k, 0], last)
        b = _path(first, corners[k, 1], last)
        c = _path(first, corners[k, 2], last)
        low, high = min(a, b, c), max(a, b, c)
        mid = max(min(a, b), min(max(a, b), c))
        i = max(np.searchsorted(edges, low, side="right") - 1, 0)
        before = _below(edges[i], low, mid, high)
        while i < len(bins) and before < 1.0:
            after = _below(edges[i + 1], low, mid, high)
            bins[i] += weights[k] * (after - before)
            before = after
            i += 1


@njit(cache=True, error_model="numpy", nogil=True)
def corner_legs(spot, corners):  # type: ignore[no-untyped-def]
    """Distances (K, 3) from a spot to the corners of all patches [m]."""
    legs = np.empty((len(corners), 3))
    for k in range(len(corners)):
        for corner in range(3):
            square = 0.0
            for axis in range(3):
                square += (corners[k, corner, axis] - spot[axis]) ** 2
            legs[k, corner] = np.sqrt(square)
    return legs


@njit(cache=True, error_model="numpy", nogil=True)
def add_patch(weight, a, b, c, bins):  # type: ignore[no-untyped-def]
    """Add a patch's weight to bins of width one from zero on; a, b and c are the paths at its corners."""
    low, high = min(a, b, c), max(a, b, c)
    mid = max(min(a, b), min(max(a, b), c))
    i = int(low)
    before = 0.0
    while i < len(bins) and before < 1.0:
        after = _below(i + 1.0, low, mid, high)
        bins[i] += weight * (after - before)
        before = after
        i += 1
