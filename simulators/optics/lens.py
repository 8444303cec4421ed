"""A camera's geometry: where it stands, how its lens maps rays to pixels, and back.

Camera frame: x right and y down in the image, z forward. Pixel (0, 0) is the centre of the upper left pixel.
Distortion: Brown and Conrady, as in D. C. Brown, "Close-range camera calibration", Photogrammetric
Engineering 37 (1971): with r^2 = x^2 + y^2 on the plane z = 1,

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y .
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]

#: Most Newton steps from a distorted point to the undistorted one; each doubles the digits.
UNDISTORT_STEPS = 8


@dataclass(frozen=True)
class Pose:
    """Where something stands in the wall's frame.

    Attributes
    ----------
    rotation
        (3, 3) rows are its own axes x, y, z in the wall's frame.
    position_m
        (3,) its origin [m].
    """

    rotation: NDArray[np.float64]
    position_m: NDArray[np.float64]

    @classmethod
    def looking_at(cls, position_m: Point, target_m: Point, up: Point = (0.0, 1.0, 0.0)) -> "Pose":
        """Stand at one point and look at another, with ``up`` upwards in the image.

        Raises
        ------
        ValueError
            If it looks straight up or down, or at itself.
        """
        forward = np.subtract(target_m, position_m)
        right = np.cross(forward, up)
        if not np.linalg.norm(right) > 0:
            raise ValueError(f"a camera at {position_m} that looks at {target_m} has no upward direction")
        axes = np.array([right, np.cross(forward, right), forward])
        return cls(axes / np.linalg.norm(axes, axis=1)[:, None], np.array(position_m, dtype=np.float64))

    def inside(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the wall's frame in the own one [m]."""
        return (points_m - self.position_m) @ self.rotation.T

    def outside(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the own frame in the wall's [m]."""
        return points_m @ self.rotation + self.position_m


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths, principal point and size of the image, all in pixels."""

    fx: float = 1100.0
    fy: float = 1100.0
    cx: float = 639.5
    cy: float = 479.5
    width: int = 1280
    height: int = 960


@dataclass(frozen=True)
class Distortion:
    """Coefficients of Brown and Conrady; all 0 is a pinhole."""

    k1: float = -0.12
    k2: float = 0.05
    p1: float = 3e-4
    p2: float = -2e-4
    k3: float = 0.0

    def distort(self, ideal: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) ideal points of the plane z = 1 to where the lens puts them."""
        x, y = ideal[:, 0], ideal[:, 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            axis=1,
        )

    def undistort(self, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) points where the lens puts them to ideal ones, by Newton's method."""
        ideal = seen.copy()
        for _ in range(UNDISTORT_STEPS):
            a, b, c, d = self._slopes(ideal)
            missing = seen - self.distort(ideal)
            step = np.stack([d * missing[:, 0] - b * missing[:, 1], a * missing[:, 1] - c * missing[:, 0]])
            ideal += (step / (a * d - b * c)).T
            if np.abs(missing).max(initial=0.0) < 1e-8:  # the step just made leaves its square
                break
        return ideal

    def _slopes(self, ideal: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return dx'/dx, dx'/dy, dy'/dx, dy'/dy, each (N,)."""
        x, y = ideal[:, 0], ideal[:, 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        slope = 2 * (self.k1 + r2 * (2 * self.k2 + 3 * r2 * self.k3))  # d radial / d(r^2), times 2
        across = x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        return (
            radial + x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x,
            across,
            across,
            radial + y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x,
        )


@dataclass(frozen=True)
class Lens:
    """Pose, intrinsics and distortion: points to pixels, and pixels to rays."""

    pose: Pose
    intrinsics: Intrinsics
    distortion: Distortion

    def project(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points in the wall's frame [m] to (N, 2) pixels (column, row); NaN behind the camera."""
        own_m = self.pose.inside(np.atleast_2d(np.asarray(points_m, dtype=np.float64)))
        depth_m = np.where(own_m[:, 2] > 0, own_m[:, 2], np.nan)
        seen = self.distortion.distort(own_m[:, :2] / depth_m[:, None])
        i = self.intrinsics
        return seen * (i.fx, i.fy) + (i.cx, i.cy)

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) pixels to (N, 3) unit vectors in the wall's frame, from ``pose.position_m``."""
        i = self.intrinsics
        ideal = self.distortion.undistort((np.atleast_2d(pixels) - (i.cx, i.cy)) / (i.fx, i.fy))
        own = np.column_stack([ideal, np.ones(len(ideal))])
        return (own / np.linalg.norm(own, axis=1)[:, None]) @ self.pose.rotation


def meet(start_m: NDArray[np.float64], rays: NDArray[np.float64], plane: Pose) -> NDArray[np.float64]:
    """(N, 3) rays to (N, 2) where they meet a plane, in its own x and y [m]; NaN where not."""
    directions = rays @ plane.rotation.T
    origin_m = plane.inside(start_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        length_m = -origin_m[2] / directions[:, 2]
    length_m[~(length_m > 0)] = np.nan
    return origin_m[:2] + length_m[:, None] * directions[:, :2]


#: The relay wall itself: x to the right and y up for one who faces it.
WALL = Pose(np.eye(3), np.zeros(3))
