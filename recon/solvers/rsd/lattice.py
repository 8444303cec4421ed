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
of the spectrum (Kaiser's design formula). The lattice is refined until rho <= 0.75 and W is chosen from rho.
"""

from dataclasses import dataclass
from math import ceil, gcd, log, pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import LatticeAxis

Taps = tuple[NDArray[np.intp], NDArray[np.float32]]
#: Largest part of the critical sampling rate that is interpolated from.
DENSEST = 0.75
#: Error of the interpolation, as a part of the field's peak.
INTERPOLATION_ERROR = 3e-4
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


def plan_axis(wall: LatticeAxis, voxels_m: NDArray[np.float64], wavenumber_rad_per_m: float) -> AxisPlan:
    """Choose lattice, FFT length and interpolation for one axis.

    Parameters
    ----------
    wall
        The wall's axis.
    voxels_m
        (n,) ascending coordinates of voxels, evenly spaced.
    wavenumber_rad_per_m
        Highest wavenumber of the field: omega/c, or 2 omega/c for confocal data.
    """
    at = (voxels_m - wall.start_m) / wall.pitch_m
    if np.abs(at - np.rint(at)).max() <= ON_LATTICE:
        return _picked(np.rint(at).astype(np.intp), np.arange(wall.count), wall.pitch_m)
    refine = max(1, ceil(wall.pitch_m * wavenumber_rad_per_m / (pi * DENSEST)))
    rho = wall.pitch_m / refine * wavenumber_rad_per_m / pi
    first, weights = kaiser_sinc(at * refine, taps_half_width(rho), rho)
    read = _plan(
        wall.pitch_m / refine, np.arange(wall.count) * refine - first[0], 1, first - first[0], weights
    )
    spread = _through(wall, voxels_m, wavenumber_rad_per_m)
    return spread if spread.length <= LONGER * read.length else read


def _through(wall: LatticeAxis, voxels_m: NDArray[np.float64], wavenumber_rad_per_m: float) -> AxisPlan:
    """Plan a lattice through the voxels."""
    step_m, stride = pi * DENSEST / wavenumber_rad_per_m, 1
    if len(voxels_m) > 1:
        pitch_m = float(voxels_m[-1] - voxels_m[0]) / (len(voxels_m) - 1)
        stride = ceil(pitch_m / step_m)
        step_m = pitch_m / stride
    rho = step_m * wavenumber_rad_per_m / pi
    first, weights = kaiser_sinc((wall.coordinates_m - voxels_m[0]) / step_m, taps_half_width(rho), rho)
    points = np.arange(first[0], first[-1] + weights.shape[1])
    return _picked(stride * np.arange(len(voxels_m)), points, step_m, (first - first[0], weights))


def _picked(
    voxels: NDArray[np.intp], wall: NDArray[np.intp], step_m: float, spread: Taps | None = None
) -> AxisPlan:
    """Plan an axis whose voxels are lattice points."""
    fold = int(voxels[1] - voxels[0]) if len(voxels) > 1 else 1
    fold = fold if _good_size(fold) == fold else 1
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
    """Return the first multiple of a divisor from `least` on without prime factors above 11.

    An FFT takes such lengths quickly. `ducc0.fft.good_size` gives the same, but the array solver, which
    counts on this, needs numpy alone.
    """
    size = ceil(least / divisor) * divisor
    while True:
        rest = size
        for prime in (2, 3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += divisor


def taps_half_width(rho: float) -> int:
    """Return W, for a field sampled at `rho` of the critical rate."""
    return max(2, ceil(-log(INTERPOLATION_ERROR) / (pi * (1 - rho))))


def kaiser_sinc(
    at: NDArray[np.float64], half_width: int, rho: float
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return first lattice point and 2 W weights with which to read a field at `at` [lattice steps]."""
    first = np.floor(at).astype(np.intp) - half_width + 1
    distance = at[:, None] - (first[:, None] + np.arange(2 * half_width))
    beta = pi * half_width * (1 - rho)
    inside = np.clip(1 - (distance / half_width) ** 2, 0, None)
    return first, (np.sinc(distance) * np.i0(beta * np.sqrt(inside)) / np.i0(beta)).astype(np.float32)
