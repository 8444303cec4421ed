"""Light of a hidden scene from any laser spot to one detector spot: what every renderer of scenes gives."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.parallel import parallel_for

Spot = tuple[float, float, float]


class LightPaths(Protocol):
    """Light that goes from any laser spot to one detector spot, e.g. all of three bounces.

    A path is as long as the way from the laser spot to the detector spot [m]. Light is given as the expected
    photons per m^2 at the detector spot, for one photon that leaves the laser spot.
    """

    def flux(self, laser_spot_m: Spot) -> float:
        """Return all light [1/m^2]."""
        ...

    def sample(
        self,
        laser_spot_m: Spot,
        number: int,
        rng: np.random.Generator,
        from_m: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Draw the paths (number,) of photons that arrive [m], in any order.

        Where each leaves the wall may be told by (number, 3) spots ``from_m`` near the laser spot, themselves
        in random order: then the light goes where that of the laser spot goes, but each path is as long as
        from there, and in their order.
        """
        ...

    def arrivals(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (K,) light [1/m^2] and its (K,) paths [m], as finely divided as they are known."""
        ...

    def transient(self, laser_spot_m: Spot, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B,) light [1/m^2] between B + 1 ascending edges after the laser spot [s]."""
        ...


class Renderer(Protocol):
    """One hidden scene."""

    def light_paths(self, detector_spot_m: Spot) -> tuple[LightPaths, ...]:
        """Return the light that comes to one detector spot; the parts are drawn one after the other."""
        ...


def transients(
    light_paths: tuple[LightPaths, ...], laser_m: NDArray[np.float64], edges_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (P, B) noise-free transients of (P, 3) laser spots at one detector spot, on all cores.

    They are the photons between B + 1 ascending edges after the laser spot [s], for one photon that leaves
    it, per m^2 at the detector spot. It takes 8 P B bytes: ask for a large capture line by line.
    """
    rows = np.zeros((len(laser_m), len(edges_s) - 1))

    def fill(index: int) -> None:
        for paths in light_paths:
            rows[index] += paths.transient(tuple(laser_m[index]), edges_s)

    parallel_for(fill, len(laser_m))
    return rows
