"""O'Toole, Lindell and Wetzstein 2018 (light-cone transform): MATLAB v5 with ``rect_data`` and ``width``.

``rect_data`` (x, y, t): rectified confocal counts; the first axis goes towards +x, the second from top to
bottom. ``width`` is half the wall's side in metres; the spots include both edges.
"""

import numpy as np

from rig.errors import DataFileError
from rig.importers.content import Content, Options, as_counts, asked_for, square_grid
from rig.importers.source import Source

NAME = "O'Toole 2018, LCT"
SIGN = "MATLAB v5 with rect_data (x, y, t) and width"
#: The wall's own light ends here; the authors' reconstruction clears the same 600 bins of 4 ps.
WALL_LIGHT_S = 2.4e-9


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.matlab5 and source.has("rect_data", "width") and not source.has("ts")


def read(source: Source, options: Options) -> Content:
    """Read the file; the bin width is not in it.

    Raises
    ------
    UsageError
        If the bin width was not given.
    DataFileError
        If an array does not have the layout's shape.
    """
    width_m = source.numbers("width", 1)[0]
    shape = source.shapes["rect_data"] or ()
    if len(shape) != 3 or min(shape) < 1 or width_m <= 0:
        raise DataFileError(
            f"{source.path}: rect_data has shape {shape} and width is {width_m} m; "
            "(x, y, t) and a positive width are needed"
        )
    bin_width_s = asked_for(
        options.bin_width_s,
        source.path,
        "how wide its bins are",
        "--bin-width (the published measurements of this layout have 4ps)",
    )
    nx, ny, bins = shape
    counts = as_counts(np.asarray(source.read("rect_data")).reshape(nx * ny, bins))
    spots_m = square_grid(nx, ny, 2 * width_m, y_down=True)
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=bins,
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        fade_from_s=WALL_LIGHT_S,
        assumed=(
            f"the {nx} x {ny} spots span {2 * width_m:g} m with both edges, x rising, y falling",
            "confocal, rectified: bin 0 begins when the pulse is on the wall",
            f"the first {WALL_LIGHT_S * 1e9:g} ns hold the wall's own light",
        ),
    )
