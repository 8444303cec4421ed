"""Reading a part of an HDF5 dataset, its chunks unpacked here and held against their size.

The HDF5 library takes for granted that a packed chunk unpacks to a whole chunk: one that ends early makes it
read beyond its memory, which is a crash, or another's data in the picture. Here a chunk that is not whole is
refused, chunks that were never written cost nothing, and no more is in memory than what was asked for and one
chunk.
"""

from array import array
from collections.abc import Iterator
from contextlib import suppress
from itertools import product
from math import prod
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.inspection import CHUNK_BYTES
from rig.files.trial_child import most_memory

try:
    from isal import isal_zlib as inflating  # unpacks in 0.4 of zlib's time
except ImportError:  # it is made for x86 and ARM alone
    import zlib as inflating

#: So many chunks are asked for one by one; their index is read once when there are more. It takes as long.
_SINGLY = 100
_SHUFFLE, _DEFLATE = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE


def read(dataset: h5py.Dataset, *parts: slice) -> NDArray:
    """Return a dataset, or the parts of its first axes that slices of step 1 choose.

    Raises
    ------
    DataFileError
        If a chunk is damaged, or more is asked for than a file of this size can be worth.
    OSError, RuntimeError, ValueError
        Of the library, as for any damaged file; see `rig.files.check.reading`.
    """
    taken = [part.indices(size)[:2] for part, size in zip(parts, dataset.shape, strict=False)]
    taken += [(0, size) for size in dataset.shape[len(taken) :]]
    shape = tuple(max(0, stop - start) for start, stop in taken)
    _bounded(dataset, prod(shape))
    if dataset.chunks is None or not _ours(dataset):
        return np.asarray(dataset[tuple(slice(*one) for one in taken)])
    values = np.empty(shape, dataset.dtype)
    if values.size:
        _fill(values, dataset, taken)
    return values


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
        self.filters = _filters(dataset)
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
            raise _damaged(self._dataset, f"a chunk has {size} bytes of {self.nbytes}")
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
            raise _damaged(self._dataset, "a chunk is missing")
        return stored[1]


def _has_chunks(dataset: h5py.Dataset) -> bool:
    """Return whether a chunk was written: where none was, the library takes any number for a chunk's size."""
    with suppress(OSError, RuntimeError, ValueError):
        return bool(dataset.id.get_num_chunks())
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


def spans(dataset: h5py.Dataset, axis: int, most_bytes: int) -> Iterator[slice]:
    """Yield slices along an axis that together are all of it, of whole chunks, and of so many bytes at most.

    One that holds one line or one line of chunks may have more bytes.
    """
    size = dataset.shape[axis]
    line_bytes = max(1, dataset.dtype.itemsize * prod(dataset.shape) // max(1, size))
    step = max(1, most_bytes // line_bytes)
    chunk = dataset.chunks[axis] if dataset.chunks else 1
    if chunk * line_bytes <= max(most_bytes, CHUNK_BYTES):
        step = max(chunk, step // chunk * chunk)
    for start in range(0, size, step):
        yield slice(start, min(start + step, size))


def _bounded(dataset: h5py.Dataset, values: int) -> None:
    """Refuse to read so many values at once if they are far more than the file can be worth."""
    claimed, most = values * dataset.dtype.itemsize, most_memory(dataset.file.id.get_filesize())
    if claimed > most:
        raise DataFileError(
            f"{dataset.file.filename}: {dataset.name} claims {claimed / 1e9:.3g} GB to be read at once, in a "
            f"file that can be worth {most / 1e9:.3g} GB; it is damaged, "
            "or compressed far more than a measurement can be: unpack it (h5repack -f NONE)"
        )


def _filters(dataset: h5py.Dataset) -> list[int]:
    """Return the filters by HDF5's number, in the order in which they were applied."""
    plist = dataset.id.get_create_plist()
    return [plist.get_filter(number)[0] for number in range(plist.get_nfilters())]


def _ours(dataset: h5py.Dataset) -> bool:
    """Return whether the chunks hold plain numbers, packed by deflate and shuffle at most."""
    plain = dataset.dtype.kind in "uifb" and dataset.dtype.itemsize <= 8
    plain = plain and dataset.id.get_type().equal(h5py.h5t.py_create(dataset.dtype))
    return plain and _filters(dataset) in ([], [_DEFLATE], [_SHUFFLE], [_SHUFFLE, _DEFLATE])


def _fill(values: NDArray, dataset: h5py.Dataset, taken: list[tuple[int, int]]) -> None:
    """Put the chunks that overlap with a part of a dataset into that part's values."""
    chunks = StoredChunks(dataset)
    ranges = [
        range(start // size * size, stop, size)
        for (start, stop), size in zip(taken, dataset.chunks, strict=True)
    ]
    for offset in product(*ranges):
        within, into = [], []
        for (start, stop), first, size in zip(taken, offset, dataset.chunks, strict=True):
            low, high = max(start, first), min(stop, first + size)
            within.append(slice(low - first, high - first))
            into.append(slice(low - start, high - start))
        target, stored = values[tuple(into)], chunks.get(offset)
        if stored is None:
            target[...] = dataset.fillvalue
        else:
            _unpack(target, dataset, chunks, stored, tuple(within))


def _unpack(
    target: NDArray,
    dataset: h5py.Dataset,
    chunks: StoredChunks,
    stored: tuple[int, bytes],
    within: tuple[slice, ...],
) -> None:
    """Put a part of a chunk as it is stored where it belongs."""
    (left_out, packed), whole, shuffled = stored, chunks.nbytes, False
    for number, name in reversed(list(enumerate(chunks.filters))):
        if left_out & (1 << number):
            continue
        if name == _DEFLATE:
            packed = _inflated(dataset, packed, whole)
        else:  # of the filters taken here, the first that packs: the last to be undone
            shuffled = dataset.dtype.itemsize > 1
    if len(packed) != whole:
        raise _damaged(dataset, f"a chunk has {len(packed)} bytes of {whole}")
    if shuffled:
        _unshuffle(target, packed, dataset, within)
        return
    chunk = np.frombuffer(packed, dataset.dtype).reshape(dataset.chunks)[within]
    target[...] = chunk.view(np.uint8) != 0 if dataset.dtype.kind == "b" else chunk  # of a bool any byte


def _inflated(dataset: h5py.Dataset, packed: bytes, whole: int) -> bytes:
    unpacking = inflating.decompressobj()
    try:
        unpacked = unpacking.decompress(packed, whole + 1)  # one more, or its check sum is never reached
    except inflating.error as error:
        raise _damaged(dataset, f"a chunk cannot be unpacked ({error})") from None
    if not unpacking.eof:
        raise _damaged(dataset, "a chunk is cut off, or unpacks to more than a chunk")
    return unpacked


def _unshuffle(target: NDArray, packed: bytes, dataset: h5py.Dataset, within: tuple[slice, ...]) -> None:
    """Undo HDF5's shuffle, which puts the first bytes of all numbers first, then the second ones.

    The bytes are put together as whole numbers are, little endian; of small counts most are zero, and cost
    nothing.
    """
    planes = np.frombuffer(packed, np.uint8).reshape(-1, *dataset.chunks)[(slice(None), *within)]
    numbers = target.view(f"<u{dataset.dtype.itemsize}")
    numbers[...] = planes[0]
    for place in range(1, len(planes)):
        if planes[place].any():
            numbers |= planes[place].astype(numbers.dtype) << (8 * place)


def _damaged(dataset: h5py.Dataset, what: str) -> DataFileError:
    return DataFileError(
        f"{dataset.file.filename} is damaged: {what} in {dataset.name}; copy it again, or measure again"
    )
