"""Lines out of photons and markers, against a slow way that looks at each photon by itself."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.harp.records import Batch
from drivers.harp.stream import TaggedRecords
from rig.acquire.assembly import Assembler, LineFailed, LineRead, Timing
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.pointing import Pointing
from rig.model.sweep import FRAME, LINE, POINT, Trajectories

SYNC_HZ, TICK_S, BINS = 1e6, 1e-3, 50
TICK = 1000  # sync pulses
INPUTS = (2, 0)


def sweep_of(columns=6, rows=3, order="snake", skip_m=0.0):
    plan = ScanPlan.grid(
        built_in(),
        columns=columns,
        rows=rows,
        order=order,
        skip_m=skip_m,
        motion="continuous",
        exposure_s=TICK_S,
    )
    angles = Pointing((0.0, 0.0, 2.0)).angles_rad(plan.spots_m)
    (sweep,) = Trajectories(plan, angles, 4e-3).sweeps(range(len(plan)))
    return sweep


class Stream:
    """Photons and markers of a sweep, cut into pieces anywhere.

    Parameters
    ----------
    began
        Sync pulse of the first tick.
    clock
        Ticks of the point clock are so many times as long as they should be.
    """

    def __init__(self, sweep, *, rate=0.05, began=777, clock=1.0, seed=0):
        rng = np.random.default_rng(seed)
        ticks = np.flatnonzero(sweep.marks)
        self.marker_tag = np.rint(began + ticks * TICK * clock).astype(np.int64)
        self.marker_mask = sweep.marks[ticks].copy()
        self.length = int(began + (len(sweep.marks) + 5) * TICK * clock)
        self.tag = np.flatnonzero(rng.random(self.length) < rate)
        photons = len(self.tag)
        self.dtime = rng.integers(0, BINS + 5, photons).astype(np.uint16)
        self.channel = rng.choice([0, 1, 2], photons).astype(np.int8)
        self.cuts = np.sort(rng.integers(0, self.length, 40)).tolist()
        self.faults = {}

    def pieces(self):
        for number, (begin, end) in enumerate(pairwise([0, *self.cuts, self.length])):
            photons = slice(*np.searchsorted(self.tag, [begin, end]))
            markers = slice(*np.searchsorted(self.marker_tag, [begin, end]))
            batch = Batch(
                self.tag[photons],
                self.dtime[photons],
                self.channel[photons],
                self.marker_tag[markers],
                self.marker_mask[markers],
                np.searchsorted(self.tag[photons], self.marker_tag[markers]),
            )
            known_to = end // 1024 * 1024
            yield TaggedRecords(np.empty(0, np.uint32), batch, known_to, self.faults.get(number, ()))
        empty = Batch(*(one[:0] for one in (self.tag, self.dtime, self.channel)), *(self.marker_tag[:0],) * 3)
        for _ in range(3):
            yield TaggedRecords(np.empty(0, np.uint32), empty, self.length, ())


def assembled(sweep, stream, lag_s=0.0):
    assembler = Assembler(sweep, Timing(INPUTS, BINS, SYNC_HZ, lag_s))
    found = []
    for piece in stream.pieces():
        for one in assembler.add(piece):
            found.append(one)
            if isinstance(one, LineFailed):
                return found
    assert assembler.done
    return found


def counts_of(sweep, stream, lag):
    """Return (steps, channels, bins), photon by photon."""
    marked = [tag for tag, mask in zip(stream.marker_tag, stream.marker_mask, strict=True) if mask & POINT]
    counts = np.zeros((len(marked), len(INPUTS), BINS), int)
    ends_after = TICK
    for step, begins in enumerate(marked):
        inside = (stream.tag >= begins + lag) & (stream.tag < begins + lag + ends_after)
        for dtime, channel in zip(stream.dtime[inside], stream.channel[inside], strict=True):
            if channel in INPUTS and dtime < BINS:
                counts[step, INPUTS.index(channel), dtime] += 1
    return counts


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["snake", "unidirectional", "progressive"]),
    st.sampled_from([0.0, 0.03]),
    st.integers(0, 3 * TICK),
    st.sampled_from([0.0, 0.002, 0.05, 0.5]),
    st.integers(0, 1000),
)
def test_each_photon_is_in_its_step(order, skip_m, lag, rate, seed):
    sweep = sweep_of(order=order, skip_m=skip_m)
    stream = Stream(sweep, rate=rate, seed=seed)
    found = assembled(sweep, stream, lag / SYNC_HZ)
    assert [one.line for one in found] == list(sweep.lines)
    exposures = [exposure for one in found for exposure in one.exposures]
    expected = counts_of(sweep, stream, lag)
    assert np.array_equal([exposure.counts for exposure in exposures], expected)
    assert [exposure.photons for exposure in exposures] == expected.sum(axis=(1, 2)).tolist()
    assert {exposure.live_time_s for exposure in exposures} == {TICK_S}


def test_what_is_beside_is_counted():
    """Every photon is in a step, beside the steps, or after the last."""
    sweep = sweep_of(columns=9, rows=5, skip_m=0.03)
    stream = Stream(sweep, rate=0.2)
    stream.dtime %= BINS
    stream.channel[:] = 2
    found = assembled(sweep, stream)
    last = stream.marker_tag[-1]  # the end of the last line
    stored = sum(exposure.photons for one in found for exposure in one.exposures)
    assert stored + sum(one.beside for one in found) == np.count_nonzero(stream.tag < last)
    assert all(one.beside > 0 for one in found)


@pytest.mark.parametrize("clock", [0.9999, 1.0001])
def test_a_point_clock_that_is_off_by_much(clock):
    """100 ppm add up to 2 ticks in a sweep of 20,000; each line is counted on from the one before."""
    sweep = sweep_of(columns=100, rows=180)
    assert len(sweep.marks) > 18_000
    stream = Stream(sweep, rate=0.001, clock=clock)
    found = assembled(sweep, stream)
    assert len(found) == len(sweep.lines)
    exposures = [exposure for one in found for exposure in one.exposures]
    points = np.flatnonzero(stream.marker_mask & POINT)
    reach = np.searchsorted(stream.tag, [stream.marker_tag[points], stream.marker_tag[points + 1]])
    kept = np.isin(stream.channel, INPUTS) & (stream.dtime < BINS)
    there = [np.count_nonzero(kept[begin:end]) for begin, end in reach.T]
    assert [exposure.photons for exposure in exposures] == there


def without(stream, tick_of_marker):
    kept = np.arange(len(stream.marker_tag)) != tick_of_marker
    stream.marker_tag, stream.marker_mask = stream.marker_tag[kept], stream.marker_mask[kept]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_missing_marker_fails_its_line_and_is_named(data):
    sweep = sweep_of()
    stream = Stream(sweep)
    ticks = np.flatnonzero(sweep.marks)
    which = data.draw(st.integers(0, len(ticks) - 1))
    without(stream, which)
    *good, last = assembled(sweep, stream)
    assert isinstance(last, LineFailed)
    assert all(isinstance(one, LineRead) for one in good)
    line = next((one for one in sweep.lines if ticks[which] <= one.end), None)
    assert last.line == line
    if which == 0:
        assert "did not come first" in last.reason
    elif ticks[which] == line.end:
        assert "its end" in last.reason
    else:
        assert f"(point {int(np.searchsorted(line.ticks, ticks[which])) + 1})" in last.reason
    assert (
        np.array_equal(
            [exposure.counts for one in good for exposure in one.exposures],
            counts_of(sweep, Stream(sweep), 0)[: line.steps.start],
        )
        or not good
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 20), st.floats(0.05, 0.95), st.integers(1, 15))
def test_a_marker_too_many_fails_its_line(where, part, mask):
    sweep = sweep_of()
    stream = Stream(sweep)
    at = stream.marker_tag[where] + int(part * TICK)
    stream.marker_tag = np.insert(stream.marker_tag, where + 1, at)
    stream.marker_mask = np.insert(stream.marker_mask, where + 1, mask)
    last = assembled(sweep, stream)[-1]
    assert isinstance(last, LineFailed)
    assert "were not planned" in last.reason


@pytest.mark.parametrize("mask", [POINT | LINE, FRAME, LINE, 8])
def test_markers_at_other_inputs(mask):
    sweep = sweep_of()
    stream = Stream(sweep)
    stream.marker_mask[3] = mask
    last = assembled(sweep, stream)[-1]
    assert isinstance(last, LineFailed)
    assert "wrong inputs" in last.reason


def test_a_whole_line_without_markers_is_not_taken_for_the_next():
    sweep = sweep_of()
    stream = Stream(sweep)
    first = sweep.lines[0]
    for _ in range(len(first.steps) + 1):
        without(stream, 1)
    (last,) = assembled(sweep, stream)
    assert isinstance(last, LineFailed)
    assert last.line == first
    assert (
        "7 of 7 markers did not come (point 1, point 2, point 3, point 4, point 5 and 2 more)" in last.reason
    )


@pytest.mark.parametrize("number", range(0, 40, 3))
def test_a_fault_spoils_the_line_that_it_may_belong_to(number):
    """It is told with its piece, the one before or the one after: no line with one of these is given."""
    sweep = sweep_of()
    stream = Stream(sweep)
    stream.faults = {number: ("the sync was lost.",)}
    *good, last = assembled(sweep, stream)
    if isinstance(last, LineRead):  # all was over before
        assert last.line == sweep.lines[-1]
        return
    assert last.reason == "the sync was lost."
    before = [0, *stream.cuts][max(number - 1, 0)]
    ends = [stream.marker_tag[0] + one.line.end * TICK for one in good]
    assert all(end <= before for end in ends)


def test_nothing_is_kept_of_the_memory_that_records_come_in():
    """The instrument's buffers are written to again with the next piece."""
    sweep = sweep_of()
    stream, whole = Stream(sweep), Stream(sweep)
    assembler = Assembler(sweep, Timing(INPUTS, BINS, SYNC_HZ, 0.0))
    found = []
    for piece in stream.pieces():
        batch = replace(piece.batch.copy())
        found += assembler.add(replace(piece, batch=batch))
        for name in ("tag", "dtime", "channel", "marker_tag", "marker_mask"):
            getattr(batch, name)[:] = 0
    counts = [exposure.counts for one in found for exposure in one.exposures]
    assert np.array_equal(counts, counts_of(sweep, whole, 0))
