"""A coarse copy of a capture, small enough to be kept: for pictures while parameters are tried.

Neighbouring positions are put together in square cells (`recon.glance`), and neighbouring bins in wider
ones. A wave of length lambda bears cells of half of it, a quarter where laser and detector move together, and
bins of an eighth of it in path: the latter damp it by sinc(1/8), 3 %.
"""

from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from recon import defaults
from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.glance import MOST_CELLS, Cells

#: Bins in a wavelength, as path.
BINS_PER_WAVELENGTH = 8
#: Most bytes of a copy; of more positions the bins are wider, and so is the shortest wavelength.
MOST_BYTES = 2**26


@dataclass(frozen=True)
class Coarse:
    """A capture in cells.

    Attributes
    ----------
    capture
        Of the cells; its histograms are in memory.
    side_m
        Of a cell.
    shortest_m
        The shortest wavelength that it bears.
    """

    capture: Capture
    side_m: float
    shortest_m: float

    @property
    def counts(self) -> NDArray:
        """(cells, bins) counts."""
        histograms = self.capture.histograms
        assert isinstance(histograms, ArrayHistograms)
        return histograms.counts


def coarse(capture: Capture) -> Coarse:
    """Read a capture once, and add its neighbours up.

    Parameters
    ----------
    capture
        Of any positions; with the side that focuses as its laser spots (`Capture.by_its_finer_aperture`).
    """
    spacing_m = defaults.spacing_m(capture)
    wide_m = float(np.ptp(capture.laser_m, axis=0).max())
    side_m = max(1, ceil(wide_m / spacing_m / MOST_CELLS)) * spacing_m
    shortest_m = (4 if capture.confocal else 2) * side_m
    cells = _cells(capture, side_m)
    group = max(1, floor(shortest_m / BINS_PER_WAVELENGTH / C_M_PER_S / capture.bin_width_s))
    least = ceil(4 * cells.capture.positions * capture.bins / MOST_BYTES)
    if least > group:
        group = least
        shortest_m = BINS_PER_WAVELENGTH * C_M_PER_S * group * capture.bin_width_s
    counts = _added_up(capture, cells, group)
    return Coarse(
        replace(cells.capture, histograms=ArrayHistograms(counts), bin_width_s=capture.bin_width_s * group),
        side_m,
        shortest_m,
    )


def _cells(capture: Capture, side_m: float) -> Cells:
    """Put positions together; where laser and detector move together, both are in the middle of the cell."""
    if not capture.confocal:
        return Cells.of(capture, side_m)
    cells = Cells.of(replace(capture, detector_m=capture.detector_m[:1]), side_m)
    return replace(cells, capture=replace(cells.capture, detector_m=cells.capture.laser_m))


def _added_up(capture: Capture, cells: Cells, group: int) -> NDArray:
    """(cells, bins) counts of the positions of each cell, each by its own lateness, in groups of bins."""
    bins = ceil(capture.bins / group)
    whole = True
    total = np.zeros((cells.capture.positions, bins), np.float32)
    for positions, counts in capture.histograms.blocks():
        whole &= bool(np.issubdtype(counts.dtype, np.integer))
        later, cell = cells.later_bins[positions], cells.of_position[positions]
        for shift in np.unique(later).tolist():
            rows = np.flatnonzero(later == shift)
            place = (np.arange(capture.bins) + shift) // group
            starts = np.flatnonzero(np.diff(place, prepend=place[0] - 1))
            summed = np.add.reduceat(counts[rows], starts, axis=1)
            inside = (place[starts] >= 0) & (place[starts] < bins)
            if not inside.any():
                continue
            first = int(place[starts][inside][0])
            np.add.at(
                total[:, first : first + int(inside.sum())], cell[rows], summed[:, inside].astype(np.float32)
            )
    if not whole:
        return total
    # photons: exact, since no cell of a scan has 2^24 in a bin, and half the size
    return total.astype(np.uint16 if total.max(initial=0) < 2**16 else np.uint32)
