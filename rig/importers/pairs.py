"""Laser and sensor points of files that keep the two apart, as our positions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.model.delays import PathDelays


@dataclass(frozen=True)
class Spots:
    """Laser and detector spots of each position.

    Attributes
    ----------
    laser_m, detector_m
        (P, 3), and (1, 3) or (P, 3).
    delays
        With the heads on their sides; None where there are none.
    assumed
        What was taken for granted.
    """

    laser_m: NDArray[np.float64]
    detector_m: NDArray[np.float64]
    delays: PathDelays | None
    assumed: tuple[str, ...]


def each_with_each(
    sensor_m: NDArray[np.float64],
    laser_m: NDArray[np.float64],
    sensor_head_m: NDArray[np.float64] | None,
    laser_head_m: NDArray[np.float64] | None,
    *,
    confocal: bool,
    laser_outer: bool,
) -> Spots:
    """Turn points of both sides into positions.

    One laser point before many sensor points is the same measurement as one detector spot with many laser
    spots (Helmholtz reciprocity): the two change places, heads included. Many laser points with many sensor
    points are pairs, each with each.

    Parameters
    ----------
    sensor_m, laser_m
        (S, 3) and (L, 3) points.
    sensor_head_m, laser_head_m
        (3,) heads; None where time is rectified.
    confocal
        Whether the points of both sides belong together one by one, so that S = L positions.
    laser_outer
        Of pairs, whether all sensor points of the first laser point come first, or the other way round.
    """
    heads = None
    if sensor_head_m is not None and laser_head_m is not None:
        heads = (laser_head_m, sensor_head_m)
    if confocal or (len(laser_m) == 1 and len(sensor_m) >= 1):
        return Spots(
            sensor_m,
            laser_m,
            PathDelays(heads[1], heads[0]) if heads else None,
            ("by reciprocity, its sensor points are the scanned laser spots, and its laser is the detector",),
        )
    delays = PathDelays(*heads) if heads else None
    if len(sensor_m) == 1:
        return Spots(laser_m, sensor_m, delays, ())
    said = f"each of {len(laser_m)} laser points with each of {len(sensor_m)} sensor points"
    if laser_outer:
        lit_m, seen_m = np.repeat(laser_m, len(sensor_m), axis=0), np.tile(sensor_m, (len(laser_m), 1))
    else:
        lit_m, seen_m = np.tile(laser_m, (len(sensor_m), 1)), np.repeat(sensor_m, len(laser_m), axis=0)
    return Spots(lit_m, seen_m, delays, (said,))
