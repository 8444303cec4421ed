"""Back-projection of histograms, its adjoint, and the filters that sharpen it.

Every voxel sums what each position has recorded at the voxel's delay, read between bins by a straight line:

    B(v) = sum_p H_p((r_p + r_c)/c)

No weight is given for the fall-off with distance; it is left to the display. The sum is blurred (it is the
adjoint of the measurement, not its inverse), so the earlier methods filter it and keep the positive part.
"""

from collections.abc import Callable
from math import ceil, floor

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from recon.capture import C_M_PER_S, Capture
from recon.grid import VoxelGrid
from recon.sampling import path_limits_m
from recon.window import Window, windowed_blocks

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Progress = Callable[[float], None]

#: Positions at a time: their histograms stay in a core's cache while all voxels are visited.
BLOCK = 256
#: Standard deviation of the Gaussian of the LOG filter, in the coarser of voxel side and plane spacing.
LOG_SIGMA = 1.0


def backproject(capture: Capture, grid: VoxelGrid, window: Window, progress: Progress | None = None) -> F32:
    """Sum histograms at the voxels' delays.

    Bins are first summed in groups whose path is no longer than the smallest voxel side (half a voxel in
    depth): finer ones would only be skipped by the voxels, photons and all.

    Parameters
    ----------
    capture
        Any positions, with one detector spot or one for each.
    grid
        Voxels.
    window
        Soft edges of the record.
    progress
        Called with the fraction that is done.

    Returns
    -------
    ndarray
        (z, y, x) float32 counts.
    """
    group = max(1, floor(_smallest_side_m(grid) / (C_M_PER_S * capture.bin_width_s)))
    bin_m = group * capture.bin_width_s * C_M_PER_S
    volume = np.zeros(grid.shape, np.float32)
    x_m, y_m, z_m = (axis.astype(np.float32) for axis in (grid.x_m, grid.y_m, grid.z_m))
    bins = _bins(capture, grid, 2 * group)
    for block, counts in windowed_blocks(capture, window, bins):
        begin_m = capture.begin_m(block, bins.start)
        grouped = _grouped(counts, group)
        detector_m = capture.detector_m if len(capture.detector_m) == 1 else capture.detector_m[block]
        for first in range(0, len(grouped), BLOCK):
            part = slice(first, first + BLOCK)
            _sum_at_delays(
                grouped[part],
                capture.laser_m[block][part].astype(np.float32),
                (detector_m if len(detector_m) == 1 else detector_m[part]).astype(np.float32),
                ((begin_m[part] + bin_m / 2) / bin_m - 1).astype(np.float32),
                np.float32(1 / bin_m),
                x_m,
                y_m,
                z_m,
                volume,
            )
            if progress:
                progress(min(block.start + part.stop, block.stop) / capture.positions)
    return volume


def project(
    volume: F32,
    grid: VoxelGrid,
    laser_m: F64,
    detector_m: F64,
    bins: int,
    bin_width_s: float,
    first_bin_s: F64,
) -> F32:
    """Spread voxels over histograms: the adjoint of `backproject` without window and grouping.

    Parameters
    ----------
    volume, grid
        (z, y, x) float32 values and their places.
    laser_m, detector_m, first_bin_s
        As in `Capture`.
    bins, bin_width_s
        Number and width of the bins.

    Returns
    -------
    ndarray
        (positions, bins) float32.
    """
    bin_m = bin_width_s * C_M_PER_S
    counts = np.zeros((len(laser_m), bins + 3), np.float32)
    begin = np.broadcast_to(C_M_PER_S * first_bin_s / bin_m + 0.5, len(laser_m))
    _spread(
        volume,
        grid.x_m,
        grid.y_m,
        grid.z_m,
        laser_m,
        np.broadcast_to(detector_m, laser_m.shape),
        begin,
        1 / bin_m,
        counts,
    )
    return counts[:, 1:-2]


def laplacian_filtered(
    capture: Capture, grid: VoxelGrid, window: Window, progress: Progress | None = None
) -> F32:
    """Back-project and keep the positive part of -d^2/dz^2, the second derivative along depth.

    Velten et al. (Nature Communications 3, 745, 2012) sharpen so along the direction away from the wall.
    """
    deep = _with_margin(grid, 1)
    volume = backproject(capture, deep, window, progress)
    padded = np.pad(volume, ((1, 1), (0, 0), (0, 0)), mode="edge")
    sharp = 2 * padded[1:-1] - padded[2:] - padded[:-2]
    return _positive(sharp, grid, deep)


def log_filtered(capture: Capture, grid: VoxelGrid, window: Window, progress: Progress | None = None) -> F32:
    """Back-project and keep the positive part of minus the Laplacian of a Gaussian, in three dimensions.

    Laurenzis and Velten (Journal of Electronic Imaging 23, 063003, 2014). The Gaussian is a ball in metres,
    its standard deviation `LOG_SIGMA` of the coarser of voxel side and plane spacing, and derivatives are by
    the metre, so that voxels need not be cubes.
    """
    steps_m = [_step_m(axis, _smallest_side_m(grid)) for axis in (grid.z_m, grid.y_m, grid.x_m)]
    sigma_m = LOG_SIGMA * max(steps_m)
    deep = _with_margin(grid, ceil(3 * sigma_m / steps_m[0]))
    volume = backproject(capture, deep, window, progress)
    sharp = np.zeros_like(volume)
    for axis, step_m in enumerate(steps_m):
        order = [2 if other == axis else 0 for other in range(3)]
        sigmas = [sigma_m / other_m for other_m in steps_m]
        sharp -= gaussian_filter(volume, sigmas, order, mode="nearest") * np.float32((sigma_m / step_m) ** 2)
    return _positive(sharp, grid, deep)


def _with_margin(grid: VoxelGrid, planes: int) -> VoxelGrid:
    """Add planes on both sides, as far as they are in front of the wall, for the filter to see."""
    step_m = _step_m(grid.z_m, _smallest_side_m(grid))
    before = min(planes, ceil(grid.z_m[0] / step_m) - 1)
    numbers = np.arange(-before, len(grid.z_m) + planes)
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m[0] + step_m * numbers)


def _positive(sharp: F32, grid: VoxelGrid, deep: VoxelGrid) -> F32:
    """Cut the margin off, and what is negative."""
    first = int(np.abs(deep.z_m - grid.z_m[0]).argmin())
    return np.maximum(sharp[first : first + len(grid.z_m)], 0)


def _step_m(axis_m: F64, otherwise_m: float) -> float:
    return float(axis_m[1] - axis_m[0]) if len(axis_m) > 1 else otherwise_m


def _smallest_side_m(grid: VoxelGrid) -> float:
    """Return the smallest spacing of the axes; 1 cm for a single voxel."""
    axes = (axis for axis in (grid.x_m, grid.y_m, grid.z_m) if len(axis) > 1)
    return min((float(axis[1] - axis[0]) for axis in axes), default=0.01)


def _bins(capture: Capture, grid: VoxelGrid, margin: int) -> slice:
    """Return the bins that the volume needs, and `margin` on either side."""
    shortest_m, longest_m = path_limits_m(capture, grid)
    bin_m = C_M_PER_S * capture.bin_width_s
    first = floor((shortest_m - C_M_PER_S * float(capture.first_bin_s.max())) / bin_m) - margin
    stop = ceil((longest_m - C_M_PER_S * float(capture.first_bin_s.min())) / bin_m) + margin
    first = min(max(0, first), capture.bins)
    return slice(first, max(first, min(capture.bins, stop)))


def _grouped(counts: F32, group: int) -> F32:
    """Sum neighbouring bins, with one empty bin before them and two behind."""
    positions, bins = counts.shape
    groups = ceil(bins / group)
    whole = np.pad(counts, ((0, 0), (0, groups * group - bins))) if bins % group else counts
    grouped = np.zeros((positions, groups + 3), np.float32)
    grouped[:, 1:-2] = whole.reshape(positions, groups, group).sum(axis=2)
    return grouped


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _sum_at_delays(
    counts: F32,
    laser_m: F32,
    detector_m: F32,
    begin: F32,
    bins_per_m: np.float32,
    x_m: F32,
    y_m: F32,
    z_m: F32,
    volume: F32,
) -> None:
    """Add a block of positions to the volume.

    Single precision tells paths of metres to better than a micrometre. Delays along x are a loop of their own
    without branches, which vectorises; unsigned indices spare the look-up a test for negative ones. One
    detector's path is common to all positions.
    """
    last = np.float32(counts.shape[1] - 2)
    zero = np.float32(0)
    width = len(x_m)
    single = len(detector_m) == 1
    for row in prange(len(z_m) * len(y_m)):
        k, j = row // len(y_m), row % len(y_m)
        total = np.zeros(width, np.float32)
        node = np.empty(width, np.uint32)
        part = np.empty(width, np.float32)
        to_detector = np.empty(width, np.float32)
        for p in range(len(laser_m)):
            if p == 0 or not single:
                u, v = detector_m[p, 1] - y_m[j], detector_m[p, 2] - z_m[k]
                d = detector_m[p, 0]
                across = u * u + v * v
                for i in range(width):
                    w = d - x_m[i]
                    to_detector[i] = np.sqrt(w * w + across)
            u, v = laser_m[p, 1] - y_m[j], laser_m[p, 2] - z_m[k]
            d, b = laser_m[p, 0], begin[p]
            across = u * u + v * v
            histogram = counts[p]
            for i in range(width):
                w = d - x_m[i]
                path_m = np.sqrt(w * w + across) + to_detector[i]
                at = min(max(path_m * bins_per_m - b, zero), last)
                node[i] = np.uint32(np.int32(at))
                part[i] = at - np.floor(at)
            for i in range(width):
                n = node[i]
                here = histogram[n]
                total[i] += here + (histogram[n + np.uint32(1)] - here) * part[i]
        for i in range(width):
            volume[k, j, i] += total[i]


@njit(nogil=True, cache=True, parallel=True)
def _spread(
    volume: F32,
    x_m: F64,
    y_m: F64,
    z_m: F64,
    laser_m: F64,
    detector_m: F64,
    begin: F64,
    bins_per_m: float,
    counts: F32,
) -> None:
    """Add every voxel to the two bins nearest to its delay; guard bins take what is outside."""
    last = counts.shape[1] - 2
    for p in prange(len(laser_m)):
        for k in range(len(z_m)):
            for j in range(len(y_m)):
                a = (laser_m[p, 1] - y_m[j]) ** 2 + (laser_m[p, 2] - z_m[k]) ** 2
                b = (detector_m[p, 1] - y_m[j]) ** 2 + (detector_m[p, 2] - z_m[k]) ** 2
                for i in range(len(x_m)):
                    r_p = np.sqrt(a + (laser_m[p, 0] - x_m[i]) ** 2)
                    r_c = np.sqrt(b + (detector_m[p, 0] - x_m[i]) ** 2)
                    at = min(max((r_p + r_c) * bins_per_m - begin[p], -1.0), last - 1.0) + 1.0
                    n = int(at)
                    counts[p, n] += (n + 1 - at) * volume[k, j, i]
                    counts[p, n + 1] += (at - n) * volume[k, j, i]
