"""Histograms: the photons of each step, channel and bin, in chunks of several steps.

A step of very many channels has several chunks, each of some channels and a band of bins, so that a step, or
a band of bins of many steps, is read without the rest. In the journal they follow one another as one.
"""

import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import product
from typing import ClassVar, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.files.blocks import read
from rig.files.description import ScanDescription
from rig.files.form import Form, create_marks
from rig.files.inspection import CHUNK_BYTES
from rig.files.journal import Chunk
from rig.files.stored import StoredChunks
from rig.model.photons import photons_in

#: Histograms in one chunk of the file: 1 MB of 15,000 bins. Of few bins it has more, up to so many bytes:
#: each chunk costs a tenth of a millisecond to write.
_CHUNK_HISTOGRAMS, _FULL_BYTES = 16, 2**13
#: A step of more bytes is stored in several chunks, of so many channels and bins at the most: 1 MB.
STEP_BYTES, BAND = 2**22, (1024, 256)
#: zlib's quickest level. Measured on sparse counts: level 4 takes nearly twice as long.
COMPRESSION = 1


class Rows(NamedTuple):
    """The first step of a chunk, and the counts of all its steps."""

    first: int
    counts: NDArray


class CountForm(Form):
    """``/transients/counts``, in chunks of whole steps; the journal holds chunks as the file does."""

    DATASETS: ClassVar[tuple[str, ...]] = ("counts",)

    def __init__(self, file: h5py.File) -> None:
        """Take over an open file."""
        self._counts = file["transients/counts"]
        self._stored = file["transients"].get("checksum")  # an older program did not write it
        self.steps, *shape = self._counts.shape  # in version 1 there is no axis of channels
        self.shape = tuple(shape)
        self._size = self._counts.chunks[0]
        self._places = _places(self._counts)
        self.sums = np.zeros((-(-self.steps // self._size), len(self._places)), np.uint32)
        self._photons = np.zeros(self.steps)
        self.at = Rows(0, np.zeros((self._size, *shape), self._counts.dtype))

    @staticmethod
    def create(transients: h5py.Group, description: ScanDescription) -> None:
        """Make the datasets of ``/transients`` in a new scan file."""
        steps, channels, bins = description.steps, description.channel_count, description.bins
        chunks = chunk_shape(steps, channels, bins, np.dtype(description.dtype).itemsize)
        counts = transients.create_dataset(
            "counts",
            (steps, channels, bins),
            description.dtype,
            chunks=chunks,
            compression="gzip",
            compression_opts=COMPRESSION,
            shuffle=True,
        )
        counts.attrs["kind"] = "expectation" if counts.dtype.kind == "f" else "photons"
        create_marks(transients, steps)
        transients["checksum"] = np.zeros(-(-steps // chunks[0]) * len(_places(counts)), "<u4")

    @staticmethod
    def copy_empty(old: h5py.Group, new: h5py.Group) -> None:
        """Make the form's datasets as in another scan file, without photons."""
        counts = old["counts"]
        empty = new.create_dataset(
            "counts",
            counts.shape,
            counts.dtype,
            chunks=counts.chunks,
            compression=counts.compression,
            compression_opts=counts.compression_opts,
            shuffle=counts.shuffle,
        )
        empty.attrs.update(counts.attrs)

    @staticmethod
    def written_here(transients: h5py.Group) -> bool:
        """Return whether the counts are stored as this program stores them."""
        counts = transients["counts"]
        own_filters = counts.compression == "gzip" and counts.shuffle and not counts.fletcher32
        if not own_filters or counts.scaleoffset is not None:
            return False
        return counts.chunks[0] == 1 or counts.chunks[1:] == counts.shape[1:]

    @staticmethod
    def chunks(file: h5py.File, measured: int) -> Iterator[Chunk]:
        """Yield the first steps of a scan file as they are stored."""
        counts = file["transients/counts"]
        chunks = StoredChunks(counts)
        live_time_s = read(file["transients/live_time_s"], slice(measured))
        for first in range(0, measured, counts.chunks[0]):
            pieces = [chunks.packed((first, *place)) for place in _places(counts)]
            yield Chunk(first, live_time_s[first : first + counts.chunks[0]], _joined(pieces))

    @staticmethod
    def unpacked(
        transients: h5py.Group, chunk: Chunk, first: int
    ) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
        """Return the photons of a journal's chunk, from one of its steps on."""
        counts = transients["counts"]
        shape = (counts.chunks[0], *counts.shape[1:])
        stored = np.frombuffer(zlib.decompress(chunk.packed), np.uint8).reshape(counts.dtype.itemsize, -1)
        values = np.ascontiguousarray(stored.T).view(counts.dtype).reshape(shape)
        wanted = values[first - chunk.first : len(chunk.live_time_s)]
        return photons_in(wanted.reshape(-1, shape[-1]))

    @staticmethod
    def stored_sums(file: h5py.File) -> NDArray[np.uint32]:
        """Return the CRC-32 of each chunk, as the file has them."""
        return read(file["transients/checksum"])

    @staticmethod
    def altered(file: h5py.File, sums: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Return (S,) which steps are marked as measured though their chunk is not what was written."""
        counts, done = file["transients/counts"], read(file["transients/done"]).astype(bool)
        size, wrong, places = counts.chunks[0], np.zeros(len(done), bool), _places(counts)
        chunks = StoredChunks(counts)
        for number, expected in enumerate(np.reshape(sums, (-1, len(places))).tolist()):
            steps = slice(number * size, (number + 1) * size)
            if done[steps].any() and expected != [
                stored_crc(chunks, (number * size, *place)) for place in places
            ]:
                wrong[steps] = done[steps]
        return wrong

    @property
    def room_bytes(self) -> int:
        """The chunk at hand, and another, in both files."""
        return 8 * int(self.at.counts.nbytes)

    def put(self, step: int, counts: NDArray) -> None:
        """Gather a step."""
        self.put_several(step, self.fitting(counts)[None])

    def put_several(self, step: int, counts: NDArray) -> int:
        """Gather steps that were counted, as many as the chunk takes; return how many.

        Parameters
        ----------
        step
            The first of them.
        counts
            (steps, channels, bins) photons.
        """
        row = step - self.at.first
        taken = self.at.counts[row : row + len(counts)]
        np.copyto(taken, counts[: len(taken)])
        self._photons[step : step + len(taken)] = _sums(taken)
        return len(taken)

    def full(self, appended: int) -> bool:
        """Return whether the chunk has all its steps."""
        return appended - self.at.first == self._size

    def turn(self, appended: int) -> None:
        """Begin the next chunk."""
        self.at = Rows(appended, self.at.counts)

    def due(self, written: int, appended: int, *, last: bool) -> bool:
        """Return whether a chunk is whole, or the last, and not yet in the HDF5 file."""
        return written < appended and (last or self.full(appended) or appended == self.steps)

    def packed(self, journaled: int, appended: int, live_time_s: NDArray[np.float32]) -> Chunk:
        """Return the chunk as HDF5's own filters would: shuffled and deflated, in nearly half their time."""
        first, counts = self.at
        counts[appended - first :] = 0
        chunks = self._counts.chunks

        def piece(place: tuple[int, ...]) -> bytes:
            part = counts[:, *(slice(at, at + size) for at, size in zip(place, chunks[1:], strict=True))]
            whole = np.zeros(chunks, counts.dtype)
            whole[tuple(map(slice, part.shape))] = part
            return zlib.compress(shuffled(whole), COMPRESSION)

        if len(self._places) == 1:
            packed = zlib.compress(shuffled(counts), COMPRESSION)
        else:
            packed = _joined(_each(piece, self._places))
        return Chunk(first, live_time_s[first:appended], packed)

    def write(self, chunk: Chunk, written: int, appended: int, *, last: bool) -> int:
        """Write the chunk."""
        self.sums[chunk.first // self._size] = self._put(chunk)
        return appended

    def _put(self, chunk: Chunk) -> list[int]:
        """Write a chunk of the journal; return the CRC-32 of each of the file's."""
        pieces = _split(chunk.packed, len(self._places))
        for place, piece in zip(self._places, pieces, strict=True):
            self._counts.id.write_direct_chunk((chunk.first, *place), piece)
        sums = [zlib.crc32(piece) for piece in pieces]
        if self._stored is not None:
            number = chunk.first // self._size * len(sums)
            self._stored[number : number + len(sums)] = sums
        return sums

    def before(self, first: int) -> tuple[Rows, int]:
        """Return the chunk that holds step ``first``, and where it begins."""
        if first >= self.at.first:
            return self.at, self.at.first
        kept = first // self._size * self._size
        return Rows(kept, read(self._counts, slice(kept, kept + self._size))), kept

    def take_up(self, measured: int) -> int:
        """Read back the first steps of a file."""
        chunks = StoredChunks(self._counts)
        for number in range(-(-measured // self._size)):
            for index, place in enumerate(self._places):
                self.sums[number, index] = zlib.crc32(chunks.packed((number * self._size, *place)))
        for first in range(0, measured, self._size):
            rows = slice(first, min(first + self._size, measured))
            self.at.counts[: rows.stop - first] = read(self._counts, rows)
            self._photons[rows] = _sums(self.at.counts[: rows.stop - first])
            self.turn(first)
        whole = measured in {self.at.first + self._size, self.steps}
        return measured if whole else self.at.first  # a part of a chunk will be written again

    def restore(self, chunk: Chunk, rows: int) -> None:
        """Write a chunk as it is."""
        self._put(chunk)

    def finish(self, measured: int) -> None:
        """Nothing is left to be done."""

    def photons(self, measured: int) -> float:
        """Return the sum of the counts of the first steps."""
        return float(self._photons[:measured].sum())


def _each(act: Callable[[tuple[int, ...]], bytes], places: list[tuple[int, ...]]) -> list[bytes]:
    """Return what comes of each place, by several threads if there can be any."""
    with suppress(RuntimeError), ThreadPoolExecutor() as threads:
        return list(threads.map(act, places))
    return [act(place) for place in places]  # the system has no more threads


def shuffled(values: NDArray) -> memoryview:
    """Return values as HDF5's shuffle stores them: the first bytes of all, then the second ones."""
    return np.ascontiguousarray(values.view(np.uint8).reshape(-1, values.itemsize).T).data


def stored_crc(chunks: StoredChunks, place: tuple[int, ...]) -> int | None:
    """Return the CRC-32 of a chunk as it is stored, None if it cannot be read."""
    try:
        stored = chunks.get(place)
    except (DataFileError, OSError, RuntimeError, ValueError, KeyError):
        return None
    return None if stored is None else zlib.crc32(stored[1])


def chunk_histograms(bins: int, itemsize: int = 4) -> int:
    """Return how many histograms a chunk of new counts holds, unless one step has more."""
    return max(_CHUNK_HISTOGRAMS, _FULL_BYTES // max(1, bins * itemsize))


def chunk_shape(steps: int, channels: int, bins: int, itemsize: int) -> tuple[int, int, int]:
    """Return the shape of a chunk of new counts."""
    if channels * bins * itemsize <= STEP_BYTES or channels == 1:
        some = min(chunk_histograms(bins, itemsize) // channels, CHUNK_BYTES // (channels * bins * itemsize))
        return min(max(some, 1), steps), channels, bins
    return 1, min(channels, BAND[0]), min(bins, BAND[1])


def _places(counts: h5py.Dataset) -> list[tuple[int, ...]]:
    """Return where, beyond the first axis, the chunks of a step begin, in the order of the file."""
    beyond = zip(counts.shape[1:], counts.chunks[1:], strict=True)
    return list(product(*(range(0, size, step) for size, step in beyond)))


def _joined(pieces: list[bytes]) -> bytes:
    """Return the chunks of a step as one: each with its length before it, but one alone as it is."""
    if len(pieces) == 1:
        return pieces[0]
    return b"".join(len(piece).to_bytes(8, "little") + piece for piece in pieces)


def _split(packed: bytes, count: int) -> list[bytes]:
    """Undo `_joined`."""
    if count == 1:
        return [packed]
    pieces, at = [], 0
    for _ in range(count):
        size = int.from_bytes(packed[at : at + 8], "little")
        pieces.append(packed[at + 8 : at + 8 + size])
        at += 8 + size
    return pieces


def _sums(rows: NDArray) -> NDArray:
    """Return the sum of the counts of each step."""
    return rows.reshape(len(rows), -1).sum(axis=1, dtype=np.float64 if rows.dtype.kind == "f" else np.uint64)
