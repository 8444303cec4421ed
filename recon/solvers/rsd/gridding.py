"""Any positions on a plane become a lattice: each position's emission is spread over its neighbours.

A few wavelengths from the wall the wave exp(ikr)/r, as a function of where on the wall it starts, holds
spatial frequencies up to k only. So it can be interpolated from a lattice, by the same Kaiser-windowed sinc
with which `recon.solvers.rsd.lattice` reads the field at voxels: wave(v - x_p) = sum_m w_pm wave(v - x_m).
The sum over positions is then the sum over lattice points that emit sum_p w_pm H^(p, omega): spreading is
interpolation transposed. It is done once for each frequency, not for each plane, and costs little.
"""

from math import ceil, floor, pi

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.aperture import Aperture, LatticeAxis
from recon.solvers.rsd.lattice import DENSEST, kaiser_sinc, taps_half_width

#: Nearest depth, in wavelengths of the lowest frequency, at which nothing evanescent is left of the wave.
NEAREST_WAVELENGTHS = 2.0
#: What computing one weight of a position's spreading takes for a moment, in double precision.
TAP_BYTES = 64


def lattice_axis(
    positions_m: NDArray[np.float64], voxels_m: NDArray[np.float64], wavenumber_rad_per_m: float
) -> LatticeAxis:
    """Choose the lattice that one axis of scattered positions is spread over.

    It passes through the voxels where their pitch, or a whole part of it, is a good step, so that the field
    need not be interpolated again; it reaches beyond the positions as far as spreading does.

    Parameters
    ----------
    positions_m
        (P,) coordinates.
    voxels_m
        (n,) ascending, evenly spaced.
    wavenumber_rad_per_m
        Highest wavenumber: omega/c, or 2 omega/c for confocal data.
    """
    step_m = pi * DENSEST / wavenumber_rad_per_m
    if len(voxels_m) > 1:
        voxel_m = float(voxels_m[-1] - voxels_m[0]) / (len(voxels_m) - 1)
        aligned_m = voxel_m / ceil(voxel_m / step_m)
        step_m = aligned_m if aligned_m >= step_m / 2 else step_m
    half_width = taps_half_width(step_m * wavenumber_rad_per_m / pi)
    first = floor((float(positions_m.min()) - voxels_m[0]) / step_m) - half_width + 1
    last = floor((float(positions_m.max()) - voxels_m[0]) / step_m) + half_width
    return LatticeAxis(float(voxels_m[0]) + first * step_m, step_m, last - first + 1)


def spread(
    laser_m: NDArray[np.float64],
    spectra: NDArray[np.complex64],
    x: LatticeAxis,
    y: LatticeAxis,
    wavenumber_rad_per_m: float,
) -> tuple[Aperture, NDArray[np.complex64]]:
    """Spread what scattered positions emit over a lattice.

    Parameters
    ----------
    laser_m
        (P, 3) positions on one plane of constant z.
    spectra
        (F, P) complex64.
    x, y
        The lattice, from `lattice_axis`.
    wavenumber_rad_per_m
        As given to `lattice_axis`.

    Returns
    -------
    Aperture, ndarray
        All points of the lattice, row by row, and (F, points) complex64 what they emit.
    """
    (column, across), (row, up) = (
        kaiser_sinc(
            (laser_m[:, i] - axis.start_m) / axis.pitch_m,
            taps_half_width(axis.pitch_m * wavenumber_rad_per_m / pi),
        )
        for i, axis in ((0, x), (1, y))
    )
    emitted = np.zeros((len(spectra), y.count, x.count), np.complex64)
    _spread(np.ascontiguousarray(spectra), column, across, row, up, emitted)
    rows, columns = np.divmod(np.arange(x.count * y.count), x.count)
    return Aperture(x, y, columns, rows), emitted.reshape(len(spectra), -1)


@njit(nogil=True, cache=True, parallel=True, fastmath=True)
def _spread(
    spectra: NDArray[np.complex64],
    column: NDArray[np.intp],
    across: NDArray[np.float32],
    row: NDArray[np.intp],
    up: NDArray[np.float32],
    emitted: NDArray[np.complex64],
) -> None:
    """Add each position's emission to its neighbours, frequency by frequency."""
    for f in prange(len(spectra)):
        for p in range(len(column)):
            for j in range(up.shape[1]):
                part = spectra[f, p] * up[p, j]
                line = emitted[f, row[p] + j]
                for i in range(across.shape[1]):
                    line[column[p] + i] += part * across[p, i]
