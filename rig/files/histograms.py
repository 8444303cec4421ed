"""The photons of a scan file as histograms, read in blocks."""

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.check import reading

#: Bytes of counts in a block: a few chunks, and small beside any machine's memory.
BLOCK_BYTES = 16 * 2**20


class DenseHistograms:
    """Histograms stored as such; of the positions that were measured.

    Parameters
    ----------
    path
        File name, for errors.
    counts
        (positions, bins) dataset.
    done
        (positions,) which positions to give.
    """

    def __init__(self, path: Path, counts: h5py.Dataset, done: NDArray[np.bool_]) -> None:
        self._path = path
        self._counts = counts
        self._done = done

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return int(np.count_nonzero(self._done)), self._counts.shape[1]

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order; the positions count those that were measured."""
        rows = _rows_of_a_block(self._counts.shape[1] * self._counts.dtype.itemsize)
        chunk = self._counts.chunks[0] if self._counts.chunks else 1
        rows = max(chunk, rows // chunk * chunk)
        given = 0
        for start in range(0, len(self._done), rows):
            wanted = np.trim_zeros(self._done[start : start + rows], "b")
            if not wanted.any():
                continue
            # no chunk after the last mark is touched: a killed writer may have left it half written
            with reading(self._path):
                counts = self._counts[start : start + len(wanted), bins]
            counts = counts if wanted.all() else counts[wanted]
            yield slice(given, given + len(counts)), counts
            given += len(counts)


class TaggedHistograms:
    """Histograms made from the time-tagged form: the bin index of every photon.

    Parameters
    ----------
    path
        File name, for errors.
    photons
        (photons,) dataset of bin indices, position by position.
    offset
        (positions + 1,) first photon of each position, then the total.
    bins
        Number of bins.
    done
        (positions,) which positions to give.
    """

    def __init__(
        self, path: Path, photons: h5py.Dataset, offset: NDArray[np.int64], bins: int, done: NDArray[np.bool_]
    ) -> None:
        self._path = path
        self._photons = photons
        self._offset = offset
        self._bins = bins
        self._done = done

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return int(np.count_nonzero(self._done)), self._bins

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order; the positions count those that were measured."""
        rows = _rows_of_a_block(self._bins * 4)
        given = 0
        for start in range(0, len(self._done), rows):
            wanted = self._done[start : start + rows]
            if not wanted.any():
                continue
            counts = self._histograms(start, start + len(wanted))[wanted][:, bins]
            yield slice(given, given + len(counts)), counts
            given += len(counts)

    def _histograms(self, start: int, stop: int) -> NDArray[np.uint32]:
        """Return the (stop - start, bins) histograms of these positions."""
        edges = self._offset[start : stop + 1]
        with reading(self._path):
            index = self._photons[edges[0] : edges[-1]].astype(np.int64)
        if index.size and (index.min() < 0 or index.max() >= self._bins):
            raise DataFileError(
                f"{self._path} has a photon in bin {index.max()} of {self._bins} bins, "
                f"at positions {start} to {stop - 1}; /transients@bins must be larger than every bin index"
            )
        row = np.repeat(np.arange(stop - start), np.diff(edges))
        flat = np.bincount(row * self._bins + index, minlength=(stop - start) * self._bins)
        return flat.reshape(stop - start, self._bins).astype(np.uint32)


def _rows_of_a_block(row_bytes: int) -> int:
    return max(1, BLOCK_BYTES // max(1, row_bytes))
