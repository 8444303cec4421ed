"""Liu X. et al. 2023 (CC-SOCR): MATLAB v5 ``sub_Sig`` with ``C_i.mat`` and ``C_d.mat`` beside it.

``sub_Sig`` (pairs, t) rectified signals. ``C_i`` and ``C_d`` (pairs, 3) whole numbers: grid indices of the
lit and of the seen spot, the second along +x and the third along +y. Neither pitch nor bin width is in the
files.
"""

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.importers.content import Content, Options, as_counts, asked_for
from rig.importers.source import Source, open_source

NAME = "Liu 2023, CC-SOCR"
SIGN = "MATLAB v5 with sub_Sig (pairs, t), and C_i.mat and C_d.mat beside it"


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.matlab5 and source.has("sub_Sig")


def read(source: Source, options: Options) -> Content:
    """Read the file and the two beside it.

    Raises
    ------
    UsageError
        If the bin width or the wall's size was not given.
    DataFileError
        If one of the three files is missing, or they do not fit together.
    """
    signal = np.asarray(source.read("sub_Sig"))
    lit, seen = _indices(source, "C_i"), _indices(source, "C_d")
    if signal.ndim != 2 or signal.dtype.kind not in "uif" or not len(signal) == len(lit) == len(seen) > 0:
        raise DataFileError(
            f"{source.path}: sub_Sig has shape {signal.shape}, but C_i has {len(lit)} "
            f"and C_d {len(seen)} rows"
        )
    bin_width_s = asked_for(
        options.bin_width_s,
        source.path,
        "how wide its bins are",
        "--bin-width (published: 32ps for the statue, 16ps for the figure 4)",
    )
    size_m = asked_for(
        options.wall_size_m,
        source.path,
        "how large the scanned square is",
        "--wall-size (published: 2m for the statue, 1.26m for the figure 4)",
    )
    low, high = lit.min(axis=0), lit.max(axis=0)
    if (high == low).all():
        raise DataFileError(f"{source.path}: C_i holds a single spot, so that the wall's size gives no pitch")
    pitch_m = size_m / (high - low).max()
    laser_m, detector_m = _place(lit, low, high, pitch_m), _place(seen, low, high, pitch_m)
    counts = as_counts(signal)
    return Content(
        laser_m=laser_m,
        detector_m=detector_m[:1] if (detector_m == detector_m[0]).all() else detector_m,
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        assumed=(
            f"the lit spots span {size_m:g} m, one index is {pitch_m * 100:g} cm; their middle is the origin",
            "rectified: bin 0 begins when the pulse is on the wall",
        ),
    )


def _indices(source: Source, name: str) -> NDArray[np.float64]:
    """Return the (pairs, 2) indices along x and y from the file of this name beside the source."""
    with open_source(source.path.with_name(f"{name}.mat")) as beside:
        return beside.numbers(name, -1, 3)[:, 1:]


def _place(index: NDArray, low: NDArray, high: NDArray, pitch_m: float) -> NDArray[np.float64]:
    return np.column_stack([(index - (low + high) / 2) * pitch_m, np.zeros(len(index))])
