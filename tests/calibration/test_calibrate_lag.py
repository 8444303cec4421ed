"""The mirror's lag: fitted to drawn arrivals, measured through the devices, used by scans, refused."""

from dataclasses import replace

import numpy as np
import pytest

from rig.acquire.acquisition import Watch, acquire
from rig.calibrate.raw import reading
from rig.calibrate.routine import changed
from rig.calibrate.run import fitted, measured
from rig.calibrate.timing.lag import LagRoutine, Swept, fit_lag, swept
from rig.errors import CalibrationError, RefusedError
from rig.files.scan import ScanFile
from rig.model.config import built_in_with
from rig.model.delays import PathDelays
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.misaligned import misaligned_at_random, true_delays_s

TOLD = PathDelays(np.array([-0.15, 0.0, 2.5]), np.array([0.15, 0.0, 2.5]), 12.3e-9)
REAL = PathDelays(np.array([-0.13, 0.02, 2.47]), np.array([0.17, -0.01, 2.53]), 15.3e-9)
POINT_S = 1e-3


def drawn(lag_s, rng, *, rows=6, columns=90, spacing_m=0.02, back=True, error_s=5e-12, taken_s=0.0):
    """First bounces of a mirror that trails evenly, of a rig that stands some centimetres elsewhere."""
    x_m = (np.arange(columns) - (columns - 1) / 2) * spacing_m
    spots_m, speed = np.zeros((rows, columns, 3)), np.zeros((rows, columns, 3))
    for row in range(rows):
        way = -1 if back and row % 2 else 1
        spots_m[row, :, 0], spots_m[row, :, 1] = way * x_m, (row - (rows - 1) / 2) * spacing_m
        speed[row, :, 0] = way * spacing_m / POINT_S
    at_s = np.tile(np.arange(columns) * POINT_S, rows)
    spots_m, speed = spots_m.reshape(-1, 3), speed.reshape(-1, 3)
    there_m = spots_m + speed * (taken_s - lag_s)
    # counts are few: errors differ from point to point
    errors_s = error_s * rng.uniform(0.7, 1.5, len(at_s))
    arrival_s = REAL.delay_s(there_m, there_m) + errors_s * rng.standard_normal(len(at_s))
    return Swept(
        spots_m, speed, at_s + taken_s, (columns - 1) * POINT_S - at_s - taken_s, arrival_s, errors_s,
        float(np.abs(spots_m).max()), taken_s, POINT_S,
    )  # fmt: skip


@pytest.mark.parametrize("taken_s", [0.0, 1e-3])
def test_lag_of_drawn_arrivals_and_its_standard_error(taken_s):
    """The rig stands centimetres from where it is said to stand: that is even in the direction of motion."""
    pulls, number = [], 60
    for seed in range(number):
        rng = np.random.default_rng(seed)
        lag_s = rng.uniform(0, 3e-3)
        found = fit_lag(drawn(lag_s, rng, taken_s=taken_s), TOLD, "drawn")
        assert found.error_s < 20e-6
        pulls.append((found.lag_s - lag_s) / found.error_s)
    # mean 0 and standard deviation 1 of 60 draws: known to 1 / sqrt(60) and 1 / sqrt(120); four of these
    assert abs(np.mean(pulls)) < 4 / np.sqrt(number)
    assert abs(np.std(pulls) - 1) < 4 / np.sqrt(2 * number)


def test_without_noise_the_lag_is_exact():
    """Centimetres of wrong places are 1 % of the slope of arrivals, and would be 1 % of the lag: 30 us."""
    seen = drawn(3e-3, np.random.default_rng(0), error_s=5e-12)
    exact = replace(seen, arrival_s=REAL.delay_s(seen.places_m(3e-3), seen.places_m(3e-3)))
    assert fit_lag(exact, TOLD, "drawn").lag_s == pytest.approx(3e-3, abs=0.5e-6)


def test_what_the_turn_leaves_is_not_fitted():
    """A mirror of 2 / w = 2 ms: traces of a turn, (1 + w t) exp(-w t), in the first points of each line."""
    rng, lag_s = np.random.default_rng(1), 2e-3
    seen = drawn(lag_s, rng, error_s=1e-12, taken_s=lag_s)
    w_t = 2 * seen.begins_s / lag_s
    extra_m = seen.speed_m_per_s * (0.25 * lag_s * (1 + w_t) * np.exp(-w_t))[:, None]
    slope_s = REAL.delay_s(seen.spots_m + extra_m, seen.spots_m + extra_m) - REAL.delay_s(
        seen.spots_m, seen.spots_m
    )
    found = fit_lag(replace(seen, arrival_s=seen.arrival_s + slope_s), TOLD, "drawn")
    assert not found.used[seen.begins_s < 4 * found.lag_s - 2e-6].any()
    assert abs(found.lag_s - lag_s) < 4 * found.error_s


def test_refusals_name_the_reason():
    rng = np.random.default_rng(2)
    for seen, reason in (
        (drawn(1e-3, rng, back=False), "a lag is seen only if lines run in both directions"),
        (drawn(1e-3, rng, rows=2, columns=12), "positions at which the mirror moves evenly are too few"),
        (drawn(0.5e-3, rng, error_s=200e-12), "the lag is known to .* only: measure more rows"),
        (drawn(-0.5e-3, rng), "ahead of its command"),
    ):
        with pytest.raises(CalibrationError, match=reason):
            fit_lag(seen, TOLD, "drawn")
    seen = drawn(1e-3, rng)
    strays = np.where(rng.random(len(seen.arrival_s)) < 0.1, 100e-12, 0.0)
    with pytest.raises(CalibrationError, match="times their errors, one lag does not explain them"):
        fit_lag(replace(seen, arrival_s=seen.arrival_s + strays), TOLD, "drawn")


def rig(folder, lag="800us", kind="optotune", **scan):
    """The built-in rig with a slow mirror; its configuration does not know how slow."""
    return built_in_with(
        {
            "galvo": {"kind": kind},
            "simulation": {"misalignment": {"mirror_lag": lag}},
            "calibration": {"folder": str(folder / "calibrations")},
            "scan": {"columns": 60, "rows": 8, "spacing": "3cm", **scan},
        }
    )


@pytest.mark.parametrize(("kind", "lag"), [("optotune", 0.8), ("optotune", 2.0), ("analogue", 0.3)])
def test_measured_lag_is_that_of_the_mirror_and_the_next_scan_uses_it(kind, lag, tmp_path):
    config, routine, lag_s = rig(tmp_path, f"{lag}ms", kind), LagRoutine(rows=4), 1e-3 * lag
    found = fitted(routine, config, measured(routine, config, None, tmp_path, Watch()))
    calibration = found.calibration
    assert abs(calibration.lag_s - lag_s) < 4 * calibration.lag_error_s
    assert calibration.lag_error_s < 20e-6
    assert calibration.chi2 == pytest.approx(1, abs=0.5)  # some 200 degrees of freedom: 4 sqrt(2 / 200) = 0.4
    assert set(calibration.devices) == {"galvo", "point_clock"}
    assert found.picture.stat().st_size > 10_000
    # the next scan: its windows follow the mirror, so that arrivals are alike there and back
    setup = routine.setup(config)
    plan = ScanPlan.grid(setup, rows=4, exposure_s=1e-3, skip_m=0.0, motion="continuous")
    acquire(plan, RigState.resolve(setup), tmp_path / "next.h5")
    with reading([tmp_path / "next.h5"]) as (scans, passes):
        assert scans[0].state.mirror_lag_s == calibration.lag_s
        assert "lag" in scans[0].calibrations.in_words()
        seen, delays = swept(scans, passes)
    again = fit_lag(seen, delays, "next")
    assert seen.taken_s == calibration.lag_s
    assert abs(again.lag_s - seen.taken_s) < 4 * np.hypot(again.error_s, calibration.lag_error_s)


def test_on_a_misaligned_rig_with_faults(tmp_path):
    """Nothing but the lag is calibrated: rectified time is off by 100 ps and more, the lag is not."""
    config = misaligned_at_random(5, tmp_path / "calibrations", scan={"columns": 60, "spacing": "2.8cm"})
    routine = LagRoutine(rows=4)
    (path,) = measured(routine, config, None, tmp_path, Watch())
    found = routine.fit([path], RigState(config))
    assert abs(found.lag_s - 0.8e-3) < 4 * found.lag_error_s
    with ScanFile(path) as scan:
        wrong_s = scan.state.delays.delay_s(scan.laser_m, np.zeros((1, 3))) - true_delays_s(
            config, scan.mirror_rad
        )
    assert np.ptp(wrong_s) > 50e-12  # of the same size as what the lag does


def test_data_that_cannot_tell(tmp_path):
    config, routine = rig(tmp_path), LagRoutine(rows=2)
    setup = routine.setup(config)
    stepped = ScanPlan.grid(setup, columns=5, rows=2, exposure_s=0.01, skip_m=0.0)
    acquire(stepped, RigState(setup), tmp_path / "stepped.h5")
    with pytest.raises(CalibrationError, match="a mirror that stops at each position"):
        routine.fit([tmp_path / "stepped.h5"], RigState(config))
    weak = changed(config, laser={"power_setpoint": 1.0})
    (path,) = measured(routine, weak, None, tmp_path, Watch())
    with pytest.raises(CalibrationError, match=r"it has no peak: .* 20 are needed"):
        routine.fit([path], RigState(weak))
    assert not (tmp_path / "calibrations").exists()


def test_a_rig_without_a_point_clock_has_no_lag(tmp_path):
    config = rig(tmp_path).model_copy(update={"point_clock": None})
    assert LagRoutine().impossible(config)
    with pytest.raises(RefusedError, match="it has no point clock"):
        measured(LagRoutine(), config, None, tmp_path, Watch())
