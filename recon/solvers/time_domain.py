"""The back-projection solver: the same image in the time domain, for any positions (paper, supplement D.2).

Each histogram is convolved with the virtual pulse and read at the delay r_p/c + t(v) of each voxel, t being
the moment at which the camera reads it (D.3), with r_c/c added where each position has its own detector spot:

    U(v, t) = sum_p a_p/r_p sum_n H[p, n] pulse(r_p/c + t - t_n),   pulse(t) = exp(i omega_0 t - t^2/(2
    sigma_t^2))

The carrier is kept apart. What is stored is the baseband B_p(tau) = sum_n H[p, n] exp(-i omega_0 t_n)
exp(-(tau - t_n)^2/(2 sigma_t^2)), as smooth as the envelope: at 8 nodes for each sigma_t the cubic through
four nodes is right to 9/384 (1/8)^4 max|B''''| sigma_t^4 = 2e-5 of the peak, and the carrier's phase is
applied exactly.

Work is positions x voxels x frames. This is the slow, independent check of the other solvers, and shares
nothing with them but the pulse and the window; it uses the pulse whole, where the others cut its spectrum at
three sigmas.
"""

from collections.abc import Iterator
from math import ceil, floor

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.errors import ParameterError
from recon.sampling import path_limits_m
from recon.solvers.problem import ImagingProblem
from recon.wave import VirtualPulse
from recon.window import windowed_blocks

#: Nodes of the baseband for each sigma_t.
NODES_PER_SIGMA = 8
#: Where the envelope is cut [sigma_t]: it has fallen to 4e-6.
CUT_SIGMAS = 5.0


def focus(problem: ImagingProblem) -> Iterator[NDArray[np.complex64]]:
    """Image a volume: positions may lie anywhere, with one detector spot or one for each.

    Yields
    ------
    ndarray
        (T, y, x) complex64 field U of each plane, and its slope where the problem asks for it.

    Raises
    ------
    ParameterError
        If the camera's light is no pulse.
    """
    if not isinstance(problem.light, VirtualPulse):
        raise ParameterError(
            "solver backprojection",
            f"the {problem.camera.name} camera",
            "its light is one frequency, an infinitely long pulse, which has no moment at which to read a "
            "histogram",
            "Use the rsd, fresnel or direct solver.",
        )
    capture, grid, pulse = problem.capture, problem.grid, problem.light
    shortest_m, longest_m = path_limits_m(capture, grid, problem.camera)
    spacing_s = pulse.sigma_s / NODES_PER_SIGMA
    begin_s = shortest_m / C_M_PER_S - 2 * spacing_s
    nodes = ceil((longest_m - shortest_m) / C_M_PER_S / spacing_s) + 5
    nodes_s = begin_s + spacing_s * np.arange(nodes, dtype=np.float64)
    baseband = np.zeros((capture.positions, nodes), np.complex64)
    first_bin_s = np.broadcast_to(capture.first_bin_s, capture.positions)
    for block, counts in windowed_blocks(capture, problem.window, slice(0, capture.bins)):
        baseband[block] = _baseband(counts, first_bin_s[block], capture.bin_width_s, pulse, nodes_s)
    baseband *= problem.weights.astype(np.float32)[:, None]
    laser_m = np.ascontiguousarray(capture.laser_m, np.float64)
    detector_m = np.ascontiguousarray(capture.detector_m if capture.round_trip else np.empty((0, 3)))
    for index, z_m in enumerate(grid.z_m):
        times_s = problem.times_s(index)
        fields = np.zeros((len(times_s), 1 + problem.slopes, *grid.shape[1:]), np.complex64)
        for field, moments_s in zip(fields, times_s, strict=True):
            _project(
                baseband,
                laser_m,
                detector_m,
                np.ascontiguousarray(np.broadcast_to(moments_s * C_M_PER_S, grid.shape[1:])),
                grid.x_m,
                grid.y_m,
                float(z_m),
                begin_s * C_M_PER_S,
                1 / (spacing_s * C_M_PER_S),
                1 / pulse.wavelength_m,
                field,
            )
        fields[:, 1:] *= 1 / spacing_s
        yield fields.reshape(-1, *grid.shape[1:])
        problem.progress((index + 1) / len(grid.z_m))


def _baseband(
    counts: NDArray[np.float32],
    first_bin_s: NDArray[np.float64],
    bin_width_s: float,
    pulse: VirtualPulse,
    nodes_s: NDArray[np.float64],
) -> NDArray[np.complex64]:
    """Convolve a block of histograms with the envelope: (block, nodes).

    The Gaussian's matrix is banded, so nodes are taken in groups with the bins that reach them. Positions
    whose record begins at the same time share the matrix.
    """
    result = np.zeros((len(counts), len(nodes_s)), np.complex64)
    bins = counts.shape[1]
    cut_s = CUT_SIGMAS * pulse.sigma_s
    for start_s in np.unique(first_bin_s):
        rows = np.flatnonzero(first_bin_s == start_s)
        for low in range(0, len(nodes_s), 8 * NODES_PER_SIGMA):
            group = nodes_s[low : low + 8 * NODES_PER_SIGMA]
            first = max(0, floor((group[0] - cut_s - start_s) / bin_width_s))
            stop = min(bins, ceil((group[-1] + cut_s - start_s) / bin_width_s))
            if stop <= first:
                continue
            times_s = start_s + (np.arange(first, stop) + 0.5) * bin_width_s
            envelope = np.exp(-(((group - times_s[:, None]) / pulse.sigma_s) ** 2) / 2)
            matrix = envelope * np.exp(-1j * pulse.carrier_rad_per_s * times_s)[:, None]
            product = counts[rows, first:stop] @ matrix.astype(np.complex64).view(np.float32)
            result[rows, low : low + len(group)] = product.view(np.complex64)
    return result


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _project(
    baseband: NDArray[np.complex64],
    laser_m: NDArray[np.float64],
    detector_m: NDArray[np.float64],
    read_m: NDArray[np.float64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: float,
    begin_m: float,
    nodes_per_m: float,
    turns_per_m: float,
    plane: NDArray[np.complex64],
) -> None:
    """Sum the basebands at each voxel's delays into a plane (1, y, x); with (2, y, x), their change by node.

    The path is r_p + `read_m`, (y, x), and r_c of the position's own detector spot where there are any. Along
    a row of voxels delays change little, so that the baseband is read from cache; what needs no lookup is
    loops of its own, which vectorise.
    """
    count = len(x_m)
    for j in prange(len(y_m)):
        path_m = np.empty(count, np.float64)
        radius_m = np.empty(count, np.float64)
        node = np.empty(count, np.int32)
        part = np.empty(count, np.float32)
        cosine = np.empty(count, np.float32)
        sine = np.empty(count, np.float32)
        real = np.zeros(count, np.float64)
        imaginary = np.zeros(count, np.float64)
        change = np.zeros(count, np.complex128)
        for p in range(len(laser_m)):
            to_laser = (laser_m[p, 1] - y_m[j]) ** 2 + (laser_m[p, 2] - z_m) ** 2
            for i in range(count):
                radius_m[i] = np.sqrt(to_laser + (laser_m[p, 0] - x_m[i]) ** 2)
                path_m[i] = radius_m[i] + read_m[j, i]
            if len(detector_m) > 0:
                to_detector = (detector_m[p, 1] - y_m[j]) ** 2 + (detector_m[p, 2] - z_m) ** 2
                for i in range(count):
                    path_m[i] += np.sqrt(to_detector + (detector_m[p, 0] - x_m[i]) ** 2)
            for i in range(count):
                at = (path_m[i] - begin_m) * nodes_per_m
                node[i] = np.int32(at)
                part[i] = at - np.floor(at)
                turns = path_m[i] * turns_per_m
                # exp(2 pi i turns) from Taylor series of half the angle, at most pi/2, to 1e-7.
                angle = np.float32((turns - np.floor(turns + 0.5)) * np.pi)
                q = angle * angle
                s = 1 - q * (1 / 110 - q * (1 / 17160))
                s = angle * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880 * s)))))
                c = 1 - q * (1 / 132 - q * (1 / 24024))
                c = 1 - q * (0.5 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (1 / 3628800 * c)))))
                cosine[i] = (1 - 2 * s * s) / radius_m[i]
                sine[i] = 2 * s * c / radius_m[i]
            row = baseband[p]
            for i in range(count):
                value = _cubic(row, node[i], part[i])
                real[i] += value.real * cosine[i] - value.imag * sine[i]
                imaginary[i] += value.real * sine[i] + value.imag * cosine[i]
            if len(plane) > 1:
                _add_change(row, node, part, cosine, sine, change)
        plane[0, j, :] = real + 1j * imaginary
        if len(plane) > 1:
            plane[1, j, :] = change


@njit(nogil=True, cache=True, fastmath=True)
def _add_change(
    row: NDArray[np.complex64],
    node: NDArray[np.int32],
    part: NDArray[np.float32],
    cosine: NDArray[np.float32],
    sine: NDArray[np.float32],
    change: NDArray[np.complex128],
) -> None:
    """Add the baseband's derivative by node, turned and weighted as its value is."""
    for i in range(len(node)):
        change[i] += _cubic_slope(row, node[i], part[i]) * complex(cosine[i], sine[i])


@njit(nogil=True, cache=True, inline="always", fastmath=True)
def _cubic(row: NDArray[np.complex64], n: int, f: float) -> complex:
    """Interpolate at n + f by the cubic through the nodes n - 1, n, n + 1, n + 2 (Lagrange)."""
    a, b = -f * (f - 1) * (f - 2) / 6, (f + 1) * (f - 1) * (f - 2) / 2
    c, d = -(f + 1) * f * (f - 2) / 2, (f + 1) * f * (f - 1) / 6
    return a * row[n - 1] + b * row[n] + c * row[n + 1] + d * row[n + 2]


@njit(nogil=True, cache=True, inline="always", fastmath=True)
def _cubic_slope(row: NDArray[np.complex64], n: int, f: float) -> complex:
    """Return the derivative of `_cubic` by f."""
    a, b = -(3 * f * f - 6 * f + 2) / 6, (3 * f * f - 4 * f - 1) / 2
    c, d = -(3 * f * f - 2 * f - 2) / 2, (3 * f * f - 1) / 6
    return a * row[n - 1] + b * row[n] + c * row[n + 1] + d * row[n + 2]
