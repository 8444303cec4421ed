"""From a spot on the relay wall to mirror angles and back: the physical model of the steering mirror.

The model's parameters are the configuration's until a calibration finds better ones.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.errors import RefusedError
from rig.model.quantities import show_length

#: Newton steps from a spot to angles; each doubles the digits, so that the last but one changes nothing.
INVERSION_STEPS = 8
#: The way of the resting beam in the frame of the mount, and the normal of the resting mirror in its own.
AHEAD = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Pointing:
    """A steering mirror before the wall z = 0. By default it faces the wall squarely and obeys exactly.

    A commanded optical angle c becomes a = gain c + offset. One mirror that turns about both axes
    (``mirrors = 1``; its electronics make the tangents independent) would send a beam that falls on it along
    its resting normal along u = (tan a_x, tan a_y, -1) / |...|: this is how its maker defines the angles. So
    its normal is halfway between u and the resting normal, and the mirror has turned by half the angle. The
    beam that comes at an angle of incidence is reflected about this normal (d - 2 (d n) n). The mount's frame
    is such that the beam of the resting mirror goes along (0, 0, -1), whatever the incidence.

    A pair (``mirrors = 2``) deflects by a_x first and by a_y a separation e later: the ray starts e tan a_x
    to the side and goes along (tan a_x / cos a_y, tan a_y, -1). The rotation turns both into the wall's
    frame; the spot is where the ray meets the wall.

    Attributes
    ----------
    mirror_m
        The mirror's pivot in the wall's frame [m]; of a pair, the second one's.
    rotation_rad
        Rotation vector from the mount's frame into the wall's [rad].
    offset_rad, gain
        Of each axis.
    incidence_rad
        (theta cos p, theta sin p) of one mirror: the beam meets the resting mirror at theta from its normal,
        and comes from the direction p in the mount's frame, from x towards y [rad].
    mirrors, separation_m
        1 or 2, and how far apart they are [m].
    area_m
        Corners (x, y) of the convex part of the wall in which the model was measured [m]; empty where it was
        not measured, and then nothing is refused.
    """

    mirror_m: tuple[float, float, float]
    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_rad: tuple[float, float] = (0.0, 0.0)
    gain: tuple[float, float] = (1.0, 1.0)
    incidence_rad: tuple[float, float] = (0.0, 0.0)
    mirrors: Literal[1, 2] = 1
    separation_m: float = 0.0
    area_m: tuple[tuple[float, float], ...] = ()

    def spots_m(self, angles_rad: ArrayLike) -> NDArray[np.float64]:
        """Return (..., 3) spots on the wall for (..., 2) commanded optical angles, right and up.

        NaN where the beam does not meet the wall.
        """
        angles = np.asarray(angles_rad, dtype=float) * self.gain + self.offset_rad
        tangents = np.tan(angles)
        turn = _turn(self.rotation_rad)
        start_m = np.asarray(self.mirror_m)
        if self.mirrors == 1:
            inside = self._reflected(tangents)
        else:
            inside = _ahead(tangents)
            inside[..., 0] /= np.cos(angles[..., 1])
            start_m = start_m + self.separation_m * tangents[..., :1] * turn[:, 0]
        direction = inside @ turn.T
        with np.errstate(divide="ignore", invalid="ignore"):
            along = np.where(direction[..., 2] < 0, -start_m[..., 2] / direction[..., 2], np.nan)
        spots = start_m + along[..., None] * direction
        spots[..., 2] = np.where(np.isnan(along), np.nan, 0.0)
        return spots

    def angles_rad(self, spots_m: ArrayLike) -> NDArray[np.float64]:
        """Return (..., 2) commanded optical angles that put the beam on (..., 3) wall spots.

        Raises
        ------
        RefusedError
            If a spot is outside the area in which the model was measured, or no angles lead there.
        """
        wanted_m = np.asarray(spots_m, dtype=float)
        self._refuse_outside(wanted_m)
        offset_m = wanted_m - np.asarray(self.mirror_m)
        turn = _turn(self.rotation_rad)
        inside = offset_m @ turn  # the way to the spot in the mount's frame
        if self.mirrors == 1:
            inside = self._straight(inside)
        angles = (np.arctan2(inside[..., :2], -inside[..., 2:]) - self.offset_rad) / self.gain
        if self.mirrors == 2:
            angles = self._refined(angles, wanted_m)
        if not np.isfinite(angles).all():
            raise RefusedError(
                "the steering mirror cannot put the beam on some of these spots: move the grid"
            )
        return angles

    @property
    def _lean(self) -> NDArray[np.float64]:
        """(3, 3) from the resting mirror's own frame, in which its normal is (0, 0, -1), into the mount's.

        The shortest turn: by the angle of incidence, towards where the beam comes from.
        """
        x_rad, y_rad = self.incidence_rad
        return _turn((y_rad, -x_rad, 0.0))

    def _reflected(self, tangents: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3) unit directions of the beam off one mirror, in the mount's frame.

        NaN where the beam meets the mirror from behind.
        """
        lean = self._lean
        normal = _unit(_unit(_ahead(tangents)) + AHEAD)  # all in the resting mirror's own frame
        source = lean @ AHEAD
        facing = normal @ source
        facing = np.where(facing > 0, facing, np.nan)[..., None]
        return np.asarray((2 * facing * normal - source) @ lean.T)

    def _straight(self, way: NDArray[np.float64]) -> NDArray[np.float64]:
        """Undo `_reflected`: where a beam along the resting normal would go, for (..., 3) ways of the beam.

        The normal is halfway between the way and the source; both are known.
        """
        lean = self._lean
        normal = _unit(_unit(way) @ lean + lean @ AHEAD)
        return np.asarray(2 * (normal @ AHEAD)[..., None] * normal - AHEAD)

    def _refined(self, angles: NDArray[np.float64], wanted_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pair's angles by Newton's method."""
        for _ in range(INVERSION_STEPS):
            angles = angles + self._step(angles, wanted_m)
        return angles

    def _step(self, angles: NDArray[np.float64], wanted_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Newton's correction of the angles."""
        missing_m = (wanted_m - self.spots_m(angles))[..., :2]
        tiny = 1e-6
        slopes = np.stack(
            [(self.spots_m(angles + by) - self.spots_m(angles - by))[..., :2] / (2 * tiny)
             for by in tiny * np.eye(2)],
            axis=-1,
        )  # fmt: skip
        step = np.linalg.solve(slopes, missing_m[..., None])[..., 0]
        return step.astype(np.float64)

    def _refuse_outside(self, spots_m: NDArray[np.float64]) -> None:
        if not self.area_m:
            return
        outside_m = outside(np.array(self.area_m), spots_m[..., :2].reshape(-1, 2))
        worst = int(outside_m.argmax())
        if outside_m[worst] > 0:
            x_m, y_m = spots_m.reshape(-1, 3)[worst, :2]
            raise RefusedError(
                f"the spot at x = {show_length(x_m)}, y = {show_length(y_m)} is "
                f"{show_length(outside_m[worst])} outside the area in which the mirror was calibrated. "
                "Use a smaller grid, or calibrate a larger area: rig calibrate galvo"
            )


def _ahead(tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3) directions (x, y, -1) for (..., 2) tangents."""
    return np.concatenate([tangents, -np.ones_like(tangents[..., :1])], axis=-1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., 3) vectors at length 1, NaN for those of length 0."""
    with np.errstate(invalid="ignore"):
        return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def outside(corners_m: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far (N, 2) points lie outside a convex polygon, negative inside it.

    Its (K, 2) corners go round counter-clockwise.
    """
    along = np.roll(corners_m, -1, axis=0) - corners_m
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    return ((points_m[:, None, :] - corners_m) * outwards).sum(axis=-1).max(axis=1)


def _turn(vector_rad: ArrayLike) -> NDArray[np.float64]:
    """Return the (3, 3) matrix of a turn by a rotation vector, by the formula of Rodrigues.

    R = 1 + sin(a)/a K + (1 - cos(a))/a^2 K^2, with a the vector's length and K v = vector x v. Written here
    since the library that has it takes a quarter of a second to import, and every scan aims.
    """
    vector = np.asarray(vector_rad, np.float64)
    cross = np.cross(vector, np.eye(3), axisb=0, axisc=0)
    part = np.sqrt(vector @ vector) / np.pi
    turn: NDArray[np.float64] = np.eye(3) + np.sinc(part) * cross + np.sinc(part / 2) ** 2 / 2 * cross @ cross
    return turn
