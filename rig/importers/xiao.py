"""Xiao et al., 18 m stand-off: MATLAB with the cube ``sig`` (x, y, t), axes towards +x and +y.

Rectified and confocal; neither the wall's size nor the bin width is in the file.
"""

from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.square import confocal_square

NAME = "Xiao, 18 m stand-off"
SIGN = "MATLAB with sig (x, y, t)"
PARTS = ("sig",)


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    UsageError
        If the bin width or the wall's size was not given.
    DataFileError
        If the array does not have the layout's shape.
    """
    bin_width_s = options.asked(
        "bin_width_s", source.path, "how wide its bins are", "the published measurement has 32ps"
    )
    size_m = options.asked(
        "wall_size_m", source.path, "how large the scanned square is", "the published measurement has 82cm"
    )
    return confocal_square(source, "sig", size_m=size_m, bin_width_s=bin_width_s)
