"""Fourier sums of the histograms at the few frequencies that the pulse needs.

H^(p, omega) = sum_n H[p, n] exp(-i omega t_n), with t_n the rectified time of the centre of bin n. Histograms
are mixed down to baseband once for all frequencies (`recon.baseband`); the sums over what is left of them are
a matrix product for each depth block. The time of the first bin, which may differ between positions, is a
phase on its result.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import cached_property
from itertools import chain
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from threadpoolctl import threadpool_limits

from recon.capture import BLOCK_BYTES, BLOCK_POSITIONS, Capture, Positions
from recon.sampling import DepthBlock
from recon.window import Edges, Window

if TYPE_CHECKING:  # compiled, which not every solver needs
    from recon.baseband import Cells, Mixer

#: Takes a capture, depth blocks, a window, what is told of progress, and a type; as `spectra`.
Spectra = Callable[
    [Capture, Sequence[DepthBlock], Window, Callable[[float], None] | None, DTypeLike],
    list[NDArray[np.complexfloating]],
]

#: Positions whose cells are multiplied at once: fewer would have threads wait for one another more often.
TOGETHER = 512
#: Blocks that are made ahead, at most, as many as are read while memory is taken and compiled loops are
#: loaded; bytes of those that are read, and of those that are mixed down, unless a single one has more.
AHEAD, READ_BYTES, MIXED_BYTES = 12, 24 * 2**20, 4 * 2**20
#: Some positions, and their cells.
Mixed = tuple[NDArray[np.intp], "Cells"]
Item = TypeVar("Item")


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
    read = ahead(capture.histograms.blocks(transform.bins), lambda block: block[1].nbytes, READ_BYTES)
    mixed = (transform.mixed(*block) for block in read)
    with one_thread_each:
        for where, cells in _gathered(ahead(mixed, lambda block: block[1].all.nbytes, MIXED_BYTES)):
            transform.add_cells(where, cells)
            if progress:
                progress((int(where[-1]) + 1) / capture.positions)
    return transform.spectra


def blocks_bytes(positions: int, bins: int) -> int:
    """Return what blocks of a record take, as double precision at the most: in work, read and mixed ahead."""
    whole = 8 * positions * bins
    block = min(8 * BLOCK_POSITIONS * bins, max(2 * BLOCK_BYTES, 8 * bins))
    return min(whole, block + READ_BYTES) + min(whole, MIXED_BYTES)


class _OneThreadEach:
    """Lets matrix products take one thread: the other cores read, and small products wait for more threads.

    The limit is that of the whole process: the first who comes sets it, and the last who leaves lifts it.
    """

    def __init__(self) -> None:
        self._lock, self._users = Lock(), 0
        self._limits = ExitStack()

    def __enter__(self) -> None:
        with self._lock:
            if not self._users:
                self._limits.enter_context(threadpool_limits(limits=1, user_api="blas"))
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if not self._users:
                self._limits.close()


one_thread_each = _OneThreadEach()


def ahead(items: Iterator[Item], size: Callable[[Item], int], most_bytes: int) -> Iterator[Item]:
    """Yield the same, made ahead in a thread: `AHEAD` of them, or as many as have so many bytes."""
    with ThreadPoolExecutor(1) as thread:
        following = deque([thread.submit(next, items, None)])
        while (item := following.popleft().result()) is not None:
            many = max(1, min(AHEAD, most_bytes // max(1, size(item))))
            following.extend(thread.submit(next, items, None) for _ in range(many - len(following)))
            yield item


def _gathered(mixed: Iterator[Mixed]) -> Iterator[Mixed]:
    """Yield the cells of `TOGETHER` positions or more at once; at the end, of all that are left."""
    some: list[Mixed] = []
    for one in chain(mixed, [None]):
        if one:
            some.append(one)
        if some and (one is None or sum(len(where) for where, _ in some) >= TOGETHER):
            places, cells = zip(*some, strict=True)
            yield np.concatenate(places), cells[0].joined(cells[1:])
            some.clear()


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
    """

    def __init__(
        self,
        capture: Capture,
        depth_blocks: Sequence[DepthBlock],
        window: Window,
        dtype: DTypeLike = np.complex64,
    ) -> None:
        self._capture, self._depth_blocks, self._dtype = capture, depth_blocks, dtype
        self._reached = {number: part for number, part in enumerate(depth_blocks) if part.reached}
        first = min((part.bins.start for part in self._reached.values()), default=0)
        self.bins = slice(first, max((part.bins.stop for part in self._reached.values()), default=first))
        self._edges = Edges(capture, window, self.bins)

    @cached_property
    def spectra(self) -> list[NDArray[np.complexfloating]]:
        """(F, P) for each depth block, (0, P) for one that the record does not reach.

        Zero for positions that were not added yet. Memory is taken when it is first asked for, and written to
        at once: touched column by column it would take ten times as long.
        """
        many = self._capture.positions
        return [np.full((part.reached * len(part.band), many), 0, self._dtype) for part in self._depth_blocks]

    def add(self, positions: Positions, counts: NDArray) -> None:
        """Add the counts of some positions, each of them once.

        Parameters
        ----------
        positions
            Which.
        counts
            (block, bins) of `bins`; they may be reused afterwards.
        """
        self.add_cells(*self.mixed(positions, counts))

    def mixed(self, positions: Positions, counts: NDArray) -> Mixed:
        """Mix down the counts of some positions, as of `add`; nothing is added yet."""
        where = np.arange(self._capture.positions)[positions]
        return where, self._mixer.counts(counts, self._edges.start(where))

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
        where, row_of = np.unique(positions, return_inverse=True)
        row = np.repeat(row_of, np.diff(offset))
        inside = (photon_bins >= self.bins.start) & (photon_bins < self.bins.stop)
        row, bins = row[inside], photon_bins[inside].astype(np.intp)
        weight = self._edges.start_at(where[row], bins)
        self.add_cells(where, self._mixer.photons(len(where), row, bins - self.bins.start, weight))

    def add_cells(self, where: NDArray[np.intp], cells: "Cells") -> None:
        """Add the cells of some positions, each of them once, to the spectra of all depth blocks."""
        from recon.baseband_kernels import add_turned

        begins_s = np.broadcast_to(self._capture.begins_s(where), where.shape)
        for number, part in self._reached.items():
            sums = self._mixer.spectrum(cells, self._run(part), self._matrices[number])
            band = part.band
            add_turned(sums, begins_s, band.first_rad_per_s, band.step_rad_per_s, where, self.spectra[number])

    @cached_property
    def _mixer(self) -> "Mixer":
        from recon.baseband import Mixer

        runs = [self._run(part) for part in self._reached.values()]
        edges = sorted({0, *(edge for run in runs for edge in (run.start, run.stop))})
        bands = [part.band for part in self._reached.values()]
        return Mixer(bands, self._edges.end, edges, self._capture.bin_width_s, self._dtype)

    @cached_property
    def _matrices(self) -> dict[int, NDArray[np.complexfloating]]:
        """Of each depth block, with the time of the first bin that is needed."""
        begin_s = self.bins.start * self._capture.bin_width_s
        return {
            number: self._mixer.matrix(part.band, self._run(part), begin_s)
            for number, part in self._reached.items()
        }

    def _run(self, part: DepthBlock) -> slice:
        """Return the bins of a depth block, counted from the first that is needed."""
        return slice(part.bins.start - self.bins.start, part.bins.stop - self.bins.start)
