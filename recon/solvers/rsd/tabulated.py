"""The sum over positions by table: any positions, any pairs, at a cost that no frequency adds to.

What one position adds to a voxel depends on the path alone: g H^ summed over the frequencies is a signal in
time, and the voxel reads it at r_p/c + t(v), t being the camera's moment, and r_c/c later where each record
has a detector spot of its own. So each position's signal is tabulated once for a depth block, and every pair
of position and voxel is a square root or two and a look-up:

    U(v) = sum_p 1/r_p exp(i omega_m tau) B_p(tau),   tau = r_p/c + t(v),
    B_p(tau) = sum_omega g H^(p, omega) exp(i (omega - omega_m) tau)

The carrier, in the band's middle omega_m, is kept apart and applied exactly; B is as smooth as the pulse's
envelope, and straight lines between `NODES` nodes for each sigma_t are right to (1/NODES)^2/8 = 1.2e-4 of its
peak. The frequencies are those of the RSD solver's depth block, so that both give the same numbers.

Paths are single precision: 6e-8 of some 200 turns of phase is 1e-4 rad.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Need
from recon.wave import BAND_SIGMAS, Band

#: Nodes of the table for each sigma_t.
NODES = 32
#: Most memory for the tables of the positions that are summed at once, and for what they are made from.
TABLE_BYTES = 64 * 2**20
#: Bytes of a node: value and difference to the next, each complex64.
NODE_BYTES = 16
#: Positions whose tables are made at once at the least; fewer would be slow.
MIN_POSITIONS = 256

F32 = NDArray[np.float32]


def focus_block(problem: ImagingProblem, emitted: NDArray[np.complex64]) -> Iterator[NDArray[np.complex64]]:
    """Image a problem of one depth block and one frame.

    Parameters
    ----------
    problem
        Geometry, voxels and the moment at which each is read. Its `working_bytes` bound the tables; more
        positions than fit are taken in turns.
    emitted
        (F, P) complex64: what each position emits at each frequency.

    Yields
    ------
    ndarray
        (1 or 2, y, x) complex64 field U of each plane, and its slope where the problem asks for it.
    """
    capture, band, grid = problem.capture, problem.band, problem.grid
    begin_m, nodes_per_m, nodes = node_range(band, problem.path_m)
    middle_rad_per_s = (band.first_rad_per_s + band.last_rad_per_s) / 2
    nodes_s = (begin_m + np.arange(nodes) / nodes_per_m) / C_M_PER_S
    phases = np.exp(1j * np.multiply.outer(band.frequencies_rad_per_s - middle_rad_per_s, nodes_s))
    phases = phases.astype(np.complex64)
    # Neighbours that share a detector spot share its path.
    order = np.lexsort(capture.detector_m.T) if capture.round_trip else np.arange(capture.positions)
    lit = capture.laser_m[order].astype(np.float32)
    seen = (capture.detector_m[order] if capture.round_trip else np.empty((0, 3))).astype(np.float32)
    axes = [axis.astype(np.float32) for axis in (grid.z_m, grid.y_m, grid.x_m)]
    at_once = max(1, min(problem.working_bytes, TABLE_BYTES) // (2 * NODE_BYTES * nodes))
    field = np.zeros((len(grid.z_m), 1 + problem.slopes, *grid.shape[1:]), np.complex64)
    for start in range(0, len(order), at_once):
        part = slice(start, min(start + at_once, len(order)))
        table = np.zeros((part.stop - start, nodes, 2), np.complex64)
        table[:, :, 0] = emitted[:, order[part]].T @ phases
        np.subtract(table[:, 1:, 0], table[:, :-1, 0], out=table[:, :-1, 1])
        for plane in range(len(grid.z_m)):
            read_m = np.broadcast_to(problem.times_s(plane)[0] * C_M_PER_S, grid.shape[1:]).astype(np.float32)
            _look_up(
                table.view(np.float32),
                lit[part],
                seen[part],
                read_m,
                axes[0][plane],
                axes[1],
                axes[2],
                np.float32(begin_m),
                np.float32(nodes_per_m),
                np.float32(middle_rad_per_s / (2 * np.pi * C_M_PER_S)),
                field[plane],
            )
            done = start + (plane + 1) / len(grid.z_m) * (part.stop - start)
            problem.progress(done / len(order))
    if problem.reference_rad_per_s is not None:
        # The slope of a straight line between nodes, and that of the carrier in the band's middle.
        field[:, 1] *= nodes_per_m * C_M_PER_S
        field[:, 1] += 1j * (middle_rad_per_s - problem.reference_rad_per_s) * field[:, 0]
    yield from field


def needs(problem: ImagingProblem, part: DepthBlock) -> Need:
    """Return the memory that a depth block's tables take."""
    grid, many = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[part.planes]), len(part.band)
    nodes = node_range(part.band, replace(problem, grid=grid).path_m)[2]
    # The table's phases, with their double-precision halves, belong to the pass's frequencies.
    fixed = 32 * grid.size + 40 * nodes * many + 100 * problem.capture.positions
    return Need(fixed, 2 * NODE_BYTES * nodes * MIN_POSITIONS, many)


def node_range(band: Band, path_m: tuple[float, float]) -> tuple[float, float, int]:
    """Return path at the first node [m], nodes for each metre, and number of nodes of a position's table.

    Parameters
    ----------
    band
        The frequencies.
    path_m
        Shortest and longest path that is looked up.
    """
    shortest_m, longest_m = path_m
    half_band = (band.last_rad_per_s - band.first_rad_per_s) / 2
    # One frequency alone has a constant B.
    nodes_per_m = max(NODES * half_band / BAND_SIGMAS / C_M_PER_S, 1 / (longest_m - shortest_m + 1e-3))
    # Two nodes of margin on either side are for the rounding of paths.
    return shortest_m - 2 / nodes_per_m, nodes_per_m, int((longest_m - shortest_m) * nodes_per_m) + 6


@njit(nogil=True, cache=True, parallel=True, fastmath=True, error_model="numpy")
def _look_up(
    table: F32,
    laser_m: F32,
    detector_m: F32,
    read_m: F32,
    z_m: np.float32,
    y_m: F32,
    x_m: F32,
    begin_m: np.float32,
    nodes_per_m: np.float32,
    turns_per_m: np.float32,
    plane: NDArray[np.complex64],
) -> None:
    """Add what each voxel of a plane (1, y, x) reads in the tables (P, nodes, 4); with (2, y, x), its change.

    The path is r_p + `read_m`, (y, x), and r_c of the record's own detector spot where there are any. What
    needs no look-up is in loops of its own, which vectorise.
    """
    count = len(x_m)
    half, one, two = np.float32(0.5), np.float32(1), np.float32(2)
    for j in prange(len(y_m)):
        node = np.empty(count, np.int32)
        part = np.empty(count, np.float32)
        cosine = np.empty(count, np.float32)
        sine = np.empty(count, np.float32)
        second = read_m[j].copy()
        same_leg = False
        real, imaginary = np.zeros(count, np.float32), np.zeros(count, np.float32)
        value_re, value_im = np.empty(count, np.float32), np.empty(count, np.float32)
        change_re, change_im = np.zeros(count, np.float32), np.zeros(count, np.float32)
        for p in range(len(laser_m)):
            across, depth = laser_m[p, 1] - y_m[j], laser_m[p, 2] - z_m
            beside = across * across + depth * depth
            factor = one
            if len(detector_m) == 0:
                pass
            elif (
                detector_m[p, 0] == laser_m[p, 0]
                and detector_m[p, 1] == laser_m[p, 1]
                and detector_m[p, 2] == laser_m[p, 2]
            ):
                factor = two
                second[:] = read_m[j]
                same_leg = False
            elif (
                not same_leg
                or detector_m[p, 0] != detector_m[p - 1, 0]
                or detector_m[p, 1] != detector_m[p - 1, 1]
                or detector_m[p, 2] != detector_m[p - 1, 2]
            ):
                across, depth = detector_m[p, 1] - y_m[j], detector_m[p, 2] - z_m
                square = across * across + depth * depth
                for i in range(count):
                    away = detector_m[p, 0] - x_m[i]
                    second[i] = read_m[j, i] + np.sqrt(square + away * away)
                same_leg = True
            for i in range(count):
                away = laser_m[p, 0] - x_m[i]
                r_p = np.sqrt(beside + away * away)
                path_m = factor * r_p + second[i]
                at = (path_m - begin_m) * nodes_per_m
                node[i] = np.int32(at)
                part[i] = at - np.float32(node[i])
                turns = path_m * turns_per_m
                # exp(2 pi i turns) from Taylor series of half the angle, at most pi/2, to 3e-7.
                angle = (turns - np.floor(turns + half)) * np.float32(np.pi)
                q = angle * angle
                s = one - q * (np.float32(1 / 72) - q * np.float32(1 / 7920))
                s = np.float32(1 / 6) - q * (np.float32(1 / 120) - q * np.float32(1 / 5040) * s)
                s = angle * (one - q * s)
                c = one - q * (np.float32(1 / 90) - q * np.float32(1 / 11880))
                c = half - q * (
                    np.float32(1 / 24) - q * np.float32(1 / 720) * (one - q * np.float32(1 / 56) * c)
                )
                c = one - q * c
                cosine[i] = (one - two * s * s) / r_p
                sine[i] = two * s * c / r_p
            row = table[p]
            for i in range(count):
                n, f = node[i], part[i]
                value_re[i] = row[n, 0] + f * row[n, 2]
                value_im[i] = row[n, 1] + f * row[n, 3]
            for i in range(count):
                real[i] += value_re[i] * cosine[i] - value_im[i] * sine[i]
                imaginary[i] += value_re[i] * sine[i] + value_im[i] * cosine[i]
            if len(plane) > 1:
                for i in range(count):
                    value_re[i], value_im[i] = row[node[i], 2], row[node[i], 3]
                for i in range(count):
                    change_re[i] += value_re[i] * cosine[i] - value_im[i] * sine[i]
                    change_im[i] += value_re[i] * sine[i] + value_im[i] * cosine[i]
        for i in range(count):
            plane[0, j, i] += complex(real[i], imaginary[i])
        if len(plane) > 1:
            for i in range(count):
                plane[1, j, i] += complex(change_re[i], change_im[i])
