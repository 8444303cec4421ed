"""Histograms mixed down to baseband: a few hundred cells in place of thousands of bins.

Of a record only the frequencies of a pulse are needed, a band of half-width B around a carrier omega_c. A
count at t is spread over the W cells around it, T_m apart by less than pi/B, by a Kaiser-Bessel window phi
that the carrier turns:

    y_m = sum_n H[n] phi((t_n - T_m)/dT) exp(-i omega_c (t_n - T_m)),
    H^(omega) = sum_m y_m exp(-i omega T_m) / phi^(omega - omega_c),

with phi^ the window's Fourier transform (the non-uniform FFT; Beatty, Nishimura and Pauly 2005, IEEE Trans.
Med. Imaging 24, 799, for the window and its parameter). Its error is exp(-pi W sqrt(1 - 1/s)) of the sum of
counts, where cells are s times as dense as the band needs. Cells are few, so that the sums over them, which
are a matrix product, take little for any number of frequencies and depth blocks. The spreading is a product,
too, for each stretch of bins: it meets few cells, and whether bins hold photons need not be asked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, pi

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import pieces
from recon.wave import Band

#: Cells that a count is spread over, and how many times as dense as the band needs cells are: an error of
#: 1e-7 in single precision, and of 4e-16 in double.
SINGLE, DOUBLE = (8, 1.7), (16, 2.0)
#: Bins of a stretch that is spread by one product, at least and at most: of a short one the call costs more
#: than the product, and of a long one most of the table is zeros.
STRETCH = (16, 128)


@dataclass(frozen=True)
class Cells:
    """The cells of some positions.

    Attributes
    ----------
    all
        (positions, cells) complex: of all bins.
    before
        (edges, positions, W) complex: what bins before each edge put into the W cells from its first on.
    """

    all: NDArray[np.complexfloating]
    before: NDArray[np.complexfloating]

    def joined(self, others: Sequence["Cells"]) -> "Cells":
        """Return these and others as one."""
        if not others:
            return self
        return Cells(
            np.concatenate([self.all, *(one.all for one in others)]),
            np.concatenate([self.before, *(one.before for one in others)], axis=1),
        )


@dataclass(frozen=True)
class _Stretch:
    """Some bins in a row, and what they put into the cells that they meet.

    Attributes
    ----------
    bins, cells
        Which; of a cell, real and imaginary part in turn.
    table
        (bins, cells).
    """

    bins: slice
    cells: slice
    table: NDArray[np.floating]

    @classmethod
    def of(cls, bins: slice, parts: NDArray[np.floating], first: NDArray[np.intp]) -> "_Stretch":
        """Make it of the (all bins, 2 W) parts that every bin puts into its own W cells."""
        many, width = bins.stop - bins.start, parts.shape[1]
        begin = 2 * int(first[bins.start])
        at = 2 * first[bins] - begin
        table = np.zeros((many, int(at[-1]) + width), parts.dtype)
        table[np.arange(many)[:, None], at[:, None] + np.arange(width)] = parts[bins]
        return cls(bins, slice(begin, begin + table.shape[1]), table)


class Mixer:
    """Mixes histograms down, and takes their spectra over runs of bins.

    Parameters
    ----------
    bands
        All frequencies that are wanted.
    weights
        (bins,) by which counts are multiplied.
    edges
        Ascending bins at which runs may begin or end, from 0 to the number of bins.
    bin_width_s
        Width of a bin.
    dtype
        complex64, or complex128 for reference.
    """

    def __init__(
        self,
        bands: Sequence[Band],
        weights: NDArray[np.floating],
        edges: Sequence[int],
        bin_width_s: float,
        dtype: DTypeLike,
    ) -> None:
        self._dtype = np.dtype(dtype)
        self._taps, dense = SINGLE if self._dtype == np.complex64 else DOUBLE
        lowest, highest = _limits(bands)
        self._carrier = (lowest + highest) / 2
        times_s = (np.arange(len(weights) + 1) + 0.5) * bin_width_s
        self._cell_s = min(float(times_s[-1]), _spacing_s(bands, dense))
        self._beta = pi * np.sqrt((self._taps / dense * (dense - 0.5)) ** 2 - 0.8)
        at = times_s / self._cell_s
        first = np.floor(at - self._taps / 2).astype(np.intp) + 1
        self._first, self._from = first - first[0], int(first[0])
        since = at[:-1, None] - (first[:-1, None] + np.arange(self._taps))  # of each cell, in cells
        turned = np.exp(-1j * self._carrier * self._cell_s * since)
        self._table = (self._window(since) * turned * weights[:, None]).astype(self._dtype)
        self._edges = np.array(edges)
        self._edge_of = {edge: number for number, edge in enumerate(edges)}

    def counts(self, counts: NDArray, fade: NDArray[np.floating]) -> Cells:
        """Mix down (positions, bins) counts, the first bins multiplied by (positions or 1, some) `fade`."""
        cells = self._empty(len(counts))
        spread, before = self._views(cells)
        fade = np.broadcast_to(fade, (len(counts), fade.shape[1]))
        for some in pieces(*counts.shape):
            faded = counts[some].astype(spread.dtype)
            faded[:, : fade.shape[1]] *= fade[some]
            self._spread(faded, spread[some], before[:, some])
        return cells

    def _spread(self, counts: NDArray, spread: NDArray[np.floating], before: NDArray[np.floating]) -> None:
        """Add counts to their cells, in order of bins; copy cells at the edges as they pass."""
        for stretch in self._stretches:
            spread[:, stretch.cells] += counts[:, stretch.bins] @ stretch.table
            edge = self._edge_of.get(stretch.bins.stop)
            if edge is not None:
                at = 2 * self._first[stretch.bins.stop]
                before[edge] = spread[:, at : at + 2 * self._taps]

    def photons(
        self,
        positions: int,
        row: NDArray[np.intp],
        bins: NDArray[np.intp],
        weight: NDArray[np.floating],
    ) -> Cells:
        """Mix down photons, each in the row of its position, its bin, and with a weight of its own."""
        from recon.baseband_kernels import mix_photons

        cells = self._empty(positions)
        following = np.searchsorted(self._edges, np.arange(len(self._table)), side="right")
        photons, table = (row, bins, weight.astype(self._table.real.dtype)), self._parts(self._table)
        mix_photons(photons, self._first, table, self._edges, following, *self._views(cells))
        return cells

    @cached_property
    def _stretches(self) -> list["_Stretch"]:
        """All bins, cut at the edges and where they meet more cells than a window has twice."""
        bins, parts = len(self._table), self._parts(self._table)
        per_bin = self._first[-1] / bins
        long = int(np.clip(self._taps / per_bin if per_bin else inf, *STRETCH))
        cuts = sorted({*range(0, bins, long), *self._edge_of})
        return [_Stretch.of(slice(*ends), parts, self._first) for ends in pairwise(cuts)]

    def spectrum(self, cells: Cells, run: slice, matrix: NDArray[np.complexfloating]) -> NDArray:
        """Return (F, positions) sums over a run of bins, its matrix from `matrix`."""
        start, stop = self._edge_of[run.start], self._edge_of[run.stop]
        first, last, taps = self._first[run.start], self._first[run.stop], self._taps
        inside = matrix[:, : last - first] @ cells.all[:, first:last].T
        ends = np.concatenate([cells.before[stop], -cells.before[start]], axis=1)
        at_ends = np.concatenate([matrix[:, last - first :], matrix[:, :taps]], axis=1)
        return inside + at_ends @ ends.T

    def matrix(self, band: Band, run: slice, begin_s: float) -> NDArray[np.complexfloating]:
        """Return (F, cells) that turns the cells of a run of bins into its spectrum; bin 0 begins then."""
        omega = band.frequencies_rad_per_s
        first, last = int(self._first[run.start]), int(self._first[run.stop])
        cell_times_s = begin_s + (self._from + np.arange(first, last + self._taps)) * self._cell_s
        turned = np.exp(-1j * np.multiply.outer(omega, cell_times_s))
        return (turned / self._transform(omega)[:, None]).astype(self._dtype)

    def _empty(self, positions: int) -> Cells:
        many = int(self._first[-1]) + self._taps
        return Cells(
            np.zeros((positions, many), self._dtype),
            np.zeros((len(self._edges), positions, self._taps), self._dtype),
        )

    def _views(self, cells: Cells) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        return self._parts(cells.all), self._parts(cells.before)

    @staticmethod
    def _parts(values: NDArray[np.complexfloating]) -> NDArray[np.floating]:
        """Return real and imaginary parts in turn along the last axis, in place."""
        return values.view(values.real.dtype)

    def _window(self, since: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.maximum(1 - (2 * since / self._taps) ** 2, 0)
        return np.i0(self._beta * np.sqrt(inside)) / np.i0(self._beta)

    def _transform(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the window's Fourier transform, its argument in cells."""
        phase = (omega - self._carrier) * self._cell_s * self._taps / 2
        root = np.sqrt(self._beta**2 - phase**2)
        return self._taps * np.sinh(root) / (root * np.i0(self._beta))


def products(bands: Sequence[Band], durations_s: Sequence[float]) -> float:
    """Return how many cells times frequencies the spectra of runs take that last so long, a band for each."""
    taps, dense = SINGLE
    spacing_s = _spacing_s(bands, dense)
    runs = zip(bands, durations_s, strict=True)
    return sum(len(band) * (duration_s / spacing_s + 2 * taps) for band, duration_s in runs)


def _limits(bands: Sequence[Band]) -> tuple[float, float]:
    """Return the lowest and the highest frequency."""
    return min(band.first_rad_per_s for band in bands), max(band.last_rad_per_s for band in bands)


def _spacing_s(bands: Sequence[Band], dense: float) -> float:
    """Return how far apart cells may be; a single frequency leaves that open."""
    lowest, highest = _limits(bands)
    return 2 * pi / (highest - lowest) / dense if highest > lowest else inf
