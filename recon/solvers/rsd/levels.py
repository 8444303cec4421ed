"""Low frequencies on coarse lattices: each part of a band is computed on as few points as its waves need.

A lattice has to be fine enough for the highest frequency of a band; most others oscillate less. So a band is
cut into levels. A level has a lattice of its own, over which the wall is spread, as in
`recon.solvers.rsd.lattice`, and whose points are read in place of the voxels. What is interpolated at the
voxels is not the field of each frequency but the sum of all, once for each plane:

    S(v) = sum_n exp(i (omega_n - omega_L) t(v)) F_n(v),    U(v) = sum_levels exp(i omega_L t(v)) S(v),

with omega_L the level's highest frequency. F_n oscillates in space with k_n, its phase with k_L - k_n where
the moments t(v) change no faster than light does, so that S oscillates with k_L at most, whichever
frequencies are summed.

Lattices are also coarser the deeper a plane is: at an offset d a wave oscillates with k d/r alone. A plane as
far from the wall as this is wide takes two thirds of the points that it would take on one lattice.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import inf, log, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, LatticeAxis
from recon.capture import C_M_PER_S
from recon.grid import VoxelGrid
from recon.solvers.rsd import kernels
from recon.solvers.rsd.lattice import AxisPlan, Taps, coarse_axis, plan_axis
from recon.solvers.rsd.regular import LatticePropagator, turn
from recon.solvers.spectral import Field
from recon.wave import Band

#: What windows are designed for, so that each interpolation errs by about 1e-5 of the wave: as single
#: precision does over many FFTs. They err by more than designed, as a wave within a window has no spectrum
#: that ends.
DESIGNED = 3e-6
#: Lattices that are tried, in steps of the finest one, and at how many frequencies a band may be cut.
STEPS, CUTS = np.geomspace(1.1, 8, 24), 10
#: Most levels of a band.
MOST = 3
#: What a frequency takes beside its points, and a level beside its frequencies, in points of a plane.
EACH, LEVEL = 8e3, 2.5e5
#: A level of a larger part of the critical rate than this would need too long a window.
DENSEST = 0.7
#: How much longer windows are than by the formula, since the oscillation changes within them.
SAFETY = 1.1
#: The half-width of the longest window, and how often windows are widened for where they end.
WIDEST, WIDENINGS = 40, 5
#: Frequencies of which fewer are not worth being cut.
FEWEST = 4

#: Moments at which the voxels of a plane are read: takes voxels and the plane's depth, as of the aperture.
Moments = Callable[[VoxelGrid, float], NDArray[np.float64]]


@dataclass(frozen=True)
class Axis:
    """An axis of a level.

    Attributes
    ----------
    plan
        How the wall is put on the lattice, and which points are read.
    points_m
        (points,) where these are.
    taps
        From which of them each voxel is interpolated; None where they are the voxels.
    """

    plan: AxisPlan
    points_m: NDArray[np.float64]
    taps: Taps | None


@dataclass(frozen=True)
class Level:
    """Neighbouring frequencies that are computed on one lattice.

    Attributes
    ----------
    part
        Which of the band.
    y, x
        Axes.
    """

    part: slice
    y: Axis
    x: Axis

    @property
    def points(self) -> float:
        """Points of its FFTs: half of the work is the wave's, and half that on what is left when folded."""
        y, x = self.y.plan, self.x.plan
        return (y.length * x.length + y.folded * x.folded) / 2


@dataclass(frozen=True)
class Side:
    """What an axis of levels is planned for.

    Attributes
    ----------
    wall
        Axis of the wall.
    first_m, last_m, count
        Voxels.
    slope
        By how much the moments change along it, as a part of what light takes for the way.
    """

    wall: LatticeAxis
    first_m: float
    last_m: float
    count: int
    slope: float

    @property
    def voxels_m(self) -> NDArray[np.float64]:
        """(count,) coordinates of voxels."""
        return np.linspace(self.first_m, self.last_m, self.count)

    def reach_m(self, near_m: float) -> float:
        """Return the longest offset of a wave, or that at which one oscillates as fast as the moments do."""
        begin_m, end_m = self.wall.coordinates_m[[0, -1]]
        as_moments_m = near_m * self.slope / sqrt(1 - self.slope**2)
        return float(max(self.last_m - begin_m, end_m - self.first_m, as_moments_m))


@dataclass(frozen=True)
class Scene:
    """What levels are planned for.

    Attributes
    ----------
    y, x
        Both axes.
    near_m
        Depth of the nearest plane, from the wall.
    round_trip_factor
        As of `LatticePropagator`.
    """

    y: Side
    x: Side
    near_m: float
    round_trip_factor: int

    @classmethod
    def of(cls, aperture: Aperture, grid: VoxelGrid, round_trip_factor: int, moments: Moments) -> "Scene":
        """Look at a scene, at its nearest plane."""
        near_m = float(grid.z_m[0])
        slopes = (C_M_PER_S / round_trip_factor * one for one in _slopes(grid, near_m, moments))
        axes = (aperture.y, grid.y_m), (aperture.x, grid.x_m)
        y, x = (
            Side(wall, float(at_m[0]), float(at_m[-1]), len(at_m), slope)
            for (wall, at_m), slope in zip(axes, slopes, strict=True)
        )
        return cls(y, x, near_m, round_trip_factor)


class _OnLevel(LatticePropagator):
    """Convolves with the spherical wave on the lattice of a level.

    Attributes
    ----------
    grid
        The points that are read.
    """

    def __init__(self, level: Level, grid: VoxelGrid, **named: Any) -> None:
        self._level, self.grid = level, grid
        super().__init__(grid=grid, **named)

    def _plans(self, aperture: Aperture, grid: VoxelGrid) -> tuple[AxisPlan, AxisPlan]:
        return self._level.y.plan, self._level.x.plan

    def at_voxels(self, z_m: float, times_s: NDArray[np.float64], reference_rad_per_s: float | None) -> Field:
        """Return what is slow, as `slow` does with the points' moments, interpolated at the voxels."""
        sums, y, x = self.slow(z_m, times_s, reference_rad_per_s), self._level.y.taps, self._level.x.taps
        return np.stack([_interpolated(one, y, x) for one in sums]) if y and x else sums


class LevelPropagator:
    """Focuses a band level by level.

    Parameters
    ----------
    aperture, emitted, band, round_trip_factor, wall_bytes, threads
        As of `LatticePropagator`.
    grid
        Voxels, at the depth that lattices are planned for.
    moments
        When they are read.
    """

    def __init__(
        self,
        aperture: Aperture,
        emitted: NDArray[np.complex64],
        band: Band,
        grid: VoxelGrid,
        round_trip_factor: int,
        moments: Moments,
        wall_bytes: int,
        threads: int,
    ) -> None:
        self._moments, self._grid = moments, grid
        levels = plan_levels(Scene.of(aperture, grid, round_trip_factor, moments), band)
        whole = sum(level.points * len(band[level.part]) for level in levels)
        self._levels = [
            _OnLevel(
                level,
                VoxelGrid(level.x.points_m, level.y.points_m, grid.z_m),
                aperture=aperture,
                emitted=emitted[level.part],
                band=band[level.part],
                round_trip_factor=round_trip_factor,
                wall_bytes=int(wall_bytes * level.points * len(band[level.part]) / whole),
                threads=threads,
            )
            for level in levels
        ]

    def focus(self, z_m: float, reference_rad_per_s: float | None = None) -> Field:
        """Sum the fields over all frequencies, as `LatticePropagator.focus` does at the voxels' moments."""
        times_s = self._moments(self._grid, z_m)
        shape = 1 + (reference_rad_per_s is not None), *self._grid.shape[1:]
        total = np.zeros(shape, np.complex64)
        for one in self._levels:
            sums = one.at_voxels(z_m, self._moments(one.grid, z_m), reference_rad_per_s)
            turn(sums, one.band.last_rad_per_s, times_s)
            total += sums
        return total


def _interpolated(field: NDArray[np.complex64], y: Taps, x: Taps) -> NDArray[np.complex64]:
    """Interpolate a field along both axes."""
    rows = np.empty((len(y[0]), field.shape[1]), np.complex64)
    kernels.read_rows(field, *y, rows)
    columns = np.empty((len(x[0]), len(rows)), np.complex64)
    kernels.read_rows(np.ascontiguousarray(rows.T), *x, columns)
    return columns.T


def plan_levels(scene: Scene, band: Band) -> tuple[Level, ...]:
    """Cut a band into the levels that take the least time; at best, the lattice of all alone.

    A run of a band is cut where the whole band would be.
    """
    whole, begins, many = band.whole, band.begins, len(band)
    limits = (
        scene.round_trip_factor * one / C_M_PER_S for one in (whole.first_rad_per_s, whole.last_rad_per_s)
    )
    levels = []
    for level in _planned(scene, len(whole), *limits):
        start, stop = (min(max(one - begins, 0), many) for one in (level.part.start, level.part.stop))
        if stop > start:
            levels.append(replace(level, part=slice(start, stop)))
    return tuple(levels)


def work_points(levels: tuple[Level, ...]) -> float:
    """Return what a plane takes, in points of FFTs."""
    return sum(level.points * (level.part.stop - level.part.start) for level in levels)


@lru_cache(maxsize=256)
def _planned(scene: Scene, many: int, lowest: float, highest: float) -> tuple[Level, ...]:
    """Plan the levels of so many frequencies with wavenumbers from `lowest` to `highest` [rad/m]."""
    sides = scene.y, scene.x
    last = [
        Axis(plan_axis(one.wall, one.voxels_m, highest, scene.near_m), one.voxels_m, None) for one in sides
    ]
    whole = Level(slice(0, many), *last)
    if many < FEWEST or scene.near_m <= 0 or max(scene.y.slope, scene.x.slope) >= 1:
        return (whole,)
    stops = np.unique(np.linspace(0, many, CUTS + 1).round().astype(int))[1:]
    tops = lowest + (highest - lowest) * (stops - 1) / (many - 1)
    y, x = (
        _lattices(side, scene.near_m, tops, axis.plan.step_m) for side, axis in zip(sides, last, strict=True)
    )
    levels = []
    for start, cut in _cut(stops, np.minimum(y.lengths * x.lengths, whole.points)):
        level = None
        if y.lengths[cut] * x.lengths[cut] < whole.points:
            level = Level(slice(start, int(stops[cut])), y.axis(scene.y, cut), x.axis(scene.x, cut))
        if level is None or level.points >= whole.points:
            level = replace(whole, part=slice(start, many))
        levels.append(level)
        if level.part.stop == many:
            break
    return tuple(levels)


def _cut(stops: NDArray[np.intp], points: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return where the levels begin that take the least, and the number of the stop where each ends.

    Parameters
    ----------
    stops
        (cuts,) ascending ends of levels that are tried, the last that of the band.
    points
        (cuts,) points of a lattice that is fine enough up to each.
    """
    last = len(stops) - 1

    def work(chosen: tuple[int, ...]) -> float:
        ends = [*chosen, last]
        return float(np.diff(stops[ends], prepend=0) @ (points[ends] + EACH)) + LEVEL * len(chosen)

    tried = (chosen for many in range(MOST) for chosen in combinations(range(last), many))
    found = min(tried, key=work)
    return list(zip([0, *(int(stops[one]) for one in found)], [*found, last], strict=True))


@dataclass(frozen=True)
class _Lattices:
    """Lattices along an axis, one for each wavenumber up to which they are fine enough.

    Attributes
    ----------
    steps_m, half_widths
        Their steps, and those of the windows with which they are interpolated.
    lengths
        About how many points there are; infinite where no lattice is fine enough.
    """

    steps_m: NDArray[np.float64]
    half_widths: NDArray[np.float64]
    lengths: NDArray[np.float64]

    def axis(self, side: Side, which: int) -> Axis:
        """Return an axis on one of them."""
        step_m, half_width = float(self.steps_m[which]), int(self.half_widths[which])
        return Axis(*coarse_axis(side.wall, side.voxels_m, step_m, half_width, DESIGNED))


def _lattices(side: Side, near_m: float, wavenumbers: NDArray[np.float64], finest_m: float) -> _Lattices:
    """Choose the lattice with the fewest points for each wavenumber [rad/m]."""
    steps_m = np.broadcast_to(STEPS * finest_m, (len(wavenumbers), len(STEPS)))
    half_widths = window_half_widths(wavenumbers[:, None], near_m, side.reach_m(near_m), steps_m)
    span_m = side.last_m - side.first_m + side.wall.pitch_m * (side.wall.count - 1)
    lengths = span_m / steps_m + 4 * half_widths
    best = lengths.argmin(axis=1)[:, None]
    return _Lattices(*(np.take_along_axis(one, best, 1)[:, 0] for one in (steps_m, half_widths, lengths)))


def window_half_widths(
    wavenumber: NDArray[np.float64] | float, near_m: float, reach_m: float, steps_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the half-widths of windows that interpolate exp(i k r)/r, r^2 = d^2 + z^2, as `DESIGNED`.

    They follow from Kaiser's formula for the oscillation where the window ends, beyond the longest offset.

    Parameters
    ----------
    wavenumber, near_m, reach_m
        k [rad/m], the least z, and the longest offset d.
    steps_m
        Steps of lattices; all are broadcast.

    Returns
    -------
    ndarray
        In lattice steps; infinite where a lattice is too coarse.
    """
    evanescent = -log(DESIGNED) / near_m  # what oscillates faster is damped to that on its way

    def needed(half_width: NDArray[np.float64]) -> NDArray[np.float64]:
        end_m = reach_m + half_width * steps_m
        rho = steps_m / pi * np.hypot(wavenumber * end_m / np.hypot(end_m, near_m), evanescent)
        return np.where(rho < DENSEST, -log(DESIGNED) / (pi * (1 - np.minimum(rho, DENSEST))), inf)

    found = np.zeros(np.broadcast_shapes(np.shape(wavenumber), steps_m.shape))
    for _ in range(WIDENINGS):
        found = np.minimum(needed(found), WIDEST)
    half_width = np.ceil(SAFETY * found) + 1
    return np.where(needed(half_width) <= half_width, half_width, inf)


def _slopes(grid: VoxelGrid, near_m: float, moments: Moments) -> tuple[float, float]:
    """Return by how much moments change along y and x, for each metre, beyond the voxels too."""
    y_m, x_m = (np.linspace(*_widened(at_m), 33) for at_m in (grid.y_m, grid.x_m))
    found = moments(VoxelGrid(x_m, y_m, grid.z_m), near_m)[0]
    found = np.broadcast_to(found, (33, 33))
    along_y, along_x = (np.abs(np.diff(found, axis=axis)).max() for axis in range(2))
    return float(along_y / (y_m[1] - y_m[0])), float(along_x / (x_m[1] - x_m[0]))


def _widened(at_m: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of an axis, and a quarter of its length or 10 cm more."""
    more_m = max(0.1, 0.25 * float(at_m[-1] - at_m[0]))
    return float(at_m[0]) - more_m, float(at_m[-1]) + more_m
