"""The light-cone transform: confocal imaging as a deconvolution (O'Toole et al., Nature 555, 338, 2018).

A small diffuse surface at (x, y, z) returns, to the spot (x', y') that is lit and seen, at the radius
r = c t/2, the part 1/r^4 of its albedo rho. With u = z^2 and v = r^2 the light cone
r^2 = (x' - x)^2 + (y' - y)^2 + z^2 has the same shape wherever its tip is:

    r^4 H(x', y', v) = sum over x, y, u of S(x, y, u) h(x' - x, y' - y, v - u)
    h(x, y, w) = delta(w - x^2 - y^2)

H being the counts in a step of v, and S = rho du/(2 sqrt(u)) the albedo in a step of u. A Wiener filter takes
it back: S^ = H^ conj(h^) / (|h^|^2 + 1/SNR), h scaled to unit power as in that paper.

Its method builds h as a volume and transforms three volumes, padded to twice the size in each direction. Here
h is never built. At a frequency q of v it is exp(-i q x^2) exp(-i q y^2), a product, so that two short
transforms give a whole plane of h^, and the planes of different q are independent: data are transformed along
v without padding across, and one plane at a time is padded, filtered and cut back to size. Cells of the
lattice have an extent: across, exp(-i q x^2) is averaged over one; along u and v the boxes of width dv give
sinc^2(q dv/(2 pi)).
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, Capture
from recon.computer import usual_threads
from recon.fft import c2c, c2r, good_size, r2c
from recon.grid import VoxelGrid
from recon.solvers.classic.interpolate import LateralAxis, read_voxels
from recon.solvers.classic.resample import ConfocalLattice, confocal_record
from recon.window import Window

#: Default ratio of signal to noise power, where |h^|^2 has its mean.
SNR = 0.8


class LightCone:
    """The cone's convolution between a volume over u and data over v, and its Wiener inverse.

    Parameters
    ----------
    y, x
        Lattices across.
    steps
        Steps of u and of v, from zero.
    step_m2
        Length of a step.
    """

    def __init__(self, y: LateralAxis, x: LateralAxis, steps: int, step_m2: float) -> None:
        self._y, self._x, self._steps = y, x, steps
        # From any point to any other, nothing comes around the period.
        latest = (y.count * y.pitch_m) ** 2 + (x.count * x.pitch_m) ** 2
        self._period = good_size(steps + min(steps, int(np.ceil(latest / step_m2))) + 1, True)
        q = 2 * np.pi / (self._period * step_m2) * np.arange(self._period // 2 + 1)
        along = np.sinc(q * step_m2 / (2 * np.pi)) ** 2
        self._kernel_y = _transformed(y, q)
        self._kernel_x = _transformed(x, q) * along[:, None]
        self._power = self._mean_power()

    def forward(self, volume: NDArray[np.float32]) -> NDArray[np.float32]:
        """Convolve (u, y, x) with the cone: (v, wall y, wall x)."""
        return self._filtered(volume, (slice(None), slice(None)), (self._y.wall, self._x.wall), None)

    def inverse(
        self, data: NDArray[np.float32], snr: float, progress: Callable[[float], None] | None = None
    ) -> NDArray[np.float32]:
        """Deconvolve (v, wall y, wall x) by the Wiener filter: (u, y, x)."""
        return self._filtered(data, (self._y.wall, self._x.wall), (slice(None), slice(None)), snr, progress)

    def _mean_power(self) -> float:
        """Return the mean of |h^|^2 over all frequencies; positive and negative ones of v are alike."""
        planes = np.mean(np.abs(self._kernel_y) ** 2, axis=1) * np.mean(np.abs(self._kernel_x) ** 2, axis=1)
        both = np.full(len(planes), 2.0)
        both[0] = 1
        if self._period % 2 == 0:
            both[-1] = 1
        return float((planes * both).sum() / self._period)

    def _filtered(
        self,
        values: NDArray[np.float32],
        taken: tuple[slice, slice],
        given: tuple[slice, slice],
        snr: float | None,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        threads = usual_threads()
        padded = np.zeros((self._period, *values.shape[1:]), np.float32)
        padded[: self._steps] = values
        spectrum = r2c(padded, axes=(0,), nthreads=threads)
        del padded
        shape = (self._y.length, self._x.length)
        inside = (slice(self._y.count), slice(self._x.count))
        result = np.empty((len(spectrum), self._y.count, self._x.count), np.complex64)[:, given[0], given[1]]

        def one(index: int) -> None:
            plane = np.zeros(shape, np.complex64)
            plane[inside][taken] = spectrum[index]
            c2c(plane, out=plane, nthreads=1)
            kernel = np.multiply.outer(self._kernel_y[index], self._kernel_x[index])
            if snr is None:
                plane *= kernel
            else:
                power = kernel.real**2 + kernel.imag**2
                plane *= kernel.conj() / (power + np.float32(self._power / snr))
            c2c(plane, forward=False, inorm=2, out=plane, nthreads=1)
            result[index] = plane[inside][given]

        with ThreadPoolExecutor(threads) as pool:
            for done, _ in enumerate(pool.map(one, range(len(spectrum))), 1):
                if progress:
                    progress(done / len(spectrum))
        return c2r(result, axes=(0,), lastsize=self._period, forward=False, inorm=2, nthreads=threads)[
            : self._steps
        ]


def _transformed(axis: LateralAxis, q: NDArray[np.float64]) -> NDArray[np.complex64]:
    """Transform exp(-i q x^2), averaged over a cell, along x: (q, length) complex64."""
    numbers = np.fft.fftfreq(axis.length, 1 / axis.length)
    x_m = numbers * axis.pitch_m
    phase = np.multiply.outer(q, x_m)
    cone = np.exp(-1j * phase * x_m) * np.sinc(phase * axis.pitch_m / np.pi)
    return c2c(cone.astype(np.complex64), axes=(1,), nthreads=usual_threads())


def reconstruct(
    capture: Capture,
    lattice: ConfocalLattice,
    grid: VoxelGrid,
    window: Window,
    *,
    snr: float = SNR,
    falloff_power: float = 4.0,
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.float32]:
    """Image a volume.

    Steps of u and v are even, so depth is finest far away: dz = du/(2 z). They are chosen so that at the
    nearest plane (or at a quarter of the greatest radius, where that is more: so there are never more than
    twice as many steps as radii) dz is half the planes' spacing or the radius that a bin stands for,
    whichever is more.

    Parameters
    ----------
    capture, lattice
        Histograms, and their lattice.
    grid
        Voxels.
    window
        Soft edges of the record.
    snr
        Ratio of signal to noise power for the Wiener filter.
    falloff_power
        Counts fall as r^-4 where surfaces are diffuse, as r^-2 where they are retroreflective.
    progress
        Called with the fraction that is done.

    Returns
    -------
    ndarray
        (z, y, x) float32 albedo, not negative.
    """
    y = LateralAxis.covering(lattice.aperture.y, grid.y_m)
    x = LateralAxis.covering(lattice.aperture.x, grid.x_m)
    depth_m = radial_step_m(capture, grid)
    far_m = farthest_m(capture, lattice, grid)
    step_m2 = 2 * max(float(grid.z_m[0]), far_m / 4) * depth_m
    steps = int(np.ceil(far_m**2 / step_m2))
    edges_m2 = step_m2 * np.arange(steps + 1, dtype=np.float64)
    record = confocal_record(capture, lattice, window, np.sqrt(edges_m2))
    record *= ((edges_m2[1:] + edges_m2[:-1]) / 2) ** (falloff_power / 2)
    cone = LightCone(y, x, steps, step_m2)
    albedo = cone.inverse(np.moveaxis(record, 2, 0), snr, progress)
    albedo *= 2 * np.sqrt(edges_m2[1:] - step_m2 / 2)[:, None, None] / step_m2  # by the metre of depth
    return read_voxels(np.maximum(albedo, 0), np.sqrt(edges_m2), y, x, grid)


def radial_step_m(capture: Capture, grid: VoxelGrid) -> float:
    """Return the step of radius that voxels need and bins can give."""
    bin_m = C_M_PER_S * capture.bin_width_s / 2
    return max(bin_m, float(grid.z_m[1] - grid.z_m[0]) / 2) if len(grid.z_m) > 1 else bin_m


def farthest_m(capture: Capture, lattice: ConfocalLattice, grid: VoxelGrid) -> float:
    """Return the radius at which the record ends, or the volume as seen from its farthest spot."""
    end_s = float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s
    return min(end_s * C_M_PER_S / 2, float(np.hypot(grid.z_m[-1] * 1.02, lattice.extent_m(grid))))
