"""The voxels that are imaged."""

from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, log10

import numpy as np
from numpy.typing import NDArray

from recon.computer import memory_bytes
from recon.errors import MemoryBoundError, ParameterError

#: What imaging holds for each voxel: field and lateness, intensity and its noise, and what a picture needs.
BYTES_PER_VOXEL = 24
#: More voxels along one axis are a slip in typing: a thousandth of a wavelength in a hall of 40 m.
MOST_ALONG_AXIS = 1_000_000


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
        MemoryBoundError
            If there are more voxels than this computer holds, or than make sense; nothing is allocated.

        Examples
        --------
        >>> import recon
        >>> grid = recon.VoxelGrid.from_spec(1.8, 1.3, 0.1, depth_m=(0.5, 3.0, 0.02))
        >>> grid.shape, round(float(grid.x_m[0]), 3), float(grid.z_m[0])
        ((126, 13, 18), -0.85, 0.5)
        """
        near, far, step = depth_m
        numbers = (width_m, height_m, voxel_m, *depth_m)
        if not (all(map(isfinite, numbers)) and min(width_m, height_m, voxel_m, step) > 0 and far >= near):
            raise ParameterError(
                "volume",
                f"{width_m:g} m x {height_m:g} m of {voxel_m:g} m voxels, depths {near:g} m to {far:g} m by "
                f"{step:g} m",
                "sizes and steps must be finite and positive, and depths must ascend",
                "Write depths as near:far:step.",
            )
        _check_size(width_m, height_m, voxel_m, depth_m)
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


def _whole(count: float) -> str:
    """Return a count that was estimated as a whole number; long ones in short."""
    return f"{np.ceil(count * (1 - 1e-9)):.6g}"


def _check_size(width_m: float, height_m: float, voxel_m: float, depth_m: tuple[float, float, float]) -> None:
    """Refuse more voxels than the computer holds, before there is one; say the least change that fits."""
    near, far, step = depth_m
    across = [_cells(width_m, voxel_m), _cells(height_m, voxel_m)]
    planes = _cells(far - near, step) + 1
    room = memory_bytes() / BYTES_PER_VOXEL
    if (
        max(across) <= MOST_ALONG_AXIS
        and planes <= MOST_ALONG_AXIS
        and across[0] * across[1] * planes <= room
    ):
        return
    least = _least_change(width_m, height_m, voxel_m, depth_m, room)
    raise MemoryBoundError(
        "volume",
        f"{_whole(across[0])} x {_whole(across[1])} voxels in {_whole(planes)} planes",
        f"this computer holds {room:.2g} voxels of {BYTES_PER_VOXEL} bytes, and an axis has at most "
        f"{MOST_ALONG_AXIS:,}",
        f"{least} would fit.",
    )


def _least_change(
    width_m: float,
    height_m: float,
    voxel_m: float,
    depth_m: tuple[float, float, float],
    room: float,
) -> str:
    """Return in words which voxels, else which steps of depth, else which of both would fit."""
    near, far, step = depth_m
    planes = _cells(far - near, step) + 1
    finest_m = max(width_m, height_m) / MOST_ALONG_AXIS
    if planes <= min(MOST_ALONG_AXIS, room):
        needed_m = max(voxel_m, finest_m, (width_m * (height_m / room * planes)) ** 0.5)
        return f"Voxels of {_rounded_up(needed_m)}"
    across = _cells(width_m, voxel_m) * _cells(height_m, voxel_m)
    if across <= room / 100:
        most = min(MOST_ALONG_AXIS, room / across)
        return f"Steps in depth of {_rounded_up((far - near) / (most - 1))}"
    most = min(1e3, MOST_ALONG_AXIS)
    needed_m = max(voxel_m, finest_m, (width_m * (height_m / room * most)) ** 0.5)
    return f"Voxels of {_rounded_up(needed_m)} and steps in depth of {_rounded_up((far - near) / (most - 1))}"


def _cells(extent_m: float, pitch_m: float) -> float:
    """Return how many cells fill an extent, at least one; infinity where no number can say it."""
    return max(1.0, extent_m / pitch_m) if pitch_m * 1e300 > extent_m else inf


def _rounded_up(length_m: float) -> str:
    """Return a length with two digits, not less than it is."""
    if not 0 < length_m < inf:
        return "another size"
    digit_m = 10.0 ** (floor(log10(length_m)) - 1)
    return f"{ceil(length_m / digit_m * (1 - 1e-9)) * digit_m * 1e3:.3g}mm"
