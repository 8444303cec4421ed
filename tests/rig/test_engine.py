"""The engine's order of steps, and that every way to end leaves the laser dark and the detector off.

The devices here are scripted: they write down what is asked of them and fail where they are told to. With
the real drivers the engine is tested in test_scan_command.py.
"""

import itertools

import numpy as np
import pytest

from drivers.harp.device import Exposure, Rates
from rig.acquire.engine import Devices, ScanEngine
from rig.acquire.events import Ended, LineDone, Outcome, Phase, PhaseChanged, StepDone
from rig.errors import RefusedError
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.state import RigState

STATE = RigState(built_in())
PLAN = ScanPlan.grid(STATE.config, columns=3, rows=2, spacing_m=0.1, exposure_s=0.01, skip_m=0.0)


class BrokenError(Exception):
    """What a scripted device raises."""


class ScriptedRig:
    """All five devices in one, with a log of calls and one call that fails."""

    bins = 4
    bin_width_s = 4e-12
    first_bin_s = 0.0
    identity = "scripted"
    by_hand: frozenset[str] = frozenset()

    def __init__(self, fail_at: int | None = None, sync_hz: float = 1e7) -> None:
        self.log: list[str] = []
        self.fail_at = fail_at
        self.sync_hz = sync_hz
        self.lit = False
        self.biased = False
        self.time_s = 0.0
        self.trips_at: int | None = None
        self.sync_in_the_dark = False
        self.counts_hz = 2e5
        self.watched = False

    def devices(self) -> Devices:
        return Devices(galvo=self, laser=self, spad=self, tcspc=self, clock=self)

    def _called(self, name: str) -> None:
        self.log.append(name)
        if self.fail_at == len(self.log) - 1:
            raise BrokenError(name)

    def settings(self):
        return {}

    def now_s(self):
        return self.time_s

    def sleep(self, duration_s):
        self._called("sleep")

    def point(self, angle_x_rad, angle_y_rad):
        self._called("point")

    def wait_settled(self, timeout_s):
        self._called("settled")

    def arm(self):
        self._called("arm")

    def emit(self):
        self.lit = True
        self._called("emit")

    def stop(self):
        self.lit = False
        self.log.append("stop")

    def emitting(self):
        return self.lit

    def beat(self, lease_s):
        assert lease_s > 0

    def enable(self):
        self.biased = True
        self._called("enable")

    def disable(self):
        self.biased = False
        self.log.append("disable")

    def rates(self):
        if not self.watched:
            self._called("rates")
        return Rates(self.sync_hz if self.lit or self.sync_in_the_dark else 0.0, (self.counts_hz,))

    def warnings(self):
        self._called("warnings")
        return ()

    def measure(self, exposure_s, meanwhile):
        self._called("measure")
        self.watched = True  # from now on rates are read to watch, not to begin
        self.time_s += 0.6
        if self.trips_at is not None and self.log.count("measure") > self.trips_at:
            self.lit = False  # an interlock opened
        return Exposure(np.ones((1, 4), np.uint32), exposure_s)


def run(rig, events, should_stop=lambda: False):
    engine = ScanEngine(rig.devices(), PLAN, STATE)
    return engine.run(events.append, should_stop)


def test_aims_before_it_lights_and_measures_in_the_plans_order():
    rig, events = ScriptedRig(), []
    ended = run(rig, events)
    in_the_dark = ["point", "settled", "enable", "sleep", "rates"]
    assert rig.log[:10] == [*in_the_dark, "arm", "emit", "sleep", "rates", "warnings"]
    assert rig.log[10:-3] == ["point", "settled", "measure"] * 6
    assert rig.log[-3:] == ["stop", "sleep", "disable"]
    assert [e.step.index for e in events if isinstance(e, StepDone)] == list(range(6))
    assert [e.steps_done for e in events if isinstance(e, LineDone)] == [3, 6]
    assert ended == events[-1] == Ended(Outcome.COMPLETE, 6, "all positions measured")


def test_begins_where_an_earlier_run_stopped():
    rig, events = ScriptedRig(), []
    engine = ScanEngine(rig.devices(), PLAN, STATE, first=4)
    ended = engine.run(events.append, lambda: False)
    assert [e.step.index for e in events if isinstance(e, StepDone)] == [4, 5]
    assert ended.steps_done == 6


def test_a_stop_finishes_the_position_and_says_so():
    rig, events = ScriptedRig(), []
    answers = itertools.chain([False] * 3, itertools.repeat(True))  # once before light, then at each position
    ended = run(rig, events, lambda: next(answers))
    assert ended.outcome is Outcome.INTERRUPTED
    assert ended.steps_done == 2
    assert not rig.lit
    assert not rig.biased


@pytest.mark.parametrize("step", range(28))
def test_whatever_fails_the_laser_goes_dark_and_the_file_is_told(step):
    rig, events = ScriptedRig(fail_at=step), []
    with pytest.raises(BrokenError):
        run(rig, events)
    assert not rig.lit
    assert not rig.biased
    assert PhaseChanged(Phase.CLOSING) in events
    assert isinstance(events[-1], Ended)
    assert events[-1].outcome is Outcome.FAILED
    assert events[-1].steps_done == sum(isinstance(e, StepDone) for e in events)


def test_a_consumer_that_fails_does_not_leave_the_laser_on():
    rig = ScriptedRig()

    def full_disk(event):
        if isinstance(event, StepDone):
            raise OSError("no space left on device")

    engine = ScanEngine(rig.devices(), PLAN, STATE)
    with pytest.raises(OSError, match="no space"):
        engine.run(full_disk, lambda: False)
    assert not rig.lit
    assert not rig.biased


def test_a_laser_that_goes_dark_by_itself_ends_the_scan_and_the_doubt_is_told():
    rig, events = ScriptedRig(), []
    rig.trips_at = 3
    with pytest.raises(RefusedError, match="went dark without a command") as caught:
        run(rig, events)
    # everything is read back at the end of each line of three
    assert "Positions 3 to 5 may be wrong" in str(caught.value)
    assert events[-1].outcome is Outcome.FAILED
    assert events[-1].reason == str(caught.value)
    assert not rig.biased


def test_a_laser_that_goes_dark_at_the_very_end_is_noticed():
    rig, events = ScriptedRig(), []
    rig.trips_at = 5  # during the last position
    with pytest.raises(RefusedError, match="Positions 3 to 5 may be wrong"):
        run(rig, events)
    assert events[-1].outcome is Outcome.FAILED
    assert events[-1].steps_done == 3  # those in doubt do not count


def test_refuses_to_measure_without_sync_pulses():
    rig, events = ScriptedRig(sync_hz=0.0), []
    with pytest.raises(RefusedError, match="sync"):
        run(rig, events)
    assert "measure" not in rig.log
    assert not rig.lit


def test_a_failure_that_takes_the_light_with_it_takes_back_what_was_not_seen_lit():
    rig, events = ScriptedRig(), []
    rig.trips_at = 4  # in the second line the interlock opens, and then the mirror fails
    usual = rig.point

    def point(angle_x_rad, angle_y_rad):
        usual(angle_x_rad, angle_y_rad)
        if rig.log.count("measure") == 5:
            raise BrokenError("power failed")

    rig.point = point
    with pytest.raises(BrokenError) as caught:
        run(rig, events)
    assert "Positions 3 to 4 may be wrong" in caught.value.__notes__[0]
    assert events[-1].steps_done == 3  # the line that was vouched for


def test_the_light_is_out_before_anybody_is_told_of_the_end():
    rig, lit_when_told = ScriptedRig(), []

    def slow_terminal(event):
        if event == PhaseChanged(Phase.CLOSING):
            lit_when_told.append(rig.lit)

    ScanEngine(rig.devices(), PLAN, STATE).run(slow_terminal, lambda: False)
    assert lit_when_told == [False]
