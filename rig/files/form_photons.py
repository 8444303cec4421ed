"""The time-tagged form: the bin of each photon, step after step, in chunks of equally many photons.

A chunk of photons ends anywhere in a step. So the HDF5 file holds whole chunks while it is written, and
a step is marked when its last photon is in one; the last, partial chunk is written at the end. The
journal holds each step once, its photons as they came.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files.blocks import read
from rig.files.description import ScanDescription
from rig.files.form import Form, create_marks
from rig.files.form_counts import shuffled, stored_crc
from rig.files.journal import Chunk
from rig.files.stored import StoredChunks

#: Photons in one chunk of the file: 128 kB, a quarter of a second at 265 kHz.
CHUNK_PHOTONS = 2**16
#: So many chunks are written at once within a line, so that what HDF5 takes each time counts little.
GATHERED_CHUNKS = 16
#: Bytes of so many bits are stored as they are; the longest block of a deflated stream that is.
_EVEN_BITS, _BLOCK = 7.8, 2**16 - 1
#: Checksums in one chunk of their dataset, which grows with the photons.
_CHUNK_SUMS = 2**10
#: Photons that are copied at once from file to journal.
_COPIED = 2**20


class Gathered(NamedTuple):
    """Photons that are not yet in the HDF5 file, and more room behind them; the number of the first."""

    first: int
    bins: NDArray[np.unsignedinteger]


class Sums(NamedTuple):
    """CRC-32 of each chunk of photons as it is stored, and of each step's own offsets."""

    chunks: NDArray[np.uint32]
    steps: NDArray[np.uint32]


class PhotonForm(Form):
    """``/transients/photons``, and where each step and channel begins in it."""

    DATASETS: ClassVar[tuple[str, ...]] = ("photons", "photon_offset", "checksum", "step_checksum")

    def __init__(self, file: h5py.File) -> None:
        """Take over an open file."""
        transients = file["transients"]
        self._photons, self._offsets, self._chunk_sums, self._step_sums = (
            transients[name] for name in self.DATASETS
        )
        self.steps = len(transients["done"])
        self._channels = (len(self._offsets) - 1) // self.steps
        self.shape = (self._channels, int(transients.attrs["bins"]))
        self._size = self._photons.chunks[0]
        self.grows = self._offsets.maxshape == (None,)
        self._offset = np.zeros(self.steps * self._channels + 1, np.int64)
        self.sums = Sums(np.zeros(0, np.uint32), np.zeros(self.steps, np.uint32))
        self.at = Gathered(0, np.zeros(2 * self._size, self._photons.dtype))

    @staticmethod
    def create(transients: h5py.Group, description: ScanDescription) -> None:
        """Make the datasets of ``/transients`` in a new scan file."""
        steps, channels, bins = description.steps, description.channel_count, description.bins
        _create_photons(transients, "<u2" if bins <= 2**16 else "<u4", CHUNK_PHOTONS)
        grows = description.plan is not None and description.plan.endless
        _create_offsets(transients, steps * channels, grows=grows)
        create_marks(transients, steps, grows=grows)
        _create_sums(transients, steps, grows=grows)

    @staticmethod
    def copy_empty(old: h5py.Group, new: h5py.Group) -> None:
        """Make the form's datasets as in another scan file, without photons."""
        _create_photons(new, old["photons"].dtype, old["photons"].chunks[0])
        grows = old["photon_offset"].maxshape == (None,)
        _create_offsets(new, len(old["photon_offset"]) - 1, grows=grows)
        _create_sums(new, len(old["done"]), grows=grows)
        for name in PhotonForm.DATASETS:
            new[name].attrs.update(old[name].attrs)

    @staticmethod
    def written_here(transients: h5py.Group) -> bool:
        """Return whether the photons are stored as this program stores them."""
        if not (set(PhotonForm.DATASETS) <= set(transients) and "bins" in transients.attrs):
            return False
        photons = transients["photons"]
        grows = photons.maxshape == (None,) and transients["checksum"].maxshape == (None,)
        own_filters = photons.compression == "gzip" and photons.shuffle and not photons.fletcher32
        return grows and own_filters and photons.scaleoffset is None

    @staticmethod
    def chunks(file: h5py.File, measured: int) -> Iterator[Chunk]:
        """Yield the first steps of a scan file."""
        transients = file["transients"]
        offset = read(transients["photon_offset"]).astype(np.int64)
        channels = (len(offset) - 1) // len(transients["done"])
        live_time_s = read(transients["live_time_s"], slice(measured))
        ends, first = offset[channels::channels], 0
        while first < measured:
            begin = int(offset[first * channels])
            last = min(max(first + 1, int(np.searchsorted(ends, begin + _COPIED))), measured)
            edges = offset[first * channels : last * channels + 1]
            photons = read(transients["photons"], slice(begin, int(edges[-1])))
            yield _chunk(first, live_time_s[first:last], np.diff(edges), photons)
            first = last

    @staticmethod
    def unpacked(
        transients: h5py.Group, chunk: Chunk, first: int
    ) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
        """Return the photons of a journal's chunk, from one of its steps on."""
        channels = (len(transients["photon_offset"]) - 1) // len(transients["done"])
        of_channel, photons = _parts(chunk, channels, transients["photons"].dtype)
        before = (first - chunk.first) * channels
        return photons[of_channel[:before].sum() :], of_channel[before:]

    @staticmethod
    def stored_sums(file: h5py.File) -> Sums:
        """Return the checksums that a scan file holds."""
        return Sums(read(file["transients/checksum"]), read(file["transients/step_checksum"]))

    @staticmethod
    def altered(file: h5py.File, sums: Sums) -> NDArray[np.bool_]:
        """Return (S,) which measured steps have other offsets than were written, or an altered chunk."""
        transients = file["transients"]
        done = read(transients["done"]).astype(bool)
        offset = read(transients["photon_offset"]).astype(np.int64)
        channels = (len(offset) - 1) // len(done)
        right = done.copy()
        for step in np.flatnonzero(done).tolist():
            right[step] = _step_sum(offset, step, channels) == sums.steps[step]
        begin, end = offset[:-1:channels][right], offset[channels::channels][right]
        photons = transients["photons"]
        stored = StoredChunks(photons)
        size = photons.chunks[0]
        chunks = -(-len(photons) // size)
        wrong = np.ones(chunks + 1, bool)  # and what lies beyond the last chunk
        for number, expected in enumerate(sums.chunks[:chunks].tolist()):
            wrong[number] = stored_crc(stored, (number * size,)) != expected
        # how many wrong chunks lie before each: equal at a step's first and last photon, none is in it
        before = np.concatenate([[0], np.cumsum(wrong)])
        low, high = np.clip([begin // size, -(-end // size)], 0, chunks + 1)
        right[right] = (before[high] == before[low]) | (begin == end)
        return done & ~right

    @property
    def room_bytes(self) -> int:
        """What is gathered, and as much again, in both files."""
        return 4 * int(self.at.bins.nbytes)

    def put(self, step: int, counts: NDArray) -> None:
        """Gather a step that was counted: its photons in the order of their bins."""
        counts = self.fitting(counts)
        if counts.dtype.kind not in "ui":
            raise TypeError(f"photons are counted in whole numbers, not in {counts.dtype}")
        photon_bins = np.repeat(np.tile(np.arange(self.shape[1]), self.shape[0]), counts.ravel())
        self.put_photons(step, photon_bins, counts.sum(axis=1, dtype=np.int64))

    def put_photons(self, step: int, photon_bins: NDArray, of_channel: NDArray) -> None:
        """Gather a step photon by photon.

        Raises
        ------
        ValueError
            If shapes, types or a bin do not fit.
        """
        photon_bins, of_channel = np.asarray(photon_bins), np.asarray(of_channel)
        self._check(photon_bins, of_channel)
        of_channel = of_channel.astype(np.int64)
        pair = step * self._channels
        begin = int(self._offset[pair]) - self.at.first
        self._make_room(begin, len(photon_bins))
        self.at.bins[begin : begin + len(photon_bins)] = photon_bins
        self._offset[pair + 1 : pair + 1 + self._channels] = self._offset[pair] + np.cumsum(of_channel)

    def _check(self, photon_bins: NDArray, of_channel: NDArray) -> None:
        channels, bins = self.shape
        if of_channel.shape != (channels,) or of_channel.dtype.kind not in "ui" or of_channel.min() < 0:
            raise ValueError(f"of_channel must be the photons of {channels} channels, not {of_channel}")
        if photon_bins.ndim != 1 or len(photon_bins) != of_channel.sum():
            raise ValueError(
                f"photon_bins must be ({of_channel.sum()},), as of_channel says, not {photon_bins.shape}"
            )
        if not len(photon_bins):
            return
        if photon_bins.dtype.kind not in "ui":
            raise ValueError(f"photon_bins must be whole numbers, not {photon_bins.dtype}")
        low, high = int(photon_bins.min()), int(photon_bins.max())
        if low < 0 or high >= bins:
            raise ValueError(f"photon_bins must be 0 to {bins - 1}, not {low} to {high}")

    def _make_room(self, held: int, photons: int) -> None:
        if held + photons > len(self.at.bins):
            bins = np.zeros(2 * (held + photons), self.at.bins.dtype)
            bins[:held] = self.at.bins[:held]
            self.at = Gathered(self.at.first, bins)

    def full(self, appended: int) -> bool:
        """Return whether so many photons are gathered that it is time to write them."""
        return bool(self._end(appended) - self.at.first >= GATHERED_CHUNKS * self._size)

    def _ends_with(self, steps: int) -> bool:
        """Return whether these steps are all that there will ever be."""
        return steps == self.steps and not self.grows

    def grow(self) -> None:
        """Take the steps that were added to the file."""
        steps = len(self._step_sums)
        offset = np.zeros(steps * self._channels + 1, np.int64)
        offset[: len(self._offset)] = self._offset
        sums = np.zeros(steps, np.uint32)
        sums[: self.steps] = self.sums.steps
        self.steps, self._offset, self.sums = steps, offset, self.sums._replace(steps=sums)

    def _end(self, steps: int) -> int:
        """Return how many photons the first steps have."""
        return int(self._offset[steps * self._channels])

    def turn(self, appended: int) -> None:
        """Nothing changes: `write` has let go of what is written."""

    def due(self, written: int, appended: int, *, last: bool) -> bool:
        """Return whether a chunk is whole, or the end has come."""
        whole = self._end(appended) - self.at.first >= self._size
        return last or whole or (self._ends_with(appended) and written < appended)

    def packed(self, journaled: int, appended: int, live_time_s: NDArray[np.float32]) -> Chunk:
        """Return the steps that the journal does not hold yet."""
        edges = self._offset[journaled * self._channels : appended * self._channels + 1]
        photons = self.at.bins[edges[0] - self.at.first : edges[-1] - self.at.first]
        return _chunk(journaled, live_time_s[journaled:appended], np.diff(edges), photons)

    def write(self, chunk: Chunk, written: int, appended: int, *, last: bool) -> int:
        """Write the chunks that are whole; at the end all, with the size of the whole."""
        left = self._write_chunks(appended)
        end = self._end(appended)
        whole = last or self._ends_with(appended)
        if whole:
            # before its photons: HDF5 packs a chunk anew that is cut
            self._photons.resize((end,))
            if end > left.first:
                self._write_from(left.first, left.bins[: end - left.first])
            self._set_sums(-(-end // self._size))
        present = appended if whole else self._within(left.first, appended)
        self._write_offsets(written, present)
        if whole:
            self._offsets[appended * self._channels + 1 :] = end
        self.at = left
        return present

    def _write_chunks(self, appended: int) -> Gathered:
        """Write the chunks that are whole; return what is left."""
        first, bins = self.at
        end = self._end(appended)
        kept = max(first, end // self._size * self._size)
        if kept == first:
            return self.at
        if len(self._photons) < kept:
            self._photons.resize((kept,))
        self._write_from(first, bins[: kept - first])
        left = np.zeros(len(bins), bins.dtype)
        left[: end - kept] = bins[kept - first : end - first]
        return Gathered(kept, left)

    def _write_from(self, start: int, bins: NDArray[np.unsignedinteger]) -> None:
        """Write the photons from ``start`` on, where a chunk begins, and the checksums of their chunks."""
        first, size = start // self._size, self._size
        stop = first + -(-len(bins) // size)
        if stop > len(self.sums.chunks):
            self._set_sums(stop)
        for number in range(first, stop):
            chunk = bins[(number - first) * size : (number - first + 1) * size]
            if len(chunk) < size:
                chunk = np.append(chunk, np.zeros(size - len(chunk), chunk.dtype))
            packed = _deflated(chunk)
            self._photons.id.write_direct_chunk((number * size,), packed)
            self.sums.chunks[number] = zlib.crc32(packed)
        self._chunk_sums[first:stop] = self.sums.chunks[first:stop]

    def _set_sums(self, chunks: int) -> None:
        """Let there be as many checksums as chunks."""
        sums = np.zeros(chunks, np.uint32)
        sums[: len(self.sums.chunks)] = self.sums.chunks[:chunks]
        self._chunk_sums.resize((chunks,))
        self.sums = self.sums._replace(chunks=sums)

    def _within(self, photons: int, appended: int) -> int:
        """Return how many of the steps that are there have all they have among the first photons."""
        ends = self._offset[self._channels : appended * self._channels + 1 : self._channels]
        return int(np.searchsorted(ends, photons, "right"))

    def _write_offsets(self, first: int, stop: int) -> None:
        """Write where the photons of some steps begin and end."""
        if first >= stop:
            return
        for step in range(first, stop):
            self.sums.steps[step] = _step_sum(self._offset, step, self._channels)
        pairs = slice(first * self._channels, stop * self._channels + 1)
        self._offsets[pairs] = self._offset[pairs]
        self._step_sums[first:stop] = self.sums.steps[first:stop]

    def before(self, first: int) -> tuple[Gathered, int]:
        """Return the photons before step ``first`` that are in no whole chunk."""
        end = self._end(first)
        kept = end // self._size * self._size
        if kept >= self.at.first:
            return self.at, self._within(self.at.first, first)
        bins = np.zeros(2 * self._size, self.at.bins.dtype)
        bins[: end - kept] = read(self._photons, slice(kept, end))
        return Gathered(kept, bins), self._within(kept, first)

    def take_up(self, measured: int) -> int:
        """Read back the first steps of a file."""
        pairs = measured * self._channels
        self._offset[: pairs + 1] = read(self._offsets, slice(pairs + 1))
        for step in range(measured):
            self.sums.steps[step] = _step_sum(self._offset, step, self._channels)
        end = self._end(measured)
        stored, chunks = StoredChunks(self._photons), np.zeros(-(-end // self._size), np.uint32)
        for number in range(len(chunks)):
            chunks[number] = zlib.crc32(stored.packed((number * self._size,)))
        self.sums = self.sums._replace(chunks=chunks)
        self.at = Gathered(end, self.at.bins)
        self.at, within = self.before(measured)
        return measured if self._ends_with(measured) else within

    def restore(self, chunk: Chunk, rows: int) -> None:
        """Write the first steps of a chunk."""
        of_channel, photons = _parts(chunk, self._channels, self._photons.dtype)
        of_channel = of_channel[: rows * self._channels]
        pair = chunk.first * self._channels
        self._offset[pair + 1 : pair + 1 + len(of_channel)] = self._offset[pair] + np.cumsum(of_channel)
        begin, total = self._end(chunk.first) - self.at.first, int(of_channel.sum())
        self._make_room(begin, total)
        self.at.bins[begin : begin + total] = photons[:total]
        self.at = self._write_chunks(chunk.first + rows)

    def finish(self, measured: int) -> None:
        """Write the partial chunk, and the offsets of the steps that were not in a whole one."""
        self.write(Chunk(0, np.zeros(0, "<f4"), b""), 0, measured, last=True)

    def photons(self, measured: int) -> float:
        """Return the number of photons of the first steps."""
        return float(self._end(measured))


def _create_photons(transients: h5py.Group, dtype: object, size: int) -> None:
    transients.create_dataset(
        "photons",
        (0,),
        dtype,
        maxshape=(None,),
        chunks=(size,),
        compression="gzip",
        compression_opts=1,
        shuffle=True,
    )


def _create_offsets(transients: h5py.Group, pairs: int, *, grows: bool) -> None:
    may = {"maxshape": (None,)} if grows else {}
    transients.create_dataset("photon_offset", data=np.zeros(pairs + 1, "<u8"), **may)


def _create_sums(transients: h5py.Group, steps: int, *, grows: bool) -> None:
    may = {"maxshape": (None,)} if grows else {}
    transients.create_dataset("checksum", (0,), "<u4", maxshape=(None,), chunks=(_CHUNK_SUMS,))
    transients.create_dataset("step_checksum", data=np.zeros(steps, "<u4"), **may)


def _chunk(
    first: int, live_time_s: NDArray[np.float32], of_channel: NDArray, photons: NDArray[np.unsignedinteger]
) -> Chunk:
    """Return steps as the journal holds them: photons of each step and channel (``<u4``), then the bins."""
    return Chunk(first, live_time_s, b"".join([of_channel.astype("<u4").data, photons.data]))


def _parts(
    chunk: Chunk, channels: int, dtype: np.dtype
) -> tuple[NDArray[np.int64], NDArray[np.unsignedinteger]]:
    """Return the photons of each step and channel of a chunk, and the bins."""
    many = len(chunk.live_time_s) * channels
    of_channel = np.frombuffer(chunk.packed, "<u4", many).astype(np.int64)
    return of_channel, np.frombuffer(chunk.packed, dtype, offset=4 * many)


def _step_sum(offset: NDArray[np.int64], step: int, channels: int) -> int:
    """Return the CRC-32 of where a step's channels begin, and where the last one ends."""
    return zlib.crc32(offset[step * channels : (step + 1) * channels + 1].tobytes())


def _deflated(chunk: NDArray[np.unsignedinteger]) -> bytes:
    """Return a chunk shuffled and deflated.

    Photons come in no order, so there are no repetitions to be looked for; only the high bytes are not all
    equally likely. Measured on light that fades over 10 ns, and a third of background: 13 ns a photon and
    87 % of the bytes, where level 1 takes 38 ns for 89 %. Where the low bytes are all equally likely, which
    a few of them tell, they are stored as they are, in half the time (layout of a deflated stream: RFC 1950
    and RFC 1951, 3.2.4).
    """
    plain = shuffled(chunk)
    low = plain[: len(chunk)] if _even(plain[: len(chunk)]) else plain[:0]
    packing = zlib.compressobj(1, wbits=-zlib.MAX_WBITS, strategy=zlib.Z_HUFFMAN_ONLY)
    parts = [b"\x78\x01", *_stored(low), packing.compress(plain[len(low) :]), packing.flush()]
    return b"".join([*parts, zlib.adler32(plain).to_bytes(4, "big")])


def _even(values: memoryview) -> bool:
    """Return whether bytes are so evenly distributed that no code makes them much shorter.

    In bits a byte, by every sixteenth of them; with 4096 bytes that is too low by 0.05 from chance alone.
    """
    number = np.bincount(np.frombuffer(values, np.uint8)[::16], minlength=256)
    part = number[number > 0] / number.sum()
    return bool(-(part * np.log2(part)).sum() > _EVEN_BITS)


def _stored(values: memoryview) -> Iterator[bytes]:
    """Yield bytes as blocks of a deflated stream that are not the last."""
    for start in range(0, len(values), _BLOCK):
        block = values[start : start + _BLOCK]
        yield struct.pack("<BHH", 0, len(block), len(block) ^ 0xFFFF)
        yield bytes(block)
