"""The way of a moving laser spot over the wall: where each photon leaves it, and where light is rendered."""

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
from numpy.typing import NDArray

#: Between times so far apart [s] the spot goes straight and evenly. With the servo's acceleration of at most
#: w^2 times a step e, where it really is lies within w^2 e dt^2 / 8 of that: 3e-4 e at 400 Hz, which is 3 um
#: or 0.01 ps for steps of 1 cm, and 0.6 mm or 2 ps for one across the whole wall.
STEP_S = 20e-6

#: Light is rendered at places this far apart along the way [m], and in between taken from the two next to it
#: in proportion. That misses h^2/8 times the second derivative of a patch's light, which goes as r^-4 and
#: with two cosines: less than 20 h^2 / (8 r^2), or 0.1 %, at r = 1 m. A shadow's edge is spread over at most
#: h, which is a patch's edge. The length of each photon's path is that from its own place: nothing of this
#: misplaces it in time.
KNOT_M = 0.02


@dataclass(frozen=True)
class Knot:
    """A place on the way at which light is rendered, for all photons that leave from near it.

    Attributes
    ----------
    spot_m
        Where [m].
    share
        What part of all photons is drawn as if from here, if light is as bright everywhere.
    reached
        (n,) the same up to the end of each step of the way.
    """

    spot_m: tuple[float, float, float]
    share: float
    reached: NDArray[np.float64]

    def moments(self, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw when (number,) photons leave, as parts of the way's duration."""
        steps = len(self.reached)
        step = np.searchsorted(self.reached, rng.random(number) * self.reached[-1], "right")
        return np.asarray((np.minimum(step, steps - 1) + rng.random(number)) / steps)


@dataclass(frozen=True)
class Track:
    """A way over the wall.

    Attributes
    ----------
    spots_m
        (n + 1, 3) where the spot is [m], at even times from beginning to end.
    duration_s
        How long it takes [s].
    """

    spots_m: NDArray[np.float64]
    duration_s: float

    def at(self, moments: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) where the spot is after these parts (N,) of the duration [m]."""
        place = moments * (len(self.spots_m) - 1)
        step = np.minimum(place.astype(np.int64), len(self.spots_m) - 2)
        here = self.spots_m[step]
        return np.asarray(here + (place - step)[:, None] * (self.spots_m[step + 1] - here))

    def part(self, begin_s: float, end_s: float) -> "Track":
        """Return the way between two times from its beginning [s]."""
        if begin_s <= 0 and end_s >= self.duration_s:
            return self
        steps = max(ceil((end_s - begin_s) / STEP_S), 1)
        moments = np.linspace(begin_s, end_s, steps + 1) / self.duration_s
        return Track(self.at(np.minimum(moments, 1.0)), end_s - begin_s)

    @cached_property
    def knots(self) -> tuple[Knot, ...]:
        """The places at which light is rendered: both ends, and evenly along the way between them."""
        way_m = np.append(0.0, np.linalg.norm(np.diff(self.spots_m, axis=0), axis=1).cumsum())
        pieces = max(ceil(way_m[-1] / KNOT_M), 1)
        piece_m = max(float(way_m[-1]), 1e-12) / pieces
        place = (way_m[:-1] + way_m[1:]) / 2 / piece_m
        knots = []
        for k in range(pieces + 1):
            x, y, z = (float(np.interp(k * piece_m, way_m, axis)) for axis in self.spots_m.T)
            reached = np.maximum(1 - np.abs(place - k), 0.0).cumsum() / len(place)
            if reached[-1] > 0:
                knots.append(Knot((x, y, z), float(reached[-1]), reached))
        return tuple(knots)


def distance_m(spots_m: NDArray[np.float64], place_m: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return (N,) how far (N, 3) spots are from a place [m]."""
    return np.asarray(np.linalg.norm(spots_m - np.array(place_m), axis=1))
