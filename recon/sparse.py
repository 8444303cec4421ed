"""Histograms of few photons: the bins that hold any, and Fourier sums over these alone.

A position that is measured for 50 us has ten photons in a thousand bins. Adding up a row of exp(-i omega t)
for each of them takes a hundredth of the matrix product over all bins (`recon.spectrum`).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.capture import Capture, Histograms
from recon.sampling import DepthBlock
from recon.window import Window


@dataclass(frozen=True)
class Photons:
    """Counts of P positions, those of a position one after the other.

    Attributes
    ----------
    offset
        (P + 1,) int64 where each position's begin, and the total.
    bins
        (n,) int32 bin of each.
    counts
        (n,) float32 how many photons; the same bin may come again.
    """

    offset: NDArray[np.int64]
    bins: NDArray[np.int32]
    counts: NDArray[np.float32]


def sparse(histograms: Histograms, bins: slice = slice(None)) -> Photons:
    """Read histograms, and keep the bins that hold photons; others than these bins are left out."""
    first = bins.start or 0
    found, counts, per_position = [], [], [np.zeros(1, np.int64)]
    for _, block in histograms.blocks(bins):
        row, column = np.nonzero(block)
        found.append((column + first).astype(np.int32))
        counts.append(block[row, column].astype(np.float32))
        per_position.append(np.bincount(row, minlength=len(block)))
    return Photons(np.cumsum(np.concatenate(per_position)), np.concatenate(found), np.concatenate(counts))


class SparseTransform:
    """Fourier sums of one depth block, added up where positions share a place.

    Parameters
    ----------
    capture
        Geometry and time axis; its histograms are not read.
    part
        Bins, frequencies and their weights g(omega).
    window
        Soft edges.
    place
        (P,) place of each position among `places`.
    places
        How many there are.
    """

    def __init__(
        self, capture: Capture, part: DepthBlock, window: Window, place: NDArray[np.intp], places: int
    ) -> None:
        self._bins, self._place, self._places = part.bins, place, places
        band, numbers = part.band, np.arange(part.bins.start, part.bins.stop)
        centres_s = (numbers + 0.5) * capture.bin_width_s
        end = window.end_weights(capture.bins, capture.bin_width_s)[part.bins]
        waves = np.exp(-1j * np.multiply.outer(centres_s, band.frequencies_rad_per_s))
        self._table = (waves * band.weights * end[:, None]).astype(np.complex64)
        self._begins_s = np.ascontiguousarray(np.broadcast_to(capture.first_bin_s, capture.positions))
        start_s = -np.inf if window.start_s is None else window.start_s
        self._edge = capture.bin_width_s, start_s, max(window.rise_s, 1e-15)
        self._band = band.first_rad_per_s, band.step_rad_per_s

    def sums(self, photons: Photons) -> NDArray[np.complex64]:
        """Return g(omega) H^(omega) at each place, (places, F) complex64."""
        sums = np.zeros((self._places, self._table.shape[1]), np.complex64)
        seen = photons.offset, photons.bins, photons.counts
        _add(seen, self._bins.start, self._table, self._begins_s, self._band, self._edge, self._place, sums)
        return sums


@njit(nogil=True, cache=True, fastmath=True)
def _add(seen, first, table, begins_s, band, edge, place, sums):  # type: ignore[no-untyped-def]
    """Add up the rows of `table` that a position's photons point to, and turn their sum by its begin."""
    offset, bins, counts = seen
    many = table.shape[1]
    line = np.empty(many, np.complex64)
    width_s, start_s, rise_s = edge
    for p in range(len(offset) - 1):
        begin_s, some = begins_s[p], False
        for n in range(offset[p], offset[p + 1]):
            b = bins[n] - first
            if b < 0 or b >= len(table):
                continue
            weight = counts[n]
            since = (begin_s + (bins[n] + 0.5) * width_s - start_s) / rise_s
            if since < 1.0:
                if since <= 0.0:
                    continue
                weight *= np.float32(0.5 - 0.5 * np.cos(np.pi * since))
            if not some:
                line[:] = 0
                some = True
            for f in range(many):
                line[f] += weight * table[b, f]
        if not some:
            continue
        angle, turn = -band[0] * begin_s, -band[1] * begin_s
        re, im, c, s = np.cos(angle), np.sin(angle), np.cos(turn), np.sin(turn)
        target = sums[place[p]]
        for f in range(many):
            target[f] += line[f] * complex(np.float32(re), np.float32(im))
            re, im = re * c - im * s, re * s + im * c
