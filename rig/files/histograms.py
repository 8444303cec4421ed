"""The photons of a scan file as histograms, read in blocks; here steps and channels become pairs."""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import BLOCK_BYTES, Histograms
from rig.errors import DataFileError
from rig.files.blocks import read, spans
from rig.files.check import reading
from rig.files.form_counts import chunk_histograms


class DenseHistograms:
    """Histograms stored as such; of the steps that were measured, each step's channels one after the other.

    Parameters
    ----------
    path
        File name, for errors.
    counts
        (steps, channels, bins) dataset, or (steps, bins) of one channel.
    steps
        (n,) which steps to give, in rising order.
    """

    def __init__(self, path: Path, counts: h5py.Dataset, steps: NDArray[np.int64]) -> None:
        self._path = path
        self._counts = counts
        self._steps = steps
        self._channels = counts.shape[1] if counts.ndim == 3 else 1

    @property
    def shape(self) -> tuple[int, int]:
        """Number of pairs of step and channel, and number of bins."""
        return len(self._steps) * self._channels, self._counts.shape[-1]

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (pairs, counts) in order, counts being (n, bins)."""
        given, chunk = 0, self._counts.chunks[0] if self._counts.chunks else 1
        for some in spans(self._counts, 0, BLOCK_BYTES):
            first, last = np.searchsorted(self._steps, (some.start, some.stop))
            if first == last:
                continue
            counts = self._read(self._steps[first:last], chunk, bins).reshape(
                -1, len(range(self.shape[1])[bins])
            )
            yield slice(given, given + len(counts)), counts
            given += len(counts)

    def _read(self, steps: NDArray[np.int64], chunk: int, bins: slice) -> NDArray:
        """Return the counts of steps in rising order.

        No chunk without a wanted step is touched, nor one after the last of them: it may be damaged, or half
        written by a killed program.
        """
        parts = []
        for run in np.split(steps, np.flatnonzero(np.diff(steps // chunk) > 1) + 1):
            start = run[0] // chunk * chunk
            with reading(self._path):
                counts = self._counts_of(slice(int(start), int(run[-1]) + 1), bins)
            parts.append(counts if len(counts) == len(run) else counts[run - start])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _counts_of(self, steps: slice, bins: slice) -> NDArray:
        """Return the counts of some steps; of steps in several chunks no other bands of bins are read."""
        if self._counts.ndim == 2 or self._counts.chunks is None:
            return read(self._counts, steps)[..., bins]
        return read(self._counts, steps, slice(None), bins)


class LaserHistograms:
    """Histograms of an exhaustive capture: steps are lasers, channels are pixels.

    Parameters
    ----------
    path
        File name, for errors.
    counts
        (steps, channels, bins) dataset.
    steps
        (lasers,) which steps, in rising order.
    """

    def __init__(self, path: Path, counts: h5py.Dataset, steps: NDArray[np.int64]) -> None:
        self._path, self._counts, self._steps = path, counts, steps

    @property
    def bins(self) -> int:
        """Number of bins."""
        return int(self._counts.shape[2])

    def of(self, lasers: slice) -> Histograms:
        """Return the histograms of a run of lasers."""
        return DenseHistograms(self._path, self._counts, self._steps[lasers])


class RepeatedHistograms:
    """Histograms of frames, added up where a step of each frame has the same spot.

    Parameters
    ----------
    frames
        Of equal shape.
    """

    def __init__(self, frames: list[Histograms]) -> None:
        self._frames = frames

    @property
    def shape(self) -> tuple[int, int]:
        """Number of pairs of spot and channel, and number of bins."""
        return self._frames[0].shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (pairs, counts) in order, counts being (n, bins)."""
        rows = _rows_of_a_block(self.shape[1] * 8)
        streams = [_in_rows(frame.blocks(bins), rows) for frame in self._frames]
        given = 0
        for parts in zip(*streams, strict=True):
            total = parts[0].astype(np.float32 if parts[0].dtype.kind == "f" else np.uint64)
            for part in parts[1:]:
                total += part
            yield slice(given, given + len(total)), total
            given += len(total)


def _in_rows(blocks: Iterator[tuple[slice, NDArray]], rows: int) -> Iterator[NDArray]:
    """Yield the same counts in pieces of equally many rows, but for the last."""
    held: list[NDArray] = []
    for _, block in blocks:
        held.append(block)
        while sum(map(len, held)) >= rows:
            together = np.concatenate(held)
            yield together[:rows]
            held = [together[rows:]]
    if sum(map(len, held)):
        yield np.concatenate(held)


class TaggedHistograms:
    """Histograms made from the time-tagged form: the bin index of every photon.

    Parameters
    ----------
    path
        File name, for errors.
    photons
        (photons,) dataset of bin indices, pair by pair.
    where
        (pairs,) first photon of each pair of step and channel, and (pairs,) the one after its last.
    bins
        Number of bins.
    wanted
        (pairs,) which pairs to give.
    """

    def __init__(
        self,
        path: Path,
        photons: h5py.Dataset,
        where: tuple[NDArray[np.int64], NDArray[np.int64]],
        bins: int,
        wanted: NDArray[np.bool_],
    ) -> None:
        self._path = path
        self._photons = photons
        self._bins = bins
        self._pairs = np.flatnonzero(wanted)
        self._first, self._stop = (edges[wanted] for edges in where)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return len(self._pairs), self._bins

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order; the positions count those that are wanted."""
        # whole chunks, as of stored histograms: what is made of the blocks is then the same to the last bit
        rows, chunk = _rows_of_a_block(self._bins * 4), chunk_histograms(self._bins)
        rows = max(rows // chunk * chunk, min(rows, chunk))
        for start in range(0, len(self._pairs), rows):
            some = slice(start, min(start + rows, len(self._pairs)))
            yield some, self._histograms(some)[:, bins]

    def _histograms(self, some: slice) -> NDArray[np.uint32]:
        """Return the (n, bins) histograms of these rows."""
        first, stop = self._first[some], self._stop[some]
        index = np.concatenate([np.zeros(0, np.int64), *self._runs(first[first < stop], stop[first < stop])])
        if index.size and (index.min() < 0 or index.max() >= self._bins):
            raise DataFileError(
                f"{self._path} has a photon in bin {index.max()} of {self._bins} bins, at positions "
                f"{self._pairs[some][0]} to {self._pairs[some][-1]}; /transients@bins must be larger than "
                "every bin index"
            )
        row = np.repeat(np.arange(len(first)), stop - first)
        flat = np.bincount(row * self._bins + index, minlength=len(first) * self._bins)
        return flat.reshape(len(first), self._bins).astype(np.uint32)

    def _runs(self, first: NDArray[np.int64], stop: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Yield the photons, those that follow one another in the file at once; none between is touched."""
        cuts = np.flatnonzero(first[1:] != stop[:-1])
        begins = first[np.concatenate([[0], cuts + 1])] if len(first) else first
        ends = stop[np.concatenate([cuts, [len(stop) - 1]])] if len(first) else stop
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            with reading(self._path):
                yield read(self._photons, slice(begin, end)).astype(np.int64)


def _rows_of_a_block(row_bytes: int) -> int:
    return max(1, BLOCK_BYTES // max(1, row_bytes))
