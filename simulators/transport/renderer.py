"""Light from laser spots over a hidden scene to detector spots: all bounces, all rows of a capture."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.threads import each
from simulators.transport.extra_bounces import Interreflections
from simulators.transport.geometry import Patches
from simulators.transport.three_bounces import Spot, ThreeBounces
from simulators.transport.visibility import occluders

#: How many bounces can be followed: wall, one to three surfaces (the second of three may be the wall), wall.
BOUNCES = (3, 4, 5)


class Way(Protocol):
    """Light of certain numbers of bounces from any laser spot to one detector spot."""

    def from_spot(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (K,) light per m^2 at the detector spot by the first patch it meets, and mean paths [m]."""
        ...

    def random_paths(
        self, laser_spot_m: Spot, weight_per_m2: NDArray[np.float64], number: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw (number,) paths [m], given the weights that `from_spot` returned."""
        ...

    def arrivals(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return light per m^2 at the detector spot and its paths [m], as fine as the way knows them."""
        ...

    def transient(self, laser_spot_m: Spot, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B,) expected photons per m^2 between B + 1 ascending edges after the wall [s]."""
        ...


class Transport:
    """All bounces that are asked for, in one scene.

    Parameters
    ----------
    patches
        Surfaces of the scene, cut small.
    triangles_m
        (T, 3, 3) triangles that block light [m]; they may be coarser than the patches.
    bounces
        3, 4 or 5; the higher ones add to the lower.
    wall_albedo
        What the relay wall reflects in the middle of five bounces.

    Raises
    ------
    ValueError
        If ``bounces`` is none of these.
    """

    def __init__(
        self,
        patches: Patches,
        triangles_m: NDArray[np.float64],
        *,
        bounces: int = 3,
        wall_albedo: float = 0.8,
    ) -> None:
        if bounces not in BOUNCES:
            raise ValueError(f"{bounces} bounces cannot be followed: choose 3, 4 or 5")
        self.patches = patches
        self._blockers = occluders(triangles_m)
        self._between = (
            Interreflections(patches, self._blockers, bounces, wall_albedo) if bounces > 3 else None
        )

    def towards(self, detector_spot_m: Spot) -> tuple[Way, ...]:
        """Return the ways to one detector spot; three bounces first."""
        three = ThreeBounces(self.patches, self._blockers, detector_spot_m)
        return (three, self._between.towards(detector_spot_m)) if self._between else (three,)

    def transients(
        self, laser_m: NDArray[np.float64], detector_m: NDArray[np.float64], edges_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the noise-free transients of a capture, or of a part of its rows, without any instrument.

        Parameters
        ----------
        laser_m
            (P, 3) laser spots [m].
        detector_m
            (1, 3) one detector spot for all, or (P, 3) one for each, e.g. ``laser_m`` for a confocal capture;
            for several detectors call once for each [m].
        edges_s
            (B + 1,) ascending bin edges; time zero is the pulse leaving the wall [s].

        Returns
        -------
        ndarray
            (P, B) photons in each bin, for one photon that leaves the laser spot, per m^2 at the detector
            spot. It takes 8 P B bytes: ask for a large capture line by line.

        Raises
        ------
        ValueError
            If there are neither one nor P detector spots.
        """
        if len(detector_m) not in (1, len(laser_m)):
            raise ValueError(
                f"{len(detector_m)} detector spots for {len(laser_m)} laser spots: give one, or as many"
            )
        if len(detector_m) == 1:
            return along(self.towards(tuple(detector_m[0])), laser_m, edges_s)
        transients = np.zeros((len(laser_m), len(edges_s) - 1))

        def row(index: int) -> None:
            for way in self.towards(tuple(detector_m[index])):
                transients[index] += way.transient(tuple(laser_m[index]), edges_s)

        each(row, len(laser_m))
        return transients


def along(
    ways: tuple[Way, ...], laser_m: NDArray[np.float64], edges_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (P, B) noise-free transients by the ways to one detector spot; see `Transport.transients`."""
    transients = np.zeros((len(laser_m), len(edges_s) - 1))

    def row(index: int) -> None:
        for way in ways:
            transients[index] += way.transient(tuple(laser_m[index]), edges_s)

    each(row, len(laser_m))
    return transients


def expected_transient(
    patches: Patches,
    triangles_m: NDArray[np.float64],
    laser_m: NDArray[np.float64],
    detector_m: NDArray[np.float64],
    edges_s: NDArray[np.float64],
    bounces: int = 3,
) -> NDArray[np.float64]:
    """Return (P, B) noise-free transients; see `Transport.transients`."""
    return Transport(patches, triangles_m, bounces=bounces).transients(laser_m, detector_m, edges_s)
