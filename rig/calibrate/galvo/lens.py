"""What a camera is to a calibration: points to pixels and back, by 14 numbers.

Pinhole with the distortion of Brown (Photogrammetric Engineering 37, 1971), in OpenCV's terms: camera frame x
right and y down in the image, z forward; a point X of the wall's frame is R X + t there.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

#: fx, fy, cx, cy [pixels], k1, k2, p1, p2, rotation vector [rad] and translation [m].
NUMBERS = 14

#: Fixed-point steps from a seen to an ideal point; each gains at least a digit with ordinary lenses.
UNDISTORT_STEPS = 15


@dataclass(frozen=True)
class CameraModel:
    """A camera in the wall's frame.

    Attributes
    ----------
    numbers
        (14,) see `NUMBERS`.
    """

    numbers: Floats

    @classmethod
    def of(cls, matrix: Floats, distortion: Floats, turn: Rotation, shift_m: Floats) -> Self:
        """Put together from OpenCV's camera matrix (3, 3), distortion (k1, k2, p1, p2, ...) and pose."""
        inner = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)[:4]]
        return cls(np.array([*inner, *turn.as_rotvec(), *shift_m]))

    @property
    def _turn(self) -> Floats:
        return np.asarray(Rotation.from_rotvec(self.numbers[8:11]).as_matrix())

    @property
    def position_m(self) -> Floats:
        """(3,) where it stands [m]."""
        return -self._turn.T @ self.numbers[11:]

    def project(self, points_m: Floats) -> Floats:
        """(..., 3) points [m] to (..., 2) pixels (column, row)."""
        own_m = points_m @ self._turn.T + self.numbers[11:]
        x, y = own_m[..., 0] / own_m[..., 2], own_m[..., 1] / own_m[..., 2]
        return self.numbers[:2] * np.stack(self._distorted(x, y), axis=-1) + self.numbers[2:4]

    def rays(self, pixels: Floats) -> Floats:
        """(..., 2) pixels to (..., 3) unit vectors in the wall's frame, from where the camera stands."""
        seen = (pixels - self.numbers[2:4]) / self.numbers[:2]
        ideal = seen.copy()
        for _ in range(UNDISTORT_STEPS):
            ideal = ideal + seen - np.stack(self._distorted(ideal[..., 0], ideal[..., 1]), axis=-1)
        own = np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1)
        return own / np.linalg.norm(own, axis=-1, keepdims=True) @ self._turn

    def _distorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        k1, k2, p1, p2 = self.numbers[4:8]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * k2)
        return (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )
