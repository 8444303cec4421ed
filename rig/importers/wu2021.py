"""Wu et al. 2021, 1.43 km stand-off: MATLAB with ``sig_in``, ``timeRes`` and ``width``.

``sig_in`` (x, y, t) confocal counts; ``timeRes`` bin width [s]; ``width`` half the wall's side [m];
``pulsewidth`` full width at half maximum of the instrument response [ps].
"""

from rig.importers.content import Content
from rig.importers.options import Options, positive
from rig.importers.source import Source
from rig.importers.square import confocal_square

NAME = "Wu 2021, 1.43 km stand-off"
SIGN = "MATLAB with sig_in (x, y, t), timeRes and width"
PARTS = ("sig_in", "timeRes", "width")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    DataFileError
        If an array does not have the layout's shape.
    """
    response_s = 1e-12 * source.numbers("pulsewidth", 1)[0] if source.has("pulsewidth") else None
    return confocal_square(
        source,
        "sig_in",
        size_m=2 * source.numbers("width", 1)[0],
        bin_width_s=positive(source.numbers("timeRes", 1)[0], f"{source.path}: timeRes"),
        instrument_response_s=response_s,
        assumed=("the directions of the axes are not in the file: the picture may be mirrored or turned",),
    )
