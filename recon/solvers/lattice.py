"""Where the field is computed along one axis, and how it is read at the voxels.

The wall's lattice and the voxels' axis need not match. The field is computed on the wall's lattice, or on
one that is finer by a whole factor; voxels that lie on it are picked, others are interpolated.

A field of wavenumber k holds spatial frequencies up to k. Sampled at h, it is rho = h k / pi of the
critical rate, and a sinc under a Kaiser window of half-width W samples interpolates it with an error of about
exp(-pi W (1 - rho)): the window's transform has that level at its first zero, where it meets the first copy
of the spectrum (Kaiser's design formula). The lattice is refined until rho <= 0.75 and W is chosen from rho.
"""

from dataclasses import dataclass
from math import ceil, log, pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import LatticeAxis

#: Largest part of the critical sampling rate that is interpolated from.
DENSEST = 0.75
#: Error of the interpolation, as a part of the field's peak.
INTERPOLATION_ERROR = 3e-4
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
        (wall points,) lattice index of each point of the wall's axis.
    first, weights
        (voxels,) index of the first lattice point that a voxel reads, and (voxels, taps) float32 weights of
        it and its successors. Reading begins at lattice index 0.
    """

    step_m: float
    half: int
    wall: NDArray[np.intp]
    first: NDArray[np.intp]
    weights: NDArray[np.float32]

    @property
    def length(self) -> int:
        """Length of the FFT."""
        return 2 * self.half

    @property
    def read(self) -> int:
        """Number of lattice points that are read, from index 0."""
        return int(self.first[-1]) + self.weights.shape[1]


def plan_axis(wall: LatticeAxis, voxels_m: NDArray[np.float64], wavenumber_rad_per_m: float) -> AxisPlan:
    """Choose lattice, FFT length and interpolation for one axis.

    Parameters
    ----------
    wall
        The wall's axis.
    voxels_m
        (n,) ascending coordinates of voxels.
    wavenumber_rad_per_m
        Highest wavenumber of the field: omega/c, or 2 omega/c for confocal data.
    """
    refine = 1
    at = (voxels_m - wall.start_m) / wall.pitch_m
    if np.abs(at - np.rint(at)).max() <= ON_LATTICE:
        nearest = np.rint(at).astype(np.intp)
        weights = np.ones((len(at), 1), np.float32)
    else:
        refine = max(1, ceil(wall.pitch_m * wavenumber_rad_per_m / (pi * DENSEST)))
        at = at * refine
        rho = wall.pitch_m / refine * wavenumber_rad_per_m / pi
        nearest, weights = kaiser_sinc(at, taps_half_width(rho), rho)
    origin = int(nearest[0])
    wall_at = np.arange(wall.count) * refine - origin
    last_read = int(nearest[-1]) - origin + weights.shape[1] - 1
    longest = max(last_read - int(wall_at[0]), int(wall_at[-1]), 1)
    half = _good_size(max(longest, (last_read + 2) // 2))
    return AxisPlan(wall.pitch_m / refine, half, wall_at % (2 * half), nearest - origin, weights)


def _good_size(least: int) -> int:
    """Return the first length from `least` on without prime factors above 11, which an FFT takes quickly."""
    size = least
    while True:
        rest = size
        for prime in (2, 3, 5, 7, 11):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 1


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
