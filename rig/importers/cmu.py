"""Tsai et al. 2019 (surface optimisation, CMU): MATLAB with ``transient`` and ``lighting``.

``transient`` (positions, t) rectified confocal counts; ``lighting`` (positions, 3) spots in metres, z = 0.
The published files are scans of O'Toole 2018 whose y was counted downwards: held against those, photon by
photon, y has to change its sign. Simulated files of the same program have ``gt_transient``, ``sensor`` and
``bin_width``, metres of optical path; their y is kept.
"""

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options, positive
from rig.importers.places import paired, zeros_as_missing
from rig.importers.source import Source

NAME = "Tsai 2019, CMU"
SIGN = "MATLAB with transient or gt_transient (positions, t), and lighting"
PARTS = ("lighting", "transient or gt_transient")
#: A record was cut where most positions begin within so many bins of one another.
_AT_ONCE = 10


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    UsageError
        If the bin width is not in the file, and was not given.
    DataFileError
        If arrays do not fit together.
    """
    if source.has("transient", "gt_transient"):
        raise DataFileError(f"{source.path} holds both transient and gt_transient; keep only the right one")
    simulated = source.has("gt_transient")
    signal = source.matlab_array("gt_transient" if simulated else "transient")
    lit_m = source.matlab_places("lighting")
    seen_m = source.matlab_places("sensor") if source.has("sensor") else lit_m
    if signal.ndim != 2 or signal.dtype.kind not in "uif" or not len(signal) == len(lit_m) == len(seen_m):
        raise DataFileError(
            f"{source.path}: the transient has shape {signal.shape}, but there are {len(lit_m)} lit and "
            f"{len(seen_m)} seen spots"
        )
    if source.has("bin_width"):
        bin_width_s = positive(source.numbers("bin_width", 1)[0], f"{source.path}: bin_width") / C_M_PER_S
    else:
        bin_width_s = options.asked(
            "bin_width_s", source.path, "how wide its bins are", "the published measurements have 4ps"
        )
    (lit_m, seen_m), unmeasured = zeros_as_missing(lit_m, seen_m)
    upright = np.array([1.0, 1.0 if simulated else -1.0, 1.0])
    lit_m, seen_m = paired(lit_m * upright, seen_m * upright)
    counts = as_counts(signal)
    begins = 0 if simulated else _cleared_bins(counts)
    return Content(
        laser_m=lit_m,
        detector_m=seen_m,
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        fade_from_s=begins * bin_width_s if begins else None,
        simulated=simulated,
        assumed=(
            "y is kept as it is" if simulated else "y is counted downwards in the file: its sign was changed",
            "confocal if there is no sensor; rectified: bin 0 starts when the pulse is on the wall",
            *(
                [f"its first {begins} bins were cleared: they held light of the wall itself"]
                if begins
                else []
            ),
            *unmeasured,
        ),
    )


def _cleared_bins(counts: NDArray) -> int:
    """Return how many bins were cleared of the wall's own light; 0 where the record begins as it may.

    After a cut, background begins in most positions at once, while the light of a hidden thing comes one
    position after the other.
    """
    begins = int(np.argmax(counts.any(axis=0)))
    at_once = counts[:, begins : begins + _AT_ONCE].any(axis=1).mean() > 0.5
    return begins if at_once else 0
