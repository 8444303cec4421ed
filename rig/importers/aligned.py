"""Aligned f-k scans, as programs that learn from them keep them: MATLAB with ``final_meas`` or ``measlr``.

A cube (x, y, t) in MATLAB's order: the scans of Lindell 2019, each record shifted to its wall, so that time
is rectified. Neither bin width nor the wall's size is in the file, and the axes are taken as those of Lindell
2019. (From the programs of Li et al. 2023, NLOST, which read both names.)
"""

from rig.errors import DataFileError
from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.square import confocal_square

NAME = "aligned f-k (NLOST)"
SIGN = "MATLAB with final_meas or measlr (x, y, t)"
PARTS = ("final_meas or measlr",)


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
        If it holds both arrays, or no cube.
    """
    if source.has("final_meas", "measlr"):
        raise DataFileError(f"{source.path} holds both final_meas and measlr; keep only the right one")
    bin_width_s = options.asked(
        "bin_width_s", source.path, "how wide its bins are", "the published scans have 32ps"
    )
    size_m = options.asked(
        "wall_size_m", source.path, "how large the scanned square is", "the published scans have 2m"
    )
    return confocal_square(
        source,
        "final_meas" if source.has("final_meas") else "measlr",
        size_m=size_m,
        bin_width_s=bin_width_s,
        y_down=True,
        assumed=("the directions of the axes are not in the file: the picture may be mirrored or turned",),
    )
