"""Plans of several passes: what is set between them, what the file keeps of each, what is imaged."""

import numpy as np
import pytest
from test_engine import ScriptedRig

from rig.acquire.engine import ScanEngine
from rig.acquire.events import Ended, Outcome, Phase, PhaseChanged, Ready, StepDone
from rig.errors import DataFileError, RefusedError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.model.config import built_in
from rig.model.devices import Preparation
from rig.model.plan import Grid, Pass, ScanPlan, Spots
from rig.model.state import RigState

STATE = RigState(built_in())
SPOTS = Spots(spots=((0.1, 0.0, 0.0), (0.2, 0.1, 0.0), (-0.1, 0.3, 0.0)))
SWEEP = ScanPlan(
    passes=(
        Pass(name="open", positions=SPOTS, exposure_s=0.01, gate_s=(0.0, 90e-9)),
        Pass(name="early", positions=SPOTS, exposure_s=0.02, gate_s=(30e-9, 10e-9)),
        Pass(name="again", positions=SPOTS, exposure_s=0.02, gate_s=(30e-9, 10e-9)),
        Pass(
            name="covered", positions=SPOTS, exposure_s=0.01, preparation=Preparation.COVER, hold_off_s=90e-9
        ),
    )
)


class GatedRig(ScriptedRig):
    """A scripted rig that also says how it is set, and asks whether it is dark meanwhile."""

    def __init__(self):
        super().__init__()
        self.set = []

    def set_gate(self, delay_s, width_s):
        self.set.append(("gate", delay_s, width_s, self.lit, self.biased))

    def set_hold_off(self, hold_off_s):
        self.set.append(("hold-off", hold_off_s, self.lit, self.biased))

    def prepare(self, preparation):
        self.set.append(("prepare", preparation, self.lit, self.biased))

    def settings(self):
        return {"set": len(self.set)}


def run(rig, plan, first=0, should_stop=lambda: False, operator=None):
    events = []
    engine = ScanEngine(rig.devices(), plan, STATE, first=first, operator=operator)
    return engine.run(events.append, should_stop), events


def test_between_passes_the_rig_is_set_in_the_dark_and_only_if_something_changes():
    rig = GatedRig()
    ended, events = run(rig, SWEEP, operator=rig)
    assert rig.set == [
        ("gate", 0.0, 90e-9, False, False),
        ("gate", 30e-9, 10e-9, False, False),
        ("prepare", Preparation.COVER, False, False),
        ("gate", 31.5e-9, 40e-9, False, False),  # as configured again
        ("hold-off", 90e-9, False, False),
        ("hold-off", 100e-9, False, False),  # as it was, at the end
    ]
    assert [e.pass_index for e in events if isinstance(e, Ready)] == [0, 1, 3]
    assert [e.step.pass_index for e in events if isinstance(e, StepDone)] == [
        0,
        0,
        0,
        1,
        1,
        1,
        2,
        2,
        2,
        3,
        3,
        3,
    ]
    assert [e.exposure.live_time_s for e in events if isinstance(e, StepDone)] == [0.01] * 3 + [0.02] * 6 + [
        0.01
    ] * 3
    assert ended == Ended(Outcome.COMPLETE, 12, "all positions measured")
    assert not rig.lit


def test_a_resumed_sweep_is_set_as_its_pass_asks():
    rig = GatedRig()
    ended, events = run(rig, SWEEP, first=4, operator=rig)
    assert rig.set[0] == ("gate", 30e-9, 10e-9, False, False)
    assert [e.step.index for e in events if isinstance(e, StepDone)] == list(range(4, 12))
    assert ended.steps_done == 12


def test_nobody_to_ask_means_no_light():
    rig = GatedRig()
    with pytest.raises(RefusedError, match="a person must be at the rig"):
        run(rig, SWEEP, first=9)
    assert "emit" not in rig.log


def test_a_stop_between_passes_does_not_light_up_again():
    rig = GatedRig()
    ended, events = run(rig, SWEEP, should_stop=lambda: rig.log.count("measure") >= 3, operator=rig)
    assert (ended.outcome, ended.steps_done) == (Outcome.INTERRUPTED, 3)
    assert rig.log.count("emit") == 1
    assert PhaseChanged(Phase.PREPARING) in events


def describe(plan, bins=8):
    return ScanDescription(
        plan.spots_m, np.zeros((1, 1, 3)), bins, 4e-12, 0.0, plan=plan, state=STATE, channels=STATE.channels
    )


def test_the_file_gives_each_pass_with_what_the_devices_said_before_it(tmp_path):
    counts = np.random.default_rng(1).poisson(2.0, (12, 1, 8)).astype("u4")
    with ScanWriter.create(tmp_path / "a.h5", describe(SWEEP)) as writer:
        for number in range(4):
            writer.record_devices({"spad": {"identity": "a detector", "gate_delay_s": 1e-9 * number}}, number)
            for row in counts[3 * number : 3 * number + 3]:
                writer.append(row, 0.01 * (number + 1))
    with ScanFile(tmp_path / "a.h5") as scan:
        passes = scan.passes()
        assert [one.asked.name for one in passes] == ["open", "early", "again", "covered"]
        for number, one in enumerate(passes):
            np.testing.assert_array_equal(one.counts, counts[3 * number : 3 * number + 3])
            assert one.live_time_s == pytest.approx(np.full(3, 0.01 * (number + 1)))
            assert one.devices["spad"]["gate_delay_s"] == 1e-9 * number
        with pytest.raises(DataFileError, match="do not form one image"):
            scan.capture()


@pytest.mark.parametrize(("measured", "added_up"), [(30, 5), (18, 3), (17, 2), (11, 1), (4, 1)])
def test_frames_are_added_up_as_far_as_they_are_whole(tmp_path, measured, added_up):
    plan = ScanPlan.grid(STATE.config, columns=3, rows=2, spacing_m=0.1, skip_m=0.0, frames=5)
    counts = np.random.default_rng(2).poisson(2.0, (30, 1, 8)).astype("u4")
    with ScanWriter.create(tmp_path / "a.h5", describe(plan)) as writer:
        for row in counts[:measured]:
            writer.append(row, 0.01)
    with ScanFile(tmp_path / "a.h5") as scan:
        capture = scan.capture()
        got = np.concatenate([block for _, block in capture.histograms.blocks(slice(2, 7))])
    expected = counts.reshape(5, 6, 8)[:added_up].sum(axis=0)[: min(measured, 6), 2:7]
    np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(capture.laser_m, plan.spots_m[: len(got)])


def test_a_random_order_visits_each_spot_once_and_always_in_the_same_order():
    snake = Grid(columns=7, rows=5, spacing_m=0.1)
    mixed = Grid(columns=7, rows=5, spacing_m=0.1, order="random", seed=3)
    assert sorted(map(tuple, mixed.spots_m)) == sorted(map(tuple, snake.spots_m))
    assert not np.array_equal(mixed.spots_m, snake.spots_m)
    np.testing.assert_array_equal(mixed.spots_m, Grid(**mixed.model_dump()).spots_m)
    assert not np.array_equal(mixed.spots_m, mixed.model_copy(update={"seed": 4}).spots_m)


def test_a_plan_is_read_back_from_its_text():
    assert ScanPlan.from_json(SWEEP.model_dump_json(), "a file") == SWEEP
