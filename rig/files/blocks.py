"""Reading a part of an HDF5 dataset, its chunks unpacked here and held against their size.

The HDF5 library takes for granted that a packed chunk unpacks to a whole chunk: one that ends early makes it
read beyond its memory, which is a crash, or another's data in the picture. Here a chunk that is not whole is
refused, chunks that were never written cost nothing, and no more is in memory than what was asked for and one
chunk.
"""

from collections.abc import Iterator
from itertools import product
from math import prod

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.inspection import CHUNK_BYTES
from rig.files.stored import StoredChunks, damaged, filters_of
from rig.files.trial_child import most_memory

try:
    from isal import isal_zlib as inflating  # unpacks in 0.4 of zlib's time
except ImportError:  # it is made for x86 and ARM alone
    import zlib as inflating

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


def _ours(dataset: h5py.Dataset) -> bool:
    """Return whether the chunks hold plain numbers, packed by deflate and shuffle at most."""
    plain = dataset.dtype.kind in "uifb" and dataset.dtype.itemsize <= 8
    plain = plain and dataset.id.get_type().equal(h5py.h5t.py_create(dataset.dtype))
    return plain and filters_of(dataset) in ([], [_DEFLATE], [_SHUFFLE], [_SHUFFLE, _DEFLATE])


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
        raise damaged(dataset, f"a chunk has {len(packed)} bytes of {whole}")
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
        raise damaged(dataset, f"a chunk cannot be unpacked ({error})") from None
    if not unpacking.eof:
        raise damaged(dataset, "a chunk is cut off, or unpacks to more than a chunk")
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
