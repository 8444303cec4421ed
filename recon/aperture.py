"""Recognise a regular grid of laser positions on the plane z = 0: a virtual aperture that an FFT can take."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.errors import GeometryError

#: How far a position may be from its lattice point [m]: a hundredth of a turn of phase at lambda = 2 cm.
TOLERANCE_M = 2e-4
#: Least part of the lattice's lines that must hold a position; scattered spots "fit" any fine enough lattice.
MIN_LINES = 0.5
#: Positions off the lattice that are taken for strays; of more, it is asked whether they make a finer one.
STRAYS = 3


@dataclass(frozen=True)
class LatticeAxis:
    """Evenly spaced coordinates.

    Attributes
    ----------
    start_m, pitch_m, count
        First coordinate, spacing, and number of lattice points. A single point has the pitch of the other
        axis.
    """

    start_m: float
    pitch_m: float
    count: int

    @property
    def coordinates_m(self) -> NDArray[np.float64]:
        """(count,) coordinates, ascending."""
        return self.start_m + self.pitch_m * np.arange(self.count, dtype=np.float64)


@dataclass(frozen=True)
class Aperture:
    """Positions as points of a lattice on the plane z = 0.

    Attributes
    ----------
    x, y
        Axes of the lattice.
    column, row
        (P,) index along x and y of each position; any order, and lattice points may be missing or repeated.
    """

    x: LatticeAxis
    y: LatticeAxis
    column: NDArray[np.intp]
    row: NDArray[np.intp]


def recognise(laser_m: NDArray[np.float64]) -> Aperture:
    """Find the lattice that the positions lie on.

    Parameters
    ----------
    laser_m
        (P, 3) laser spots, in any order.

    Raises
    ------
    GeometryError
        If the spots are not on z = 0, or not evenly spaced along x or y; it names the position that is
        farthest off.
    """
    return _recognised(np.asarray(laser_m, np.float64).tobytes())


@lru_cache(maxsize=4)
def _recognised(spots: bytes) -> Aperture:
    """Find the lattice of positions given by their bytes: solvers ask for each depth block anew."""
    laser_m = np.frombuffer(spots).reshape(-1, 3)
    off_plane = np.abs(laser_m[:, 2])
    if off_plane.max() > TOLERANCE_M:
        worst = int(off_plane.argmax())
        raise _irregular(f"position {worst} is {laser_m[worst, 2] * 1e3:.2f} mm off the plane z = 0")
    x, column = _axis(laser_m[:, 0], "x")
    y, row = _axis(laser_m[:, 1], "y")
    if x.count == 1:
        x = LatticeAxis(x.start_m, y.pitch_m, 1)
    if y.count == 1:
        y = LatticeAxis(y.start_m, x.pitch_m, 1)
    column.flags.writeable = row.flags.writeable = False  # all who ask are given the same
    return Aperture(x, y, column, row)


def _axis(values_m: NDArray[np.float64], name: str) -> tuple[LatticeAxis, NDArray[np.intp]]:
    """Fit start and pitch to coordinates, and number them."""
    ordered = np.sort(values_m)
    lines = np.split(ordered, np.flatnonzero(np.diff(ordered) > 2 * TOLERANCE_M) + 1)
    crowd = np.array([len(line) for line in lines])
    # Lines with few positions may be strays: they do not make the lattice, but must fit it.
    levels = np.array([line.mean() for line in lines])[crowd >= np.median(crowd) / 4]
    steps = np.diff(levels)
    if len(steps) == 0:
        axis, index, error_m = _number(values_m, float(levels[0]), 2 * TOLERANCE_M)
    else:
        # The typical step is the pitch, unless so many lines are missing that most steps are longer.
        axis, index, error_m = _number(values_m, *_fit(levels, float(np.median(steps))))
        if error_m.max() > TOLERANCE_M:
            if np.count_nonzero(error_m > TOLERANCE_M) > STRAYS:
                # Lines of which only a few positions are measured yet belong to a finer lattice.
                levels = np.array([line.mean() for line in lines])
                steps = np.diff(levels)
            finer = _number(values_m, *_fit(levels, float(steps[steps < 1.5 * steps.min()].mean())))
            if finer[2].max() <= TOLERANCE_M and len(lines) >= MIN_LINES * finer[0].count:
                axis, index, error_m = finer
    if error_m.max() > TOLERANCE_M:
        worst = int(error_m.argmax())
        raise _irregular(
            f"position {worst} at {name} = {values_m[worst]:.4f} m is {error_m[worst] * 1e3:.2f} mm off the "
            f"best even spacing, {axis.pitch_m * 1e3:.3f} mm"
        )
    return axis, index


def _fit(levels_m: NDArray[np.float64], pitch_m: float) -> tuple[float, float]:
    """Fit start and pitch to levels whose steps are whole numbers of about `pitch_m`.

    Numbering each level from the one before keeps the pitch's error from growing along the axis.
    """
    numbers = np.concatenate([[0], np.cumsum(np.maximum(1, np.rint(np.diff(levels_m) / pitch_m)))])
    pitch, start = np.polyfit(numbers, levels_m, 1)
    return float(start), float(pitch)


def _number(
    values_m: NDArray[np.float64], start_m: float, pitch_m: float
) -> tuple[LatticeAxis, NDArray[np.intp], NDArray[np.float64]]:
    """Return the axis that holds all values, the point on it nearest to each, and the distance to that."""
    number = np.rint((values_m - start_m) / pitch_m)
    low = number.min()
    axis = LatticeAxis(float(start_m + low * pitch_m), pitch_m, int(number.max() - low) + 1)
    index = (number - low).astype(np.intp)
    return axis, index, np.abs(values_m - axis.coordinates_m[index])


def _irregular(found: str) -> GeometryError:
    return GeometryError(
        "aperture",
        "laser positions on an even grid on the plane z = 0",
        found,
        "Use the rsd solver or a back-projection, which take any positions.",
    )
