"""O'Toole, Lindell and Wetzstein 2018 (light-cone transform): MATLAB with ``rect_data`` and ``width``.

``rect_data`` (x, y, t): rectified confocal counts; the first axis goes towards +x, the second from top to
bottom. ``width`` is half the wall's side in metres; the spots include both edges.
"""

from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.square import confocal_square

NAME = "O'Toole 2018, LCT"
SIGN = "MATLAB with rect_data (x, y, t) and width"
PARTS = ("rect_data", "width")
#: The wall's own light ends here; the authors' reconstruction clears the same 600 bins of 4 ps.
WALL_LIGHT_S = 2.4e-9


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS) and not source.has("ts")


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
    bin_width_s = options.asked(
        "bin_width_s",
        source.path,
        "how wide its bins are",
        "the published measurements of this layout have 4ps",
    )
    return confocal_square(
        source,
        "rect_data",
        size_m=2 * width_m,
        bin_width_s=bin_width_s,
        y_down=True,
        fade_from_s=WALL_LIGHT_S,
        assumed=(f"the first {WALL_LIGHT_S * 1e9:g} ns hold light of the wall itself",),
    )
