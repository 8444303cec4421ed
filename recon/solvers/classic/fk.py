"""f-k migration of confocal data (Lindell, Wetzstein, O'Toole, ACM Transactions on Graphics 38, 116, 2019).

All surfaces are thought to send a pulse at t = 0 that travels at half the speed of light, so that it reaches
the wall at the radius r = c t/2 and amplitude falls as 1/r. A diffuse surface's counts fall as r^-4, so the
wave on the wall is psi(x, y, r) = r sqrt(H). With its spectrum psi^ over (x, y, r) and

    r-frequency = sqrt(k_x^2 + k_y^2 + k_z^2)          (the wave equation; Stolt, Geophysics 43, 23, 1978)

the wave at t = 0, which is the image, is

    psi(x, y, z) = sum over k of psi^(k_x, k_y, |k|) k_z/|k| exp(2 pi i (k_x x + k_y y + k_z z)) , k_z > 0

and |psi|^2 is shown. Only k_z > 0 is taken, the part of the wave that goes to the wall, so psi is analytic
and |psi|^2 has no carrier.

The spectrum is wanted between its samples. Straight lines between them dim late times and leave ghosts; here
each is read by a Kaiser-Bessel window over six samples of a spectrum of twice the length, the data having
been divided by the window's transform before (Beatty, Nishimura and Pauly, IEEE Transactions on Medical
Imaging 24, 799, 2005), right to about 1e-5. The record's middle is the origin of time meanwhile, and its
phase is given back.
"""

from collections.abc import Callable

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import Capture
from recon.computer import usual_threads
from recon.fft import c2c, good_size, r2c
from recon.grid import VoxelGrid
from recon.solvers.classic.interpolate import LateralAxis, read_voxels
from recon.solvers.classic.lct import farthest_m, radial_step_m
from recon.solvers.classic.resample import ConfocalLattice, confocal_record
from recon.window import Window

#: Samples that the window spans, and its shape for a spectrum of twice the length (Beatty et al., eq. 5).
TAPS = 6
BETA = float(np.pi * np.sqrt((TAPS / 2) ** 2 * 1.5**2 - 0.8))
#: Nodes of the window's table from one sample to the next; straight lines between them are right to 1e-6.
TABLE = 2048


def migrate(
    wave: NDArray[np.float32],
    step_m: float,
    y: LateralAxis,
    x: LateralAxis,
    planes: slice,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float32]:
    """Take the wave on the wall to the volume.

    Parameters
    ----------
    wave
        (wall y, wall x, R) amplitude at radii (n + 1/2) `step_m`, R even.
    step_m
        Step of radius, and of depth.
    y, x
        Lattices.
    planes
        Which depths n `step_m` to give, n up to R.
    progress
        Called with the fraction that is done.

    Returns
    -------
    ndarray
        (planes, y, x) float32 |psi|^2. The three lowest of the R frequencies (the mean, and waves longer than
        two thirds of the record) and the three highest are left out, where the window would reach over the
        end of the spectrum.
    """
    threads = usual_threads()
    radii = wave.shape[2]
    spectrum = np.zeros((y.length, x.length, radii + 1), np.complex64)
    spectrum[: wave.shape[0], : wave.shape[1]] = r2c(_apodised(wave), axes=(2,), nthreads=threads)
    c2c(spectrum, axes=(0, 1), out=spectrum, nthreads=threads)
    wanted = np.zeros((planes.stop - planes.start, y.length, x.length), np.complex64)
    # Wavenumbers across, in steps of that along z: 1 / (2 R step).
    across_y = np.fft.fftfreq(y.length, y.pitch_m) * 2 * radii * step_m
    across_x = np.fft.fftfreq(x.length, x.pitch_m) * 2 * radii * step_m
    table = _window_table()
    rows = max(1, 2**22 // (x.length * radii))
    for first in range(0, y.length, rows):
        part = slice(first, min(first + rows, y.length))
        along_z = np.zeros((part.stop - part.start, x.length, 2 * radii), np.complex64)
        _stolt(spectrum[part], across_y[part], across_x, table, along_z)
        c2c(along_z, axes=(2,), forward=False, out=along_z, nthreads=threads)
        wanted[:, part] = np.moveaxis(along_z[:, :, planes], 2, 0)
        if progress:
            progress(part.stop / y.length)
    c2c(wanted, axes=(1, 2), forward=False, inorm=0, out=wanted, nthreads=threads)
    # The wall's first point is at the corner of the arrays; the lattice may begin before it.
    wanted = np.roll(wanted, (y.wall.start, x.wall.start), axis=(1, 2))[:, : y.count, : x.count]
    scale = 1 / (y.length * x.length * 2 * radii)
    return (wanted.real**2 + wanted.imag**2) * np.float32(scale**2)


def reconstruct(
    capture: Capture,
    lattice: ConfocalLattice,
    grid: VoxelGrid,
    window: Window,
    *,
    falloff_power: float = 4.0,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float32]:
    """Image a volume: (z, y, x) float32 |psi|^2, linear in counts; parameters as in `lct.reconstruct`."""
    y = LateralAxis.covering(lattice.aperture.y, grid.y_m)
    x = LateralAxis.covering(lattice.aperture.x, grid.x_m)
    step_m = radial_step_m(capture, grid)
    radii = good_size(int(np.ceil(farthest_m(capture, lattice, grid) / step_m / 2)), True) * 2
    edges_m = step_m * np.arange(radii + 1, dtype=np.float64)
    wave = confocal_record(capture, lattice, window, edges_m)
    wave *= (edges_m[1:] - step_m / 2) ** (falloff_power - 2)
    wave = np.sqrt(np.maximum(wave, 0, out=wave), out=wave)
    half_m = max(float(grid.z_m[1] - grid.z_m[0]) / 2 if len(grid.z_m) > 1 else 0.0, step_m)
    first = max(0, int((grid.z_m[0] - half_m) / step_m))
    planes = slice(first, min(radii, max(first, int((grid.z_m[-1] + half_m) / step_m + 1)) + 1))
    image = migrate(wave, step_m, y, x, planes, progress)
    return read_voxels(image, step_m * (np.arange(planes.start, planes.stop + 1) - 0.5), y, x, grid)


def _apodised(wave: NDArray[np.float32]) -> NDArray[np.float32]:
    """Divide by the window's transform, and pad to twice the length with the middle at index 0."""
    half = wave.shape[2] // 2
    at = (np.arange(2 * half) - half) / (4 * half)
    root = np.sqrt(BETA**2 - (np.pi * TAPS * at) ** 2)
    flat = wave * (root / (TAPS * np.sinh(root))).astype(np.float32)
    padded = np.zeros((*wave.shape[:2], 4 * half), np.float32)
    padded[..., :half] = flat[..., half:]
    padded[..., -half:] = flat[..., :half]
    return padded


def _window_table() -> NDArray[np.float32]:
    """(TABLE + 1, TAPS) the window at the samples around a point, for the point's places between samples."""
    part = np.linspace(0, 1, TABLE + 1)[:, None]
    distance = (part - (np.arange(TAPS) - (TAPS / 2 - 1))) / (TAPS / 2)
    return np.i0(BETA * np.sqrt(np.maximum(1 - distance**2, 0))).astype(np.float32)


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _stolt(
    spectrum: NDArray[np.complex64],
    across_y: NDArray[np.float64],
    across_x: NDArray[np.float64],
    table: NDArray[np.float32],
    along_z: NDArray[np.complex64],
) -> None:
    """Read each row of the spectrum at |k| for every k_z, with the obliquity factor k_z/|k|.

    Wavenumbers are in steps of k_z; the spectrum has the same step, since it has twice the radii. The
    record's middle, R/2 + 1/2 steps from the origin, gives the phase.
    """
    radii = spectrum.shape[2] - 1
    taps = table.shape[1]
    middle = (radii / 2 + 0.5) / (2 * radii)  # turns of phase for a step of |k|
    for j in prange(len(across_y)):
        for i in range(len(across_x)):
            squared = across_y[j] ** 2 + across_x[i] ** 2
            row = spectrum[j, i]
            for n in range(1, radii):
                k = np.sqrt(squared + n * n)
                if k < taps // 2 or k > radii - taps // 2:
                    continue
                whole = int(k)
                place = (k - whole) * (len(table) - 1)
                node = int(place)
                f = np.float32(place - node)
                value = np.complex64(0)
                for t in range(taps):
                    weight = table[node, t] + f * (table[node + 1, t] - table[node, t])
                    value += weight * row[whole + t - taps // 2 + 1]
                turns = -k * middle
                angle = 2 * np.pi * (turns - np.floor(turns))
                factor = n / k
                along_z[j, i, n] = value * np.complex64(
                    complex(factor * np.cos(angle), factor * np.sin(angle))
                )
