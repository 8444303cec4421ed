"""The sum over positions term by term, frequency by frequency: for cameras that need each frequency's field.

    F(v, omega) = sum_p H^(p, omega) exp(i omega r_p/c)/r_p,   with r_p + r_c in the exponent where spots are
    given for the second leg

From one frequency to the next a pair's phase turns by exp(i d_omega r/c): a complex multiplication in place
of a sine. Single precision loses 1e-7 a step; every `ANCHOR` frequencies the phase is evaluated anew.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.wave import Band

#: Frequencies between two exact phases.
ANCHOR = 64

F64 = NDArray[np.float64]


def plane_field(
    laser_m: F64,
    detector_m: F64 | None,
    spectra: NDArray[np.complex64],
    band: Band,
    y_m: F64,
    x_m: F64,
    z_m: float,
) -> NDArray[np.complex64]:
    """Take the field of each frequency on one plane.

    Parameters
    ----------
    laser_m
        (P, 3) laser spots, anywhere.
    detector_m
        (P, 3) spots to which the second leg goes, `laser_m` itself for confocal data; None for the first leg
        alone.
    spectra
        (F, P) complex64 spectra of the histograms.
    band
        Their frequencies; its weights are not applied.
    y_m, x_m, z_m
        Voxels of the plane.

    Returns
    -------
    ndarray
        (F, y, x) complex64.
    """
    field = np.zeros((len(spectra), len(y_m), len(x_m)), np.complex64)
    turns = 1 / (2 * np.pi * C_M_PER_S)
    _sum(
        np.ascontiguousarray(laser_m, np.float64),
        np.ascontiguousarray(laser_m if detector_m is None else detector_m, np.float64),
        1.0 if detector_m is not None else 0.0,
        np.ascontiguousarray(spectra.T),
        band.first_rad_per_s * turns,
        band.step_rad_per_s * turns,
        y_m,
        x_m,
        z_m,
        field,
    )
    return field


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _sum(
    laser_m: F64,
    detector_m: F64,
    second: float,
    spectra: NDArray[np.complex64],
    turns_per_m: float,
    step_turns_per_m: float,
    y_m: F64,
    x_m: F64,
    z_m: float,
    field: NDArray[np.complex64],
) -> None:
    """Add all positions, spectra (P, F), into field (F, y, x); `second` is 0 where the first leg is all."""
    many, count = field.shape[0], len(x_m)
    for j in prange(len(y_m)):
        real, imaginary = np.zeros((many, count), np.float32), np.zeros((many, count), np.float32)
        path_m, r_p = np.empty(count), np.empty(count)
        re, im = np.empty(count, np.float32), np.empty(count, np.float32)
        turn_re, turn_im = np.empty(count, np.float32), np.empty(count, np.float32)
        for p in range(len(laser_m)):
            beside = (laser_m[p, 1] - y_m[j]) ** 2 + (laser_m[p, 2] - z_m) ** 2
            beyond = (detector_m[p, 1] - y_m[j]) ** 2 + (detector_m[p, 2] - z_m) ** 2
            for i in range(count):
                r_p[i] = np.sqrt(beside + (laser_m[p, 0] - x_m[i]) ** 2)
                path_m[i] = r_p[i] + second * np.sqrt(beyond + (detector_m[p, 0] - x_m[i]) ** 2)
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
