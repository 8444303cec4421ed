"""Confocal scans of a square, stored as one cube (x, y, t)."""

from collections.abc import Sequence
from math import inf

from rig.errors import DataFileError
from rig.importers.content import Content, square_grid
from rig.importers.cube import cube_blocks, cube_shape
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
        File and its (x, y, t) array, in MATLAB's order.
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
    if not 0 < size_m < inf:
        raise DataFileError(f"{source.path}: its wall is {size_m:g} m wide; a positive size is needed")
    nx, ny, bins = cube_shape(source, name)
    dtype, blocks = cube_blocks(source, name)
    spots_m = square_grid(nx, ny, size_m, y_down)
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=bins,
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=dtype,
        blocks=blocks,
        fade_from_s=fade_from_s,
        instrument_response_s=instrument_response_s,
        assumed=(
            f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y "
            + ("falling" if y_down else "rising"),
            "confocal, rectified: bin 0 starts when the pulse is on the wall",
            *assumed,
        ),
    )
