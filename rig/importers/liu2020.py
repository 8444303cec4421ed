"""Liu, Bauer, Velten 2020 (diffraction): MATLAB with ``rect_data``, ``ts`` and ``SPAD_index``.

``rect_data`` (y, x, t) in MATLAB's order: rectified counts of a laser grid before one detector spot; ``ts``
bin width [s]; ``SPAD_index`` the detector's (row, column) on the grid; ``sampling_spacing`` pitch [m]. Which
way the axes point is not in the file; it is taken to be as in the same group's other releases.
"""

import numpy as np

from rig.errors import DataFileError
from rig.importers.content import Content
from rig.importers.cube import cube_blocks, cube_shape
from rig.importers.options import Options, positive
from rig.importers.source import Source

NAME = "Liu 2020, diffraction"
SIGN = "MATLAB with rect_data (y, x, t), ts and SPAD_index"
PARTS = ("rect_data", "ts", "SPAD_index")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    UsageError
        If the file has no ``sampling_spacing``, and the wall's size was not given.
    DataFileError
        If arrays do not fit together.
    """
    rows, columns, bins = cube_shape(source, "rect_data")
    row, column = source.numbers("SPAD_index", 2)
    if not (1 <= row <= rows and 1 <= column <= columns):
        raise DataFileError(
            f"{source.path}: SPAD_index is ({row:g}, {column:g}), outside of the grid of {rows} x {columns} "
            "spots"
        )
    bin_width_s = positive(source.numbers("ts", 1)[0], f"{source.path}: ts")
    if source.has("sampling_spacing"):
        pitch_m = positive(source.numbers("sampling_spacing", 1)[0], f"{source.path}: sampling_spacing")
    else:
        size_m = options.asked("wall_size_m", source.path, "how far apart its spots are")
        pitch_m = size_m / max(1, rows - 1, columns - 1)
    x_m = (np.arange(columns) - (columns - 1) / 2) * pitch_m
    y_m = ((rows - 1) / 2 - np.arange(rows)) * pitch_m
    grid_x, grid_y = np.meshgrid(x_m, y_m)
    detector_m = [np.interp(column - 1, range(columns), x_m), np.interp(row - 1, range(rows), y_m), 0.0]
    dtype, blocks = cube_blocks(source, "rect_data")
    return Content(
        laser_m=np.column_stack([grid_x.ravel(), grid_y.ravel(), np.zeros(rows * columns)]),
        detector_m=np.array([detector_m]),
        bins=bins,
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=dtype,
        blocks=blocks,
        assumed=(
            "y falls along the first axis in MATLAB's order and x rises along the second: "
            "the file does not contain this, so the picture may be mirrored or turned",
            "SPAD_index is (row, column), counted from one; the middle of the grid is the origin",
            "rectified: bin 0 starts when the pulse is on the wall",
        ),
    )
