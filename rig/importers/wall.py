"""Bringing a relay wall that stands anywhere into the program's frame."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError

#: No wall has spots farther away, and squares of what is far beyond are no numbers.
_FARTHEST_M = 1e6

#: A wall whose spots are within this of a plane is flat [m].
FLAT_M = 1e-4
#: A wall that is not flat is kept as it stands where its normal is within 45 degrees of z.
_FACING = np.sqrt(0.5)
#: The origin lies amid the spots where it is this part of their extent away from their edges.
_AMID = 0.1
#: z = 0 is at the wall where it is not further from its spots than this part of their extent across.
_BESIDE = 0.25


@dataclass(frozen=True)
class WallFrame:
    """A rigid motion x -> axes (x - origin) of another frame into ours.

    Attributes
    ----------
    origin_m
        (3,) the other frame's point that becomes our origin.
    axes
        (3, 3) rows: our x, y and z axes in the other frame.
    """

    origin_m: NDArray[np.float64]
    axes: NDArray[np.float64]

    @classmethod
    def of(cls, spots_m: NDArray, normals: NDArray | None, towards_m: NDArray | None) -> Self:
        """Find the motion that lays a wall onto z = 0, its y axis as upright as it can be.

        A wall that lies in z = 0 already, its room at z > 0, stays where it is; so does one that is not flat,
        if z = 0 runs through it and it faces z. Else the origin becomes the middle of the spots, z the wall's
        normal into the room, y the other frame's y axis as far as it lies in the wall, and x = y cross z, so
        that nothing is mirrored.

        Parameters
        ----------
        spots_m
            (P, 3) spots on the wall; NaN where there is none.
        normals
            (P, 3) normals into the room, NaN where there is none; None where not known.
        towards_m
            (3,) a point in the room, such as the laser, used where there is no normal.

        Raises
        ------
        DataFileError
            If the spots do not tell a plane, its side is not known, or it is a floor.
        """
        spots_m = _there(spots_m)
        require_near("the wall's spots", spots_m)
        middle_m = (spots_m.min(axis=0) + spots_m.max(axis=0)) / 2
        normal = None if normals is None else normals[np.isfinite(normals).all(axis=1)].sum(axis=0)
        spread, directions = np.linalg.svd(spots_m - spots_m.mean(axis=0), full_matrices=False)[1:]
        if normal is not None and np.linalg.norm(normal) > 0:
            z = normal / np.linalg.norm(normal)
        elif len(spots_m) >= 3 and spread[1] > 1e-6 * spread[0]:
            z = directions[2]
            side = 0.0 if towards_m is None else float(np.dot(towards_m - middle_m, z))
            in_place = np.abs(spots_m[:, 2]).max() < FLAT_M
            if side == 0.0 and not in_place:
                raise DataFileError("the wall's spots have no normals, so the room's side is not known")
            z = z * np.sign(side) if side else np.array([0.0, 0.0, 1.0])
        else:
            raise DataFileError("the wall's spots lie on one line and have no normals: the wall is not known")
        if _stands_as_ours(spots_m, z):
            return cls(np.zeros(3), np.eye(3))
        up = np.array([0.0, 1.0, 0.0]) - z[1] * z
        if np.linalg.norm(up) < 0.1:
            raise DataFileError("the relay wall is a floor or a ceiling, so it has no upward direction")
        y = up / np.linalg.norm(up)
        return cls(middle_m, np.stack([np.cross(y, z), y, z]))

    @classmethod
    def amid(cls, lit_m: NDArray, seen_m: NDArray, *, across: bool = True) -> Self:
        """Find the shift that brings the origin amid the spots of a wall that faces z.

        It is for layouts whose axes are ours, but whose origin may be anywhere, mostly in a corner. The
        origin stays where it lies amid the spots across the wall, and z stays where z = 0 runs through the
        wall or close by; else it becomes the middle of the spots.

        Parameters
        ----------
        lit_m, seen_m
            (P, 3) spots of the laser, and (P, 3) or (1, 3) of the detector; NaN where there is none. Those of
            the laser count, or of the detector where the laser has one spot alone.
        across
            Whether the origin is shifted across the wall, too, and not along z alone.
        """
        spots_m = _there(lit_m)
        if not np.ptp(spots_m[:, :2], axis=0).any():
            spots_m = _there(seen_m)
        low_m, high_m = spots_m.min(axis=0), spots_m.max(axis=0)
        middle_m, near_m = (low_m + high_m) / 2, _AMID * (high_m - low_m)
        across_in = not across or ((low_m + near_m <= 0)[:2].all() and (high_m - near_m >= 0)[:2].all())
        beside_m = _BESIDE * (high_m - low_m)[:2].max()
        z_in = low_m[2] - beside_m <= 0 <= high_m[2] + beside_m
        origin_m = np.array([*(np.zeros(2) if across_in else middle_m[:2]), 0.0 if z_in else middle_m[2]])
        return cls(origin_m, np.eye(3))

    @property
    def still(self) -> bool:
        """Whether the motion moves nothing."""
        return bool((self.axes == np.eye(3)).all() and not self.origin_m.any())

    def in_words(self) -> str:
        """Return what the motion does, as a sentence with its numbers."""
        if self.still:
            return "the file's frame is kept: nothing was moved"
        origin = ", ".join(f"{value:.6g}" for value in self.origin_m + 0.0)
        if (self.axes == np.eye(3)).all():
            kept = "" if self.origin_m[2] else "; z is unchanged"
            return f"the origin was moved to (x, y, z) = ({origin}) m of the file's frame{kept}"
        x, y = (np.array2string(row, precision=4) for row in self.axes[:2])
        return f"the wall was moved onto z = 0: origin at (x, y, z) = ({origin}) m, x along {x}, y along {y}"

    def bring(self, points_m: NDArray) -> NDArray[np.float64]:
        """Return (n, 3) points of the other frame in ours."""
        return (points_m - self.origin_m) @ self.axes.T


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Put the file's name before what is said of its wall."""
    try:
        yield
    except DataFileError as error:
        raise DataFileError(f"{path}: {error}") from None


def require_near(what: str, places_m: NDArray) -> None:
    """Refuse places that are farther away than any room is large; those that are NaN are none.

    Raises
    ------
    DataFileError
        If there is such a place; it says what lies there.
    """
    farthest_m = np.max(np.abs(places_m), initial=0.0, where=np.isfinite(places_m))
    if farthest_m > _FARTHEST_M:
        raise DataFileError(
            f"{what} lie up to {farthest_m:.3g} m away; the file is damaged, or its places are not in m"
        )


def _there(spots_m: NDArray) -> NDArray:
    """Return the spots that have a place."""
    there = np.isfinite(spots_m).all(axis=1)
    if not there.any():
        raise DataFileError(
            f"none of the wall's {len(spots_m)} spots has a place: none is a finite number (NaN); the rays "
            "missed the wall, or the places were not written"
        )
    return spots_m[there]


def _stands_as_ours(spots_m: NDArray, normal: NDArray) -> bool:
    """Return whether a wall lies in z = 0, or z = 0 runs through it and it is not flat, and it faces z."""
    z_m = spots_m[:, 2]
    if np.abs(z_m).max() < FLAT_M:
        return bool(normal[2] > 0)
    from_middle_m = spots_m - spots_m.mean(axis=0)
    thin = np.linalg.svd(from_middle_m, full_matrices=False)[2][-1]
    flat = np.abs(from_middle_m @ thin).max() < FLAT_M
    return bool(not flat and z_m.min() < FLAT_M and z_m.max() > -FLAT_M and normal[2] > _FACING)
