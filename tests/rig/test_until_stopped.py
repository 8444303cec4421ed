"""Frames that go on until somebody stops the scan: a file that grows, and what is done with it."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import count

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_scan_file_interrupted import At
from test_scan_file_tagged import BINS, Model, create

from rig.acquire.acquisition import Watch, acquire, interrupted, resume
from rig.acquire.events import Grown, Noticed, Outcome, StepDone
from rig.errors import DataFileError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.files.journal import Journal, Kind, journal_of
from rig.files.outline import ScanOutline
from rig.live.messages import Block, Gap
from rig.live.state import LiveState, Subject
from rig.model import plan as plan_model
from rig.model.config import built_in, built_in_with
from rig.model.plan import MORE_FRAMES, Pass, ScanPlan
from rig.model.state import RigState
from support.thorough import THOROUGH

PLAN = ScanPlan.grid(
    built_in(), columns=3, rows=2, skip_m=0.0, frames=2, until_stopped=True, motion="continuous"
)
SIZE = 6


def described(channels=1, plan=PLAN):
    return ScanDescription(
        plan.spots_m, np.zeros((1, channels, 3)), BINS, 4e-12, 0.0, tagged=True, plan=plan,
        mirror_rad=plan.spots_m[:, :2] / 2,
    )  # fmt: skip


def assert_positions(scan, frames):
    """As many frames as planned, each of the same positions."""
    assert (scan.frames, scan.steps) == (frames, frames * SIZE)
    assert scan.plan.endless
    np.testing.assert_array_equal(scan.laser_m, np.tile(PLAN.spots_m[:SIZE], (frames, 1)))
    np.testing.assert_array_equal(scan.mirror_rad, scan.laser_m[:, :2] / 2)


actions = st.lists(
    st.one_of(
        st.tuples(st.just("append"), st.sampled_from([0, 1, 5, 16, 40])),
        st.tuples(st.just("checkpoint"), st.just(0)),
        st.tuples(st.just("withdraw"), st.integers(0, 4 * SIZE)),
        st.tuples(st.just("resume"), st.just(0)),
        st.tuples(st.just("grow"), st.just(0)),
    ),
    max_size=60,
)


@settings(max_examples=20)
@given(actions, st.sampled_from([1, 2]), st.sampled_from([8, 64]), st.integers(0, 99))
def test_whatever_is_done_a_file_that_grows_holds_what_was_given(
    tmp_path_factory, todo, channels, chunk, seed
):
    """Also as another program sees it meanwhile, and from its journal alone, as after a crash."""
    folder = tmp_path_factory.mktemp("any")
    path, model, plan = folder / "scan.h5", Model(channels, seed), PLAN
    writer = create(path, described(channels), chunk)
    for action, number in todo:
        if action == "append" and writer.appended < writer.steps:
            writer.append_photons(*model.step(number), 0.01)
        elif action == "checkpoint":
            writer.checkpoint()
            shutil.copy2(path, folder / "copy.h5")
            model.assert_marked_in(folder / "copy.h5")
            shutil.copy2(journal_of(path), journal_of(folder / "copy.h5"))
            with ScanFile(folder / "copy.h5") as scan:
                assert_positions(scan, plan.frames)
                assert np.flatnonzero(scan.done).tolist() == list(range(len(model.photons)))
            with ScanOutline(folder / "copy.h5") as outline:  # from the journal, without photons
                assert outline.plan == plan
                assert np.flatnonzero(outline.marked).tolist() == list(range(len(model.photons)))
        elif action == "withdraw":
            writer.withdraw(number)
            model.cut(number)
        elif action == "grow" and plan.frames < 32:
            plan = plan.longer(10**6)
            writer.grow(plan)
        elif action == "resume":
            writer.close("interrupted")
            model.assert_in(path)
            writer = ScanWriter.resume(path)
        assert (writer.appended, writer.steps) == (len(model.photons), len(plan))
    writer.close("interrupted")
    model.assert_in(path)
    with ScanFile(path) as scan:
        assert_positions(scan, plan.frames)
        assert scan.photons == sum(map(len, model.photons))
        assert not scan.altered.any()
        measured = len(model.photons)
        np.testing.assert_array_equal(scan.counts(range(scan.steps))[:measured], model.counts(measured))
        assert scan.whole_frames.tolist() == list(range(measured // SIZE))


def test_an_interrupt_at_any_line_of_growing_loses_nothing(tmp_path):
    """The file can be read, with or without the new frames, and taken up again."""
    for number in count(0, 1 if THOROUGH else 3):
        path, model = tmp_path / f"{number}.h5", Model(1, 5)
        writer = create(path, described(), 16)
        for _ in range(7):
            writer.append_photons(*model.step(20), 0.01)
        writer.checkpoint()
        at = At(number)
        try:
            sys.settrace(at)
            writer.grow(PLAN.longer(10**6))
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(None)
        writer.close("failed", "interrupted")
        with ScanFile(path) as scan:
            assert_positions(scan, scan.frames)
            assert scan.frames in (2, 4)
            assert np.flatnonzero(scan.done).tolist() == list(range(7))
            np.testing.assert_array_equal(scan.counts(range(scan.steps))[:7], model.counts(7))
        with ScanWriter.resume(path) as again:
            again.append_photons(*model.step(20), 0.01)
        model.assert_in(path)
        if len(at.places) <= number:  # it had grown before that line
            break
    assert number > 40


def test_a_file_of_a_plan_with_an_end_does_not_grow(tmp_path):
    ended = ScanPlan(passes=(PLAN.passes[0].model_copy(update={"until_stopped": False}),))
    with (
        ScanWriter.create(tmp_path / "a.h5", described(plan=ended)) as writer,
        pytest.raises(ValueError, match="was made for 12 steps: it cannot grow"),
    ):
        writer.grow(PLAN.longer(10**6))
    with h5py.File(tmp_path / "a.h5") as file:  # stored as ever
        assert file["geometry/laser_m"].chunks is None


def test_plans_grow_by_a_bounded_number_of_frames_up_to_what_a_file_holds(monkeypatch):
    frames, plan = [], PLAN
    while plan is not None:
        frames.append(plan.frames)
        plan = plan.longer(1000)
    assert frames == [2, 4, 8, 16, 32, 64, 128, 166]  # 1000 // 6
    assert max(np.diff(frames)) == MORE_FRAMES
    monkeypatch.setattr(plan_model, "MAX_STEPS", 20)
    assert PLAN.longer(1000).frames == 3


def test_only_continuous_scans_of_one_pass_have_no_last_frame():
    step = PLAN.passes[0].model_dump() | {"motion": "step"}
    with pytest.raises(ValueError, match="need a continuous scan of one pass only"):
        ScanPlan(passes=(Pass(**step),))
    with pytest.raises(ValueError, match="need a continuous scan of one pass only"):
        ScanPlan(passes=(PLAN.passes[0], PLAN.passes[0]))


CONFIG = built_in_with({"simulation": {"seed": 5}, "calibration": {"use": False}})
SCANNED = ScanPlan.grid(
    CONFIG, columns=12, rows=3, spacing_m=0.05, skip_m=0.0, exposure_s=1e-3, motion="continuous",
    frames=2, until_stopped=True,
)  # fmt: skip


def stopped_after(steps, seen):
    def look(event):
        seen.append(event)

    def stop():
        return sum(isinstance(one, StepDone) for one in seen) >= steps and "enough"

    return Watch([look], stop)


def test_frame_after_frame_until_stopped_and_on_from_there(tmp_path):
    """The light stays on from frame to frame; what was measured is whole, frame by frame."""
    path, seen = tmp_path / "a.h5", []
    done = acquire(SCANNED, RigState(CONFIG), path, stopped_after(5 * 36, seen))
    assert (done.ended.outcome, done.ended.reason) == (Outcome.INTERRUPTED, "enough")
    assert [one.plan.frames for one in seen if isinstance(one, Grown)] == [4, 8]
    with ScanFile(path) as scan:
        assert scan.frames == 8
        assert 5 <= len(scan.whole_frames) < 8
        assert sum(note.kind == "light" for note in scan.events) == 2  # on once, off once
        before = scan.counts(range(5 * 36))
        assert before.sum(axis=(1, 2)).min() > 0
    plan, state = interrupted(path)
    assert (plan.endless, plan.frames) == (True, 8)
    more = resume(plan, state, path, stopped_after(4 * 36, []))
    assert more.ended.outcome is Outcome.INTERRUPTED
    with ScanFile(path) as scan:
        assert len(scan.whole_frames) >= 9
        assert (scan.frames, scan.status) == (16, "interrupted")
        np.testing.assert_array_equal(scan.counts(range(5 * 36)), before)


def test_a_file_that_is_full_ends_the_scan(tmp_path, monkeypatch):
    monkeypatch.setattr(plan_model, "MAX_STEPS", 3 * 36)
    seen = []
    done = acquire(SCANNED, RigState(CONFIG), tmp_path / "a.h5", Watch([seen.append]))
    assert (done.ended.outcome, done.ended.steps_done) == (Outcome.COMPLETE, 3 * 36)
    assert any(isinstance(one, Noticed) and "cannot hold more frames" in one.sentence for one in seen)


SMALL = ("--grid", "12x6", "--spacing", "10cm", "--exposure", "1ms", "--mode", "continuous")


@pytest.mark.skipif(os.name != "posix", reason="ends a scan by a signal")
def test_ctrl_c_is_the_end_that_was_asked_for(tmp_path):
    command = [sys.executable, "-m", "rig", "scan", *SMALL, "--frames", "until-stopped", "--out", "a.h5"]
    with subprocess.Popen(
        [*command, "--json"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as scan:
        for line in scan.stderr:
            if "70 %" in line:
                break
        scan.send_signal(signal.SIGINT)
        out, err = scan.communicate(timeout=120)
    assert scan.returncode == 0, err
    assert "Ended as asked: stopped by the operator." in err
    assert json.loads(out)["status"] == "interrupted"
    with ScanFile(tmp_path / "a.h5") as file:
        assert file.done.any()
        assert file.plan.endless


def test_a_rule_ends_it_and_resume_says_that_it_has_no_last_frame(rig, tmp_path):
    dry = rig("scan", *SMALL, "--frames", "until-stopped", "--dry-run")
    assert "until stopped, of 72 positions, ~" in dry.out
    done = rig("scan", *SMALL, "--frames", "until-stopped", "--until", "time 1ms", "--out", "a.h5")
    assert done.code == 0, done.err
    assert "Ended as asked: time " in done.err
    again = rig("resume", "a.h5", "--until", "time 1ms")
    assert again.code == 0, again.err
    assert "a.h5 has no last frame: it goes on until it is stopped" in again.err


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--frames", "0"), "'0' is not a number of frames"),
        (("--frames", "many"), "or --frames until-stopped"),
        (("--frames", "until-stopped"), "needs --mode continuous"),
        (("--frames", "until-stopped", "--mode", "continuous", "--ptu"), "--ptu is not possible"),
    ],
)
def test_what_is_no_number_of_frames_is_refused(rig, asked, said):
    done = rig("scan", "--grid", "4x3", "--spacing", "20cm", *asked)
    assert done.code == 2
    assert said in done.err


def test_the_view_knows_frames_that_come_to_be_planned():
    subject = Subject.of("a.h5", replace(described(), channels=RigState(built_in()).channels))
    state = LiveState(subject)
    assert (subject.frames, subject.frame_steps, subject.endless) == (2, SIZE, True)
    one = Block(10, np.array([0, 1, 2]), np.zeros(2, np.uint16), np.full(2, 0.01), 1.0)
    state(one)
    state(Grown(PLAN.longer(10**6)))
    state(Gap(12, 24))
    seen = state.seen()
    assert (seen.measured, seen.left_s) == (14, None)
    assert np.flatnonzero(np.isfinite(seen.photons)).tolist() == [4, 5]


def _with_frames(frames):
    """Return the plan as JSON, with another number of frames, which no plan need allow."""
    plan = json.loads(PLAN.model_dump_json())
    plan["passes"][0]["frames"] = frames
    return json.dumps(plan)


@pytest.mark.parametrize(
    "said", [_with_frames(10**9), _with_frames(-1), _with_frames("many"), "{}", "[]", "no JSON", 3, None]
)
def test_a_journal_that_says_what_cannot_be_is_refused_at_once(tmp_path, said):
    """Whole as a record, as only somebody who means harm would write it."""
    path, model = tmp_path / "a.h5", Model(1, 5)
    with create(path, described(), 16) as writer:
        for _ in range(7):
            writer.append_photons(*model.step(20), 0.01)
        writer.checkpoint()
        shutil.copy2(path, tmp_path / "b.h5")
        shutil.copy2(journal_of(path), journal_of(tmp_path / "b.h5"))
    journal = Journal(journal_of(tmp_path / "b.h5"))
    assert list(journal.records())
    journal.say(Kind.GROWN, said)
    journal.close()
    with (
        pytest.raises(DataFileError, match="holds an impossible record of added frames"),
        ScanFile(tmp_path / "b.h5"),
    ):
        pass
