"""Photons and markers of a sweep, put together to lines; a line counts only if all its markers came."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.model.devices import Records
from rig.model.photons import TaggedExposure
from rig.model.sorting import sort_photons
from rig.model.sweep import FRAME, Line, Sweep

#: A marker may come so far from its tick, in ticks: the clock is even, and a marker exact to one sync pulse.
OUT_OF_STEP = 0.25
#: Markers that are named one by one when they are missing or too many.
MOST_NAMED = 5


@dataclass(frozen=True)
class LineRead:
    """A line whose markers all came.

    Attributes
    ----------
    line
        Which.
    exposures
        What each of its steps gave.
    beside
        Photons since the line before that belong to no step: the mirror turned, or passed what is left out.
    """

    line: Line
    exposures: tuple[TaggedExposure, ...]
    beside: int


@dataclass(frozen=True)
class LineFailed:
    """A line that cannot be trusted. The sweep is given up with it."""

    line: Line
    reason: str


@dataclass(frozen=True)
class Timing:
    """How the timing instrument counts.

    Attributes
    ----------
    inputs
        Of each channel.
    bins
        Photons beyond these are in no histogram.
    sync_hz
        Sync pulses a second.
    lag_s
        By how much the mirror trails its command.
    """

    inputs: tuple[int, ...]
    bins: int
    sync_hz: float
    lag_s: float


class Assembler:
    """Puts the records of one sweep together.

    The first marker says when the sweep began. From it each tick is counted on by the sync rate, which each
    line with all its markers measures anew: the point clock need not be exact.

    Parameters
    ----------
    sweep
        What is under way.
    timing
        How the instrument counts.
    """

    def __init__(self, sweep: Sweep, timing: Timing) -> None:
        self._sweep = sweep
        self._timing = timing
        self._tick = timing.sync_hz * sweep.tick_s  # sync pulses a tick
        self._lag = timing.lag_s * timing.sync_hz
        self._began: int | None = None
        self._number = 0  # of the line that comes next
        self._photons = [(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.int8))]
        self._markers: list[tuple[NDArray[np.int64], NDArray[np.uint8]]] = []
        self._whole_to = self._next_whole_to = 0

    @property
    def done(self) -> bool:
        """Whether all lines were read."""
        return self._number == len(self._sweep.lines)

    @property
    def line(self) -> Line:
        """The line that comes next."""
        return self._sweep.lines[min(self._number, len(self._sweep.lines) - 1)]

    def add(self, records: Records) -> Iterator[LineRead | LineFailed]:
        """Take records, and yield the lines that are complete with them; nothing after one that failed."""
        # a fault may belong to the records before those with which it is told
        self._whole_to, self._next_whole_to = self._next_whole_to, records.complete_to
        batch = records.batch
        if len(batch.tag):
            self._photons.append((batch.tag.copy(), batch.dtime.copy(), batch.channel.copy()))
        if len(batch.marker_tag):
            self._markers.append((batch.marker_tag.copy(), batch.marker_mask.copy()))
        if records.faults and not self.done:
            yield LineFailed(self.line, " ".join(records.faults))
            return
        if self._began is None and self._markers and (failed := self._begin()):
            yield failed
            return
        while not self.done and self._began is not None and self._is_complete():
            found = self._read()
            yield found
            if isinstance(found, LineFailed):
                return
            self._number += 1

    def _begin(self) -> LineFailed | None:
        tags, masks = self._markers[0]
        if masks[0] != FRAME:
            return LineFailed(self.line, "the marker of the mirror's start did not come first.")
        self._began = int(tags[0])
        self._markers[0] = tags[1:], masks[1:]
        return None

    def _at(self, tick: NDArray[np.int64] | int) -> NDArray[np.float64]:
        """Return the sync pulse of a tick."""
        assert self._began is not None
        return self._began + np.asarray(tick) * self._tick

    def _is_complete(self) -> bool:
        needed = self._at(self.line.end) + self._lag + OUT_OF_STEP * self._tick
        return bool(self._whole_to > needed)

    def _read(self) -> LineRead | LineFailed:
        line = self.line
        tags, masks = self._take_markers(line)
        if reason := self._unfit(line, tags, masks):
            return LineFailed(line, reason)
        self._tick = (tags[-1] - self._began) / line.end
        begins, passed_on = tags[:-1], np.diff(line.ticks, append=line.end) == 1
        ends = np.where(passed_on, tags[1:], begins + round(self._tick))
        return self._sorted(line, np.stack([begins, ends], axis=1) + round(self._lag))

    def _take_markers(self, line: Line) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Take away the markers up to the end of a line."""
        tags, masks = (np.concatenate(one) for one in zip(*self._markers, strict=True))
        count = int(np.searchsorted(tags, self._at(line.end) + (1 - OUT_OF_STEP) * self._tick))
        self._markers = [(tags[count:], masks[count:])]
        return tags[:count], masks[:count]

    def _unfit(self, line: Line, tags: NDArray[np.int64], masks: NDArray[np.uint8]) -> str:
        """Say what is wrong with the markers of a line; nothing if they are as planned."""
        planned = np.append(line.ticks, line.end)
        place = (tags - self._at(0)) / self._tick
        ticks = np.rint(place).astype(np.int64)
        number = f"line {self._number + 1} of this sweep: "
        missing = np.flatnonzero(~np.isin(planned, ticks))
        if len(missing):
            names = [f"point {one + 1}" if one < len(line.ticks) else "its end" for one in missing]
            return f"{number}{len(missing)} of {len(planned)} markers did not come ({_few(names)})."
        _, first = np.unique(ticks, return_index=True)
        extra = np.setdiff1d(np.arange(len(ticks)), first)
        strange = np.union1d(extra, np.flatnonzero(~np.isin(ticks, planned)))
        if len(strange):
            names = [f"at tick {place[one]:.2f}" for one in strange]
            return f"{number}{len(strange)} markers came that were not planned ({_few(names)})."
        if (masks != self._sweep.marks[planned]).any():
            return f"{number}markers came at the wrong inputs: check their cables."
        if (late := np.abs(place - ticks).max()) > OUT_OF_STEP:
            return f"{number}a marker came {late:.2f} ticks away from its planned time."
        return ""

    def _sorted(self, line: Line, edges: NDArray[np.int64]) -> LineRead:
        tag, dtime, channel = (np.concatenate(one) for one in zip(*self._photons, strict=True))
        timing = self._timing
        found = sort_photons(tag, dtime, channel, edges.ravel(), timing.inputs, timing.bins)
        self._photons = [(tag[found.taken :], dtime[found.taken :], channel[found.taken :])]
        ends = np.cumsum(found.counts.sum(axis=1))[::2]  # every other window is what lies between two steps
        of_step = found.counts[::2]
        sizes = of_step.sum(axis=1)
        live_s = np.diff(edges, axis=1).ravel() / timing.sync_hz
        exposures = tuple(
            TaggedExposure(found.photon_bins[end - size : end], counts, timing.bins, live)
            for end, size, counts, live in zip(
                ends.tolist(), sizes.tolist(), of_step, live_s.tolist(), strict=True
            )
        )
        return LineRead(line, exposures, found.taken - int(sizes.sum()))


def warm_up() -> None:
    """Let what sorts photons be compiled, which takes seconds the first time, before there is light."""
    nothing = np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.int8)
    sort_photons(*nothing, np.array([0, 1]), (0,), 1)


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:MOST_NAMED])
    return shown + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
