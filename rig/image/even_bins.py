"""Counts divided by the real widths of their bins."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isclose

import numpy as np
from numpy.typing import NDArray

from recon.capture import Histograms
from rig.errors import CalibrationError
from rig.model.calibrations.kinds import BinWidths
from rig.model.quantities import show


def corrected(
    histograms: Histograms, widths: BinWidths, *, bin_width_s: float, first_bin_s: float
) -> Histograms:
    """Return histograms as bins of one width would have counted them.

    Parameters
    ----------
    histograms
        As recorded.
    widths
        The instrument's bins.
    bin_width_s, first_bin_s
        Bins of the histograms, in recorded (not rectified) time.

    Returns
    -------
    Histograms
        float32, read in the same blocks; bins that were not measured stay as they are.

    Raises
    ------
    CalibrationError
        If the widths are those of other bins.
    """
    _refuse_others(widths, histograms.shape[1], bin_width_s, first_bin_s)
    return _Divided(histograms, widths.widths.astype(np.float32))


@dataclass(frozen=True)
class _Divided:
    histograms: Histograms
    widths: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return self.histograms.shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order."""
        for positions, counts in self.histograms.blocks(bins):
            yield positions, counts.astype(np.float32) / self.widths[bins]


def _refuse_others(widths: BinWidths, bins: int, bin_width_s: float, first_bin_s: float) -> None:
    """Widths belong to bins: others cannot be had from them, not even coarser ones that begin elsewhere."""
    same_width = isclose(widths.bin_width_s, bin_width_s, rel_tol=1e-6)
    same_start = isclose(widths.first_bin_s, first_bin_s, abs_tol=bin_width_s / 100)
    if same_width and same_start and len(widths.measured) == bins:
        return
    raise CalibrationError(
        f"the bin widths of {widths.created:%Y-%m-%d %H:%M} are those of {len(widths.measured)} bins of "
        f"{show(widths.bin_width_s, 's', 4)} from {show(widths.first_bin_s, 's', 5)} on; the scan has {bins} "
        f"of {show(bin_width_s, 's', 4)} from {show(first_bin_s, 's', 5)} on. Measure these with "
        "rig calibrate dnl, or leave the correction out"
    )
