"""The voxels that are imaged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.errors import ParameterError


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

    @classmethod
    def from_spec(
        cls,
        width_m: float,
        height_m: float,
        voxel_m: float,
        depth_m: tuple[float, float, float],
        centre_m: tuple[float, float] = (0.0, 0.0),
    ) -> "VoxelGrid":
        """Fill a box with voxels.

        Parameters
        ----------
        width_m, height_m
            Extent along x and y, from edge to edge of the outermost voxels.
        voxel_m
            Pitch along x and y.
        depth_m
            First plane, last plane (the one at or before it), and step.
        centre_m
            Centre of the box along x and y.

        Raises
        ------
        ParameterError
            If a size or a step is not positive, or depths run backwards.
        """
        near, far, step = depth_m
        if min(width_m, height_m, voxel_m, step) <= 0 or far < near:
            raise ParameterError(
                "volume",
                f"{width_m} m x {height_m} m of {voxel_m} m voxels, depths {near} m to {far} m by {step} m",
                "sizes and steps must be positive, and depths ascend",
                "Write depths as near:far:step.",
            )
        planes = int(np.floor((far - near) / step + 1e-6)) + 1
        return cls(
            _centred(width_m, voxel_m) + centre_m[0],
            _centred(height_m, voxel_m) + centre_m[1],
            near + step * np.arange(planes, dtype=np.float64),
        )

    def check_in_front(self) -> None:
        """Refuse voxels that are not in front of the wall, and none at all.

        Raises
        ------
        ParameterError
            If so.
        """
        if self.size == 0 or self.z_m[0] <= 0:
            raise ParameterError(
                "volume",
                f"depths from {self.z_m[:1]} m",
                "voxels must be in front of the wall",
                "Begin at z > 0.",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape (nz, ny, nx) of a volume on this grid."""
        return len(self.z_m), len(self.y_m), len(self.x_m)

    @property
    def size(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape))


def _centred(extent_m: float, pitch_m: float) -> NDArray[np.float64]:
    """Return centres of the cells that fill an extent, symmetric about zero."""
    count = max(1, round(extent_m / pitch_m))
    return (np.arange(count, dtype=np.float64) - (count - 1) / 2) * pitch_m
