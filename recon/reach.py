"""Which part of a record a volume can be seen in, and which frequencies image it without aliasing."""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, Capture
from recon.grid import VoxelGrid
from recon.wave import Band, VirtualPulse


@dataclass(frozen=True)
class Slab:
    """Neighbouring planes of voxels that are imaged from the same bins with the same frequencies.

    Attributes
    ----------
    planes
        Which planes of the grid.
    bins
        Which bins of the record, both ends given; empty where the record does not reach the planes.
    band
        Frequencies and weights.
    """

    planes: slice
    bins: slice
    band: Band

    @property
    def reached(self) -> bool:
        """Whether the record holds anything that can come from these planes."""
        return self.bins.stop > self.bins.start


def path_limits_m(capture: Capture, grid: VoxelGrid) -> tuple[float, float]:
    """Bound the length of wall to voxel to wall over all voxels and positions.

    The two legs are bounded apart, so the bounds are safe for any arrangement, and exact where one voxel is
    nearest to, and one farthest from, both ends.
    """
    laser = leg_limits_m(capture.laser_m, grid)
    detector = laser if capture.confocal else leg_limits_m(capture.detector_m, grid)
    return laser[0] + detector[0], laser[1] + detector[1]


def leg_limits_m(spots_m: NDArray[np.float64], grid: VoxelGrid) -> tuple[float, float]:
    """Least and greatest distance between any spot and the grid's box."""
    low = np.array([axis[0] for axis in (grid.x_m, grid.y_m, grid.z_m)])
    high = np.array([axis[-1] for axis in (grid.x_m, grid.y_m, grid.z_m)])
    outside = np.maximum(0, np.maximum(low - spots_m, spots_m - high))
    farthest = np.maximum(np.abs(spots_m - low), np.abs(spots_m - high))
    return float(np.linalg.norm(outside, axis=1).min()), float(np.linalg.norm(farthest, axis=1).max())


def slabs(capture: Capture, pulse: VirtualPulse, grid: VoxelGrid) -> list[Slab]:
    """Cut the volume into slabs over depth.

    A single plane is seen in a short part of the record, so it needs few frequencies; every slab costs a
    pass of the Fourier sum over the record. Slabs as thick as half a pulse are a good balance, since the
    pulse's own length has to be added to the part of the record in any case.

    Returns
    -------
    list of Slab
        In order of depth, covering all planes.
    """
    z_m = grid.z_m
    thickness_m = pulse.half_length_s * C_M_PER_S
    count = max(1, ceil((z_m[-1] - z_m[0]) / thickness_m))
    edges = np.linspace(0, len(z_m), min(count, len(z_m)) + 1).round().astype(int)
    return [_slab(capture, pulse, grid, slice(int(a), int(b))) for a, b in pairwise(edges)]


def _slab(capture: Capture, pulse: VirtualPulse, grid: VoxelGrid, planes: slice) -> Slab:
    shortest_m, longest_m = path_limits_m(capture, VoxelGrid(grid.x_m, grid.y_m, grid.z_m[planes]))
    earliest_s, latest_s = shortest_m / C_M_PER_S, longest_m / C_M_PER_S
    margin_s, width_s = pulse.half_length_s, capture.bin_width_s
    begin_s, end_s = float(capture.first_bin_s.min()), float(capture.first_bin_s.max())
    first = min(max(0, floor((earliest_s - margin_s - end_s) / width_s)), capture.bins)
    stop = max(first, min(capture.bins, ceil((latest_s + margin_s - begin_s) / width_s)))
    # A count at t adds to voxels at delay tau a pulse at tau - t, and its copies one period away: these must
    # stay a pulse's half-length away from every voxel.
    longest_lag_s = max(end_s + stop * width_s - earliest_s, latest_s - begin_s - first * width_s)
    return Slab(planes, slice(first, stop), pulse.band(longest_lag_s + margin_s))
