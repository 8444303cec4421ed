"""What one channel of the detector sees of a hidden scene that moves as a whole.

A scene that is moved by o sends light from a laser spot x_p to a detector spot x_c as the scene where it
stood sends it from x_p - o to x_c - o: all distances and angles are the same. So nothing is cut into patches
anew, and no tree of what hides what is built anew; only the second leg, to the detector, is computed once for
each position and channel.
"""

from collections.abc import Iterator
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Spot
from simulators.motion.path import BackAndForth
from simulators.photons import HiddenScenePhotons
from simulators.transport.light_paths import LightPaths, Renderer


def shifted(spot_m: Spot, offset_m: Spot) -> Spot:
    """Return a spot on the wall as it lies to a scene that is moved by an offset."""
    return spot_m[0] - offset_m[0], spot_m[1] - offset_m[1], spot_m[2] - offset_m[2]


class MovedPaths:
    """Light of a scene that was moved; a `simulators.transport.light_paths.LightPaths`.

    Parameters
    ----------
    paths
        Of the scene where it stood, to the `shifted` detector spot.
    offset_m
        By how much it was moved [m].
    """

    def __init__(self, paths: LightPaths, offset_m: Spot) -> None:
        self._paths, self._offset_m = paths, offset_m

    def flux(self, laser_spot_m: Spot) -> float:
        """Return all light [1/m^2]."""
        return self._paths.flux(shifted(laser_spot_m, self._offset_m))

    def sample(
        self,
        laser_spot_m: Spot,
        number: int,
        rng: np.random.Generator,
        from_m: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Draw the paths (number,) of photons that arrive [m], maybe from spots of their own."""
        moved_m = None if from_m is None else from_m - self._offset_m
        return self._paths.sample(shifted(laser_spot_m, self._offset_m), number, rng, moved_m)

    def arrivals(self, laser_spot_m: Spot) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (K,) light [1/m^2] and its (K,) paths [m]."""
        return self._paths.arrivals(shifted(laser_spot_m, self._offset_m))

    def transient(self, laser_spot_m: Spot, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B,) light [1/m^2] between B + 1 ascending edges after the laser spot [s]."""
        return self._paths.transient(shifted(laser_spot_m, self._offset_m), edges_s)


class MovingScenePhotons(HiddenScenePhotons):
    """Detections of light of a hidden scene that moves; satisfies `simulators.bench.MovingPhotons`.

    Parameters
    ----------
    renderer
        What is hidden, where it stands without motion.
    motion
        How it moves.
    others
        As of `HiddenScenePhotons`.
    """

    def __init__(self, renderer: Renderer, motion: BackAndForth, *others: Any, **named: Any) -> None:
        super().__init__(renderer, *others, **named)
        self._renderer, self._motion, self._begin_s = renderer, motion, 0.0
        self._last: list[tuple[int, tuple[LightPaths, ...]]] = []  # shared by all copies

    def at(self, bench_s: float) -> Self:
        """Return the same, of a scene that is where it is at a bench time [s], and goes on from there."""
        moved = copy(self)
        moved._begin_s = bench_s
        return moved

    def _lit(self, duration_s: float) -> Iterator[tuple[tuple[LightPaths, ...], float]]:
        for step, part_s in self._motion.pieces(self._begin_s, duration_s):
            yield self._paths_of(step), part_s

    def _paths_of(self, step: int) -> tuple[LightPaths, ...]:
        """Return the light of the scene at a position; the last one is remembered."""
        for known, paths in self._last:  # none, or one; other threads may replace it
            if known == step:
                return paths
        offset_m = self._motion.offset_m(step)
        still = self._renderer.light_paths(shifted(self.detector_spot_m, offset_m))
        moved = tuple(MovedPaths(paths, offset_m) for paths in still)
        self._last[:] = [(step, moved)]
        return moved
