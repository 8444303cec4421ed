"""Fourth and fifth bounces: light that goes on between hidden surfaces, and over the relay wall.

With E_j(x, t) the light that cluster j reflects of one photon from wall spot x, over time, and K_jk the form
factor between clusters, the light that arrives at the detector spot x_c after one and two more surfaces is

    h_4(t) = sum_j sum_k E_j(x_p) * K_jk * E_k(x_c)
    h_5(t) = sum_j sum_m sum_k E_j(x_p) * K_jm R_m K_mk * E_k(x_c) ,

where * convolves, each K delays by r / c, m runs over the hidden surfaces and the relay wall, and R_m is area
times albedo. All but the first factor does not depend on the laser: it is summed once, from the detector
backwards, into the tail of each cluster, the light due at the detector for a photon that leaves this cluster
(the adjoint side). Then each laser position costs patches times bins instead of patches squared or cubed.

Ends of the paths (E) take the fine patches: their visibility, their times. In between, about a thousand
clusters stand for them, in a large scene some 7 cm or 0.2 ns wide: a tail is right on that scale, on which
interreflections of matt surfaces are smooth. Bins of 1 cm of path (33 ps) are finer than that, and than the
instrument's 65 ps. In between, all surfaces count as Lambertian with their
whole albedo: the third bounce is where gloss shows.
"""

from math import ceil

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.constants import C_M_PER_S
from simulators.parallel import parallel_for
from simulators.transport.clusters import Clusters, form_factors, gather, with_wall
from simulators.transport.light_paths import Spot
from simulators.transport.patches import Patches
from simulators.transport.three_bounces import form_factors_from, open_form_factors
from simulators.transport.visibility import Occluders, shade

#: Width of the bins in which tails are kept, as a length of path [m]; bin b is centred on b times this.
BIN_M = 0.01

#: The last part of each tail, as a fraction of its light, that is left out where tails are added up.
FAINT = 1e-6

#: Clusters of hidden surfaces.
CLUSTERS = 1000

#: Part of the relay wall that light comes back from, width and height, and the squares it is taken in [m].
WALL_M, WALL_PITCH_M = (2.4, 2.0), 0.1

#: Of each patch: the light that it reflects, the side of its cluster, the distance from the laser spot [m].
_Lit = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]


class Interreflections:
    """The exchange of light inside a scene, for any laser and detector.

    Parameters
    ----------
    patches, blockers
        The scene, as for `simulators.transport.three_bounces.ThreeBounces`.
    bounces
        4: from surface to surface once. 5: also twice, and over the relay wall.
    wall_albedo
        What the relay wall reflects.
    clusters
        How many clusters stand for the patches.
    """

    def __init__(
        self,
        patches: Patches,
        blockers: Occluders,
        bounces: int,
        wall_albedo: float = 0.8,
        clusters: int = CLUSTERS,
    ) -> None:
        self.patches, self.blockers, self.bounces = patches, blockers, bounces
        self.clusters = gather(patches, clusters)
        if bounces > 4:
            self.clusters = with_wall(self.clusters, WALL_M, WALL_PITCH_M, wall_albedo)
        self.forms, self.distances_m = form_factors(self.clusters, blockers)

    def light_paths(self, detector_spot_m: Spot) -> "ExtraBounces":
        """Sum up all that leads from the clusters to one detector spot."""
        spot = np.array(detector_spot_m, dtype=np.float64)
        form, leg_m = form_factors_from(self.patches, self.blockers, spot)
        bins = self._bins(leg_m)
        tails = np.zeros((len(self.forms), 2, bins))
        _collect(form, leg_m, *self._ends(), BIN_M, tails)
        one_more = self._bounce(tails, np.ones(len(tails)))
        total = one_more
        if self.bounces > 4:
            total = one_more + self._bounce(one_more, self.clusters.reflecting_m2)
        return ExtraBounces(self.patches, self.blockers, self.clusters, total)

    def _bins(self, leg_m: NDArray[np.float64]) -> int:
        corners_m = self.clusters.centre_m
        across_m = float(np.linalg.norm(np.ptp(corners_m, axis=0))) if len(corners_m) else 0.0
        longest_m = leg_m.max(initial=0.0) + (self.bounces - 3) * across_m
        return ceil(longest_m / BIN_M) + 4

    def _ends(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
        reflecting_m2 = self.patches.area_m2 * self.patches.albedo
        return reflecting_m2, self.clusters.member, self.clusters.flipped

    def _bounce(self, tails: NDArray[np.float64], reflecting: NDArray[np.float64]) -> NDArray[np.float64]:
        """Put one more surface before each tail."""
        more = np.zeros_like(tails)
        first, last = _span(tails.cumsum(axis=2))
        centre_m, normal, places = self.clusters.centre_m, self.clusters.normal, self.distances_m / BIN_M
        parallel_for(
            lambda j: _bounce(
                j, self.forms[j], places[j], centre_m, normal, reflecting, tails, first, last, more[j]
            ),
            len(more),
        )
        return more


class ExtraBounces:
    """Light of more than three bounces from any laser spot to one detector spot; see `Interreflections`.

    Parameters
    ----------
    patches, blockers
        The scene.
    clusters
        What the patches are gathered in.
    tails_per_m2
        (M, 2, B) light due at the detector spot, per m^2 there, for one photon that leaves each side of each
        cluster, in bins of `BIN_M` of path; side 0 is the one that the normal points to.
    """

    def __init__(
        self, patches: Patches, blockers: Occluders, clusters: Clusters, tails_per_m2: NDArray[np.float64]
    ) -> None:
        self.patches = patches
        self._blockers = blockers
        self._clusters = clusters
        self._tails = tails_per_m2
        self._cumulative = tails_per_m2.cumsum(axis=2)
        self._span = _span(self._cumulative)
        total = self._cumulative[:, :, -1]
        moment_m = tails_per_m2 @ (BIN_M * np.arange(tails_per_m2.shape[2]))
        self._mean_m: NDArray[np.float64] = moment_m / np.where(total > 0, total, 1.0)
        self._last: tuple[Spot, _Lit] | None = None

    def from_spot(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what comes by way of each patch as the first after the wall.

        Returns
        -------
        weight_per_m2
            (K,) expected photons for one that leaves the laser spot, per m^2 at the detector spot [1/m^2].
        path_m
            (K,) mean length of the whole path [m].
        """
        reflected, side, leg_m = self._lit(laser_spot_m)
        member, total = self._clusters.member, self._cumulative[:, :, -1]
        return reflected * total[member, side], leg_m + self._mean_m[member, side]

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
        """Draw (number,) paths [m] of photons that arrive; see `LightPaths` for ``from_m``."""
        if number == 0:
            return np.empty(0)
        _, side, _ = self._lit(laser_spot_m)
        cumulative = self.from_spot(laser_spot_m)[0].cumsum()
        levels = rng.random(number) * cumulative[-1]
        first = np.minimum(np.searchsorted(cumulative, levels, side="right"), len(cumulative) - 1)
        inside = rng.random((number, 2))
        inside = np.where(inside.sum(axis=1, keepdims=True) > 1, 1 - inside, inside)
        a, b, c = np.moveaxis(self.patches.corners_m[first], 1, 0)
        point = a + inside[:, :1] * (b - a) + inside[:, 1:] * (c - a)
        leg_m = np.linalg.norm(point - (np.array(laser_spot_m) if from_m is None else from_m), axis=1)
        rows = np.stack([self._clusters.member[first], side[first]], axis=1)
        return leg_m + BIN_M * _random_bins(self._cumulative, rows, rng.random(number), rng.random(number))

    def arrivals(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return all light (B,) per m^2 at the detector spot, and its paths (B,) [m]."""
        return self._arrivals(*self._lit(laser_spot_m))

    def _arrivals(
        self, reflected: NDArray[np.float64], side: NDArray[np.int64], leg_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        bins = np.zeros(self._tails.shape[2] + ceil(leg_m.max(initial=0.0) / BIN_M) + 2)
        _spread(reflected, leg_m / BIN_M, self._clusters.member, side, self._tails, *self._span, bins)
        return bins, BIN_M * np.arange(len(bins), dtype=np.float64)

    def transient(self, laser_spot_m: Spot, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B,) expected photons per m^2 between B + 1 ascending edges after the wall [s]."""
        return self._between_edges(*self.arrivals(laser_spot_m), edges_s)

    def transient_seen(
        self, form: NDArray[np.floating], laser_spot_m: NDArray[np.float64], edges_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return as `transient`, where the form factors (K,) of the spot with the patches are known."""
        leg_m = np.linalg.norm(self.patches.centre_m - laser_spot_m, axis=1)
        return self._between_edges(*self._arrivals(*self._reflected(form.astype(np.float64), leg_m)), edges_s)

    @staticmethod
    def _between_edges(
        bins: NDArray[np.float64], path_m: NDArray[np.float64], edges_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        edges_m = np.append(path_m - BIN_M / 2, path_m[-1] + BIN_M / 2)
        reached = np.append(0.0, bins.cumsum())
        return np.diff(np.interp(edges_s * C_M_PER_S, edges_m, reached))

    def _lit(self, laser_spot_m: Spot) -> _Lit:
        """Return what each patch gets from a spot; the last spot is remembered."""
        last = self._last
        if last is None or last[0] != laser_spot_m:
            spot = np.array(laser_spot_m, dtype=np.float64)
            lit = self._reflected(*open_form_factors(spot, self.patches.centre_m, self.patches.normal))
            shade(self._blockers, spot, self.patches.centre_m, lit[0])
            last = self._last = (laser_spot_m, lit)
        return last[1]

    def _reflected(self, form: NDArray[np.float64], leg_m: NDArray[np.float64]) -> _Lit:
        """Return what each patch reflects towards others of what it gets by form factors (K,)."""
        side = ((form > 0) ^ self._clusters.flipped).astype(np.int64)
        leads_on = self._cumulative[self._clusters.member, side, -1] > 0
        return np.abs(form) * self.patches.area_m2 * self.patches.albedo * leads_on, side, leg_m


def _span(cumulative: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first bin (M, 2) of each tail with light, and the one after the last that matters."""
    total = cumulative[:, :, -1]
    enough = (1 - FAINT) * total[:, :, None]
    return (cumulative > 0).argmax(axis=2), (cumulative < enough).sum(axis=2) + (total > 0)


@njit(cache=True, error_model="numpy", nogil=True)
def _collect(form, leg, reflecting, member, flipped, width, tails):  # type: ignore[no-untyped-def]
    """Add what each patch reflects towards the detector to its cluster's tail."""
    for k in range(len(form)):
        if form[k] == 0.0:
            continue
        side = 1 if (form[k] > 0.0) != flipped[k] else 0
        place = leg[k] / width
        b = int(place)
        part, light = place - b, abs(form[k]) * reflecting[k]
        tails[member[k], side, b] += (1.0 - part) * light
        tails[member[k], side, b + 1] += part * light


@njit(cache=True, error_model="numpy", nogil=True)
def _add(tail, b, early, late, bins):  # type: ignore[no-untyped-def]
    """Add ``early`` times the tail from bin b on, and ``late`` times the same from the next."""
    if len(tail) == 0:
        return
    bins[b] += early * tail[0]
    inner = bins[b + 1 : b + len(tail)]
    for i in range(len(inner)):
        inner[i] += early * tail[i + 1] + late * tail[i]
    bins[b + len(tail)] += late * tail[-1]


@njit(cache=True, error_model="numpy", nogil=True)
def _bounce(j, forms, places, centre, normal, reflecting, tails, first, last, more):  # type: ignore[no-untyped-def]
    """Add to ``more`` (2, B) what leaves either side of cluster j and goes on by the tails of the others.

    Light is shared between two bins so that the mean time is kept.
    """
    for k in range(len(forms)):
        if forms[k] == 0.0:
            continue
        from_j, to_k = 0.0, 0.0
        for axis in range(3):
            d = centre[k, axis] - centre[j, axis]
            from_j += d * normal[j, axis]
            to_k += d * normal[k, axis]
        here = 0 if from_j > 0.0 else 1
        there = 1 if to_k > 0.0 else 0
        b = int(places[k])
        late = (places[k] - b) * forms[k] * reflecting[k]
        early = forms[k] * reflecting[k] - late
        _add(tails[k, there, first[k, there] : last[k, there]], b + first[k, there], early, late, more[here])


@njit(cache=True, error_model="numpy", nogil=True)
def _spread(reflected, place, member, side, tails, first, last, bins):  # type: ignore[no-untyped-def]
    """Add the tail of each patch's cluster, delayed by the way to the patch."""
    for k in range(len(reflected)):
        if reflected[k] == 0.0:
            continue
        b = int(place[k])
        late = (place[k] - b) * reflected[k]
        early = reflected[k] - late
        row, start, stop = member[k], first[member[k], side[k]], last[member[k], side[k]]
        _add(tails[row, side[k], start:stop], b + start, early, late, bins)


@njit(cache=True, error_model="numpy", nogil=True)
def _random_bins(cumulative, rows, levels, inside):  # type: ignore[no-untyped-def]
    """Draw a place in bins from the cumulative tail of each row."""
    places = np.empty(len(rows))
    for n in range(len(rows)):
        tail = cumulative[rows[n, 0], rows[n, 1]]
        places[n] = np.searchsorted(tail, levels[n] * tail[-1], side="right") + inside[n] - 0.5
    return places
