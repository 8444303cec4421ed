"""Liu X. et al. 2023 (CC-SOCR), second form: MATLAB ``data`` with ``setup.mat`` beside it.

``data`` (n, m, t), or (pairs, t), rectified signals; ``laserpoints`` and ``detectpoints`` (n, m, 3), or
(pairs, 3), of ``setup.mat``: the lit and the seen spot of each signal in metres, x to the right, y up and z
into the room. ``data_0.mat`` has ``setup_0.mat`` beside it, and so on. The bin width is in neither. Where
fewer spots were chosen than the cube has room for, the rest of it is zero. General-NLOS keeps its own scans,
and those of 3D-RSD, in the same way.
"""

from pathlib import Path

import numpy as np

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.flight import given_flights
from rig.importers.options import Options
from rig.importers.places import paired, zeros_as_missing
from rig.importers.source import Source, open_source
from rig.importers.wall import WallFrame, named

NAME = "Liu 2023, CC-SOCR with setup"
SIGN = "MATLAB with data (n, m, t), and setup.mat with laserpoints and detectpoints beside it"
PARTS = ("data", "setup.mat")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    placed = source.has("cameraGridPositions")  # Z-NLOS, which has its places with it
    return source.has("data") and not placed and _setup(source.path).is_file()


def read(source: Source, options: Options) -> Content:
    """Read the file and the one beside it.

    Raises
    ------
    UsageError
        If the bin width was not given.
    DataFileError
        If the two files do not fit together.
    """
    signal = source.matlab_array("data")
    with open_source(_setup(source.path)) as setup:
        lit_m, seen_m = (setup.matlab_places(name) for name in ("laserpoints", "detectpoints"))
    fits = signal.ndim in {2, 3} and signal.dtype.kind in "uif" and np.prod(signal.shape[:-1]) == len(lit_m)
    if not fits or len(seen_m) != len(lit_m):
        raise DataFileError(
            f"{source.path}: data has shape {signal.shape}, but {_setup(source.path).name} has "
            f"{len(lit_m)} laser and {len(seen_m)} detector points"
        )
    bin_width_s = options.asked(
        "bin_width_s",
        source.path,
        "how wide its bins are",
        "published: 32ps for the statue, N and T and general-NLOS, 16ps for the figure 4, 18.75ps for 3D-RSD",
    )
    delay_s = given_flights(options, len(lit_m))
    counts = as_counts(signal.reshape(len(lit_m), -1))
    filled = counts.any(axis=1)
    if not filled.any():
        raise DataFileError(f"{source.path}: data is zero everywhere; there is nothing to import")
    counts, lit_m, seen_m = counts[filled], lit_m[filled], seen_m[filled]
    (lit_m, seen_m), unmeasured = zeros_as_missing(lit_m, seen_m)
    lit_m, seen_m = paired(lit_m, seen_m)
    with named(source.path):
        frame = WallFrame.amid(lit_m, seen_m)
    empty = np.count_nonzero(~filled)
    return Content(
        laser_m=frame.bring(lit_m),
        detector_m=frame.bring(seen_m),
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        delay_s=None if delay_s is None else delay_s[filled],
        assumed=(
            *([f"{empty} signals that are zero everywhere are left out, as not measured"] if empty else []),
            *unmeasured,
            "rectified: bin 0 starts when the pulse is on the wall"
            if delay_s is None
            else "the flight to each position, given with --tof, is subtracted from its time",
            "z grows into the room: that is not in the file",
        ),
        frame=frame,
    )


def _setup(path: Path) -> Path:
    """Return the file with the places: of the same name as the data but for that word, else setup.mat."""
    alike = path.with_name(path.name.replace("data", "setup", 1))
    return alike if alike != path and alike.is_file() else path.with_name("setup.mat")
