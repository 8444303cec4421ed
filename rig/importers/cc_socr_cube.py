"""Liu X. et al. 2023 (CC-SOCR), second form: MATLAB v5 ``data`` (n, m, t) with ``setup.mat`` beside it.

``data`` rectified signals; ``laserpoints`` and ``detectpoints`` (n, m, 3) of ``setup.mat``: the lit and the
seen spot of each signal in metres, x to the right and y up from a corner of the wall. The bin width is in
neither. Where fewer spots were chosen than the cube has room for, the rest of it is zero.
"""

import numpy as np

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options
from rig.importers.places import paired, zeros_as_missing
from rig.importers.source import Source, open_source
from rig.importers.wall import WallFrame

NAME = "Liu 2023, CC-SOCR with setup"
SIGN = "MATLAB v5 with data (n, m, t), and setup.mat with laserpoints and detectpoints beside it"
PARTS = ("data", "setup.mat")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file and the one beside it.

    Raises
    ------
    UsageError
        If the bin width was not given.
    DataFileError
        If the two files do not fit together.
    """
    signal = np.asarray(source.read("data"))
    with open_source(source.path.with_name("setup.mat")) as setup:
        lit_m, seen_m = (setup.places(name) for name in ("laserpoints", "detectpoints"))
    fits = signal.ndim == 3 and signal.dtype.kind in "uif" and signal.shape[0] * signal.shape[1] == len(lit_m)
    if not fits or len(seen_m) != len(lit_m):
        raise DataFileError(
            f"{source.path}: data has shape {signal.shape}, but setup.mat has {len(lit_m)} laser and "
            f"{len(seen_m)} detector points"
        )
    bin_width_s = options.asked(
        "bin_width_s",
        source.path,
        "how wide its bins are",
        "published: 32ps for the statue, 16ps for the figure 4",
    )
    counts = as_counts(signal.reshape(len(lit_m), -1))
    filled = counts.any(axis=1)
    if not filled.any():
        raise DataFileError(f"{source.path}: data is zero throughout; there is nothing to import")
    counts, lit_m, seen_m = counts[filled], lit_m[filled], seen_m[filled]
    (lit_m, seen_m), unmeasured = zeros_as_missing(lit_m, seen_m)
    lit_m, seen_m = paired(lit_m, seen_m)
    try:
        frame = WallFrame.amid(lit_m, seen_m)
    except DataFileError as error:
        raise DataFileError(f"{source.path}: {error}") from None
    empty = np.count_nonzero(~filled)
    return Content(
        laser_m=frame.bring(lit_m),
        detector_m=frame.bring(seen_m),
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        assumed=(
            *([f"{empty} signals that are zero throughout are left out, as not measured"] if empty else []),
            *unmeasured,
            "rectified: bin 0 begins when the pulse is on the wall",
            "z grows into the room: that is not in the file",
        ),
        frame=frame,
    )
