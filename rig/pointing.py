"""From a spot on the relay wall to mirror angles and back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Pointing:
    """A two-axis mirror that faces the wall squarely.

    The beam leaves the mirror along (tan a_x, tan a_y, -1), so the spot is where that ray meets z = 0.

    Attributes
    ----------
    mirror_m
        The mirror in the wall's frame [m].
    """

    mirror_m: tuple[float, float, float]

    def angles_rad(self, spots_m: ArrayLike) -> NDArray[np.float64]:
        """Return (..., 2) optical angles, right and up, that put the beam on (..., 3) wall spots."""
        offset_m = np.asarray(spots_m, dtype=float) - np.asarray(self.mirror_m)
        return np.arctan2(offset_m[..., :2], -offset_m[..., 2:])

    def spots_m(self, angles_rad: ArrayLike) -> NDArray[np.float64]:
        """Return (..., 3) spots on the wall z = 0 for (..., 2) optical angles."""
        tangents = np.tan(np.asarray(angles_rad, dtype=float))
        x_m, y_m, z_m = self.mirror_m
        spots = np.zeros((*tangents.shape[:-1], 3))
        spots[..., 0] = x_m + z_m * tangents[..., 0]
        spots[..., 1] = y_m + z_m * tangents[..., 1]
        return spots
