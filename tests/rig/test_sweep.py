"""The way of a mirror that never stops: its ticks, its marks, and that it can be followed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.errors import RefusedError
from rig.model.config import built_in
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.pointing import Pointing
from rig.model.sweep import FRAME, HARDEST_TURN, LINE, POINT, Trajectories

CONFIG = built_in()
POINTING = Pointing((-0.15, 0.0, 2.5))


def paths(plan, turn_s=8e-3):
    return Trajectories(plan, POINTING.angles_rad(plan.spots_m), turn_s)


def plan_of(**changes):
    return ScanPlan.grid(CONFIG, motion="continuous", exposure_s=1e-3, **changes)


PLANS = st.builds(
    lambda columns, rows, order, frames, skip_m: plan_of(
        columns=columns, rows=rows, order=order, frames=frames, skip_m=skip_m
    ),
    st.integers(1, 40),
    st.integers(1, 12),
    st.sampled_from(["snake", "unidirectional", "progressive"]),
    st.integers(1, 3),
    st.sampled_from([0.0, 0.05]),
).filter(len)


@settings(max_examples=60, deadline=None)
@given(PLANS, st.integers(0, 10**6))
def test_each_step_is_one_marked_tick_at_its_own_angle(plan, where):
    """Whatever the order, gaps and frames, from the start or resumed at any line."""
    ends = np.append(0, np.flatnonzero(plan.ends_line) + 1)[:-1]
    first = int(ends[where % len(ends)])
    (sweep,) = paths(plan).sweeps(range(first, len(plan)))
    angles = POINTING.angles_rad(plan.spots_m)
    ticks = np.concatenate([line.ticks for line in sweep.lines])
    assert [step for line in sweep.lines for step in line.steps] == list(range(first, len(plan)))
    assert np.array_equal(np.flatnonzero(sweep.marks & POINT), ticks)
    assert sweep.angles_rad[ticks] == pytest.approx(angles[first:], abs=1e-12)
    assert len(sweep.marks) == len(sweep.angles_rad)


@settings(max_examples=60, deadline=None)
@given(PLANS)
def test_lines_and_frames_are_marked(plan):
    (sweep,) = paths(plan).sweeps(range(len(plan)))
    begins = [line.ticks[0] for line in sweep.lines]
    ends = [line.end for line in sweep.lines]
    assert np.array_equal(np.flatnonzero(sweep.marks & LINE), np.sort([*begins, *ends]))
    assert (sweep.marks[ends] == LINE).all()
    frames = [
        line.ticks[0] for line in sweep.lines if line.steps.start % (len(plan) // plan.passes[0].frames) == 0
    ]
    assert np.array_equal(np.flatnonzero(sweep.marks & FRAME), [0, *frames])
    assert sweep.marks[0] == FRAME


@settings(max_examples=40, deadline=None)
@given(PLANS)
def test_the_beam_never_jumps(plan):
    """It starts and ends at rest, and nowhere accelerates more than in a turn of its line's speed."""
    turn = 8
    (sweep,) = paths(plan, turn * 1e-3).sweeps(range(len(plan)))
    speed = np.linalg.norm(np.diff(sweep.angles_rad, axis=0), axis=1)
    pitch_rad = 0.01 / 2.5 * 1.1  # of the grid, at most, seen from the mirror
    assert max(speed[0], speed[-1]) <= 2 * pitch_rad / turn
    accelerated = np.linalg.norm(np.diff(sweep.angles_rad, 2, axis=0), axis=1)
    assert accelerated.max(initial=0.0) < HARDEST_TURN * pitch_rad / turn


def test_sweeps_fit_the_mirrors_memory_and_follow_one_another():
    plan = plan_of(columns=30, rows=10, skip_m=0.0)
    whole = paths(plan)
    cut = list(whole.sweeps(range(len(plan)), longest=150))
    assert len(cut) > 2
    assert all(len(one.marks) <= 150 for one in cut)
    assert [step for one in cut for line in one.lines for step in line.steps] == list(range(len(plan)))
    way = whole.way(150)
    assert way.positions == tuple(len(one.marks) for one in cut)
    assert way.duration_s == pytest.approx(sum(one.duration_s for one in cut))
    with pytest.raises(RefusedError, match=r"holds 20 positions.*one line of 30"):
        next(whole.sweeps(range(len(plan)), longest=20))


def test_what_it_takes_is_told_before():
    plan = plan_of()
    way = paths(plan).way()
    assert way.duration_s == pytest.approx(23.384 + 130 * 8e-3 + 4 * 4e-3, abs=0.2)
    nearest = np.abs(POINTING.angles_rad(plan.spots_m)).max(axis=0)
    farthest = np.array(way.farthest_rad)
    assert (farthest >= nearest).all()
    assert farthest[0] - nearest[0] == pytest.approx(8 / 4 * 0.01 / 2.5, rel=0.25)  # a quarter of a turn on


@pytest.mark.parametrize("order", ["random", None])
def test_only_lines_can_be_followed(order):
    if order:
        plan = plan_of(order=order)
    else:
        spots = Spots(spots=((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)))
        plan = ScanPlan(passes=(Pass(positions=spots, exposure_s=1e-3, motion="continuous"),))
    with pytest.raises(RefusedError, match="--mode step"):
        paths(plan)


def test_all_passes_move_alike():
    one = plan_of(columns=3, rows=2, skip_m=0.0).passes[0]
    with pytest.raises(ValueError, match="all passes must have the same motion"):
        ScanPlan(passes=(one, one.model_copy(update={"motion": "step"})))
