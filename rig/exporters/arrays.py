"""What a volume holds, by name, and whether it is a box of equal voxels."""

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files import Volume

#: How far a voxel may be from its place on an even axis, in parts of a voxel.
EVEN = 1e-3


def volume_arrays(volume: Volume) -> dict[str, NDArray]:
    """Return intensity, axes and, where there are any, depth map and frame times."""
    names = ("intensity", "x_m", "y_m", "z_m", "depth_m", "t_s")
    return {name: getattr(volume, name) for name in names if getattr(volume, name) is not None}


def pitches_m(volume: Volume) -> tuple[float, float, float]:
    """Return the spacing of voxels along x, y and z; an axis of one voxel takes that of another.

    Raises
    ------
    UsageError
        If an axis is not evenly spaced.
    """
    found: list[float | None] = []
    for name in ("x_m", "y_m", "z_m"):
        axis_m = getattr(volume, name)
        if len(axis_m) < 2:
            found.append(None)
            continue
        pitch_m = float(axis_m[-1] - axis_m[0]) / (len(axis_m) - 1)
        off_m = np.abs(axis_m - axis_m[0] - pitch_m * np.arange(len(axis_m))).max()
        if not pitch_m > 0 or off_m > EVEN * pitch_m:
            raise UsageError(
                f"the volume's {name} is not evenly spaced, which this layout cannot hold; "
                "export it to .npz or .mat, which keep its axes"
            )
        found.append(pitch_m)
    known = [pitch_m for pitch_m in found if pitch_m is not None] or [1.0]
    x, y, z = (known[0] if pitch_m is None else pitch_m for pitch_m in found)
    return x, y, z
