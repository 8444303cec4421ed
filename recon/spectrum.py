"""Fourier sums of the histograms at the few frequencies that the pulse needs.

H^(p, omega) = sum_n H[p, n] exp(-i omega t_n), with t_n the rectified time of the centre of bin n. For some
tens of frequencies this is a real matrix product, counts times [cos, -sin], at the speed of sgemm; the time
of the first bin, which may differ between positions, is a phase on its result.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil, sqrt

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture, Positions
from recon.sampling import DepthBlock
from recon.wave import Band
from recon.window import Edges, Window

#: Takes a capture, depth blocks, a window, what is told of progress, and a type; as `spectra`.
Spectra = Callable[
    [Capture, Sequence[DepthBlock], Window, Callable[[float], None] | None, DTypeLike],
    list[NDArray[np.complexfloating]],
]

#: Positions and their counts.
Block = tuple[slice, NDArray]


def spectra(
    capture: Capture,
    depth_blocks: Sequence[DepthBlock],
    window: Window,
    progress: Callable[[float], None] | None = None,
    dtype: DTypeLike = np.complex64,
) -> list[NDArray[np.complexfloating]]:
    """Take the spectra of all positions, for every depth block, in one pass over the record.

    Parameters
    ----------
    capture
        Histograms, read in blocks; only the bins that some depth block needs are asked for.
    depth_blocks
        Bins and frequencies.
    window
        Soft edges.
    progress
        Called with the fraction that is done.
    dtype
        complex64, or complex128 for reference.

    Returns
    -------
    list of ndarray
        (F, P) of `dtype` for each depth block; (0, P) for one that the record does not reach.

    Examples
    --------
    The photons of one position, all in one bin, have the same magnitude at all frequencies:

    >>> import numpy as np, recon
    >>> from recon.sampling import depth_blocks
    >>> from recon.spectrum import spectra
    >>> counts = np.zeros((1, 600))
    >>> counts[0, 340] = 5
    >>> spots_m = np.zeros((1, 3))
    >>> capture = recon.Capture(recon.ArrayHistograms(counts), 20e-12, np.zeros(1), spots_m, spots_m)
    >>> grid = recon.VoxelGrid.from_spec(0.2, 0.2, 0.1, (0.95, 1.05, 0.05))
    >>> blocks = depth_blocks(capture, recon.VirtualPulse(0.1), grid)
    >>> (of_block,) = spectra(capture, blocks, recon.Window())
    >>> sorted({float(one) for one in np.abs(of_block).round(3).ravel()})
    [5.0]
    """
    transform = Transform(capture, depth_blocks, window, dtype)
    if transform.bins.stop == transform.bins.start:
        return transform.spectra
    for positions, counts in ahead(capture.histograms.blocks(transform.bins)):
        transform.add(positions, counts)
        if progress:
            progress(positions.stop / capture.positions)
    return transform.spectra


def ahead(blocks: Iterator[Block]) -> Iterator[Block]:
    """Yield the same, each read in a thread while the one before is worked at."""
    with ThreadPoolExecutor(1) as thread:
        following = thread.submit(next, blocks, None)
        while (block := following.result()) is not None:
            following = thread.submit(next, blocks, None)
            yield block


class Transform:
    """Adds positions to spectra, in any order and any number at once; what comes twice is added up.

    Parameters
    ----------
    capture
        Geometry and time axis; its histograms are not read.
    depth_blocks, window, dtype
        As of `spectra`.

    Attributes
    ----------
    bins
        Bins that are needed; empty where no depth block is reached.
    spectra
        (F, P) for each depth block, (0, P) for one that the record does not reach; zero for positions that
        were not added yet.
    """

    def __init__(
        self,
        capture: Capture,
        depth_blocks: Sequence[DepthBlock],
        window: Window,
        dtype: DTypeLike = np.complex64,
    ) -> None:
        self._capture, self._dtype = capture, dtype
        self.spectra: list[NDArray[np.complexfloating]] = [
            np.zeros((part.reached * len(part.band), capture.positions), dtype) for part in depth_blocks
        ]
        self._families = _families(depth_blocks)
        first = min((one.edges[0] for one in self._families), default=0)
        self.bins = slice(first, max((one.edges[-1] for one in self._families), default=first))
        self._matrices = [_fourier_matrix(one, capture.bin_width_s, dtype) for one in self._families]
        self._edges = Edges(capture, window, self.bins, np.empty(0, dtype).real.dtype)

    def add(self, positions: Positions, counts: NDArray) -> None:
        """Add the counts of some positions, each of them once.

        Parameters
        ----------
        positions
            Which.
        counts
            (block, bins) of `bins`; they may be reused afterwards.
        """
        soft = self._edges.soften(positions, counts)
        begins_s = self._capture.begins_s(positions)
        for family, matrix in zip(self._families, self._matrices, strict=True):
            phases = self._phases(family, begins_s)
            for number, sums in family.sums(soft, matrix, self.bins.start):
                self.spectra[number][:, positions] += sums.view(self._dtype).T * phases

    def add_photons(
        self, positions: NDArray[np.intp], offset: NDArray[np.integer], photon_bins: NDArray[np.integer]
    ) -> None:
        """Add photons one by one: the quicker way where most bins are empty.

        Parameters
        ----------
        positions
            (n,) which; they may come more than once.
        offset
            (n + 1,) where the photons of each begin, and the end.
        photon_bins
            (photons,) the bin of each, in the whole record.
        """
        wanted, row_of = np.unique(positions, return_inverse=True)
        row = np.repeat(row_of, np.diff(offset))
        inside = (photon_bins >= self.bins.start) & (photon_bins < self.bins.stop)
        row, bins = row[inside], photon_bins[inside].astype(np.intp)
        weight = self._edges.weights(wanted[row], bins)
        begins_s = self._capture.begins_s(wanted)
        for family, matrix in zip(self._families, self._matrices, strict=True):
            phases = self._phases(family, begins_s)
            for number, sums in family.sums_of_photons(len(wanted), row, bins, weight, matrix):
                self.spectra[number][:, wanted] += sums.view(self._dtype).T * phases

    def _phases(self, family: "_Family", begins_s: NDArray[np.float64]) -> NDArray[np.complexfloating]:
        """(F, positions) what the time of the first bin does to a sum.

        Exponentials are slow: those of every few frequencies are multiplied by those of the steps between.
        """
        band = family.band
        few = ceil(sqrt(len(band)))
        steps_rad_per_s = band.step_rad_per_s * np.arange(few)
        coarse = np.exp(-1j * np.multiply.outer(band.first_rad_per_s + few * steps_rad_per_s, begins_s))
        fine = np.exp(-1j * np.multiply.outer(steps_rad_per_s, begins_s))
        return (coarse[:, None] * fine).reshape(few * few, -1)[: len(band)].astype(self._dtype)


@dataclass(frozen=True)
class _Family:
    """Depth blocks that have the same frequencies: what bins they share is summed once.

    Attributes
    ----------
    band
        The frequencies.
    members
        Numbers of the depth blocks, and the bins of each.
    edges
        Ascending bins at which any member begins or ends.
    """

    band: Band
    members: dict[int, slice]

    @cached_property
    def edges(self) -> list[int]:
        return sorted({edge for bins in self.members.values() for edge in (bins.start, bins.stop)})

    def sums(
        self, counts: NDArray[np.floating], matrix: NDArray[np.floating], first: int
    ) -> Iterator[tuple[int, NDArray[np.floating]]]:
        """Yield each member's number and sum over its bins, (block, 2 F); `counts` begin at bin `first`."""
        pieces = {
            edge: counts[:, edge - first : end - first] @ matrix[edge - self.edges[0] : end - self.edges[0]]
            for edge, end in pairwise(self.edges)
        }
        yield from self._of_members(pieces)

    def sums_of_photons(
        self,
        rows: int,
        row: NDArray[np.intp],
        bins: NDArray[np.intp],
        weight: NDArray[np.floating],
        matrix: NDArray[np.floating],
    ) -> Iterator[tuple[int, NDArray[np.floating]]]:
        """As `sums`, from the row, the bin and the weight of each photon."""
        from recon.photon_sums import sum_photons

        starts = np.array(self.edges)
        piece = np.searchsorted(starts, np.arange(starts[0], starts[-1]), side="right") - 1
        summed = np.zeros((len(starts) - 1, rows, matrix.shape[1]), matrix.dtype)
        sum_photons(row, bins - starts[0], weight, piece, matrix, summed)
        yield from self._of_members(dict(zip(self.edges, summed, strict=False)))

    def _of_members(
        self, pieces: dict[int, NDArray[np.floating]]
    ) -> Iterator[tuple[int, NDArray[np.floating]]]:
        """Put the sums between neighbouring edges together to those of the members' bins."""
        for number, bins in self.members.items():
            total, *others = (piece for edge, piece in pieces.items() if bins.start <= edge < bins.stop)
            yield number, sum(others, total)


def _families(depth_blocks: Sequence[DepthBlock]) -> list[_Family]:
    """Put the depth blocks that the record reaches together by their frequencies."""
    found: dict[tuple[float, float, int], _Family] = {}
    for number, part in enumerate(depth_blocks):
        if part.reached:
            key = part.band.first_rad_per_s, part.band.step_rad_per_s, len(part.band)
            found.setdefault(key, _Family(part.band, {})).members[number] = part.bins
    return list(found.values())


def widths(depth_blocks: Sequence[DepthBlock]) -> list[tuple[int, int]]:
    """Return how many bins are multiplied with how many frequencies, for each sum over a record."""
    return [(one.edges[-1] - one.edges[0], len(one.band)) for one in _families(depth_blocks)]


def _fourier_matrix(family: _Family, bin_width_s: float, dtype: DTypeLike) -> NDArray[np.floating]:
    """(bins, 2 F): real and imaginary part of exp(-i omega t) in turn, t counted from the record's start."""
    centres_s = (np.arange(family.edges[0], family.edges[-1]) + 0.5) * bin_width_s
    factors = np.exp(-1j * np.multiply.outer(centres_s, family.band.frequencies_rad_per_s))
    return factors.astype(dtype).view(np.empty(0, dtype).real.dtype)
