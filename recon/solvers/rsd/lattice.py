"""Where the field is computed along one axis: how the wall is put there, and how it is read at the voxels.

The wall's lattice and the voxels' axis need not match. Where the voxels lie on the wall's lattice, the field
is computed on that. Otherwise the lattice goes through the voxels, and what the wall emits is spread over it
by interpolation transposed: once for each frequency, where interpolating at the voxels would cost as much for
each plane too. Only voxels so fine that a lattice through them would be far longer are interpolated, from the
wall's lattice or one that is finer by a whole factor.

Voxels that are s lattice steps apart see a spectrum that is folded s times, so that the transform back has
only one point for each.

A field of wavenumber k holds spatial frequencies up to k. Sampled at h, it is rho = h k / pi of the
critical rate, and a sinc under a Kaiser window of half-width W samples interpolates it with an error of about
exp(-pi W (1 - rho)): the window's transform has that level at its first zero, where it meets the first copy
of the spectrum (Kaiser's design formula).

The wave that is interpolated is known, exp(i k r)/r with r^2 = d^2 + z^2. At an offset d it oscillates with
k d/r only, which is less than k where the depth z is not small beside wall and volume. So W is found by
trying: it is the least with which the wave at the nearest plane is interpolated as well as it should be, at
all offsets there are. Lattices of different steps are planned, and that with the least work is taken. Where
the wave is another, the lattice is refined until rho <= 0.75, and W follows from rho.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, gcd, hypot, inf, log, pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import LatticeAxis

Taps = tuple[NDArray[np.intp], NDArray[np.float32]]
#: Largest part of the critical sampling rate that is interpolated from.
DENSEST = 0.75
#: Error of the interpolation, as a part of the field's peak.
INTERPOLATION_ERROR = 3e-4
#: Longest window that is tried, and on how many lattice points' neighbourhoods.
WIDEST, OFFSETS = 48, 48
#: How much longer an FFT may be so that its length has no factor of 7 or 11, which take as much longer.
FACTORS = 1.06
#: How much longer a lattice through the voxels may be than the wall's: interpolating at the voxels takes as
#: long as the rest together.
LONGER = 1.3
#: Voxels this near to a lattice point, in lattice steps, are read at it: at a quarter wavelength a step the
#: phase is wrong by 1.6 mrad at most.
ON_LATTICE = 1e-3


@dataclass(frozen=True)
class AxisPlan:
    """One axis of the computation.

    Attributes
    ----------
    step_m
        Spacing of the lattice.
    half
        Length of the FFT is 2 `half`, and the kernel is evaluated at offsets 0 to `half` steps; offsets from
        any wall point to any lattice point that is read are no longer, so that nothing wraps around.
    wall
        (points,) lattice index of each point that emits.
    spread
        Where they are not the wall's points themselves: (wall points,) the first of them that each point of
        the wall's axis is spread over, and (wall points, taps) float32 weights for it and its successors.
    fold
        How many times the spectrum is folded: only every `fold`-th lattice point is read.
    first, weights
        (voxels,) index of the first such point that a voxel reads, and (voxels, taps) float32 weights of
        it and its successors. Reading begins at index 0.
    """

    step_m: float
    half: int
    wall: NDArray[np.intp]
    spread: Taps | None
    fold: int
    first: NDArray[np.intp]
    weights: NDArray[np.float32]

    @property
    def length(self) -> int:
        """Length of the FFT."""
        return 2 * self.half

    @property
    def folded(self) -> int:
        """Length of the FFT back."""
        return self.length // self.fold

    @property
    def in_turn(self) -> bool:
        """Whether the voxels are the first lattice points, one after the other."""
        return self.weights.shape[1] == 1 and self.read == len(self.first)

    @property
    def read(self) -> int:
        """Number of points that are read, from index 0."""
        return int(self.first[-1]) + self.weights.shape[1]


@dataclass(frozen=True)
class Wave:
    """What is interpolated along an axis.

    Attributes
    ----------
    wavenumber_rad_per_m
        Highest wavenumber k of the field: omega/c, or 2 omega/c for confocal data.
    near_m
        Depth z of the nearest plane, where the wave is exp(i k r)/r; None where it is another.
    farthest_m
        The longest offset along the axis between a point of the wall and a voxel.
    """

    wavenumber_rad_per_m: float
    near_m: float | None = None
    farthest_m: float = inf

    @property
    def step_m(self) -> float:
        """A step that samples it well, whatever its offsets."""
        return pi * DENSEST / self.wavenumber_rad_per_m

    def half_width(self, step_m: float) -> int | None:
        """Return the half-width W with which it is interpolated from samples; None where none will do."""
        rho = step_m * self.wavenumber_rad_per_m / pi
        if self.near_m is None:
            return taps_half_width(rho) if rho <= DENSEST + 1e-9 else None
        rho *= self.sine
        return _least_width(self, step_m, taps_half_width(rho)) if rho < 1 else None

    @property
    def sine(self) -> float:
        """Its oscillation at the longest offset, as a part of k."""
        return 1.0 if self.near_m is None else self.farthest_m / hypot(self.farthest_m, self.near_m)

    def error(self, step_m: float, half_width: int, designed: float = INTERPOLATION_ERROR) -> float:
        """Return the greatest error of interpolating it, as a part of its size there."""
        assert self.near_m is not None
        # Between two lattice points, where it is greatest.
        steps = np.floor(np.linspace(0, self.farthest_m / step_m, OFFSETS))
        offsets_m = (steps[:, None] + [0.25, 0.5]).reshape(-1) * step_m
        first, weights = kaiser_sinc(offsets_m / step_m, half_width, designed)
        lattice_m = (first[:, None] + np.arange(2 * half_width)) * step_m
        found = (weights * self._at(lattice_m)).sum(axis=1)
        return float(np.abs(found / self._at(offsets_m) - 1).max())

    def _at(self, offsets_m: NDArray[np.floating]) -> NDArray[np.complexfloating]:
        assert self.near_m is not None
        r = np.sqrt(offsets_m**2 + self.near_m**2)
        return np.asarray(np.exp(1j * self.wavenumber_rad_per_m * r) / r, np.complex128)


@lru_cache(maxsize=64)
def _least_width(wave: Wave, step_m: float, width: int) -> int | None:
    """Return the least half-width, from `width` on, that is good enough; solvers ask for it several times."""
    if width > WIDEST or wave.error(step_m, WIDEST) > INTERPOLATION_ERROR:
        return None
    widest = WIDEST
    while width < widest:
        middle = (width + widest) // 2
        if wave.error(step_m, middle) > INTERPOLATION_ERROR:
            width = middle + 1
        else:
            widest = middle
    return widest


def plan_axis(
    wall: LatticeAxis,
    voxels_m: NDArray[np.float64],
    wavenumber_rad_per_m: float,
    near_m: float | None = None,
) -> AxisPlan:
    """Choose lattice, FFT length and interpolation for one axis.

    Parameters
    ----------
    wall
        The wall's axis.
    voxels_m
        (n,) ascending coordinates of voxels, evenly spaced.
    wavenumber_rad_per_m, near_m
        As of `Wave`.
    """
    at = (voxels_m - wall.start_m) / wall.pitch_m
    if np.abs(at - np.rint(at)).max() <= ON_LATTICE:
        return _picked(np.rint(at).astype(np.intp), np.arange(wall.count), wall.pitch_m)
    ends_m = wall.coordinates_m[[0, -1]]
    farthest_m = float(max(voxels_m[-1] - ends_m[0], ends_m[1] - voxels_m[0]))
    wave = Wave(wavenumber_rad_per_m, near_m if near_m and near_m > 0 else None, farthest_m)
    read = min(_between(wall, at, wave), key=_work)
    spread = min(_through(wall, voxels_m, wave), key=_work)
    return spread if _work(spread) <= LONGER**2 * _work(read) else read


def _work(plan: AxisPlan) -> int:
    """Return what a plan takes: as much for the wave on the whole lattice as for what is read."""
    return plan.length**2 + plan.folded**2


def _steps(whole_m: float, wave: Wave) -> Iterator[tuple[int, float, int]]:
    """Yield into how many steps a distance may be cut, the step, and the half-width for it."""
    last = ceil(whole_m / wave.step_m)
    found = False
    for count in range(1, last + 1):
        half_width = wave.half_width(whole_m / count)
        if half_width is not None:
            found = True
            yield count, whole_m / count, half_width
    if not found:  # nearer than a wave's own oscillation
        yield last, whole_m / last, taps_half_width(whole_m / last * wave.wavenumber_rad_per_m / pi)


def _between(wall: LatticeAxis, at: NDArray[np.float64], wave: Wave) -> Iterator[AxisPlan]:
    """Plan lattices through the wall's points, from which the field is interpolated at the voxels."""
    for refine, step_m, half_width in _steps(wall.pitch_m, wave):
        first, weights = kaiser_sinc(at * refine, half_width)
        yield _plan(step_m, np.arange(wall.count) * refine - first[0], 1, first - first[0], weights)


def _through(wall: LatticeAxis, voxels_m: NDArray[np.float64], wave: Wave) -> Iterator[AxisPlan]:
    """Plan lattices through the voxels, over which the wall is spread."""
    count = len(voxels_m)
    pitch_m = float(voxels_m[-1] - voxels_m[0]) / (count - 1) if count > 1 else wave.step_m
    for stride, step_m, half_width in _steps(pitch_m, wave):
        first, weights = kaiser_sinc((wall.coordinates_m - voxels_m[0]) / step_m, half_width)
        points = np.arange(first[0], first[-1] + weights.shape[1])
        yield _picked(stride * np.arange(count), points, step_m, (first - first[0], weights))


def coarse_axis(
    wall: LatticeAxis, voxels_m: NDArray[np.float64], step_m: float, half_width: int, error: float
) -> tuple[AxisPlan, NDArray[np.float64], Taps]:
    """Plan a lattice of a given step that voxels lie between: its points are read, and interpolated later.

    Returns
    -------
    plan
        It reads all points that voxels lie between.
    points_m
        (points,) their coordinates.
    taps
        (voxels,) the first of them that each voxel is interpolated from, and (voxels, 2 W) weights.
    """
    start_m = float(voxels_m[0]) - (half_width - 0.5) * step_m  # so that the first voxel reads from point 0
    taps = kaiser_sinc((voxels_m - start_m) / step_m, half_width, error)
    points = np.arange(int(taps[0][-1]) + 2 * half_width)
    first, weights = kaiser_sinc((wall.coordinates_m - start_m) / step_m, half_width, error)
    emitting = np.arange(first[0], first[-1] + weights.shape[1])
    plan = _picked(points, emitting, step_m, (first - first[0], weights))
    return plan, np.asarray(start_m + step_m * points, np.float64), taps


def _picked(
    voxels: NDArray[np.intp], wall: NDArray[np.intp], step_m: float, spread: Taps | None = None
) -> AxisPlan:
    """Plan an axis whose voxels are lattice points."""
    fold = int(voxels[1] - voxels[0]) if len(voxels) > 1 else 1
    fold = fold if _smooth(fold, 11) else 1
    first = (voxels - voxels[0]) // fold
    return _plan(step_m, wall - voxels[0], fold, first, np.ones((len(first), 1), np.float32), spread)


def _plan(
    step_m: float,
    wall: NDArray[np.intp],
    fold: int,
    first: NDArray[np.intp],
    weights: NDArray[np.float32],
    spread: Taps | None = None,
) -> AxisPlan:
    """Choose the FFT's length; `wall` counts from the first lattice point that is read."""
    last_read = fold * (int(first[-1]) + weights.shape[1] - 1)
    longest = max(last_read - int(wall[0]), int(wall[-1]), 1)
    span = int(wall[-1] - wall[0])  # all points that emit, and all that are read, have a place of their own
    half = _good_size(max(longest, (last_read + 2) // 2, (span + 2) // 2), fold // gcd(fold, 2))
    return AxisPlan(step_m, half, wall % (2 * half), spread, fold, first, weights)


def _good_size(least: int, divisor: int = 1) -> int:
    """Return the multiple of a divisor, from `least` on, that a transform takes most quickly.

    Transforms take lengths without prime factors above 5 the most quickly, and next those without any above
    11: these are taken where they are shorter by more than `FACTORS`. `recon.fft.good_size` gives the latter
    alone, and the array solver, which counts on this, needs numpy alone.
    """
    size = ceil(least / divisor) * divisor
    while not _smooth(size, 11):
        size += divisor
    return next((one for one in range(size, int(FACTORS * size) + 1, divisor) if _smooth(one, 5)), size)


def _smooth(size: int, most: int) -> bool:
    """Return whether a number has no prime factor above `most`."""
    for prime in (2, 3, 5, 7, 11):
        while prime <= most and size % prime == 0:
            size //= prime
    return size == 1


def taps_half_width(rho: float, error: float = INTERPOLATION_ERROR) -> int:
    """Return W, for a field sampled at `rho` of the critical rate."""
    return max(2, ceil(-log(error) / (pi * (1 - rho))))


def kaiser_sinc(at: NDArray[np.float64], half_width: int, error: float = INTERPOLATION_ERROR) -> Taps:
    """Return first lattice point and 2 W weights with which to read a field at `at` [lattice steps]."""
    first = np.floor(at).astype(np.intp) - half_width + 1
    distance = at[:, None] - (first[:, None] + np.arange(2 * half_width))
    inside = np.clip(1 - (distance / half_width) ** 2, 0, None)
    beta = -log(error)
    return first, (np.sinc(distance) * np.i0(beta * np.sqrt(inside)) / np.i0(beta)).astype(np.float32)
