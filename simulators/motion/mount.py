"""How the steering mirror is mounted: where the beam of a real, not quite aligned rig really goes."""

from dataclasses import dataclass
from math import cos, tan
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MirrorMount:
    """From a command to a ray. By default one mirror that faces the wall squarely and does what it is told.

    A commanded optical angle c becomes a = gain c + offset. With ``mirrors = 1`` both axes turn one
    mirror, whose electronics make the tangents independent: the beam leaves the pivot along
    (tan a_x, tan a_y, -1). With ``mirrors = 2`` a first mirror deflects by a_x and a second one, a separation
    e behind it, by a_y: the ray starts e tan a_x to the side and goes along (tan a_x / cos a_y, tan a_y, -1),
    so that on a wall at distance d it meets x = (d / cos a_y + e) tan a_x, y = d tan a_y, as is usual for
    galvanometer pairs. ``rotation`` then turns both start and direction into the wall's frame.

    Attributes
    ----------
    rotation
        (3, 3) from the mount's frame into the wall's.
    offset_rad
        Optical angles at command zero.
    gain
        Real angle for each commanded one.
    mirrors, separation_m
        1 or 2, and how far apart they are.
    """

    rotation: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offset_rad: tuple[float, float] = (0.0, 0.0)
    gain: tuple[float, float] = (1.0, 1.0)
    mirrors: Literal[1, 2] = 1
    separation_m: float = 0.0

    def ray(self, angles_rad: tuple[float, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return start (3,) from the pivot [m] and direction (3,) for optical angles of the mirror."""
        a_x, a_y = (
            gain * angle + offset
            for angle, gain, offset in zip(angles_rad, self.gain, self.offset_rad, strict=True)
        )
        turn = np.array(self.rotation)
        if self.mirrors == 1:
            return np.zeros(3), turn @ (tan(a_x), tan(a_y), -1.0)
        start = np.array([self.separation_m * tan(a_x), 0.0, 0.0])
        return turn @ start, turn @ (tan(a_x) / cos(a_y), tan(a_y), -1.0)

    def rays(self, angles_rad: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return `ray` of (n, 2) angles: starts (n, 3) and directions (n, 3)."""
        a_x, a_y = (np.array(self.gain) * angles_rad + np.array(self.offset_rad)).T
        tan_x, turned = np.tan(a_x), np.array(self.rotation).T
        starts, directions = np.zeros((len(a_x), 3)), np.full((len(a_x), 3), -1.0)
        directions[:, 0], directions[:, 1] = tan_x, np.tan(a_y)
        if self.mirrors == 2:
            starts[:, 0] = self.separation_m * tan_x
            directions[:, 0] /= np.cos(a_y)
        return starts @ turned, directions @ turned


def rotated(about_x_rad: float, about_y_rad: float, about_z_rad: float) -> NDArray[np.float64]:
    """(3, 3) rotation first about x, then about y, then about z, right-handed."""
    (cx, cy, cz), (sx, sy, sz) = (
        f(np.array([about_x_rad, about_y_rad, about_z_rad])) for f in (np.cos, np.sin)
    )
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
