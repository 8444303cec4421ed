"""The Rayleigh-Sommerfeld diffraction solver: the exact sum over the wall, by FFT.

For one frequency and one plane of voxels, sum_p H^(p, omega) exp(i k r_p)/r_p is a convolution over the
wall's plane with the spherical wave exp(i k r)/r, k = omega/c (2 omega/c for confocal data, whose light goes
both legs). The wave is evaluated at the very offsets that the lattice has, and the FFT is long enough that
nothing wraps around: the result is the discrete sum itself, to single precision, with no approximation of
the wave.

How it is made quick, per plane and frequency, for an FFT of N points and V voxels:

- the wave is even along both axes, so only a quarter is evaluated, and transformed by two real DCT-I of N/4
  points (half an FFT of N) in place of an FFT;
- from one frequency to the next the wave is multiplied by exp(-i dk r): no sine or cosine (N/4 complex
  multiplications; single precision loses 1e-7 a step);
- one pass multiplies by the wall's spectrum, kept for all frequencies (N multiplications, 8 N bytes read);
- the inverse FFT along y takes all columns, the one along x only the rows that are read (3/4 of an FFT of N);
- the detector's phase and the sum over frequencies are one pass of Horner's rule,
  total <- total * exp(i d_omega r_c/c) + field (V multiplications).

That is 1.25 FFTs of N points for each plane and frequency, against the 2 of kernel and inverse. For confocal
data no phase depends on both voxel and frequency, the sum is taken before the inverse FFT, and 0.5 FFTs
remain. Planes are shared out to threads; each thread's working set stays within its cache.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from os import cpu_count
from threading import local

import numpy as np
from ducc0.fft import c2c, dct
from numpy.typing import NDArray

from recon.aperture import Aperture
from recon.capture import C_M_PER_S
from recon.grid import VoxelGrid
from recon.solvers import fused
from recon.solvers.lattice import AxisPlan, plan_axis
from recon.wave import Band

#: Memory for the wall's spectra, unless another is asked for.
WALL_BYTES = 256 * 2**20


class _Workspace:
    """Arrays of one thread."""

    def __init__(self, y: AxisPlan, x: AxisPlan) -> None:
        quarter = (2, y.half + 1, x.half + 1)
        self.wave = np.empty(quarter, np.float32)
        self.step = np.empty(quarter, np.float32)
        self.kernel = np.empty(quarter, np.float32)
        self.spectrum = np.empty((y.length, x.length), np.complex64)
        self.rows = np.empty((len(y.first), x.length), np.complex64)


class PlanePropagator:
    """Takes the field on the wall, at the frequencies of one band, to planes of voxels.

    Parameters
    ----------
    aperture
        The wall's lattice.
    spectra
        (F, P) complex64: what each position emits at each frequency.
    band
        The frequencies and their weights g.
    grid
        Axes x and y are used.
    legs
        Legs of the path that the kernel stands for: 1, or 2 for confocal data.
    plans
        Lattice along y and along x, for these frequencies or higher ones.
    """

    def __init__(
        self,
        aperture: Aperture,
        spectra: NDArray[np.complex64],
        band: Band,
        grid: VoxelGrid,
        legs: int,
        plans: tuple[AxisPlan, AxisPlan],
    ) -> None:
        self._band = band
        self._grid = grid
        self._legs = legs
        self._y, self._x = plans
        self._walls = _wall_spectra(aperture, spectra, band, self._y, self._x)
        self._threads = local()

    def focus(self, z_m: float, detector_m: NDArray[np.float64] | None) -> NDArray[np.complex64]:
        """Sum the field on the plane at depth `z_m` over all frequencies.

        Parameters
        ----------
        z_m
            Depth of the plane.
        detector_m
            (3,) spot from which each frequency gets the phase exp(i omega r_c/c), or None for no phase.

        Returns
        -------
        ndarray
            (y, x) complex64.
        """
        work = self._workspace()
        total = np.zeros(self._grid.shape[1:], np.complex64)
        if detector_m is None:
            work.spectrum[:] = 0
            for wall in self._walk(z_m, work):
                fused.multiply(wall, work.kernel, work.spectrum, True)
            fused.add_field(total, total, self._rows(work), self._x.first, self._x.weights)
            return total
        base, step = np.empty_like(total), np.empty_like(total)
        fused.phase(
            self._grid.y_m - detector_m[1],
            self._grid.x_m - detector_m[0],
            z_m - detector_m[2],
            self._band.first_rad_per_s / (2 * np.pi * C_M_PER_S),
            self._band.step_rad_per_s / (2 * np.pi * C_M_PER_S),
            base,
            step,
        )
        for wall in self._walk(z_m, work):
            fused.multiply(wall, work.kernel, work.spectrum, False)
            fused.add_field(total, step, self._rows(work), self._x.first, self._x.weights)
        total *= base
        return total

    def _walk(self, z_m: float, work: _Workspace) -> Iterator[NDArray[np.complex64]]:
        """From the highest frequency down, leave the kernel's transform in `work` and yield the wall's."""
        fused.spherical_wave(
            np.arange(self._y.half + 1, dtype=np.float64) * self._y.step_m,
            np.arange(self._x.half + 1, dtype=np.float64) * self._x.step_m,
            z_m,
            self._legs * self._band.last_rad_per_s / (2 * np.pi * C_M_PER_S),
            self._legs * self._band.step_rad_per_s / (2 * np.pi * C_M_PER_S),
            work.wave,
            work.step,
        )
        for index in reversed(range(len(self._walls))):
            dct(work.wave, axes=(1, 2), type=1, out=work.kernel, nthreads=1)
            yield self._walls[index]
            if index:
                fused.next_frequency(work.wave, work.step)

    def _rows(self, work: _Workspace) -> NDArray[np.complex64]:
        """Transform the spectrum back and read it along y: (voxel rows, lattice columns)."""
        c2c(work.spectrum, axes=(0,), forward=False, out=work.spectrum, nthreads=1)
        fused.read_rows(work.spectrum, self._y.first, self._y.weights, work.rows)
        return c2c(work.rows, axes=(1,), forward=False, out=work.rows, nthreads=1)

    def _workspace(self) -> _Workspace:
        """Return the calling thread's arrays."""
        if not hasattr(self._threads, "work"):
            self._threads.work = _Workspace(self._y, self._x)
        return self._threads.work


def _wall_spectra(
    aperture: Aperture, spectra: NDArray[np.complex64], band: Band, y: AxisPlan, x: AxisPlan
) -> NDArray[np.complex64]:
    """Put positions on the lattice, weight by g, and transform: (F, y, x) complex64."""
    walls = np.zeros((len(spectra), y.length, x.length), np.complex64)
    at = (y.wall[aperture.row] * x.length + x.wall[aperture.column]).astype(np.intp)
    scale = band.weights / (y.length * x.length)  # the inverse FFT's, once
    for wall, emitted, factor in zip(walls, spectra, scale, strict=True):
        np.add.at(wall.reshape(-1), at, emitted * np.complex64(factor))
        c2c(wall, out=wall, nthreads=cpu_count() or 1)
    return walls


def focus_slab(
    aperture: Aperture,
    spectra: NDArray[np.complex64],
    band: Band,
    grid: VoxelGrid,
    detector_m: NDArray[np.float64] | None,
    progress: Callable[[float], None] | None = None,
    *,
    working_bytes: int = WALL_BYTES,
) -> NDArray[np.complex64]:
    """Image all planes of a grid with one band.

    Parameters
    ----------
    aperture
        Where the positions are.
    spectra
        (F, P) complex64 spectra of the histograms.
    band
        Their frequencies, and the weights of the virtual pulse.
    grid
        Voxels.
    detector_m
        (3,) detector spot, or None for confocal data.
    progress
        Called with the fraction that is done, from the calling thread.
    working_bytes
        Memory for the wall's spectra; more frequencies than fit are taken in turns.

    Returns
    -------
    ndarray
        (z, y, x) complex64 field U.
    """
    field = np.zeros(grid.shape, np.complex64)
    legs = 2 if detector_m is None else 1
    wavenumber = legs * band.last_rad_per_s / C_M_PER_S
    plans = plan_axis(aperture.y, grid.y_m, wavenumber), plan_axis(aperture.x, grid.x_m, wavenumber)
    many = len(band.weights)
    at_once = max(1, working_bytes // (8 * plans[0].length * plans[1].length))
    for start in range(0, many, at_once):
        part = slice(start, min(start + at_once, many))
        propagator = PlanePropagator(aperture, spectra[part], band[part], grid, legs, plans)
        with ThreadPoolExecutor(cpu_count()) as threads:
            planes = {
                threads.submit(propagator.focus, float(z_m), detector_m): index
                for index, z_m in enumerate(grid.z_m)
            }
            for done, plane in enumerate(as_completed(planes), 1):
                field[planes[plane]] += plane.result()
                if progress:
                    progress((start + done / len(planes) * (part.stop - start)) / many)
    return field
