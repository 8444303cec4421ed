"""From the lattice that a method computes on to the voxels that were asked for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.aperture import LatticeAxis
from recon.fft import good_size
from recon.grid import VoxelGrid


@dataclass(frozen=True)
class LateralAxis:
    """One axis across: the wall's lattice, continued to cover the voxels.

    Attributes
    ----------
    start_m, pitch_m, count
        First coordinate, spacing and number of lattice points.
    wall
        Where the wall's points are among them.
    length
        Length of a cyclic convolution in which no wall point and lattice point meet around the corner.
    """

    start_m: float
    pitch_m: float
    count: int
    wall: slice
    length: int

    @classmethod
    def covering(cls, wall: LatticeAxis, voxels_m: NDArray[np.float64]) -> "LateralAxis":
        """Extend a wall's axis to the voxels."""
        first = min(0, int(np.floor((voxels_m[0] - wall.start_m) / wall.pitch_m + 1e-6)))
        last = max(wall.count - 1, int(np.ceil((voxels_m[-1] - wall.start_m) / wall.pitch_m - 1e-6)))
        count = last - first + 1
        return cls(
            wall.start_m + first * wall.pitch_m,
            wall.pitch_m,
            count,
            slice(-first, wall.count - first),
            good_size(count + wall.count, False),
        )

    @property
    def edges_m(self) -> NDArray[np.float64]:
        """(count + 1,) edges of the cells around the lattice points."""
        return self.start_m + self.pitch_m * (np.arange(self.count + 1, dtype=np.float64) - 0.5)


def read_voxels(
    values: NDArray[np.float32],
    depth_edges_m: NDArray[np.float64],
    y: LateralAxis,
    x: LateralAxis,
    grid: VoxelGrid,
) -> NDArray[np.float32]:
    """Average over voxels.

    A voxel shows the mean over its own extent, so that a surface thinner than the planes' spacing is not
    missed between them; where cells are coarser than voxels, the mean over a cell's extent about the voxel's
    centre, which is a straight line from cell to cell.

    Parameters
    ----------
    values
        (cells along z, y, x) densities.
    depth_edges_m
        (cells + 1,) edges along z, not necessarily even.
    y, x
        The other axes.
    grid
        Voxels; outside the cells it is dark.

    Returns
    -------
    ndarray
        (z, y, x) float32.
    """
    read = np.tensordot(_means(depth_edges_m, grid.z_m), values, axes=(1, 0))
    read = _means(y.edges_m, grid.y_m) @ read
    return np.ascontiguousarray(read @ _means(x.edges_m, grid.x_m).T)


def _means(edges_m: NDArray[np.float64], centres_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """(voxels, cells) shares of the cells in the mean over each voxel."""
    cells_m = np.diff(edges_m)
    nearest = np.clip(np.searchsorted(edges_m, centres_m) - 1, 0, len(cells_m) - 1)
    side_m = centres_m[1] - centres_m[0] if len(centres_m) > 1 else 0.0
    width_m = np.maximum(side_m, cells_m[nearest])[:, None]
    low = np.maximum(edges_m[:-1], centres_m[:, None] - width_m / 2)
    high = np.minimum(edges_m[1:], centres_m[:, None] + width_m / 2)
    return (np.maximum(high - low, 0) / width_m).astype(np.float32)
