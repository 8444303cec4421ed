"""The photons of each position as an image of the wall."""

from bisect import bisect_right
from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, LatticeAxis, recognise
from recon.errors import GeometryError


@dataclass(frozen=True)
class WallMap:
    """Where the positions of a scan lie in an image of the wall.

    Attributes
    ----------
    cells
        The image's pixels, and which of them each position is in: one position each, where they are evenly
        spaced; else square cells that hold one on average.
    even
        Whether the positions are evenly spaced.
    rounds
        Number of positions by the end of each round.
    """

    cells: Aperture
    even: bool
    rounds: tuple[int, ...]

    @classmethod
    def of(cls, spots_m: NDArray[np.float64], rounds: tuple[int, ...]) -> "WallMap":
        """Make the map of (P, 3) positions."""
        middle_m = (spots_m[:, 2].min() + spots_m[:, 2].max()) / 2
        try:
            return cls(recognise(spots_m - [0, 0, middle_m]), True, rounds)
        except GeometryError:
            return cls(_in_cells(spots_m), False, rounds)

    def image(self, photons: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """Return (rows, columns) photons, and of how many positions the side of a square is their mean.

        Parameters
        ----------
        photons
            (P,) photons of each position; NaN where it was not measured, as in the image. In progressive
            order squares of the finest complete round have the mean of what was measured in them.
        """
        there = np.isfinite(photons)
        side = _side_of_a_square(self.rounds, int(np.count_nonzero(there))) if self.even else 1
        return _in_squares(self.cells, there, photons, side), side


def squares_in_words(side: int) -> str:
    """Say of what the pixels of an image are means; nothing where they are not."""
    return f"means of squares of {side} x {side} positions" if side > 1 else ""


def _in_cells(spots_m: NDArray[np.float64]) -> Aperture:
    """Put scattered positions into square cells, as many as there are positions."""
    low_m = spots_m[:, :2].min(axis=0)
    size_m = np.maximum(np.ptp(spots_m[:, :2], axis=0), 1e-3)
    side_m = max(sqrt(size_m[0] * size_m[1] / len(spots_m)), float(size_m.max()) / len(spots_m))
    column, row = ((spots_m[:, :2] - low_m) / side_m).astype(np.intp).T
    x, y = (
        LatticeAxis(float(low + side_m / 2), float(side_m), int(place.max()) + 1)
        for low, place in zip(low_m, (column, row), strict=True)
    )
    return Aperture(x, y, column, row)


def _side_of_a_square(rounds: tuple[int, ...], measured: int) -> int:
    """Return how many positions are in the side of a square that holds a measured one everywhere.

    The last round of a progressive scan is the whole grid; each before it has half of its positions.
    """
    complete = max(bisect_right(rounds, measured) - 1, 0)
    return int(2 ** ceil((len(rounds) - 1 - complete) / 2))


def _in_squares(
    wall: Aperture, there: NDArray[np.bool_], photons: NDArray[np.float64], side: int
) -> NDArray[np.float64]:
    """Return (rows, columns) the mean of what was measured in each square; NaN where nothing was."""
    rows, columns = -(-wall.y.count // side), -(-wall.x.count // side)
    square = (wall.row[there] // side) * columns + wall.column[there] // side
    visits = np.bincount(square, minlength=rows * columns)
    sums = np.bincount(square, photons[there], minlength=rows * columns)
    means = np.divide(sums, visits, out=np.full(rows * columns, np.nan), where=visits > 0)
    full = means.reshape(rows, columns).repeat(side, axis=0).repeat(side, axis=1)
    return full[: wall.y.count, : wall.x.count]
