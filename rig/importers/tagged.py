"""Time-tagged records of a file, read in pieces: once for what they hold, once more for the counts.

Memory does not grow with the photons, only with the markers.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.harp.records import (
    SYNC_CHANNEL,
    T2,
    T2_VERSION_1,
    T3,
    T3_VERSION_1,
    Batch,
    DamagedRecordsError,
    Decoder,
    RecordFormat,
)
from rig.errors import DataFileError
from rig.files.picoquant import Head
from rig.importers.picoharp_records import PicoHarpDecoder


@dataclass(frozen=True)
class PicoHarpFormat:
    """Records of a PicoHarp 300.

    Attributes
    ----------
    is_t3
        Whether tags count sync pulses.
    """

    is_t3: bool


#: Record types by their number in the head (the vendor's demos), which ends with the instrument: 03 PicoHarp
#: 300, 04 HydraHarp, 05 and 06 TimeHarp 260, 07 MultiHarp and PicoHarp 330.
_FORMATS: dict[int, RecordFormat | PicoHarpFormat] = {
    0x00010204: T2_VERSION_1,
    0x00010304: T3_VERSION_1,
    0x01010204: T2,
    0x01010304: T3,
    0x00010205: T2,
    0x00010305: T3,
    0x00010206: T2,
    0x00010306: T3,
    0x00010207: T2,
    0x00010307: T3,
    0x00010203: PicoHarpFormat(is_t3=False),
    0x00010303: PicoHarpFormat(is_t3=True),
}
#: Records decoded at once, and bytes of counts made at once.
_PIECE, _BLOCK_BYTES = 2**18, 2**25
#: T2 times are as long as the pulses are apart; so many bins must do.
MOST_BINS = 2**16
#: A plan has 5 million points at most; with a marker each and one for each line there are fewer than these.
_MOST_MARKERS = 10_000_000


@dataclass(frozen=True)
class Records:
    """The records of a file.

    Attributes
    ----------
    head
        Of the file.
    format
        How the records are read.
    count
        How many whole records there are.
    truncated
        Whether there are fewer than the head says, or it does not say.
    told
        What is to be said of that.
    """

    head: Head
    format: RecordFormat | PicoHarpFormat
    count: int
    truncated: bool
    told: tuple[str, ...]

    @classmethod
    def of(cls, head: Head) -> Self:
        """Find them.

        Raises
        ------
        DataFileError
            If they are of another kind.
        """
        kind = int(head.number("TTResultFormat_TTTRRecType"))
        if kind not in _FORMATS:
            raise DataFileError(
                f"{head.path} holds records of the type {kind:#010x}, which are not those of a HydraHarp, a "
                "MultiHarp, a TimeHarp 260 or a PicoHarp 300; this program does not know their fields"
            )
        said, there = int(head.number("TTResult_NumberOfRecords")), (head.size - head.end) // 4
        if 0 < said <= there:
            more = f"behind its {said:,} records the file has {there - said:,} more, which are left out"
            return cls(head, _FORMATS[kind], said, False, (more,) if there > said else ())
        of = f"{said:,}" if said > 0 else "an unknown number"
        told = f"the file is cut off: it holds {there:,} whole records of {of}"
        return cls(head, _FORMATS[kind], there, True, (told,))

    def batches(self, width_s: float) -> Iterator[tuple[Batch, NDArray[np.integer], int]]:
        """Yield decoded pieces, their photons alone, with each photon's bin and the number of sync pulses.

        A photon of T2 without a sync pulse before it has the bin -1.

        Raises
        ------
        DataFileError
            If the records are damaged.
        """
        decoder, left, sync = _decoder(self.format), self.count, -1
        unit_s = 0.0 if self.format.is_t3 else self.head.number("MeasDesc_GlobalResolution")
        buffer = np.empty(min(left, _PIECE), "<u4")
        with self.head.path.open("rb", buffering=0) as file:
            file.seek(self.head.end)
            while left:
                piece = buffer[: file.readinto(buffer[:left].data) // 4]
                if not len(piece):
                    raise DataFileError(f"{self.head.path} has become shorter while it was read")
                left -= len(piece)
                try:
                    batch = decoder.decode(piece)
                except DamagedRecordsError as error:
                    raise DataFileError(f"{self.head.path} is damaged: {error}") from None
                if self.format.is_t3:
                    yield batch, batch.dtime, 0
                else:
                    bins = np.empty(batch.photons, np.int64)
                    sync = _after_sync(batch.tag, batch.channel, sync, max(1, round(width_s / unit_s)), bins)
                    yield _without_syncs(batch, bins)


def _decoder(of: RecordFormat | PicoHarpFormat) -> Decoder | PicoHarpDecoder:
    return Decoder(of) if isinstance(of, RecordFormat) else PicoHarpDecoder(of.is_t3)


def _without_syncs(batch: Batch, bins: NDArray[np.int64]) -> tuple[Batch, NDArray[np.int64], int]:
    """Return the photons of a batch alone, their bins, and how many sync pulses there were."""
    photon = batch.channel != SYNC_CHANNEL
    before = np.concatenate([[0], np.cumsum(photon)])
    kept = replace(
        batch,
        tag=batch.tag[photon],
        dtime=batch.dtime[photon],
        channel=batch.channel[photon],
        marker_photon=before[batch.marker_photon],
    )
    return kept, bins[photon], batch.photons - kept.photons


@dataclass
class Survey:
    """What the records hold: markers, and photons of each input.

    Attributes
    ----------
    tag, mask, photon
        (markers,) when, which inputs, and how many photons of the file lie before.
    counts, lowest, highest
        (64,) photons of each input, and their lowest and highest bin.
    syncs, unknown
        Sync pulses of T2, and records that no format describes.
    timeless
        Photons without a sync pulse near enough before them.
    """

    tag: NDArray[np.int64]
    mask: NDArray[np.uint8]
    photon: NDArray[np.int64]
    counts: NDArray[np.int64]
    lowest: NDArray[np.int64]
    highest: NDArray[np.int64]
    syncs: int
    unknown: int
    timeless: int

    @classmethod
    def of(cls, records: Records, width_s: float) -> Self:
        """Read all records once."""
        markers: list[tuple[NDArray, NDArray, NDArray]] = []
        counts, lowest, highest = np.zeros(64, np.int64), np.full(64, MOST_BINS), np.full(64, -1)
        photons = syncs = unknown = timeless = there = 0
        for batch, bins, pulses in records.batches(width_s):
            if batch.markers:
                masks = batch.marker_mask.copy()
                markers.append((batch.marker_tag.copy(), masks, batch.marker_photon + photons))
                there += batch.markers
                if there > _MOST_MARKERS:
                    raise DataFileError(
                        f"{records.head.path} holds more than {_MOST_MARKERS:,} markers: it is not a scan"
                    )
            timeless += _survey(batch.channel, bins, counts, lowest, highest)
            photons, syncs, unknown = photons + batch.photons, syncs + pulses, unknown + batch.unknown
        empty = (np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.int64))
        tag, mask, photon = (np.concatenate(some) for some in zip(empty, *markers, strict=True))
        return cls(tag, mask, photon, counts, lowest, highest, syncs, unknown, timeless)

    @property
    def photons(self) -> int:
        """Number of photons on all inputs."""
        return int(self.counts.sum())

    def in_words(self) -> str:
        """Return what was found, e.g. ``799,798 photons on input 0; marker 1: 4,096``."""
        inputs = [f"{self.counts[i]:,} photons on input {i}" for i in np.flatnonzero(self.counts)]
        markers = [
            f"marker {number}: {np.count_nonzero(self.mask & 1 << number - 1):,}"
            for number in (1, 2, 3, 4)
            if (self.mask & 1 << number - 1).any()
        ]
        syncs = [f"{self.syncs:,} sync pulses"] if self.syncs else []
        return "; ".join([*(inputs or ["no photons"]), *syncs, *(markers or ["no markers"])])


def blocks(
    records: Records,
    width_s: float,
    inputs: tuple[int, ...],
    bins: range,
    points: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> Iterator[NDArray[np.uint32]]:
    """Yield (n, bins) counts, point by point and in a point channel by channel."""
    start, stop = points
    channel_of = np.full(256, -1)
    channel_of[list(inputs)] = np.arange(len(inputs))
    rows = max(1, _BLOCK_BYTES // (4 * len(inputs) * len(bins)))
    first, before = 0, 0
    block = np.zeros((min(rows, len(start)), len(inputs), len(bins)), np.uint32)
    for batch, bin_of, _ in records.batches(width_s):
        done = 0
        while done < batch.photons:
            last = min(first + rows, len(start)) - 1
            until = stop[last] if last == len(start) - 1 else start[last + 1]
            here = slice(done, int(np.clip(until - before, done, batch.photons)))
            _count(
                block,
                start[first : last + 1] - before,
                stop[first : last + 1] - before,
                here.start,
                here.stop,
                (bin_of, batch.channel, channel_of),
                bins.start,
            )
            done = here.stop
            if done == batch.photons or last == len(start) - 1:
                break
            yield block.reshape(-1, len(bins))
            first = last + 1
            block = np.zeros((min(rows, len(start) - first), len(inputs), len(bins)), np.uint32)
        before += batch.photons
    while first < len(start):
        yield block.reshape(-1, len(bins))
        first += len(block)
        block = np.zeros((min(rows, len(start) - first), len(inputs), len(bins)), np.uint32)


def photons_before(records: Records, tags: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many photons of a T3 file come before each of these rising sync pulses."""
    found = np.empty(len(tags), np.int64)
    done = before = 0
    for batch, _, _ in records.batches(0.0):
        if batch.photons:
            here = slice(done, int(np.searchsorted(tags, batch.tag[-1], "right")))
            found[here] = before + np.searchsorted(batch.tag, tags[here])
            done, before = here.stop, before + batch.photons
    found[done:] = before
    return found


@njit(cache=True, nogil=True)
def _count(block, start, stop, begin, end, photons, low):  # type: ignore[no-untyped-def]
    """Count photons ``begin`` to ``end`` of a batch into the rows to which they belong."""
    bin_of, channel, channel_of = photons
    bins = block.shape[2]
    for row in range(np.searchsorted(stop, begin, "right"), len(start)):
        if start[row] >= end:
            return
        counts = block[row]
        for i in range(max(begin, start[row]), min(end, stop[row])):
            column, place = channel_of[channel[i]], np.int64(bin_of[i]) - low
            if column >= 0 and 0 <= place < bins:
                counts[column, place] += 1


@njit(cache=True)
def _after_sync(tag, channel, sync, width, bins):  # type: ignore[no-untyped-def]
    """Give each T2 photon its bin after the last sync pulse; -1 to sync pulses, and before the first."""
    for i in range(len(tag)):
        if channel[i] == SYNC_CHANNEL:
            sync, bins[i] = tag[i], -1
        else:
            bins[i] = (tag[i] - sync) // width if sync >= 0 else -1
    return sync


@njit(cache=True)
def _survey(channel, bins, counts, lowest, highest):  # type: ignore[no-untyped-def]
    """Add a batch's photons to those of each input; return how many have no bin."""
    timeless = 0
    for i in range(len(channel)):
        c = channel[i]
        counts[c] += 1
        if 0 <= bins[i] < MOST_BINS:
            lowest[c], highest[c] = min(lowest[c], bins[i]), max(highest[c], bins[i])
        else:
            timeless += 1
    return timeless
