"""Scans use calibrations, keep a copy of them, and can be seen with later ones."""

import json

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rig.bench.simulated import true_geometry
from rig.errors import DataFileError, UsageError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.image.recalibrate import as_recorded, from_store, recalibrated
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.kinds import GalvoModel, TimeZero
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import load
from rig.model.delays import PathDelays

MISALIGNED = """
name = "crooked rig"
[calibration]
folder = "here"
[hydraharp]
bins = 3000
[simulation]
[simulation.misalignment]
wall_tilt = ["5deg", "2deg"]
mirror_offset = ["0.5deg", "-0.3deg"]
mirror_gain = [1.005, 0.996]
cable_delay = "3ns"
"""
ORIGIN = {
    "valid_days": 30,
    "rig_name": "crooked rig",
    "devices": {},
    "measured_from": {},
    "simulated": True,
}


def true_calibrations(config):
    """What a perfect calibration would find: the bench's own truth."""
    truth = true_geometry(config)
    turn = Rotation.from_matrix(np.array(truth.mount.rotation)).as_rotvec()
    galvo = GalvoModel(
        **ORIGIN,
        method="cameras",
        mirror_m=truth.galvo_m,
        rotation_rad=tuple(turn.tolist()),
        offset_rad=truth.mount.offset_rad,
        gain=truth.mount.gain,
        mirrors=1,
        separation_m=0.0,
        area_m=[(-0.8, -0.6), (0.8, -0.6), (0.8, 0.6), (-0.8, 0.6)],
        spot_error_m=0.0,
        residual_m=0.0,
        positions=99,
    )
    time_zero = TimeZero(
        **ORIGIN,
        electronics_delay_s=truth.electronics_delay_s,
        electronics_delay_error_s=0.0,
        laser_head_m=truth.galvo_m,
        detector_head_m=truth.detector_head_m,
        detector_spot_m=truth.channels[0].spot_m,
        rectified_error_s=0.0,
        rectified_error_worst_s=0.0,
        residual_s=0.0,
        chi2=1.0,
        positions=99,
        drift_per_minute_s=None,
        drift_per_minute_error_s=None,
        spots_m=[],
        residuals_s=[],
    )
    return galvo, time_zero


@pytest.fixture
def crooked(tmp_path):
    path = tmp_path / "crooked.toml"
    path.write_text(MISALIGNED)
    return path


SMALL = ("--grid", "8x6", "--spacing", "15cm", "--exposure", "1ms")


def test_a_scan_uses_its_calibrations_and_keeps_them(rig, tmp_path, crooked):
    config = load(crooked)
    store = CalibrationStore(tmp_path / "here")
    calibrations = true_calibrations(config)
    for calibration in calibrations:
        store.add(calibration)
    done = rig("scan", "-c", crooked, *SMALL, "--out", "a.h5")
    assert done.code == 0, done.err
    assert "Calibrations: galvo of " in done.err
    with ScanFile(tmp_path / "a.h5") as scan:
        assert set(scan.calibrations.records) == {"galvo", "time-zero"}
        assert scan.calibrations.galvo == calibrations[0]
        assert scan.state.pointing == calibrations[0].pointing()
        # the bench puts the beam where the plan wants it, since the model that was inverted is the truth
        truth = true_geometry(config)
        real_m = np.array([truth.laser_spot_m(tuple(angles)) for angles in scan.mirror_rad])
        assert real_m == pytest.approx(scan.laser_m, abs=1e-9)
        assert scan.delays.electronics_delay_s == pytest.approx(15.3e-9)


def test_a_grid_beyond_what_was_calibrated_is_refused(rig, tmp_path, crooked):
    CalibrationStore(tmp_path / "here").add(true_calibrations(load(crooked))[0])
    done = rig("scan", "-c", crooked, "--out", "a.h5")
    assert done.code == 4
    assert "outside the area in which the mirror was calibrated" in done.err
    assert not (tmp_path / "a.h5").exists()


def test_a_resumed_scan_keeps_the_calibrations_that_it_began_with(rig, tmp_path, crooked):
    store = CalibrationStore(tmp_path / "here")
    galvo, _ = true_calibrations(load(crooked))
    store.add(galvo)
    assert rig("scan", "-c", crooked, *SMALL, "--out", "whole.h5").code == 0
    assert rig("scan", "-c", crooked, *SMALL, "--out", "part.h5").code == 0
    with h5py.File(tmp_path / "part.h5", "r+") as file:
        file["transients/done"][20:] = False
        file["stop"].attrs["status"] = "interrupted"
    store.path_for(galvo, ".json").unlink()  # a later scan would go elsewhere
    assert rig("resume", "part.h5").code == 0
    with ScanFile(tmp_path / "whole.h5") as whole, ScanFile(tmp_path / "part.h5") as part:
        assert (counts(whole) == counts(part)).all()


def counts(scan):
    return np.concatenate([block for _, block in scan.capture().histograms.blocks()])


def test_a_scan_from_before_is_seen_right_with_later_calibrations(rig, tmp_path, crooked):
    assert rig("scan", "-c", crooked, *SMALL, "--out", "a.h5").code == 0
    config = load(crooked)
    galvo, time_zero = true_calibrations(config)
    with ScanFile(tmp_path / "a.h5") as scan:
        before = as_recorded(scan)
        seen = recalibrated(scan, Calibrations({"galvo": galvo, "time-zero": time_zero}))
        truth = true_geometry(config)
        real_m = np.array([truth.laser_spot_m(tuple(angles)) for angles in scan.mirror_rad])
        assert np.linalg.norm(before.capture.laser_m - real_m, axis=1).min() > 0.01
        assert seen.capture.laser_m == pytest.approx(real_m, abs=1e-9)
        legs_m = np.linalg.norm(real_m - truth.galvo_m, axis=1) + np.linalg.norm(truth.detector_head_m)
        expected_s = scan.first_bin_s - truth.electronics_delay_s - legs_m / 299_792_458.0
        assert seen.capture.first_bin_s == pytest.approx(expected_s, abs=1e-15)
        # the gate opened at one time after the sync: later in rectified time where the legs are shorter
        assert seen.fade_from_s == pytest.approx(
            scan.gate_start_s - (scan.first_bin_s - seen.capture.first_bin_s).min(), abs=1e-15
        )
        assert len(seen.notes) == 2


def test_recon_names_what_it_was_calibrated_with(rig, tmp_path, crooked):
    assert rig("scan", "-c", crooked, *SMALL, "--out", "a.h5").code == 0
    none = rig("recon", "a.h5", "--calibrations", "there")
    assert none.code == 2
    assert "holds no calibration of the devices" in none.err
    store = CalibrationStore(tmp_path / "there")
    for calibration in true_calibrations(load(crooked)):
        store.add(calibration)
    done = rig("recon", "a.h5", "--calibrations", "there", "--wavelength", "60cm", "--json")
    assert done.code == 0, done.err
    assert any("time zero: later by 3" in note for note in json.loads(done.out)["calibrated"])


def test_a_file_without_mirror_angles_cannot_be_calibrated_again(tmp_path):
    path = tmp_path / "a.h5"
    description = ScanDescription(
        laser_m=np.zeros((2, 3)),
        detector_m=np.zeros((1, 3)),
        bins=5,
        bin_width_s=4e-12,
        first_bin_s=0.0,
        delays=PathDelays(np.zeros(3), np.zeros(3)),
    )
    with ScanWriter.create(path, description) as writer:
        writer.append(np.ones(5, "u4"))
        writer.append(np.ones(5, "u4"))
    galvo, _ = true_calibrations(load_text(tmp_path))
    with ScanFile(path) as scan, pytest.raises(DataFileError, match="mirror_rad"):
        recalibrated(scan, Calibrations({"galvo": galvo}))
    with ScanFile(path) as scan, pytest.raises(UsageError, match="no calibration"):
        from_store(scan, CalibrationStore(tmp_path / "nowhere"))


def load_text(tmp_path):
    (tmp_path / "crooked.toml").write_text(MISALIGNED)
    return load(tmp_path / "crooked.toml")
