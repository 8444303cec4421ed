"""Time zero and response: measured on a misaligned rig with all faults, used by scans, refused."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from recon.defaults import shortest_wavelength_m, wavelength
from rig.acquire.acquisition import Watch, acquire
from rig.bench.simulated import true_geometry
from rig.calibrate.geometry_fit import Arrivals
from rig.calibrate.run import fitted, measured
from rig.calibrate.timing import irf, peaks
from rig.calibrate.timing.irf import ResponseRoutine
from rig.calibrate.timing.target import TargetRoutine, place
from rig.calibrate.timing.time_zero import TimeZeroRoutine, fit_path_delays
from rig.errors import CalibrationError, UsageError
from rig.files.scan import ScanFile
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.misaligned import (
    galvo_calibration,
    misaligned,
    misaligned_at_random,
    true_arrivals_s,
    true_delays_s,
    true_width_s,
)


def errors_s(legs, config, known, mirror_rad):
    """What a scan with these legs subtracts, less what it should."""
    spots_m = RigState(config, known).pointing.spots_m(mirror_rad)
    return legs.delay_s(spots_m, np.zeros((1, 3))) - true_delays_s(config, mirror_rad)


def grid_rad(config):
    x_m, y_m = np.meshgrid(np.linspace(-0.8, 0.8, 11), np.linspace(-0.64, 0.64, 9))
    return RigState(config).pointing.angles_rad(np.stack([x_m.ravel(), y_m.ravel(), 0 * x_m.ravel()], axis=1))


def test_legs_from_drawn_arrivals_rectify_and_know_how_well():
    pulls = []
    for seed in range(6):
        config, rng = misaligned_at_random(seed), np.random.default_rng(seed)
        known, angles = galvo_calibration(config, 0.5e-3, seed), grid_rad(config)
        error_s = np.full(len(angles), 0.3e-12)
        seen_s = true_arrivals_s(config, angles) + error_s * rng.standard_normal(len(angles))
        seen_s[7] += 200e-12  # an outlier may not matter
        found = fit_path_delays(Arrivals(angles, seen_s, error_s), np.zeros(3), RigState(config, known))
        wrong_s = errors_s(found.delays, config, known, angles)
        assert np.median(np.abs(wrong_s)) < 5e-12
        assert np.abs(wrong_s).max() < 15e-12
        pulls.append(wrong_s / (found.rectified_error_s / np.sqrt(max(found.chi2, 1))))
    # neighbours err together: a seed counts as a few independent pulls, so 20 or so: 1 +- 0.16, four of these
    assert 0.36 < np.sqrt(np.mean(np.square(pulls))) < 1.64


@pytest.mark.parametrize("seed", [2, 4])
def test_arrivals_alone_do_not_lead_the_search_astray(seed):
    """Without spots they say little of the incidence; the rest of the rig is found first."""
    rng = np.random.default_rng(seed)
    config = misaligned(signs=rng.choice([-1, 1], 16))
    x_m, y_m = np.meshgrid(np.linspace(-0.85, 0.85, 7), np.linspace(-0.6, 0.6, 5))
    spots_m = np.stack([x_m.T.ravel(), y_m.T.ravel(), 0 * x_m.ravel()], axis=1)
    angles = RigState(config).pointing.angles_rad(spots_m)
    error_s = np.full(len(angles), 2e-12)
    seen_s = true_arrivals_s(config, angles) + error_s * rng.standard_normal(len(angles))
    found = fit_path_delays(Arrivals(angles, seen_s, error_s), np.zeros(3), RigState(config))
    # at most 14 of 35 arrivals are used up by unknowns: 21 degrees of freedom, 4 sqrt(2 / 21)
    assert found.chi2 == pytest.approx(1, abs=1.25)
    assert np.isfinite(found.rectified_error_s).all()


def test_a_measured_calibration_rectifies_and_warns(tmp_path):
    config = misaligned_at_random(3, tmp_path / "calibrations")
    routine = TimeZeroRoutine(columns=7, rows=5)
    files = measured(routine, config, None, tmp_path, Watch())
    with ScanFile(files[0]) as scan:
        angles = scan.mirror_rad
    known = galvo_calibration(config, 0.5e-3, 3)
    found = routine.fit(files, RigState(config, known))
    assert found.warnings == []
    wrong_s = errors_s(found.legs, config, known, angles)
    assert np.median(np.abs(wrong_s)) < 5e-12
    assert np.abs(wrong_s).max() < 15e-12
    assert found.chi2 == pytest.approx(1, abs=0.6)  # 56 degrees of freedom: 4 sqrt(2 / 56)
    assert abs(found.drift_per_minute_s - 1e-12) < 4 * found.drift_per_minute_error_s
    alone = routine.fit(files[:1], RigState(config, known))
    assert alone.drift_per_minute_s is None
    without = routine.fit(files, RigState(config))
    assert "galvo is not calibrated" in without.warnings[0]
    assert without.rectified_error_s > 5 * found.rectified_error_s


def test_a_scan_uses_both_and_is_rectified(tmp_path):
    """The first bounce, rectified, comes |x_p - h| - |x_c - h| after the pulse is on the wall."""
    config = misaligned_at_random(4, tmp_path / "calibrations")
    store = CalibrationStore(config.calibration.folder)
    known = galvo_calibration(config, 0.5e-3, 4)
    store.add(known.galvo)
    zero, response = TimeZeroRoutine(columns=7, rows=5), ResponseRoutine(columns=3, rows=2, exposure_s=0.3)
    store.add(zero.fit(measured(zero, config, None, tmp_path, Watch())[:1], RigState(config, known)))
    width = fitted(response, config, measured(response, config, None, tmp_path, Watch())).calibration
    assert abs(width.fwhm_s - true_width_s()) < 2e-12
    assert abs(width.fwhm_s - true_width_s()) < 4 * width.fwhm_error_s
    setup = zero.setup(config)
    plan = ScanPlan.grid(setup, columns=3, rows=3, spacing_m=0.4, exposure_s=0.05, skip_m=0.0)
    target = tmp_path / "scan.h5"
    acquire(plan, RigState.resolve(setup), target)
    with ScanFile(target) as scan:
        assert scan.instrument_response_s == width.fwhm_s
        assert set(scan.calibrations.records) == {"galvo", "time-zero", "irf"}
        capture, angles = scan.capture(), scan.mirror_rad
        fine = replace(capture, laser_m=capture.laser_m / 100)  # 4 mm apart: the response is the limit
        choice = wavelength(fine, scan.instrument_response_s)
        assert f"{width.fwhm_s * 1e12:.0f} ps" in choice.reason
        assert 1.5 <= choice.value / shortest_wavelength_m(width.fwhm_s) < 1.6  # rounded up
        counts = np.concatenate([block for _, block in capture.histograms.blocks()])
    bench = true_geometry(config)
    head_m = np.array(bench.detector_head_m)
    along_m = np.linalg.norm(scan.laser_m - head_m, axis=1) - np.linalg.norm(head_m)
    assert np.allclose(scan.laser_m, RigState.resolve(config).pointing.spots_m(angles), atol=1e-6)
    times_s = capture.first_bin_s[:, None] + (np.arange(counts.shape[1]) + 0.5) * capture.bin_width_s
    near = np.abs(times_s - along_m[:, None] / 299_792_458) < 0.15e-9
    seen_s = np.array([np.average(t[k], weights=c[k]) for t, c, k in zip(times_s, counts, near, strict=True)])
    # the tail delays the mean by 3.7 ps, cut at 150 ps a little less; 27 000 counts: 0.2 ps; spots: 1 ps
    assert np.abs(seen_s - along_m / 299_792_458 - 3.3e-12).max() < 15e-12


def test_too_few_positions_are_refused_and_nothing_is_stored(tmp_path):
    config = misaligned_at_random(0, tmp_path / "calibrations")
    routine = TimeZeroRoutine(columns=4, rows=3, exposure_s=0.02)
    files = measured(routine, config, None, tmp_path, Watch())
    with pytest.raises(CalibrationError, match="12 positions with a first bounce are too few"):
        fitted(routine, config, files)
    short = ResponseRoutine(columns=2, rows=1, exposure_s=0.02)
    files = measured(short, config, None, tmp_path, Watch())
    with pytest.raises(CalibrationError, match="too few for a response"):
        fitted(short, config, files)
    assert not list((tmp_path / "calibrations").glob("*"))


@pytest.mark.parametrize("gated", [True, False])
def test_a_known_target_gives_the_delay(gated, tmp_path):
    rig = {"simulation": {"scene": "point", "misalignment": {"cable_delay": "3ns"}}, "spad": {"gated": gated}}
    config = built_in_with({**rig, "calibration": {"folder": str(tmp_path)}})
    routine = TargetRoutine(place("1m"), columns=5, rows=4)
    if not gated:
        config = TimeZeroRoutine().setup(config)
    files = measured(routine, config, None, tmp_path, Watch())
    found = routine.fit(files, RigState(config))
    # 7000 counts: 0.7 ps with the tail's shape free, four of these; a patch of 2 cm: 0.1 ps
    assert found.electronics_delay_s == pytest.approx(15.3e-9, abs=3e-12)


@pytest.mark.parametrize("text", ["1cm,2cm", "0cm,0cm,-1m", "1"])
def test_a_target_is_a_place_before_the_wall(text):
    with pytest.raises(UsageError):
        place(text)


def test_width_of_a_gaussian_and_its_slope():
    shape = peaks.Emg(30e-12, 50e-12, 1e-9)
    assert irf.width_s(shape) == pytest.approx(2.3548200450 * 30e-12, rel=1e-7)
    assert irf.width_slopes(shape)[0] == pytest.approx(2.3548200450, rel=1e-6)
    widths_s = [irf.width_s(peaks.Emg(30e-12, 50e-12, part)) for part in (0.01, 0.1, 0.3)]
    assert all(less < more for less, more in pairwise(widths_s))
