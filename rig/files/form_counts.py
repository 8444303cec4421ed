"""Histograms: the photons of each step, channel and bin, in chunks of several steps."""

import zlib
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files.blocks import read
from rig.files.description import ScanDescription
from rig.files.form import Form, create_marks
from rig.files.journal import Chunk
from rig.model.photons import photons_in

#: Histograms in one chunk of the file: 1 MB of 15,000 bins.
CHUNK_HISTOGRAMS = 16
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
        self.sums = np.zeros(-(-self.steps // self._size), np.uint32)
        self._photons = np.zeros(self.steps)
        self.at = Rows(0, np.zeros((self._size, *shape), self._counts.dtype))

    @staticmethod
    def create(transients: h5py.Group, description: ScanDescription) -> None:
        """Make the datasets of ``/transients`` in a new scan file."""
        steps, channels, bins = description.steps, description.channel_count, description.bins
        size = min(max(CHUNK_HISTOGRAMS // channels, 1), steps)
        counts = transients.create_dataset(
            "counts",
            (steps, channels, bins),
            description.dtype,
            chunks=(size, channels, bins),
            compression="gzip",
            compression_opts=COMPRESSION,
            shuffle=True,
        )
        counts.attrs["kind"] = "expectation" if counts.dtype.kind == "f" else "photons"
        create_marks(transients, steps)
        transients["checksum"] = np.zeros(-(-steps // size), "<u4")

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
        return own_filters and counts.scaleoffset is None and counts.chunks[1:] == counts.shape[1:]

    @staticmethod
    def chunks(file: h5py.File, measured: int) -> Iterator[Chunk]:
        """Yield the first steps of a scan file as they are stored."""
        counts, live_time_s = file["transients/counts"], file["transients/live_time_s"][:measured]
        for first in range(0, measured, counts.chunks[0]):
            _, packed = counts.id.read_direct_chunk(_place(counts, first))
            yield Chunk(first, live_time_s[first : first + counts.chunks[0]], packed)

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
        counts, done = file["transients/counts"], file["transients/done"][()].astype(bool)
        size, wrong = counts.chunks[0], np.zeros(len(done), bool)
        for number, expected in enumerate(sums.tolist()):
            steps = slice(number * size, (number + 1) * size)
            if done[steps].any() and stored_crc(counts, _place(counts, number * size)) != expected:
                wrong[steps] = done[steps]
        return wrong

    @property
    def room_bytes(self) -> int:
        """The chunk at hand, and another, in both files."""
        return 8 * int(self.at.counts.nbytes)

    def put(self, step: int, counts: NDArray) -> None:
        """Gather a step."""
        row = step - self.at.first
        np.copyto(self.at.counts[row], self.fitting(counts))
        self._photons[step] = _sums(self.at.counts[row : row + 1])[0]

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
        return Chunk(first, live_time_s[first:appended], zlib.compress(shuffled(counts), COMPRESSION))

    def write(self, chunk: Chunk, written: int, appended: int, *, last: bool) -> int:
        """Write the chunk."""
        self._put(chunk)
        self.sums[chunk.first // self._size] = zlib.crc32(chunk.packed)
        return appended

    def _put(self, chunk: Chunk) -> None:
        self._counts.id.write_direct_chunk(_place(self._counts, chunk.first), chunk.packed)
        if self._stored is not None:
            self._stored[chunk.first // self._size] = zlib.crc32(chunk.packed)

    def before(self, first: int) -> tuple[Rows, int]:
        """Return the chunk that holds step ``first``, and where it begins."""
        if first >= self.at.first:
            return self.at, self.at.first
        kept = first // self._size * self._size
        return Rows(kept, self._counts[kept : kept + self._size]), kept

    def take_up(self, measured: int) -> int:
        """Read back the first steps of a file."""
        for number in range(-(-measured // self._size)):
            place = _place(self._counts, number * self._size)
            self.sums[number] = zlib.crc32(self._counts.id.read_direct_chunk(place)[1])
        for first in range(0, measured, self._size):
            rows = slice(first, min(first + self._size, measured))
            self.at.counts[: rows.stop - first] = self._counts[rows]
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


def shuffled(values: NDArray) -> memoryview:
    """Return values as HDF5's shuffle stores them: the first bytes of all, then the second ones."""
    return np.ascontiguousarray(values.view(np.uint8).reshape(-1, values.itemsize).T).data


def stored_crc(dataset: h5py.Dataset, place: tuple[int, ...]) -> int | None:
    """Return the CRC-32 of a chunk as it is stored, None if it cannot be read."""
    try:
        return zlib.crc32(dataset.id.read_direct_chunk(place)[1])
    except (OSError, RuntimeError, ValueError, KeyError):
        return None


def _place(counts: h5py.Dataset, first: int) -> tuple[int, ...]:
    """Return where the chunk begins whose first step is ``first``."""
    return (first, *(0 for _ in counts.shape[1:]))


def _sums(rows: NDArray) -> NDArray:
    """Return the sum of the counts of each step."""
    return rows.reshape(len(rows), -1).sum(axis=1, dtype=np.float64 if rows.dtype.kind == "f" else np.uint64)
