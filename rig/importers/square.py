"""Confocal scans of a square, stored as one cube (x, y, t)."""

from collections.abc import Sequence

import numpy as np

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts, square_grid
from rig.importers.source import Source


def confocal_square(
    source: Source,
    name: str,
    *,
    size_m: float,
    bin_width_s: float,
    y_down: bool = False,
    fade_from_s: float | None = None,
    instrument_response_s: float | None = None,
    assumed: Sequence[str] = (),
) -> Content:
    """Read a rectified confocal cube whose first index goes towards +x.

    Parameters
    ----------
    source, name
        File and its (x, y, t) array.
    size_m
        Side of the square, from the first to the last spot.
    bin_width_s
        Width of a bin; bin 0 begins when the pulse is on the wall.
    y_down
        Whether the second index goes from top to bottom.
    fade_from_s, instrument_response_s, assumed
        As in `Content`.

    Raises
    ------
    DataFileError
        If the array is no such cube.
    """
    cube = np.asarray(source.read(name))
    if cube.ndim != 3 or cube.size == 0 or cube.dtype.kind not in "uifb" or not 0 < size_m < np.inf:
        raise DataFileError(
            f"{source.path}: {name} has shape {cube.shape} and type {cube.dtype}, on a wall of {size_m:g} m; "
            "a cube (x, y, t) of numbers on a wall of positive size is needed"
        )
    nx, ny, bins = cube.shape
    counts = as_counts(cube.reshape(nx * ny, bins))
    spots_m = square_grid(nx, ny, size_m, y_down)
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=bins,
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        fade_from_s=fade_from_s,
        instrument_response_s=instrument_response_s,
        assumed=(
            f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y "
            + ("falling" if y_down else "rising"),
            "confocal, rectified: bin 0 begins when the pulse is on the wall",
            *assumed,
        ),
    )
