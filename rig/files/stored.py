"""The chunks of an HDF5 dataset as they are stored."""

from array import array
from contextlib import suppress
from math import prod
from typing import Any

import h5py
import numpy as np

from rig.errors import DataFileError

#: So many chunks are asked for one by one; their index is read once when there are more. It takes as long.
_SINGLY = 100


class StoredChunks:
    """The chunks of a dataset as they are stored.

    Parameters
    ----------
    dataset
        A dataset in chunks.

    Attributes
    ----------
    filters
        By HDF5's number, in the order in which they were applied.
    nbytes
        Size of a chunk when it is not packed.
    """

    def __init__(self, dataset: h5py.Dataset) -> None:
        self._dataset = dataset
        self.filters = filters_of(dataset)
        self.nbytes = prod(dataset.chunks) * dataset.dtype.itemsize
        self._asks = not self.filters or not _has_chunks(dataset)
        self._asked = 0
        self._index: _Index | None = None

    def get(self, offset: tuple[int, ...]) -> tuple[int, bytes] | None:
        """Return the chunk that begins at a place, and before it the mask of the filters that it left out.

        None where it was never written.

        Raises
        ------
        DataFileError
            If it is not packed and has not the size of a chunk: the library makes room for a chunk, and reads
            as many bytes as the file says.
        OSError, RuntimeError, ValueError
            Of the library, as for any damaged file.
        """
        if not self._asks:
            try:
                return self._read(offset)
            except (OSError, RuntimeError):  # it was never written, or is damaged: others may be so, too
                self._asks = True
        size = self._size(offset)
        if size is None:
            return None
        if not self.filters and size != self.nbytes:
            raise damaged(self._dataset, f"a chunk has {size} bytes of {self.nbytes}")
        return self._read(offset)

    def _size(self, offset: tuple[int, ...]) -> int | None:
        """Return the stored size of a chunk, None where it was never written."""
        self._asked += 1
        if self._asked == _SINGLY:
            with suppress(OSError, RuntimeError, ValueError, OverflowError):  # damaged: asked one by one
                self._index = _Index(self._dataset)
        if self._index is not None:
            return self._index.size(offset)
        info = self._dataset.id.get_chunk_info_by_coord(offset)
        return None if info.byte_offset is None else info.size

    def _read(self, offset: tuple[int, ...]) -> tuple[int, bytes]:
        left_out, packed = self._dataset.id.read_direct_chunk(offset)
        return left_out, packed

    def packed(self, offset: tuple[int, ...]) -> bytes:
        """Return the chunk that begins at a place.

        Raises
        ------
        DataFileError
            As `get`, or if it was never written.
        """
        stored = self.get(offset)
        if stored is None:
            raise damaged(self._dataset, "a chunk is missing")
        return stored[1]


def _has_chunks(dataset: h5py.Dataset) -> bool:
    """Return whether a chunk was written: where none was, the library takes any number for a chunk's size."""
    with suppress(OSError, RuntimeError, ValueError):
        first = dataset.id.get_chunk_info_by_coord((0,) * dataset.ndim)  # found without a walk through all
        return first.byte_offset is not None or bool(dataset.id.get_num_chunks())
    return False


class _Index:
    """The stored sizes of all chunks of a dataset.

    The library walks through the whole of it for each chunk that it is asked for: 1 ms where there are
    50,000 chunks.

    Raises
    ------
    OSError, RuntimeError
        If it cannot be read to its end.
    ValueError, OverflowError
        If it has a chunk twice, or one outside the dataset.
    """

    def __init__(self, dataset: h5py.Dataset) -> None:
        self._chunk = dataset.chunks
        along = [-(-size // chunk) for size, chunk in zip(dataset.shape, dataset.chunks, strict=True)]
        self._steps = [prod(along[axis + 1 :]) for axis in range(len(along))]
        numbers, sizes = array("q"), array("q")

        def note(info: Any) -> None:
            if any(first >= size for first, size in zip(info.chunk_offset, dataset.shape, strict=True)):
                raise ValueError("a chunk lies outside")
            numbers.append(self._number(info.chunk_offset))
            sizes.append(info.size)

        dataset.id.chunk_iter(note)
        order = np.argsort(numbers)
        self._numbers, self._sizes = np.asarray(numbers)[order], np.asarray(sizes)[order]
        if (np.diff(self._numbers) == 0).any():
            raise ValueError("a chunk is there twice")

    def size(self, offset: tuple[int, ...]) -> int | None:
        """Return the stored size of the chunk that begins at a place, None where it was never written."""
        number = self._number(offset)
        row = int(np.searchsorted(self._numbers, number))
        return int(self._sizes[row]) if row < len(self._numbers) and self._numbers[row] == number else None

    def _number(self, offset: tuple[int, ...]) -> int:
        """Return the number of the chunk that begins at a place, counted along the last axis first."""
        places = zip(offset, self._chunk, self._steps, strict=True)
        return sum(first // size * step for first, size, step in places)


def filters_of(dataset: h5py.Dataset) -> list[int]:
    """Return the filters of a dataset by HDF5's number, in the order in which they were applied."""
    plist = dataset.id.get_create_plist()
    return [plist.get_filter(number)[0] for number in range(plist.get_nfilters())]


def damaged(dataset: h5py.Dataset, what: str) -> DataFileError:
    """Return the error of a dataset in which something is not as it was written."""
    return DataFileError(
        f"{dataset.file.filename} is damaged: {what} in {dataset.name}; copy it again, or measure again"
    )
