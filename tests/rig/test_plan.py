"""The plan: its grid, its order, and what it refuses before anything moves."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LimitError
from rig.acquire.preflight import check
from rig.errors import RefusedError, UsageError
from rig.model.config import built_in, built_in_with, load
from rig.model.plan import Grid, ScanPlan, Square
from rig.model.pointing import Pointing
from rig.model.state import RigState


def test_the_default_is_the_papers_scan():
    plan = ScanPlan.grid(built_in())
    # 130 x 180 positions 1 cm apart; the 4 x 4 grid points within 2 cm of the detector's spot are left out
    assert len(plan) == 23_384
    assert plan.passes[0].positions.skipped == 16
    assert np.ptp(plan.spots_m, axis=0) == pytest.approx([1.79, 1.29, 0.0])
    assert plan.spots_m.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)


def test_neighbours_in_time_are_neighbours_on_the_wall():
    config = built_in()
    plan = ScanPlan.grid(config, skip_m=0.0)
    steps = np.linalg.norm(np.diff(plan.spots_m, axis=0), axis=1)
    assert steps == pytest.approx(config.scan.spacing_m)


def test_nothing_near_the_detectors_spot_is_scanned():
    config = built_in_with({"channels": [{"spot": ["11.3cm", "-20.4cm", "0cm"]}]})
    plan = ScanPlan.grid(config, skip_m=0.06)
    offset = np.abs(plan.spots_m[:, :2] - [0.113, -0.204]).max(axis=1)
    assert offset.min() > 0.03
    assert plan.passes[0].positions.skipped == 36  # 6 x 6 points of a 1 cm lattice fall into a 6 cm square


@given(st.integers(2, 30), st.integers(2, 30), st.floats(0.001, 0.05), st.floats(0, 0.2))
def test_every_position_is_visited_once(columns, rows, spacing_m, skip_m):
    plan = ScanPlan.grid(built_in(), columns=columns, rows=rows, spacing_m=spacing_m, skip_m=skip_m)
    lattice = {tuple(p) for p in np.round(plan.spots_m[:, :2] / spacing_m * 2).astype(int)}
    assert len(lattice) == len(plan)
    grid = plan.passes[0].positions
    assert len(grid.line_of_spot) == len(plan)
    assert (np.diff(grid.line_of_spot) >= 0).all()
    assert sum(step.ends_line for step in plan.steps()) == len(np.unique(grid.line_of_spot))


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_pointing_and_its_inverse(x_m, y_m):
    pointing = Pointing((0.3, -0.2, 2.4))
    spot = np.array([x_m, y_m, 0.0])
    # tan and atan lose a few units in the last place of angles below 1 rad at 2.4 m
    assert pointing.spots_m(pointing.angles_rad(spot)) == pytest.approx(spot, abs=1e-14)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"spacing_m": 0.02}, "deg of mirror angle in x"),
        ({"columns": 10, "rows": 240}, "deg of mirror angle in y"),
        ({"exposure_s": 0.0005}, "nearest possible value is 1 ms"),
        ({"exposure_s": 0.0025}, "nearest possible value is 2 ms"),
        ({"columns": 3, "rows": 3, "skip_m": 1.0}, "no positions"),
    ],
)
def test_refuses_what_the_rig_cannot_do(tmp_path, changes, told):
    state = RigState(built_in())
    with pytest.raises((RefusedError, LimitError), match=told):
        check(ScanPlan.grid(state.config, **changes), state, tmp_path)


def test_refuses_a_scan_that_the_disk_cannot_hold(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=10))
    state = RigState(built_in())
    with pytest.raises(RefusedError, match="has 10 bytes free"):
        check(ScanPlan.grid(state.config), state, tmp_path)


def test_what_has_to_be_free_is_what_is_asked_for(tmp_path, monkeypatch):
    """A scan of 3 MB was refused where 5 MB were free, and the message did not say what is enough."""
    state = RigState(built_in())
    plan = ScanPlan.grid(state.config, columns=40, rows=30, spacing_m=0.05)
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=5_000_000))
    with pytest.raises(RefusedError) as refused:
        check(plan, state, tmp_path)
    needed_mb = float(re.search(r"needs ([\d.]+) MB free", str(refused.value))[1])
    assert needed_mb > 5
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=(needed_mb + 0.1) * 1e6))
    assert check(plan, state, tmp_path)


def test_the_duration_counts_exposure_settling_and_readout():
    config = built_in()
    plan = ScanPlan.grid(config, columns=10, rows=10, skip_m=0.0, exposure_s=0.1)
    assert plan.duration_s(config) == pytest.approx(100 * (0.1 + 0.006 + 0.005))


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 12))
def test_a_progressive_order_visits_each_position_once(columns, rows, skip_spacings):
    without = (Square(x_m=0.02, y_m=0.01, side_m=0.01 * skip_spacings),) if skip_spacings else ()
    raster = Grid(columns=columns, rows=rows, spacing_m=0.01, without=without)
    grid = raster.model_copy(update={"order": "progressive"})
    assert sorted(map(tuple, grid.spots_m)) == sorted(map(tuple, raster.spots_m))
    assert grid.rounds[-1:] == raster.rounds[-1:]


@given(st.integers(1, 40), st.integers(1, 40))
def test_the_whole_aperture_is_seen_after_a_sixteenth(columns, rows):
    plan = progressive(columns, rows)
    cells = -(-columns // 4) * -(-rows // 4)  # a sixteenth of the steps, and the cells that the rim cuts
    corner_m = plan.spots_m.min(axis=0)
    column, row, _ = np.rint((plan.spots_m[:cells] - corner_m) / 0.01).astype(int).T
    assert len(set(zip(column // 4, row // 4, strict=True))) == cells


@given(st.integers(2, 40), st.integers(2, 40))
def test_a_round_is_scanned_in_short_steps(columns, rows):
    plan = progressive(columns, rows)
    place = np.rint((plan.spots_m - plan.spots_m.min(axis=0)) / 0.01)
    begins = 0
    for number, end in enumerate(plan.passes[0].positions.rounds):
        steps = np.abs(np.diff(place[begins:end], axis=0)).max(axis=1, initial=0)
        # the pitch along a line: 8 spacings in the first three rounds, then halved by every second
        assert steps.max(initial=0) <= 8 // 2 ** (max(0, number - 1) // 2)
        begins = end
    assert end == len(plan)


def test_a_line_of_a_progressive_order_is_one_of_the_walls():
    plan = progressive(20, 13)
    grid = plan.passes[0].positions
    assert (np.diff(grid.line_of_spot) >= 0).all()
    for line in np.unique(grid.line_of_spot):
        assert len(np.unique(plan.spots_m[grid.line_of_spot == line, 1])) == 1


def test_a_progressive_plan_is_stored_and_read():
    plan = progressive(20, 13)
    again = ScanPlan.from_json(plan.model_dump_json(), "the file")
    assert again == plan
    assert np.array_equal(again.spots_m, plan.spots_m)


def test_longer_steps_of_the_mirror_take_longer():
    config = built_in()
    raster, coarse_to_fine = (
        ScanPlan.grid(config, order=order, skip_m=0.0) for order in ("snake", "progressive")
    )
    more_s = coarse_to_fine.duration_s(config) - raster.duration_s(config)
    # no step but six is longer than 8 spacings: ln 8 time constants of 9.2 in 6 ms, and most are of 2 or less
    assert 0 < more_s < len(raster) * 0.006 * np.log(2.5) / 9.2


def progressive(columns, rows):
    return ScanPlan.grid(
        built_in(), columns=columns, rows=rows, spacing_m=0.01, skip_m=0.0, order="progressive"
    )


def test_frames_visit_the_same_grid_again_and_again():
    once = ScanPlan.grid(built_in(), columns=5, rows=4, skip_m=0.0)
    plan = ScanPlan.grid(built_in(), columns=5, rows=4, skip_m=0.0, frames=3)
    np.testing.assert_array_equal(plan.spots_m, np.tile(once.spots_m, (3, 1)))
    assert [step.ends_line for step in plan.steps()] == 3 * [step.ends_line for step in once.steps()]
    assert plan.duration_s(built_in()) == pytest.approx(3 * once.duration_s(built_in()))


@pytest.mark.parametrize("frames", [0, 200_000])
def test_frames_are_at_least_one_and_steps_bounded(frames):
    with pytest.raises(UsageError, match=r"frames|5,000,000"):
        ScanPlan.grid(built_in(), columns=10, rows=10, skip_m=0.0, frames=frames)


def test_lines_may_be_farther_apart_than_positions():
    plan = ScanPlan.grid(built_in(), columns=5, rows=4, spacing_m=0.01, row_spacing_m=0.08, skip_m=0.0)
    assert plan.passes[0].positions.area_m == pytest.approx((0.04, 0.24))
    assert np.ptp(plan.spots_m, axis=0) == pytest.approx([0.04, 0.24, 0.0])
    np.testing.assert_allclose(np.diff(np.unique(plan.spots_m[:, 1].round(9))), 0.08)


def test_only_a_mirror_that_rests_is_bound_to_whole_milliseconds(tmp_path):
    config = load(Path(__file__).parents[2] / "configs" / "video.toml")
    state = RigState(config)
    found = check(ScanPlan.grid(config, motion="continuous", frames=10), state, tmp_path)
    # 4,180 points of 50 us, and 22 turns of 2 ms: a frame; and what it takes to set off and to stop
    assert found.duration_s == pytest.approx(10 * (4180 * 50e-6 + 22 * 2e-3), rel=0.02)
    with pytest.raises(LimitError, match="nearest possible value is 1 ms"):
        check(ScanPlan.grid(config), state, tmp_path)
