"""Which part of a record a volume can be seen in, and which frequencies image it without aliasing."""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from recon.camera import Camera, ConfocalCamera, Plane
from recon.capture import C_M_PER_S, Capture
from recon.grid import VoxelGrid
from recon.wave import Band, Light

CONFOCAL = ConfocalCamera()
#: Least thickness of a depth block, as a part of the path between the first and the last light of a plane.
THICKNESS = 0.06


@dataclass(frozen=True)
class DepthBlock:
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


def plane_times_s(capture: Capture, grid: VoxelGrid, camera: Camera, z_m: float) -> NDArray[np.float64]:
    """Return the moments at which a camera reads the plane at `z_m`: (T, ny or 1, nx or 1)."""
    detector_m = None if capture.round_trip else capture.detector_m[0]
    return camera.reading_times_s(Plane(grid.x_m[None], grid.y_m[:, None], float(z_m), detector_m))


def path_limits_m(capture: Capture, grid: VoxelGrid, camera: Camera = CONFOCAL) -> tuple[float, float]:
    """Bound the path, times c the delay, at which a record is read over all voxels, positions and frames.

    For the confocal camera that is the length of wall to voxel to wall. The aperture's own paths and the
    reading times are bounded apart, so the bounds are safe for any arrangement, and exact where one voxel is
    nearest to, and one farthest from, both ends.
    """
    planes_s = (plane_times_s(capture, grid, camera, z_m) for z_m in grid.z_m)  # one at a time
    limits_s = [(float(plane.min()), float(plane.max())) for plane in planes_s]
    shortest_m, longest_m = C_M_PER_S * min(limits_s)[0], C_M_PER_S * max(one for _, one in limits_s)
    ends = [capture.laser_m]
    if capture.round_trip:
        ends.append(capture.laser_m if capture.confocal else capture.detector_m)
    for spots_m in ends:
        least_m, greatest_m = distance_limits_m(spots_m, grid)
        shortest_m, longest_m = shortest_m + least_m, longest_m + greatest_m
    return shortest_m, longest_m


def distance_limits_m(spots_m: NDArray[np.float64], grid: VoxelGrid) -> tuple[float, float]:
    """Least and greatest distance between any spot and the grid's box."""
    nearest, farthest = np.zeros(len(spots_m)), np.zeros(len(spots_m))
    for number, axis in enumerate((grid.x_m, grid.y_m, grid.z_m)):
        at = np.ascontiguousarray(spots_m[:, number])  # axis by axis: five times as fast as all together
        below, above = axis[0] - at, at - axis[-1]
        nearest += np.maximum(np.maximum(below, above), 0) ** 2
        farthest += np.minimum(below, above) ** 2
    return float(np.sqrt(nearest.min())), float(np.sqrt(farthest.max()))


def depth_blocks(
    capture: Capture, light: Light, grid: VoxelGrid, camera: Camera = CONFOCAL
) -> list[DepthBlock]:
    """Cut the volume into depth blocks.

    A single plane is seen in a short part of the record, so it needs few frequencies; a thick block needs
    more, for all its planes. But each block costs a Fourier sum over its part of the record. Blocks as thick
    as half a pulse, or as `THICKNESS` of the path that one plane takes in any case, are a good balance; for a
    video, as thick as light goes between its first and its last frame.

    Returns
    -------
    list of DepthBlock
        In order of depth, covering all planes.
    """
    z_m = grid.z_m
    lasts_s = float(np.ptp(plane_times_s(capture, grid, camera, z_m[0]), axis=0).max())
    shortest_m, longest_m = path_limits_m(capture, VoxelGrid(grid.x_m, grid.y_m, z_m[:1]), camera)
    thickness_m = max(
        light.half_length_s * C_M_PER_S, lasts_s * C_M_PER_S, THICKNESS * (longest_m - shortest_m)
    )
    count = max(1, ceil((z_m[-1] - z_m[0]) / thickness_m))
    edges = np.linspace(0, len(z_m), min(count, len(z_m)) + 1).round().astype(int)
    parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    seen = [
        _seen(capture, light, VoxelGrid(grid.x_m, grid.y_m, grid.z_m[planes]), camera) for planes in parts
    ]
    return [
        DepthBlock(planes, bins, light.band(period_s))
        for planes, (bins, period_s) in zip(parts, seen, strict=True)
    ]


def depth_block(
    capture: Capture, light: Light, grid: VoxelGrid, planes: slice, camera: Camera = CONFOCAL
) -> DepthBlock:
    """Return some planes as one depth block."""
    bins, period_s = _seen(capture, light, VoxelGrid(grid.x_m, grid.y_m, grid.z_m[planes]), camera)
    return DepthBlock(planes, bins, light.band(period_s))


def _seen(capture: Capture, light: Light, planes: VoxelGrid, camera: Camera) -> tuple[slice, float]:
    """Return the bins in which planes are seen, and the time after which a pulse may repeat there."""
    shortest_m, longest_m = path_limits_m(capture, planes, camera)
    earliest_s, latest_s = shortest_m / C_M_PER_S, longest_m / C_M_PER_S
    margin_s, width_s = light.half_length_s, capture.bin_width_s
    begin_s, end_s = float(capture.first_bin_s.min()), float(capture.first_bin_s.max())
    # Clipped before rounding: the margin of a continuous wave is infinite.
    first = floor(min(max(0, (earliest_s - margin_s - end_s) / width_s), capture.bins))
    stop = max(first, ceil(min(capture.bins, (latest_s + margin_s - begin_s) / width_s)))
    # A count at t adds to voxels at delay tau a pulse at tau - t, and its copies one period away: these must
    # stay a pulse's half-length away from every voxel.
    longest_lag_s = max(end_s + stop * width_s - earliest_s, latest_s - begin_s - first * width_s)
    return slice(first, stop), longest_lag_s + margin_s
