"""The sum over positions term by term in single precision: any positions, for cameras of many frames.

    F(v, omega) = sum_p H^(p, omega) exp(i omega r_p/c)/r_p,   with r_p + r_c in the exponent where each
    position has a detector spot of its own

From one frequency to the next a pair's phase turns by exp(i d_omega r/c): a complex multiplication in place
of a sine. Single precision loses 1e-7 a step; every `ANCHOR` frequencies the phase is evaluated anew.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.solvers.spectral import Field, SumPropagator

#: Frequencies between two exact phases.
ANCHOR = 64

F64 = NDArray[np.float64]


class TermwisePropagator(SumPropagator):
    """Sums over all positions in single precision, from complex64 spectra."""

    def fields(self, z_m: float) -> Field:
        """Return the fields on the plane at depth `z_m`: (F, y, x) complex64."""
        fields = np.zeros((len(self.band), *self._grid.shape[1:]), np.complex64)
        turns = 1 / (2 * np.pi * C_M_PER_S)
        _sum(
            self._laser_m,
            self._detector_m,
            self._emitted,
            self.band.first_rad_per_s * turns,
            self.band.step_rad_per_s * turns,
            self._grid.y_m,
            self._grid.x_m,
            z_m,
            fields,
        )
        return fields


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _sum(
    laser_m: F64,
    detector_m: F64,
    spectra: NDArray[np.complex64],
    turns_per_m: float,
    step_turns_per_m: float,
    y_m: F64,
    x_m: F64,
    z_m: float,
    field: NDArray[np.complex64],
) -> None:
    """Add all positions, spectra (P, F), into field (F, y, x); no detectors: the laser path is all."""
    many, count = field.shape[0], len(x_m)
    for j in prange(len(y_m)):
        real, imaginary = np.zeros((many, count), np.float32), np.zeros((many, count), np.float32)
        path_m, r_p = np.empty(count), np.empty(count)
        re, im = np.empty(count, np.float32), np.empty(count, np.float32)
        turn_re, turn_im = np.empty(count, np.float32), np.empty(count, np.float32)
        for p in range(len(laser_m)):
            beside = (laser_m[p, 1] - y_m[j]) ** 2 + (laser_m[p, 2] - z_m) ** 2
            for i in range(count):
                r_p[i] = np.sqrt(beside + (laser_m[p, 0] - x_m[i]) ** 2)
                path_m[i] = r_p[i]
            if len(detector_m) > 0:
                beyond = (detector_m[p, 1] - y_m[j]) ** 2 + (detector_m[p, 2] - z_m) ** 2
                for i in range(count):
                    path_m[i] += np.sqrt(beyond + (detector_m[p, 0] - x_m[i]) ** 2)
            for i in range(count):
                turns = step_turns_per_m * path_m[i]
                angle = np.float32(2 * np.pi * (turns - np.floor(turns)))
                turn_re[i], turn_im[i] = np.cos(angle), np.sin(angle)
            for f in range(many):
                if f % ANCHOR == 0:
                    for i in range(count):
                        turns = (turns_per_m + f * step_turns_per_m) * path_m[i]
                        angle = np.float32(2 * np.pi * (turns - np.floor(turns)))
                        re[i], im[i] = np.cos(angle) / r_p[i], np.sin(angle) / r_p[i]
                a, b = spectra[p, f].real, spectra[p, f].imag
                for i in range(count):
                    u, v = re[i], im[i]
                    real[f, i] += u * a - v * b
                    imaginary[f, i] += u * b + v * a
                    re[i] = u * turn_re[i] - v * turn_im[i]
                    im[i] = u * turn_im[i] + v * turn_re[i]
        for f in range(many):
            for i in range(count):
                field[f, j, i] = complex(real[f, i], imaginary[f, i])
