"""Time-tagged records of a HydraHarp and its kin, decoded and encoded in bulk.

A record is 32 bits, little endian (source: the vendor's description of the formats and its demos):

    bits        31        30..25     24..10       9..0
    T3          special   channel    dtime        nsync      nsync counts sync pulses, modulo 1024
    T2          special   channel    time tag (24..0)        in base resolutions (1 ps), modulo a period

    special  channel   what it is
    0        input     a photon
    1        63        overflow: the tag's counter has wrapped, or so many times as the tag field says
    1        1 to 15   markers, a bit each; several inputs may come in one record
    1        0         T2 only: a sync pulse

Version 1 of the records says one wrap a record, and wraps in T2 after 33,552,000; version 2 wraps after 2^25,
and puts the number of wraps into the tag's field, where 0 means 1. The generic records of a MultiHarp are
those of version 2.

    decoder = Decoder(T3)
    while reading:
        batch = decoder.decode(buffer)   # any piece of the stream, uint32; the next piece continues
        batch.tag, batch.dtime, batch.channel           a row for each photon
        batch.marker_tag, batch.marker_mask, batch.marker_photon        a row for each marker record

The records of a PicoHarp 300 and of older TimeHarps have other fields, and are not read here.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Channel of a sync pulse, which T2 records like a photon.
SYNC_CHANNEL = -1
#: Largest dtime of a record; a longer one is not recorded by the instrument.
MAX_DTIME = 0x7FFF
#: Highest input that a record can name (channel 63 is the overflow's).
MAX_CHANNEL = 62
#: Tags reach at most this far (100 hours in picoseconds are 3.6e17); damage could count beyond int64.
MAX_TAG = 1 << 62

_SPECIAL = 1 << 31
_OVERFLOW = 63


@dataclass(frozen=True)
class RecordFormat:
    """How the 32 bits of a record are read.

    Attributes
    ----------
    tag_bits
        Width of the tag's field.
    period
        What one wrap of the tag stands for.
    counts_wraps
        Whether an overflow record says how many wraps it stands for (version 2).
    """

    tag_bits: int
    period: int
    counts_wraps: bool

    @property
    def is_t3(self) -> bool:
        """Whether tags count sync pulses, and a photon has a time after its pulse."""
        return self.tag_bits == 10

    @property
    def most_wraps(self) -> int:
        """How many wraps one overflow record can stand for."""
        return (1 << self.tag_bits) - 1 if self.counts_wraps else 1


T3 = RecordFormat(tag_bits=10, period=1024, counts_wraps=True)
T2 = RecordFormat(tag_bits=25, period=1 << 25, counts_wraps=True)
T3_VERSION_1 = RecordFormat(tag_bits=10, period=1024, counts_wraps=False)
T2_VERSION_1 = RecordFormat(tag_bits=25, period=33_552_000, counts_wraps=False)


class DamagedRecordsError(ValueError):
    """Raised when overflow records count further than any measurement lasts, which only damage can do."""


@dataclass(frozen=True)
class Batch:
    """What a piece of a record stream says, in the order of the stream.

    Attributes
    ----------
    tag
        (photons,) int64. T3: index of the sync pulse since the start; T2: base resolutions since the start.
    dtime
        (photons,) uint16, time bins after that sync pulse; 0 in T2.
    channel
        (photons,) int8, input from 0; `SYNC_CHANNEL` for a sync pulse in T2.
    marker_tag
        (markers,) int64, as ``tag``.
    marker_mask
        (markers,) uint8, inputs that were marked: M1 is 1, M2 is 2, M3 is 4, M4 is 8; several may be set.
    marker_photon
        (markers,) int64, how many photons of this batch lie before the marker in the stream.
    overflows
        Wraps of the tag that the piece contained.
    unknown
        Records that no format describes.
    """

    tag: NDArray[np.int64]
    dtime: NDArray[np.uint16]
    channel: NDArray[np.int8]
    marker_tag: NDArray[np.int64]
    marker_mask: NDArray[np.uint8]
    marker_photon: NDArray[np.int64]
    overflows: int = 0
    unknown: int = 0

    @property
    def photons(self) -> int:
        """Number of photons, and in T2 of sync pulses."""
        return len(self.tag)

    @property
    def markers(self) -> int:
        """Number of marker records."""
        return len(self.marker_tag)

    def copy(self) -> "Batch":
        """Return a batch that stays as it is when the decoder goes on."""
        return Batch(
            self.tag.copy(),
            self.dtime.copy(),
            self.channel.copy(),
            self.marker_tag.copy(),
            self.marker_mask.copy(),
            self.marker_photon.copy(),
            self.overflows,
            self.unknown,
        )


class Decoder:
    """Decodes a record stream that comes in pieces, cut anywhere between records.

    Attributes
    ----------
    format
        How the records are read.
    base
        What the wraps so far add to a record's tag.
    """

    def __init__(self, record_format: RecordFormat) -> None:
        self.format = record_format
        self.base = 0
        self._photons = _photon_arrays(0)
        self._markers = _marker_arrays(0)

    def decode(self, buffer: NDArray[np.uint32]) -> Batch:
        """Decode the next piece of the stream.

        Parameters
        ----------
        buffer
            (records,) uint32; it is read only, and may be reused afterwards.

        Returns
        -------
        Batch
            Views of memory that the next call writes to again: use it before, or copy it.

        Raises
        ------
        DamagedRecordsError
            When tags exceed `MAX_TAG`.
        ValueError
            When the buffer is no one-dimensional array of uint32.
        """
        if buffer.ndim != 1 or buffer.dtype != np.uint32:
            raise ValueError(f"records are (n,) uint32, not {buffer.shape} {buffer.dtype}")
        self._make_room(len(buffer))
        fmt = self.format
        base, photons, markers, overflows, unknown = _decode(
            buffer, self.base, fmt.tag_bits, fmt.period, fmt.counts_wraps, self._photons, self._markers
        )
        if base > MAX_TAG:
            raise DamagedRecordsError("the overflow records count on beyond the longest measurement")
        self.base = base
        tag, dtime, channel = self._photons
        marker_tag, marker_mask, marker_photon = self._markers
        return Batch(
            tag[:photons],
            dtime[:photons],
            channel[:photons],
            marker_tag[:markers],
            marker_mask[:markers],
            marker_photon[:markers],
            overflows,
            unknown,
        )

    def _make_room(self, records: int) -> None:
        """Have memory for as many photons, or markers, as there are records, and one that is overwritten."""
        if len(self._photons[0]) <= records:
            self._photons = _photon_arrays(records + 1)
            self._markers = _marker_arrays(records + 1)


class Encoder:
    """Writes batches as a record stream, in version 2; the inverse of `Decoder`.

    Parameters
    ----------
    record_format
        `T3` or `T2`.

    Attributes
    ----------
    last
        Tag of the last photon or marker that was encoded.
    """

    def __init__(self, record_format: RecordFormat) -> None:
        if not record_format.counts_wraps:
            raise ValueError("records of version 1 are read, not written")
        self.format = record_format
        self.last = 0

    def encode(self, batch: Batch) -> NDArray[np.uint32]:
        """Return the records of a batch, with overflow records where tags wrap.

        Parameters
        ----------
        batch
            In the order of the stream: tags of photons and markers together must not fall.

        Returns
        -------
        NDArray
            (records,) uint32, new memory.

        Raises
        ------
        ValueError
            When tags fall, or a dtime, a channel or a mask does not fit its field.
        """
        fmt = self.format
        if (reason := self._unfit(batch)) is not None:
            raise ValueError(reason)
        photons = batch.tag, batch.dtime, batch.channel
        markers = batch.marker_tag, batch.marker_mask, batch.marker_photon
        nothing = np.empty(0, np.uint32)
        records, _ = _encode(photons, markers, self.last, fmt.tag_bits, fmt.most_wraps, nothing)
        if records < 0:
            raise ValueError("times decrease: photons and markers must be in order of time")
        encoded = np.empty(records, np.uint32)
        _, self.last = _encode(photons, markers, self.last, fmt.tag_bits, fmt.most_wraps, encoded)
        return encoded

    def _unfit(self, batch: Batch) -> str | None:
        """Say what does not fit into a record."""
        lowest = 0 if self.format.is_t3 else SYNC_CHANNEL
        longest = MAX_DTIME if self.format.is_t3 else 0
        if batch.photons and not lowest <= batch.channel.min() <= batch.channel.max() <= MAX_CHANNEL:
            return f"a channel is outside {lowest} to {MAX_CHANNEL}"
        if batch.photons and batch.dtime.max() > longest:
            return f"a dtime of {batch.dtime.max()} bins is above {longest}"
        if batch.markers and not 1 <= batch.marker_mask.min() <= batch.marker_mask.max() <= 15:
            return "a marker's mask is outside 1 to 15"
        places = batch.marker_photon
        if batch.markers and (places[0] < 0 or places[-1] > batch.photons or (np.diff(places) < 0).any()):
            return "markers do not lie between the photons of their batch, in order"
        return None


_PhotonArrays = tuple[NDArray[np.int64], NDArray[np.uint16], NDArray[np.int8]]
_MarkerArrays = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64]]


def _photon_arrays(size: int) -> _PhotonArrays:
    return np.empty(size, np.int64), np.empty(size, np.uint16), np.empty(size, np.int8)


def _marker_arrays(size: int) -> _MarkerArrays:
    return np.empty(size, np.int64), np.empty(size, np.uint8), np.empty(size, np.int64)


@njit(cache=True, nogil=True)
def _decode(records, base, tag_bits, period, counts_wraps, photon_arrays, marker_arrays):  # type: ignore[no-untyped-def]
    """Decode into the arrays; return the new base, and how many photons, markers, wraps and unknown records.

    Each record is written as a photon first, and the place is kept only where it was one: photons are by far
    the most, and so take no branch that the processor could guess wrongly.
    """
    tag, dtime, channel = photon_arrays
    marker_tag, marker_mask, marker_photon = marker_arrays
    tag_mask = (np.int64(1) << tag_bits) - 1
    dtime_mask = np.int64(0x7FFF) if tag_bits == 10 else np.int64(0)
    sync_code = np.int64(0) if tag_bits == 25 else np.int64(-1)
    photons = markers = overflows = unknown = 0
    for i in range(len(records)):
        record = np.int64(records[i])
        count = record & tag_mask
        code = (record >> 25) & 63
        tag[photons] = base + count
        dtime[photons] = (record >> 10) & dtime_mask
        channel[photons] = code
        if record < _SPECIAL:
            photons += 1
        elif code == _OVERFLOW:
            wraps = max(count, 1) if counts_wraps else 1
            overflows += wraps
            base += wraps * period
            if base > MAX_TAG:
                break
        elif 1 <= code <= 15:
            marker_tag[markers] = base + count
            marker_mask[markers] = code
            marker_photon[markers] = photons
            markers += 1
        elif code == sync_code:
            channel[photons] = SYNC_CHANNEL
            photons += 1
        else:
            unknown += 1
    return base, photons, markers, overflows, unknown


@njit(cache=True, nogil=True)
def _encode(photon_arrays, marker_arrays, last, tag_bits, most_wraps, records):  # type: ignore[no-untyped-def]
    """Write the records if there is room; return their number (-1: tags fall) and the last tag."""
    tag, dtime, channel = photon_arrays
    marker_tag, marker_mask, marker_photon = marker_arrays
    written = len(records) > 0
    n, photon, marker = 0, 0, 0
    while photon < len(tag) or marker < len(marker_tag):
        is_marker = marker < len(marker_tag) and marker_photon[marker] <= photon
        here = marker_tag[marker] if is_marker else tag[photon]
        if here < last:
            return -1, last
        wraps = (here >> tag_bits) - (last >> tag_bits)
        last = here
        while wraps > 0:
            several = min(wraps, most_wraps)
            if written:
                records[n] = _SPECIAL | (_OVERFLOW << 25) | several
            wraps -= several
            n += 1
        if is_marker:
            code = np.int64(_SPECIAL) | (np.int64(marker_mask[marker]) << 25)
            marker += 1
        else:
            is_sync = channel[photon] == SYNC_CHANNEL
            code = np.int64(_SPECIAL) if is_sync else np.int64(channel[photon]) << 25
            code |= np.int64(dtime[photon]) << 10
            photon += 1
        if written:
            records[n] = code | (here & ((1 << tag_bits) - 1))
        n += 1
    return n, last
