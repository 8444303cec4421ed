"""The part of a record that estimates are read off: few positions, coarse bins, hidden light alone."""

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.aperture import recognise
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError
from recon.estimate.value import EstimateError

#: Most positions that are imaged: as many as a wall of 64 x 64 has.
MOST_POSITIONS = 4096
#: Profiles are smoothed by this part of a record, and light is what is above this part of its peak.
SMOOTHED, ABOVE = 1 / 200, 0.1
#: The part of a profile's bins that is taken as dark.
DARK = 0.2


@dataclass(frozen=True)
class Profile:
    """The sum of all records on one time axis.

    Attributes
    ----------
    total
        (bins,) counts.
    first_bin_s, bin_width_s
        Left edge of bin 0, and the width of a bin.
    peaks_s
        (P,) centre of each record's largest bin.
    confocal
        Whether each position is lit and seen at the same spot.
    """

    total: NDArray[np.float64]
    first_bin_s: float
    bin_width_s: float
    peaks_s: NDArray[np.float64]
    confocal: bool

    def hidden_s(self, fade_from_s: float | None = None) -> tuple[float, float]:
        """Return when light of hidden objects begins and ends; before `fade_from_s` there is none.

        Raises
        ------
        EstimateError
            If nothing stands above the record's dark part.
        """
        total = self.total.copy()
        if fade_from_s is not None:
            total[: max(0, ceil((fade_from_s - self.first_bin_s) / self.bin_width_s))] = 0
        above = gaussian_filter1d(total, max(1.0, len(total) * SMOOTHED))
        above = above - np.quantile(above, DARK)
        lit = np.flatnonzero(above > ABOVE * above.max())
        if len(lit) == 0:
            raise EstimateError(
                "estimate", "light of hidden objects", "the record is dark", "Record for longer."
            )
        begin, end = (self.first_bin_s + float(edge) * self.bin_width_s for edge in (lit[0], lit[-1] + 1))
        return begin, end


def profile(capture: Capture) -> Profile:
    """Add all records up, each moved by whole bins onto one time axis, in one pass."""
    first_s = np.broadcast_to(capture.first_bin_s, capture.positions)
    moves = np.rint((first_s - first_s.min()) / capture.bin_width_s).astype(int)
    total = np.zeros(capture.bins + moves.max())
    peaks_s = np.empty(capture.positions)
    for block, counts in capture.histograms.blocks():
        peaks_s[block] = first_s[block] + (counts.argmax(axis=1) + 0.5) * capture.bin_width_s
        for move in np.unique(moves[block]):
            total[move : move + capture.bins] += counts[moves[block] == move].sum(axis=0, dtype=float)
    return Profile(total, float(first_s.min()), capture.bin_width_s, peaks_s, capture.confocal)


def thinned(capture: Capture, merge: int, fade_from_s: float | None) -> Capture:
    """Return few positions with coarse bins, in memory; bins before `fade_from_s` are dark.

    Parameters
    ----------
    capture
        The record.
    merge
        Bins that become one; what is left over at the end is dropped.
    fade_from_s
        Time before which the record holds the wall's own light.
    """
    kept = _kept(capture.laser_m)
    bins = capture.bins // merge
    counts = np.empty((len(kept), bins), np.float32)
    first_s = np.broadcast_to(capture.first_bin_s, capture.positions)
    begin = (
        np.zeros(capture.positions) if fade_from_s is None else (fade_from_s - first_s) / capture.bin_width_s
    )
    for block, given in capture.histograms.blocks(slice(0, bins * merge)):
        wanted = kept[(kept >= block.start) & (kept < block.stop)]
        rows = np.where(np.arange(bins * merge) < begin[wanted, None], 0, given[wanted - block.start])
        where = np.searchsorted(kept, wanted)
        counts[where] = rows.reshape(len(wanted), bins, merge).sum(axis=2)
    return replace(
        capture,
        histograms=ArrayHistograms(counts),
        bin_width_s=capture.bin_width_s * merge,
        first_bin_s=capture.first_bin_s if len(capture.first_bin_s) == 1 else capture.first_bin_s[kept],
        laser_m=capture.laser_m[kept],
        detector_m=capture.detector_m if len(capture.detector_m) == 1 else capture.detector_m[kept],
    )


def _kept(laser_m: NDArray[np.float64]) -> NDArray[np.intp]:
    """Choose positions: every n-th line of a lattice both ways, or every n-th of scattered ones."""
    if len(laser_m) <= MOST_POSITIONS:
        return np.arange(len(laser_m))
    stride = int(np.ceil(np.sqrt(len(laser_m) / MOST_POSITIONS)))
    try:
        lattice = recognise(laser_m)
    except GeometryError:
        return np.arange(0, len(laser_m), stride**2)
    return np.flatnonzero((lattice.column % stride == 0) & (lattice.row % stride == 0))
