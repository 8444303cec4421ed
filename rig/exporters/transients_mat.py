"""MATLAB v5 of transients: ``counts`` (positions, bins), places in metres, rectified time in seconds."""

from pathlib import Path

import numpy as np

from recon.capture import Capture
from rig.exporters.mat import refuse_larger, save
from rig.exporters.rectified import RectifiedHistograms, rectified
from rig.files import ScanFile

NAME = "MATLAB v5"
ENDINGS = (".mat",)


def write(path: Path, scan: ScanFile, rectify: bool = False) -> None:
    """Write the file: measured positions only.

    ``first_bin_s`` is the left edge of bin 0 in rectified time, one number, or one for each position where
    the scan's time includes the legs; 0 where ``rectify`` asks for one time axis that begins when the pulse
    is on the wall.

    Raises
    ------
    UsageError
        If there are more counts than the layout can hold.
    """
    capture = rectified(scan.capture()) if rectify else scan.capture()
    fractions = isinstance(capture.histograms, RectifiedHistograms) and not capture.histograms.whole
    save(
        path,
        {
            "counts": _counts(path, capture, np.dtype("f4" if scan.expectation or fractions else "u4")),
            "laser_m": capture.laser_m,
            "detector_m": capture.detector_m,
            "bin_width_s": capture.bin_width_s,
            "first_bin_s": capture.first_bin_s[:, None],
        },
    )


def _counts(path: Path, capture: Capture, dtype: np.dtype) -> np.ndarray:
    refuse_larger(path, "counts", capture.positions * capture.bins * dtype.itemsize)
    counts = np.empty((capture.positions, capture.bins), dtype)
    for block, rows in capture.histograms.blocks():
        counts[block] = rows
    return counts
