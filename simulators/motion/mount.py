"""How the steering mirror is mounted: where the beam of a real, not quite aligned rig really goes."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MirrorMount:
    """From a command to a ray. By default one mirror that faces the wall squarely and does what it is told.

    A commanded optical angle c becomes a = gain c + offset. With ``mirrors = 1`` both axes turn one
    mirror. Its normal is tilted from rest by half the angle whose tangents are (tan a_x, tan a_y): a beam
    that comes along the resting normal leaves the pivot along (tan a_x, tan a_y, -1). A beam that comes at
    an angle is reflected about the same normal. The mount is turned so that at rest the beam leaves along
    (0, 0, -1) for any angle of incidence.

    With ``mirrors = 2`` a first mirror deflects by a_x and a second one, a separation
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
    incidence_rad, incidence_direction_rad
        Angle between the beam that comes and the normal of one mirror at rest, and the direction from which
        it comes, in the mount's frame from x towards y.
    mirrors, separation_m
        1 or 2, and how far apart they are.
    """

    rotation: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    offset_rad: tuple[float, float] = (0.0, 0.0)
    gain: tuple[float, float] = (1.0, 1.0)
    incidence_rad: float = 0.0
    incidence_direction_rad: float = 0.0
    mirrors: Literal[1, 2] = 1
    separation_m: float = 0.0

    @cached_property
    def _turned(self) -> NDArray[np.float64]:
        return np.array(self.rotation).T.copy()

    @cached_property
    def _linear(self) -> NDArray[np.float64]:
        return np.array([self.gain, self.offset_rad], np.float64)

    @cached_property
    def _at_rest(self) -> NDArray[np.float64]:
        """One mirror's normal at rest, where the beam comes from, and the mirror's two axes, a row each."""
        cos_i, sin_i = np.cos(self.incidence_rad), np.sin(self.incidence_rad)
        cos_p, sin_p = np.cos(self.incidence_direction_rad), np.sin(self.incidence_direction_rad)
        resting = np.array([sin_i * cos_p, sin_i * sin_p, -cos_i])
        source = 2 * cos_i * resting + (0.0, 0.0, 1.0)  # at rest (0, 0, -1) is its mirror image
        # the mirror's own axes: one in the plane of incidence, one across it, turned back by the direction
        along, across = np.array([cos_i * cos_p, cos_i * sin_p, sin_i]), np.array([-sin_p, cos_p, 0.0])
        x, y = cos_p * along - sin_p * across, sin_p * along + cos_p * across
        return np.array([resting, source, x, y])

    def ray(self, angles_rad: tuple[float, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return start (3,) from the pivot [m] and direction (3,) for optical angles of the mirror."""
        starts, directions = self.rays(np.array([angles_rad]))
        return starts[0], directions[0]

    def rays(self, angles_rad: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return `ray` of (n, 2) angles: starts (n, 3) and directions (n, 3).

        Directions are NaN where the beam meets the mirror from behind.
        """
        from simulators.motion.beam import rays  # numba, which who only describes a bench need not wait for

        two, apart_m = self.mirrors == 2, float(self.separation_m)
        starts, directions = rays(angles_rad, self._linear, self._at_rest, two, apart_m, self._turned)
        return starts, directions


def rotated(about_x_rad: float, about_y_rad: float, about_z_rad: float) -> NDArray[np.float64]:
    """(3, 3) rotation first about x, then about y, then about z, right-handed."""
    (cx, cy, cz), (sx, sy, sz) = (
        f(np.array([about_x_rad, about_y_rad, about_z_rad])) for f in (np.cos, np.sin)
    )
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
