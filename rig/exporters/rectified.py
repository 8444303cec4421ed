"""Transients on one time axis for all positions, which begins when the pulse is on the wall."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture, Histograms
from rig.errors import UsageError

#: Shifts within this part of a bin of a whole number of bins are whole: rounding of doubles alone.
_WHOLE = 1e-6


@dataclass(frozen=True)
class RectifiedHistograms:
    """Histograms shifted so that bin 0 of each begins when the pulse is on the wall.

    A shift is seldom a whole number of bins. Then each bin is shared between the two that it overlaps, by the
    overlap: a position keeps its total and its mean time, and a peak is up to one bin wider. What came before
    the pulse was on the wall is left out.

    Attributes
    ----------
    held
        The histograms as they are.
    shift
        (P,) bins by which each is to be moved to later times; negative where time includes legs.
    """

    held: Histograms
    shift: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        positions, bins = self.held.shape
        return positions, max(1, bins + int(np.ceil(self.shift.max() - _WHOLE)))

    @property
    def whole(self) -> bool:
        """Whether all shifts are whole bins, so that counts stay whole numbers."""
        return bool((np.abs(self.shift - np.rint(self.shift)) < _WHOLE).all())

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order, each position once."""
        whole = np.floor(self.shift + _WHOLE).astype(int)
        part = np.maximum(self.shift - whole, 0.0)
        part[part < _WHOLE] = 0.0
        for block, counts in self.held.blocks():
            dtype = counts.dtype if self.whole else np.float32
            moved = np.zeros((len(counts), self.shape[1]), dtype)
            for row, (k, f) in enumerate(zip(whole[block], part[block], strict=True)):
                if f:
                    _add(moved[row], counts[row] * np.float32(1 - f), k)
                    _add(moved[row], counts[row] * np.float32(f), k + 1)
                else:
                    _add(moved[row], counts[row], k)
            yield block, moved[:, bins]


def _add(row: NDArray, counts: NDArray, first: int) -> None:
    """Add counts to a row from a bin on, as far as they fall into it."""
    low, high = max(first, 0), min(first + len(counts), len(row))
    if low < high:
        row[low:high] += counts[low - first : high - first]


def rectified(capture: Capture) -> Capture:
    """Return the capture on one time axis that begins when the pulse is on the wall.

    Raises
    ------
    UsageError
        If all records end before that.
    """
    first_bin_s = np.broadcast_to(capture.first_bin_s, (capture.positions,))
    if first_bin_s.max() + capture.bins * capture.bin_width_s <= 0:
        raise UsageError(
            "all records end before the pulse is on the wall, so nothing is left in rectified time; "
            "check the scan's delays"
        )
    histograms = RectifiedHistograms(capture.histograms, first_bin_s / capture.bin_width_s)
    return replace(capture, histograms=histograms, first_bin_s=np.zeros(1))
