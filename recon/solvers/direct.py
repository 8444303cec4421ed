"""The direct solver: the sum that defines the image, term by term in double precision, for any positions.

Work is positions x voxels x frequencies. It is the reference that the quick solvers are held against.
"""

from collections.abc import Iterator

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.solvers.problem import ImagingProblem
from recon.solvers.spectral import Field, SumPropagator, by_planes, spectral


class DirectPropagator(SumPropagator):
    """Sums over all positions in double precision, from complex128 spectra."""

    def fields(self, z_m: float) -> Field:
        """Return the fields on the plane at depth `z_m`: (F, y, x) complex128."""
        fields = np.zeros((*self._grid.shape[1:], len(self.band)), np.complex128)
        _sum(
            np.asarray(self._emitted, np.complex128),
            self._laser_m,
            self._detector_m,
            self._grid.x_m,
            self._grid.y_m,
            z_m,
            self.band.first_rad_per_s / C_M_PER_S,
            self.band.step_rad_per_s / C_M_PER_S,
            fields,
        )
        return np.ascontiguousarray(fields.transpose(2, 0, 1))


@njit(nogil=True, cache=True, parallel=True)
def _sum(
    emitted: NDArray[np.complex128],
    laser_m: NDArray[np.float64],
    detector_m: NDArray[np.float64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: float,
    k: float,
    step: float,
    fields: NDArray[np.complex128],
) -> None:
    """Add exp(i k path) emitted/r_p over positions into (y, x, F); k grows by `step` with each frequency."""
    for j in prange(len(y_m)):
        for i in range(len(x_m)):
            for p in range(len(laser_m)):
                across = (laser_m[p, 0] - x_m[i]) ** 2 + (laser_m[p, 1] - y_m[j]) ** 2
                r_p = np.sqrt(across + (laser_m[p, 2] - z_m) ** 2)
                path = r_p
                if len(detector_m) > 0:
                    across = (detector_m[p, 0] - x_m[i]) ** 2 + (detector_m[p, 1] - y_m[j]) ** 2
                    path += np.sqrt(across + (detector_m[p, 2] - z_m) ** 2)
                wave = np.exp(1j * k * path) / r_p
                turn = np.exp(1j * step * path)
                for f in range(emitted.shape[1]):
                    fields[j, i, f] += wave * emitted[p, f]
                    wave *= turn


def _focus_block(problem: ImagingProblem, emitted: Field) -> Iterator[Field]:
    return by_planes(problem, DirectPropagator(problem.capture, emitted, problem.band, problem.grid).focus)


focus = spectral(_focus_block, np.complex128)
