"""When to open the gate: the first bounce blocked, the nearest object kept, and what cannot be is mapped."""

import json

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from rig.acquire.acquisition import Watch
from rig.bench.simulated import true_geometry
from rig.calibrate.gate.edge import fit_edge, passed
from rig.calibrate.gate.routine import MAY_PASS, GateRoutine
from rig.calibrate.gate.sweep import nearest_after_s
from rig.calibrate.run import measured
from rig.commands.operator import ConsoleOperator
from rig.errors import CalibrationError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.model.config import built_in_with
from rig.model.delays import PathDelays
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.show.volume import X_LABEL
from simulators.detector.first_bounce import direct_s
from support.calibration_files import config_with, write_counts
from support.drawn import coloured, leftwards, line, panel

C_M_PER_S = 299_792_458.0
RISE_S, SIGMA_S = 200e-12 / 0.6, 35e-12 / 2.3548


def test_what_passes_is_the_edge_averaged_over_the_pulse():
    for x_s in np.linspace(-300e-12, 300e-12, 13):
        slow, _ = quad(
            lambda u, x_s=x_s: np.clip(0.5 - (x_s + u * SIGMA_S) / RISE_S, 0, 1) * norm.pdf(u),
            -8,
            8,
            limit=200,
        )
        assert passed(x_s, RISE_S, SIGMA_S) == pytest.approx(slow, abs=1e-6)
    assert passed(-1e-9, RISE_S, SIGMA_S) == pytest.approx(1)
    assert passed(1e-9, RISE_S, SIGMA_S) == pytest.approx(0)


def test_the_edge_is_found_within_its_errors():
    """20 drawn sweeps: pulls with a mean within 3/sqrt(20) of 0 and a spread within 3/sqrt(40) of 1."""
    pulls = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        arrival_s = rng.uniform(0, 2e-9, 40)
        late_s = (np.arange(-0.8e-9, 3e-9, 200e-12)[:, None] - arrival_s).ravel()
        due = passed(late_s - 30e-12, RISE_S, SIGMA_S)
        whole = np.broadcast_to(rng.poisson(1500, 40), (len(late_s) // 40, 40)).ravel().astype(float)
        edge = fit_edge(late_s, rng.poisson(1500 * due).astype(float), whole, SIGMA_S)
        offset_error_s, rise_error_s = np.sqrt(np.diag(edge.covariance))
        pulls.append([(edge.offset_s - 30e-12) / offset_error_s, (edge.rise_s - RISE_S) / rise_error_s])
    pulls = np.array(pulls)
    assert np.abs(pulls.mean(axis=0)).max() < 3 / np.sqrt(20)
    assert np.abs(pulls.std(axis=0, ddof=1) - 1).max() < 3 / np.sqrt(40)


def test_nearest_light_takes_the_shortest_way_over_the_plane():
    legs = PathDelays(np.array([-0.2, 0.1, 2.5]), np.array([0.3, 0.0, 2.2]), 12e-9)
    spot_m, seen_m = np.array([[0.7, -0.4, 0.0]]), (0.1, 0.2, 0.0)
    x, y = np.meshgrid(np.linspace(0, 0.8, 401), np.linspace(-0.5, 0.3, 401))
    there = np.sqrt((x - 0.7) ** 2 + (y + 0.4) ** 2 + 0.5**2) + np.sqrt(
        (x - 0.1) ** 2 + (y - 0.2) ** 2 + 0.5**2
    )
    back_m = np.linalg.norm(legs.detector_head_m - seen_m) - np.linalg.norm(legs.detector_head_m - spot_m[0])
    slow_s = (there.min() + back_m) / C_M_PER_S
    assert nearest_after_s(spot_m, legs, seen_m, 0.5)[0] == pytest.approx(slow_s, abs=0.1e-12)


# On the simulated rig, with its faults and out of place

ROUTINE = GateRoutine(columns=6, exposure_s=0.05)


def true_opening_s(config):
    """The edge's foot after the latest first bounce of the scan, and what the pulse's width adds."""
    geometry = true_geometry(config)
    mirror = RigState(config).pointing.angles_rad(ScanPlan.grid(config).spots_m)
    latest_s = max(direct_s(geometry.laser_spot_m((x, y)), geometry) for x, y in mirror)
    grid_s = np.arange(0, 400e-12, 1e-13)
    return latest_s + float(grid_s[(passed(grid_s, RISE_S, SIGMA_S) <= MAY_PASS).argmax()])


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    config = built_in_with(
        {
            "calibration": {"folder": str(folder / "calibrations")},
            "scan": {"columns": 60, "rows": 43, "spacing": "3cm"},
            "spad": {"spot": ["15cm", "10cm", "0cm"]},
            "simulation": {
                "seed": 4,
                "faults": {"memory": 1e-5, "reflections_per_pulse": 1e-4, "failed_gate_radius": "20cm"},
                "misalignment": {"wall_tilt": ["5deg", "2deg"], "mirror_turn": ["1deg", "1deg", "1deg"],
                                 "spad_shift": ["-1cm", "2cm", "-2cm"], "cable_delay": "3ns"},
            },
        }
    )  # fmt: skip
    return config, measured(ROUTINE, config, ConsoleOperator(), folder, Watch())


def test_the_opening_is_found_and_failing_positions_are_mapped(sweep):
    """Within 50 ps: a grid of six columns, extended to the corners, on a rig out of place."""
    config, files = sweep
    found = ROUTINE.fit(files, RigState(config))
    assert abs(found.gate_delay_s - true_opening_s(config)) < 50e-12
    assert found.edge_s == pytest.approx(200e-12, abs=5 * found.edge_error_s)
    assert found.passed <= MAY_PASS
    # the beam goes somewhat elsewhere on the misaligned rig: leave its rim out
    geometry = true_geometry(config)
    angles = RigState(config).pointing.angles_rad(
        np.column_stack([found.spots_m, np.zeros(len(found.spots_m))])
    )
    spots = np.array([geometry.laser_spot_m((x, y)) for x, y in angles])
    away_m = np.hypot(spots[:, 0] - 0.15, spots[:, 1] - 0.10)
    assert (away_m < 0.2).any()
    assert found.failed == (away_m <= 0.2).tolist()
    assert [earliest is None for earliest in found.earliest_s] == found.failed
    kept = [late for late, failed in zip(found.latest_s, found.failed, strict=True) if not failed]
    assert found.gate_delay_s < min(kept)
    # the gate closes with the histogram, 88 ns after the sync pulse
    assert found.gate_delay_s + found.gate_width_s == pytest.approx(88e-9, abs=20e-12)
    assert_drawn(ROUTINE.figure(files, found), found)


def assert_drawn(figure, found):
    edge = panel(figure, "part of the first bounce")
    late_ps, part = line(edge, "fitted edge").T
    # the edge falls from 80 to 20 % within its duration; the curve has 400 points over three times the ramp
    shown_ps = np.interp([-0.8, -0.2], -part, late_ps)
    assert abs(np.ptp(shown_ps) - 1e12 * found.edge_s) < 0.02 * 1e12 * found.edge_s
    off = line(edge, "first bounce that passes")
    near = np.abs(off[:, 0] - shown_ps.mean()) < 300
    assert np.median(np.abs(off[near, 1] - np.interp(off[near, 0], late_ps, part))) < 0.05
    wall = panel(figure, "y (m)")
    spots, earliest_ns = coloured(wall)
    can = np.array([one is not None for one in found.earliest_s])
    np.testing.assert_allclose(spots, np.array(found.spots_m)[can])
    np.testing.assert_allclose(earliest_ns, [1e9 * one for one in found.earliest_s if one is not None])
    np.testing.assert_allclose(line(wall, "gate fails"), np.array(found.spots_m)[found.failed])
    assert wall.get_xlabel() == X_LABEL
    assert leftwards(wall)


def test_the_gate_keeps_the_nearest_object_before_it_blocks(sweep):
    """Nearer than arrivals spread: where the bounce comes late it is not blocked, and that is mapped."""
    config, files = sweep
    near = GateRoutine(columns=6, nearest_m=0.12).fit(files, RigState(config))
    far = ROUTINE.fit(files, RigState(config))
    assert near.gate_delay_s < far.gate_delay_s
    open_for = [one for one, failed in zip(near.latest_s, near.failed, strict=True) if not failed]
    assert near.gate_delay_s <= min(open_for) + 10e-12
    late = [i for i, one in enumerate(near.earliest_s) if one is None and not near.failed[i]]
    assert late
    assert all(far.earliest_s[i] > near.gate_delay_s for i in late)
    with pytest.raises(CalibrationError, match="Give a larger --nearest"):
        GateRoutine(columns=6, nearest_m=0.01).fit(files, RigState(config))


def part_of(path, kept, target):
    """Write a scan file that holds some of the passes of another."""
    with ScanFile(path) as scan:
        passes = scan.passes()[kept]
        plan = ScanPlan(passes=tuple(one.asked for one in passes))
        description = ScanDescription(
            plan.spots_m, scan.detector_m, *passes[0].time_axis, plan=plan, state=scan.state, simulated=True
        )
        with ScanWriter.create(target, description) as writer:
            for number, one in enumerate(passes):
                writer.record_devices(one.devices, number)
                for counts, live_s in zip(one.counts, one.live_time_s, strict=True):
                    writer.append(counts, live_s)
    return target


def test_a_sweep_that_misses_the_edge_is_refused(sweep, tmp_path):
    config, files = sweep
    wide, whole = files
    cases = (
        (slice(7), "does not reach the gate's edge"),
        (slice(-5, None), "does not show the gate's edge"),
        (slice(3), "five or more at other delays"),
    )
    for number, (kept, reason) in enumerate(cases):
        part = part_of(whole, kept, tmp_path / f"{number}.h5")
        with pytest.raises(CalibrationError, match=reason):
            ROUTINE.fit([wide, part], RigState(config))


def test_the_command_fits_a_recorded_sweep(sweep, rig, tmp_path):
    _, files = sweep
    given = [word for file in files for word in ("--from", file)]
    done = rig("calibrate", "gate", "--json", "--nearest", "40cm", *given)
    assert done.code == 0, done.err
    assert json.loads(done.out)["calibration"]["nearest_m"] == 0.4
    done = rig("calibrate", "gate", "--nearest", "4", *given)
    assert done.code == 2
    assert "no unit" in done.err
    assert len(list((tmp_path / "calibrations").glob("gate-*"))) == 2


# Bad data


def wide_open(tmp_path, counts, **spad):
    setup = GateRoutine().setup(config_with(tmp_path))
    config = setup.model_copy(update={"detector": setup.detector.model_copy(update=spad)})
    return write_counts(tmp_path / "open.h5", counts, config, exposure_s=0.01)


@pytest.mark.parametrize(
    ("photons", "reason"),
    [(0, "beam is not blocked"), (30, "are needed"), (40_000, "saturated")],
)
def test_too_little_and_too_much_light_are_refused(sweep, tmp_path, photons, reason):
    config, files = sweep
    counts = np.zeros((9, 12_500))
    counts[:, 3600:3608] = photons / 8
    with pytest.raises(CalibrationError, match=reason):
        ROUTINE.fit([wide_open(tmp_path, counts), *files[1:]], RigState(config))


def test_files_that_are_no_sweep_are_refused(sweep, tmp_path):
    config, files = sweep
    counts = np.zeros((9, 12_500))
    counts[:, 3600:3608] = 100 + np.arange(8)  # equal ones would be a full counter
    with pytest.raises(CalibrationError, match="other positions"):
        ROUTINE.fit([wide_open(tmp_path, counts), *files[1:]], RigState(config))
    (tmp_path / "open.h5").unlink()
    with pytest.raises(CalibrationError, match="without the gate"):
        ROUTINE.fit([wide_open(tmp_path, counts, gated=False), *files[1:]], RigState(config))
