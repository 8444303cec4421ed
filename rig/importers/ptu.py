"""PicoQuant ``.ptu``: time-tagged records of a HydraHarp, whose markers tell the points of a scan.

The file is read twice, in pieces, so that memory does not grow with the photons: first for the markers and
the range of times, then for the photons of each point.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.hydraharp.records import (
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
from rig.errors import DataFileError, UsageError
from rig.files.picoquant import MAGIC_RECORDS, Head
from rig.importers.content import Content
from rig.importers.options import Options
from rig.importers.source import Source
from rig.importers.visits import Visits, visits

NAME = "PicoQuant records"
SIGN = ".ptu with the records of a HydraHarp, MultiHarp or TimeHarp 260"
PARTS = ("TTResultFormat_TTTRRecType", "TTResult_NumberOfRecords")

#: Record types by their number in the head; the last two are those of MultiHarp and its kin.
_FORMATS = {
    0x00010204: T2_VERSION_1,
    0x00010304: T3_VERSION_1,
    0x01010204: T2,
    0x01010304: T3,
    0x00010207: T2,
    0x00010307: T3,
}
#: Records decoded at once, and bytes of counts made at once.
_PIECE, _BLOCK_BYTES = 2**18, 2**25
#: T2 times are as long as the pulses are apart; so many bins must do.
_MOST_BINS = 2**16
#: A gap between markers of so many usual ones lacks some.
_GAP = 1.5


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.head is not None and source.head.magic == MAGIC_RECORDS and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the records: each point's photons become its transient.

    Raises
    ------
    UsageError
        If places, markers or bins are not known and were not given, or do not fit the file.
    DataFileError
        If the records are of another kind, damaged, or lack what a scan needs.
    """
    assert source.head is not None
    records = Records.of(source.head)
    width_s = _bin_width_s(records, options)
    seen = _Survey.of(records, width_s)
    if not seen.photons or not len(seen.mask):
        raise DataFileError(
            f"{source.path} is no scan: it holds {seen.in_words()}. Without "
            f"{'photons' if len(seen.mask) else 'markers'} nothing tells which photons belong to which point"
        )
    plan = visits(source.head, options)
    inputs = _inputs(seen, plan, options, source.path)
    start, stop, told = _points(seen, records, plan)
    low, high = _range(seen, plan, inputs)
    laser_m, detector_m, delay_s = plan.pairs(len(start))
    outside = seen.photons - _between(start, stop)
    if outside:
        told.append(f"{outside:,} of {seen.photons:,} photons lie before or between points, and are left out")
    return Content(
        laser_m=laser_m,
        detector_m=detector_m,
        bins=high - low,
        bin_width_s=width_s,
        first_bin_s=plan.first_bin_s + low * width_s,
        dtype=np.dtype("<u4"),
        blocks=_blocks(records, width_s, inputs, range(low, high), (start, stop)),
        fade_from_s=plan.fade_from_s,
        delay_s=delay_s,
        assumed=(*records.told, *told, *plan.assumed),
    )


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
    format: RecordFormat
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
                f"{head.path} holds records of the type {kind:#010x}, which are not those of a HydraHarp or "
                "a MultiHarp; this program does not know their fields"
            )
        said, there = int(head.number("TTResult_NumberOfRecords")), (head.size - head.end) // 4
        if 0 < said <= there:
            return cls(head, _FORMATS[kind], said, False, ())
        of = f"{said:,}" if said > 0 else "a number that it does not say"
        told = f"the file is cut off: it holds {there:,} whole records of {of}"
        return cls(head, _FORMATS[kind], there, True, (told,))

    def batches(self, width_s: float) -> Iterator[tuple[Batch, NDArray[np.int64]]]:
        """Yield decoded pieces, with each photon's bin: -1 where it has none, as a sync pulse of T2 has not.

        Raises
        ------
        DataFileError
            If the records are damaged.
        """
        decoder, left, sync = Decoder(self.format), self.count, np.int64(-1)
        width = (
            max(1, round(width_s / self.head.number("MeasDesc_GlobalResolution")))
            if not self.format.is_t3
            else 1
        )
        with self.head.path.open("rb") as file:
            file.seek(self.head.end)
            while left:
                piece = np.fromfile(file, "<u4", min(left, _PIECE))
                if not len(piece):
                    raise DataFileError(f"{self.head.path} has become shorter while it was read")
                left -= len(piece)
                try:
                    batch = decoder.decode(piece)
                except DamagedRecordsError as error:
                    raise DataFileError(f"{self.head.path} is damaged: {error}") from None
                if self.format.is_t3:
                    yield batch, batch.dtime.astype(np.int64)
                else:
                    bins = np.empty(batch.photons, np.int64)
                    sync = _after_sync(batch.tag, batch.channel, sync, width, bins)
                    yield batch, bins


@dataclass
class _Survey:
    """What the records hold: markers, and photons of each input.

    Attributes
    ----------
    tag, mask, photon
        (markers,) when, which inputs, and how many photons of the file lie before.
    counts, lowest, highest
        (64,) photons of each input, and their lowest and highest bin.
    syncs, unknown
        Sync pulses of T2, and records that no format describes.
    events
        Photons and sync pulses together.
    """

    tag: NDArray[np.int64]
    mask: NDArray[np.uint8]
    photon: NDArray[np.int64]
    counts: NDArray[np.int64]
    lowest: NDArray[np.int64]
    highest: NDArray[np.int64]
    syncs: int
    unknown: int
    events: int

    @classmethod
    def of(cls, records: Records, width_s: float) -> Self:
        """Read all records once."""
        markers: list[tuple[NDArray, NDArray, NDArray]] = []
        counts, lowest, highest = np.zeros(64, np.int64), np.full(64, _MOST_BINS), np.full(64, -1)
        syncs = unknown = events = 0
        for batch, bins in records.batches(width_s):
            if batch.markers:
                masks = batch.marker_mask.copy()
                markers.append((batch.marker_tag.copy(), masks, batch.marker_photon + events))
            syncs += _survey(batch.channel, bins, counts, lowest, highest)
            unknown, events = unknown + batch.unknown, events + batch.photons
        empty = (np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.int64))
        tag, mask, photon = (np.concatenate(some) for some in zip(empty, *markers, strict=True))
        return cls(tag, mask, photon, counts, lowest, highest, syncs, unknown, events)

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


def _bin_width_s(records: Records, options: Options) -> float:
    """Return the width of a bin: of the instrument in T3, of a person's choice in T2."""
    if records.format.is_t3:
        width_s = float(records.head.number("MeasDesc_Resolution"))
    else:
        width_s = float(
            options.asked("bin_width_s", records.head.path, "how wide bins are to be", "T2 records have none")
        )
        unit_s = float(records.head.number("MeasDesc_GlobalResolution"))
        if unit_s > 0:
            width_s = max(1, round(width_s / unit_s)) * unit_s
    if not 1e-15 < width_s < 1:
        raise DataFileError(
            f"{records.head.path}: bins of {width_s:g} s are none of a photon counter; it is damaged"
        )
    return width_s


def _inputs(seen: _Survey, plan: Visits, options: Options, path: object) -> tuple[int, ...]:
    """Return which inputs are the scan's channels, in the order of its channels."""
    if plan.inputs is not None:
        return plan.inputs
    counting = np.flatnonzero(seen.counts)
    if len(counting) == 1:
        return (int(counting[0]),)
    wanted = options.asked("input", path, f"which input is imaged: it holds {seen.in_words()}")
    if wanted not in counting:
        raise UsageError(f"--input {wanted}: {path} holds {seen.in_words()}")
    return (int(wanted),)


def _range(seen: _Survey, plan: Visits, inputs: tuple[int, ...]) -> tuple[int, int]:
    """Return the first bin, and the one after the last."""
    if plan.bins is not None and 0 < plan.bins <= _MOST_BINS:
        return 0, plan.bins
    low, high = int(seen.lowest[list(inputs)].min()), int(seen.highest[list(inputs)].max()) + 1
    if low >= high:
        raise DataFileError(
            "the input's photons have no time after a sync pulse: T2 needs recorded sync pulses"
        )
    return low, high


def _points(seen: _Survey, records: Records, plan: Visits) -> tuple[NDArray, NDArray, list[str]]:
    """Return where each point's photons begin and end, and what is to be said.

    A point begins at its marker and ends at the next one, of a point or a line; the last ends with the
    records.

    Raises
    ------
    UsageError
        If it is not said which marker is the points'.
    DataFileError
        If there are not as many markers as the plan has points.
    """
    path = records.head.path
    if plan.point_marker is None:
        raise UsageError(
            f"{path} does not say which marker begins a point; give it with --point-marker (it holds "
            f"{seen.in_words()})"
        )
    is_point = seen.mask & 1 << plan.point_marker - 1 != 0
    is_line = np.zeros_like(is_point)
    if plan.line_marker is not None:
        is_line = seen.mask & 1 << plan.line_marker - 1 != 0
        if plan.columns is not None:
            _check_lines(seen, is_point, is_line, plan, records)
    edges = is_point | is_line
    ends = np.append(seen.photon[edges][1:], seen.events)[is_point[edges]]
    begins, tags = seen.photon[is_point], seen.tag[is_point]
    told = [f"{seen.unknown:,} records are of no known kind, and were passed over"] if seen.unknown else []
    if records.truncated and len(begins) and len(begins) <= plan.points:
        whole = len(begins) - 1
        where = plan.place(whole)
        told.append(
            f"the last whole of {plan.points:,} points is the one before {where}; the rest is missing"
        )
        begins, ends = begins[:whole], ends[:whole]
        if not whole:
            raise DataFileError(f"{path} is cut off within its first point: nothing in it is whole")
    elif len(begins) != plan.points:
        raise DataFileError(
            f"{path} holds {len(begins):,} markers of points (marker {plan.point_marker}), but the plan has "
            f"{plan.points:,} points. {_gaps(tags, plan)}"
        )
    return begins, ends, told


def _check_lines(seen: _Survey, is_point: NDArray, is_line: NDArray, plan: Visits, records: Records) -> None:
    """Raise DataFileError, naming line and point, unless each line has its points."""
    columns = plan.columns
    assert columns is not None
    path, rows = records.head.path, plan.points // columns
    line_of_point = np.cumsum(is_line)[is_point] - 1
    lines = int(np.count_nonzero(is_line))
    in_line = np.bincount(line_of_point[line_of_point >= 0], minlength=lines)
    checked = in_line[:-1] if records.truncated else in_line
    for line in np.flatnonzero(checked != columns)[:1]:
        tags = seen.tag[is_point][line_of_point == line]
        gaps = np.append(np.diff(tags), 0)
        late = np.flatnonzero(gaps > _GAP * np.median(gaps))
        after = f" After point {late[0] + 1} of it there is a gap." if len(late) else ""
        raise DataFileError(
            f"{path}: line {line + 1} has {in_line[line]} markers of points (marker {plan.point_marker}) of "
            f"{columns}.{after} The photons of a line without all its markers cannot be told apart"
        )
    if not records.truncated and lines != rows:
        raise DataFileError(
            f"{path} holds {lines} markers of lines (marker {plan.line_marker}), the plan has {rows}"
        )


def _gaps(tags: NDArray[np.int64], plan: Visits) -> str:
    """Say where markers seem to be missing, or to be too many."""
    if len(tags) > plan.points:
        return "There are too many: check --grid, and the marker's hold-off time"
    if len(tags) < 3:
        return "Check --grid and --point-marker"
    gaps = np.diff(tags)
    late = np.flatnonzero(gaps > _GAP * np.median(gaps))
    if not len(late):
        return "They follow one another evenly, so that the first or the last are missing: check --grid"
    return f"The first gap is after {plan.place(int(late[0]))}, where one seems to be missing"


def _between(start: NDArray[np.int64], stop: NDArray[np.int64]) -> int:
    return int((stop - start).sum())


def _blocks(
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
    for batch, bin_of in records.batches(width_s):
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


@njit(cache=True)
def _count(block, start, stop, begin, end, photons, low):  # type: ignore[no-untyped-def]
    """Count photons ``begin`` to ``end`` of a batch into the rows to which they belong."""
    bin_of, channel, channel_of = photons
    row = 0
    for i in range(begin, end):
        while row < len(start) and stop[row] <= i:
            row += 1
        if row == len(start):
            return
        column, place = channel_of[channel[i]], bin_of[i] - low
        if i >= start[row] and column >= 0 and 0 <= place < block.shape[2]:
            block[row, column, place] += 1


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
    """Add a batch's photons to those of each input; return the number of sync pulses."""
    syncs = 0
    for i in range(len(channel)):
        c = channel[i]
        if c == SYNC_CHANNEL:
            syncs += 1
            continue
        counts[c] += 1
        if 0 <= bins[i] < _MOST_BINS:
            lowest[c], highest[c] = min(lowest[c], bins[i]), max(highest[c], bins[i])
    return syncs
