"""Continuous scans through the real drivers and the simulated wires: whole, disturbed, taken up again."""

import json
import re
from contextlib import ExitStack

import numpy as np
import pytest

from drivers.errors import DeviceError
from rig.acquire.acquisition import Watch, acquire, record, resume
from rig.acquire.connect import devices_on
from rig.acquire.events import LineDone, Noticed, Outcome, Recorded, StepDone
from rig.bench.simulated import simulated_instruments
from rig.errors import DoubtError
from rig.files import ScanFile
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.simulated_wires import wires_to

CONFIG = built_in_with({"simulation": {"seed": 5}, "calibration": {"use": False}})
COLUMNS, ROWS = 24, 8


def plan_of(motion="continuous", config=CONFIG, **changes):
    asked = {
        "columns": COLUMNS,
        "rows": ROWS,
        "spacing_m": 0.05,
        "exposure_s": 2e-3,
        "skip_m": 0.0,
        **changes,
    }
    return ScanPlan.grid(config, motion=motion, **asked)


class Rig:
    """Devices on a simulated bench, all of which can be reached behind the drivers' backs."""

    def __init__(self, config=CONFIG):
        self.config = config
        self._stack = ExitStack()

    def __enter__(self):
        self.bench, instruments = simulated_instruments(self.config)
        self.bench.warm_up()
        self._stack.enter_context(instruments)
        self.instruments = instruments
        self.harp = instruments._harp.instrument
        wires = wires_to(self.config, self.bench, instruments)
        self.devices = self._stack.enter_context(devices_on(self.config, wires, tagged=True))
        return self

    def __exit__(self, *error):
        return self._stack.__exit__(*error)


def totals(path):
    with ScanFile(path) as scan:
        return scan.counts(range(scan.steps)).sum(axis=(1, 2), dtype=np.int64)


def test_a_scan_has_all_positions_with_their_photons(tmp_path):
    """As many as a scan that rests at each position, within statistics, and told as photons."""
    done = acquire(plan_of(), RigState(CONFIG), tmp_path / "a.h5")
    assert done.ended.outcome is Outcome.COMPLETE
    acquire(plan_of("step"), RigState(CONFIG), tmp_path / "b.h5")
    moving, resting = totals(tmp_path / "a.h5"), totals(tmp_path / "b.h5")
    assert done.photons == moving.sum()
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.tagged
        assert scan.status == "complete"
        assert scan.live_time_s == pytest.approx(2e-3, abs=2e-7)  # two sync pulses
        assert {note.kind for note in scan.events} == {"light", "turns", "bias"}
        assert "point_clock" in scan.devices
    # Poisson, and 0.1 % for the light between positions, which changes smoothly
    expected = resting.sum()
    assert abs(moving.sum() - expected) < 5 * np.sqrt(2 * expected) + 1e-3 * expected
    # position by position: the light of 5 cm of wall, where it is not even, is 5 % more or less at most
    assert np.abs(moving - resting).max() < 6 * np.sqrt(2 * resting.max()) + 0.05 * resting.max()


@pytest.mark.parametrize("order", ["unidirectional", "progressive"])
def test_other_orders(tmp_path, order):
    plan = plan_of(order=order, frames=2)
    assert acquire(plan, RigState(CONFIG), tmp_path / "a.h5").ended.outcome is Outcome.COMPLETE
    first, second = totals(tmp_path / "a.h5").reshape(2, -1)
    assert not np.array_equal(first, second)
    assert abs(first.sum() - second.sum()) < 5 * np.sqrt(first.sum() + second.sum())


def test_records_come_before_their_lines_and_lines_before_they_are_done(tmp_path):
    seen = []
    acquire(plan_of(), RigState(CONFIG), tmp_path / "a.h5", Watch([lambda event: seen.append(type(event))]))
    assert seen.index(Recorded) < seen.index(StepDone) < seen.index(LineDone)
    assert seen.count(StepDone) == COLUMNS * ROWS
    assert seen.count(LineDone) >= 1


def interrupted_after(steps, tmp_path):
    done = 0

    def count(event):
        nonlocal done
        done += isinstance(event, StepDone)

    watch = Watch([count], lambda: done >= steps)
    ended = acquire(plan_of(), RigState(CONFIG), tmp_path / "a.h5", watch).ended
    assert ended.outcome is Outcome.INTERRUPTED
    return ended.steps_done


@pytest.mark.parametrize("steps", [1, 3 * COLUMNS, (ROWS - 1) * COLUMNS])
def test_stopped_and_taken_up_again(tmp_path, steps):
    """Whole lines are kept, untouched; the rest is measured."""
    kept = interrupted_after(steps, tmp_path)
    assert kept % COLUMNS == 0
    assert kept >= steps
    before = totals(tmp_path / "a.h5")
    assert not before[kept:].any()
    assert resume(plan_of(), RigState(CONFIG), tmp_path / "a.h5").ended.outcome is Outcome.COMPLETE
    after = totals(tmp_path / "a.h5")
    assert np.array_equal(before[:kept], after[:kept])
    assert after.min() > 0


def disturbed(rig, target, at, what, mend=None):
    """Scan; after so many positions something happens. Return what was noticed, and the failure if any."""
    noticed, done = [], 0

    def look(event):
        nonlocal done
        if isinstance(event, Noticed) and event.kind == "warning":
            noticed.append(event)
            if mend is not None:
                mend()
        if isinstance(event, StepDone):
            done += 1
            if done == at:
                what()

    try:
        record(plan_of(), RigState(rig.config), rig.devices, target, Watch([look]))
    except Exception as error:
        return noticed, error
    return noticed, None


def test_the_interlock_opens(tmp_path):
    """Lines that ended after the light was last seen are taken back."""
    with Rig() as rig:
        _, error = disturbed(
            rig, tmp_path / "a.h5", 3 * COLUMNS, lambda: rig.bench.change_light(emitting=False)
        )
        assert isinstance(error, DoubtError | DeviceError), error
        assert not rig.bench.light.emitting
        assert not rig.bench.light.sensitive
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.sum() <= 3 * COLUMNS
        assert scan.counts(range(scan.steps))[scan.done].sum(axis=(1, 2)).min(initial=99) > 20


def test_a_memory_that_is_full_ends_the_scan_and_not_the_file(tmp_path):
    with Rig() as rig:

        def clog():
            rig.harp.fifo.link_hz = 1.0
            rig.harp.fifo.capacity = 2000

        _, error = disturbed(rig, tmp_path / "a.h5", 2 * COLUMNS, clog)
        assert isinstance(error, DoubtError)
        assert "buffer was full" in str(error)
        assert not rig.bench.light.emitting
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.sum() % COLUMNS == 0
    assert resume(plan_of(), RigState(CONFIG), tmp_path / "a.h5").ended.outcome is Outcome.COMPLETE


def test_a_line_that_fails_each_time_ends_the_scan(tmp_path):
    with Rig() as rig:
        board = rig.instruments.daq
        board.lost_marks = {
            3 * COLUMNS
        }  # in the third line, and then in the first of each sweep that follows

        def spoil():
            board.lost_marks = {10}

        noticed, error = disturbed(rig, tmp_path / "a.h5", -1, spoil, spoil)
        assert isinstance(error, DoubtError)
        assert "a line failed 3 times" in str(error)
        assert "did not come (point" in str(error)
        assert len(noticed) == 3
        assert not rig.bench.light.emitting
    with ScanFile(tmp_path / "a.h5") as scan:
        assert 2 * COLUMNS <= scan.done.sum() < COLUMNS * ROWS


def test_without_a_point_clock_nothing_begins(tmp_path, rig):
    (tmp_path / "rig.toml").write_text("[simulation]\nseed = 1\n")
    done = rig("scan", "--config", "rig.toml", "--mode", "continuous", "--out", "a.h5")
    assert done.code == 4, done
    assert "[point_clock]" in done.err
    assert not (tmp_path / "a.h5").exists()


def test_the_loading_of_the_mirror_is_told_before_and_meanwhile_in_the_same_words(tmp_path, rig):
    """60 x 20 positions, three between each two lines, four to set off and four to stop."""
    small = ("--grid", "60x20", "--spacing", "2cm", "--exposure", "1ms", "--mode", "continuous")
    dry = rig("scan", *small, "--dry-run")
    words = re.search(r"one sweep: (1,265 positions are loaded into the mirror; .*1\.17 s)", dry.out)
    assert words, dry.out
    plan = json.loads(rig("scan", *small, "--dry-run", "--json").out)
    assert plan["sweeps"] == 1
    assert plan["loading_s"] == pytest.approx(1265 * 0.922e-3, rel=0.01)
    done = rig("scan", *small, "--out", "a.h5")
    assert done.code == 0, done.err
    assert words[1] in done.err
    with ScanFile(tmp_path / "a.h5") as scan:
        (note,) = [note for note in scan.events if note.kind == "loading"]
    assert note.sentence == words[1]
    assert (note.first, note.last) == (0, scan.steps - 1)


def test_from_the_command_line_to_the_image(tmp_path, rig):
    asked = ("--exposure", "1ms", "--grid", "60x44", "--spacing", "3cm", "--out", "a.h5")
    done = rig("scan", "--mode", "continuous", *asked)
    assert done.code == 0, done.err
    made = rig("recon", "a.h5")
    assert made.code == 0, made.err
    assert (tmp_path / "a.png").exists()
