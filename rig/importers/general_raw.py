"""General-NLOS (irregular relay surfaces) as measured: MATLAB ``counts``, with its peaks beside it.

Two pairs of mirrors scan laser and detector over n x m pairs of spots, every other line backwards. ``counts``
(pairs or more, t) holds one record a pair, first bounce and all. ``peak1.mat`` and ``peak2.mat`` (n, m) hold
the bin of the first bounce of each laser spot, seen there, and of each detector spot, lit there; half their
sum is the delay of the pair. ``setup.mat``, or ``laserpoints.mat`` and ``detectpoints.mat``, holds the spots
(n, m, 3) in metres. Peaks and spots have all lines in one direction.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options
from rig.importers.places import paired, zeros_as_missing
from rig.importers.source import Source, open_source
from rig.importers.wall import WallFrame, named

NAME = "general-NLOS, raw"
SIGN = "MATLAB with counts (pairs, t), and peak1.mat, peak2.mat and the spots beside it"
PARTS = ("counts", "peak1.mat", "peak2.mat", "setup.mat or laserpoints.mat")
#: The first bounce and its tail are over by then; the authors clear 40 bins of 32 ps, or 100.
WALL_LIGHT_S = 1.28e-9


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file and those beside it.

    Raises
    ------
    UsageError
        If the bin width was not given.
    DataFileError
        If the files do not fit together.
    """
    signal = source.matlab_array("counts")
    peaks = [_peaks(source.path, name) for name in ("peak1", "peak2")]
    lit_m, seen_m = _spots(source.path)
    pairs = peaks[0].size
    fits = signal.ndim == 2 and signal.dtype.kind in "uif" and len(signal) >= pairs
    if not fits or peaks[1].shape != peaks[0].shape or not pairs == len(lit_m) == len(seen_m):
        raise DataFileError(
            f"{source.path}: counts has shape {signal.shape}, the peaks {peaks[0].shape} and "
            f"{peaks[1].shape}, and there are {len(lit_m)} laser and {len(seen_m)} detector points; "
            "one of each a pair is needed"
        )
    bin_width_s = options.asked("bin_width_s", source.path, "how wide its bins are", "published: 32ps")
    (lit_m, seen_m), unmeasured = zeros_as_missing(lit_m, seen_m)
    lit_m, seen_m = paired(lit_m, seen_m)
    with named(source.path):
        frame = WallFrame.amid(lit_m, seen_m)
    counts = as_counts(_one_direction(signal[:pairs], peaks[0].shape))
    more = len(signal) - pairs
    return Content(
        laser_m=frame.bring(lit_m),
        detector_m=frame.bring(seen_m),
        bins=counts.shape[1],
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        # the middle of the peak's bin
        delay_s=((peaks[0] + peaks[1]) / 2 + 0.5).ravel() * bin_width_s,
        fade_from_s=WALL_LIGHT_S,
        frame=frame,
        assumed=(
            "each position's time starts half way between the first bounces of its two spots (peak1, peak2)",
            f"the first {WALL_LIGHT_S * 1e9:g} ns after the first bounce hold light of the wall itself",
            "every other line was measured backwards; z grows into the room",
            *([f"{more} records after the last pair are left out"] if more else []),
            *unmeasured,
        ),
    )


def _peaks(path: Path, name: str) -> NDArray[np.float64]:
    """Return the (n, m) bins of a first bounce, from the file of this name beside the source."""
    with open_source(path.with_name(f"{name}.mat")) as beside:
        peaks = beside.matlab_array(name)
    if peaks.dtype.kind not in "uif" or peaks.ndim != 2 or not peaks.size:
        raise DataFileError(
            f"{path.with_name(name)}.mat: {name} has shape {peaks.shape}; bins (n, m) are needed"
        )
    return peaks.astype(float)


def _spots(path: Path) -> list[NDArray[np.float64]]:
    """Return the (pairs, 3) points of laser and detector, from one file beside the source, or two."""
    names = ("laserpoints", "detectpoints")
    setup = path.with_name("setup.mat")
    spots = []
    for name in names:
        with open_source(setup if setup.is_file() else path.with_name(f"{name}.mat")) as beside:
            spots.append(beside.matlab_places(name))
    return spots


def _one_direction(signal: NDArray, shape: tuple[int, ...]) -> NDArray:
    """Return (pairs, t) records with every other line of the (n, m) pairs turned round."""
    lines = signal.reshape(*shape, -1).copy()
    lines[1::2] = lines[1::2, ::-1]
    return lines.reshape(len(signal), -1)
