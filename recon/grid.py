"""The voxels that are imaged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class VoxelGrid:
    """Voxel centres of a box, as three axes.

    Attributes
    ----------
    x_m, y_m, z_m
        (nx,), (ny,), (nz,) coordinates of voxel centres, each evenly spaced and ascending. Volumes on the
        grid have shape (nz, ny, nx).
    """

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape (nz, ny, nx) of a volume on this grid."""
        return len(self.z_m), len(self.y_m), len(self.x_m)

    @property
    def size(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape))
