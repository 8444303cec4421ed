"""Calibrations are kept whole, known again, and doubted where there is reason to."""

import json
from datetime import UTC, datetime, timedelta

import pytest

from rig.errors import DataFileError
from rig.model.calibrations.base import digest
from rig.model.calibrations.kinds import GateOpening, TimeZero
from rig.model.calibrations.store import CalibrationStore, doubts, read
from rig.model.config import CalibrationConfig, built_in
from rig.model.state import Gate, RigState
from support.misaligned import galvo_calibration

NOON = datetime(2026, 3, 4, 12, tzinfo=UTC)
DEVICES = {"galvo": "G1", "laser": "L1", "spad": "S1", "tcspc": "T1"}


def time_zero(**changes):
    given = {
        "created": NOON,
        "valid_days": 7,
        "rig_name": "simulated rig",
        "devices": DEVICES,
        "measured_from": {"raw.h5": "00ff"},
        "simulated": True,
        "electronics_delay_s": 15.3e-9,
        "electronics_delay_error_s": 2e-12,
        "laser_head_m": (0.1, 0.2, 2.5),
        "detector_head_m": (-0.1, 0.2, 2.5),
        "detector_spot_m": (0.0, 0.0, 0.0),
        "rectified_error_s": 1e-12,
        "rectified_error_worst_s": 2e-12,
        "residual_s": 3e-12,
        "chi2": 1.0,
        "positions": 99,
        "drift_per_minute_s": None,
        "drift_per_minute_error_s": None,
        "spots_m": [],
        "residuals_s": [],
    }
    return TimeZero(**(given | changes))


def gate(**changes):
    given = {
        "created": NOON,
        "valid_days": 30,
        "rig_name": "simulated rig",
        "devices": {"laser": "L1", "spad": "S1"},
        "measured_from": {},
        "simulated": True,
        "gate_delay_s": 33e-9,
        "gate_delay_error_s": 10e-12,
        "gate_width_s": 40e-9,
        "nearest_m": 0.5,
        "passed": 1e-4,
        "edge_s": 200e-12,
        "edge_error_s": 2e-12,
        "offset_s": 0.0,
        "residual": 1.0,
        "spots_m": [(0.0, 0.0)],
        "earliest_s": [None],
        "latest_s": [34e-9],
        "failed": [False],
    }
    return GateOpening(**(given | changes))


def configured(folder, **spad):
    config = built_in()
    return config.model_copy(
        update={
            "calibration": CalibrationConfig(folder=folder),
            "detector": config.detector.model_copy(update=spad),
        }
    )


def resolved(config, identities=None):
    return RigState(config).of_devices(identities).calibrations


def test_a_mirror_calibrated_before_there_was_an_incidence_has_none(tmp_path):
    """Its file has no such key, and a digest without it."""
    galvo = galvo_calibration(built_in(), 1e-3, seed=0).galvo
    old = json.loads(galvo.document())
    assert old.pop("incidence_rad") == [0.0, 0.0]
    del old["digest"]
    path = CalibrationStore(tmp_path).path_for(galvo, ".json")
    path.write_text(json.dumps({**old, "digest": digest(old)}))
    again = read(path)
    assert again == galvo
    assert again.pointing().incidence_rad == (0.0, 0.0)


def test_what_is_stored_is_read_back(tmp_path):
    store = CalibrationStore(tmp_path / "new")
    path = store.add(time_zero())
    assert path.name == "time-zero-20260304T120000Z.json"
    assert read(path) == time_zero()
    assert [one.calibration for one in store.everything()] == [time_zero()]
    assert list((tmp_path / "new").iterdir()) == [path]  # nothing half written beside it


def test_a_changed_file_is_noticed(tmp_path):
    path = CalibrationStore(tmp_path).add(time_zero())
    content = json.loads(path.read_text())
    content["electronics_delay_s"] += 1e-12
    path.write_text(json.dumps(content))
    with pytest.raises(DataFileError, match=r"changed after it was stored.*measure it again"):
        read(path)


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"kind": "dark"}', '{"kind": 1, "digest": "x"}'])
def test_what_is_no_calibration_is_refused_by_name(tmp_path, text):
    path = tmp_path / "dark-1.json"
    path.write_text(text)
    with pytest.raises(DataFileError, match=r"dark-1\.json"):
        read(path)


def test_the_newest_of_the_connected_devices_counts(tmp_path):
    store = CalibrationStore(tmp_path)
    for hours, delay_s, laser in ((0, 1e-9, "L1"), (1, 2e-9, "L1"), (2, 3e-9, "L2")):
        store.add(
            time_zero(
                created=NOON + timedelta(hours=hours),
                electronics_delay_s=delay_s,
                devices=DEVICES | {"laser": laser},
            )
        )
    chosen = resolved(configured(tmp_path), DEVICES)
    assert chosen.time_zero.electronics_delay_s == 2e-9
    assert any("belongs to another laser and is not used" in sentence for sentence in chosen.warnings)
    assert resolved(configured(tmp_path), DEVICES | {"laser": "L2"}).time_zero.electronics_delay_s == 3e-9


def test_an_old_calibration_is_used_and_doubted(tmp_path):
    CalibrationStore(tmp_path).add(time_zero())
    assert doubts(time_zero(), NOON + timedelta(days=6.9)) == ""
    told = doubts(time_zero(), NOON + timedelta(days=10))
    assert "10 days old" in told
    assert "rig calibrate time-zero" in told


def test_another_rig_in_the_same_folder_is_left_alone(tmp_path):
    store = CalibrationStore(tmp_path)
    store.add(time_zero(rig_name="the other rig"))
    assert resolved(configured(tmp_path), DEVICES).records == {}
    store.add(time_zero(created=NOON - timedelta(days=1)))
    assert resolved(configured(tmp_path), DEVICES).time_zero.rig_name == "simulated rig"


def test_a_rehearsal_says_nothing_of_the_real_rig(tmp_path):
    CalibrationStore(tmp_path).add(time_zero(simulated=False))
    assert resolved(configured(tmp_path), DEVICES).time_zero is None


def test_a_gate_that_overrules_the_configuration_is_told(tmp_path):
    CalibrationStore(tmp_path).add(gate(created=datetime.now(UTC).replace(microsecond=0)))
    state = RigState.resolve(configured(tmp_path, gate_delay_s=31.5e-9))
    assert state.gate == Gate(33e-9, 40e-9)
    assert state.doubts == ("the gate opens at 33 ns as calibrated, not at 31.5 ns as configured",)
    assert RigState.resolve(configured(tmp_path, gate_delay_s=33e-9)).doubts == ()


def test_what_a_calibration_doubts_itself_is_told_by_each_scan(tmp_path):
    fresh = datetime.now(UTC).replace(microsecond=0)
    CalibrationStore(tmp_path).add(time_zero(created=fresh, warnings=["the galvo is not calibrated"]))
    assert resolved(configured(tmp_path)).warnings == (
        "the time-zero calibration: the galvo is not calibrated",
    )


def test_the_newest_is_read_alone_and_once(tmp_path):
    store = CalibrationStore(tmp_path)
    old, new = (store.add(time_zero(created=NOON + timedelta(hours=hours))) for hours in (0, 1))
    old.write_text("damaged, and no matter: a newer one is there")
    assert store.newest("time-zero", DEVICES, "simulated rig").path == new
    new.write_text("what is known is not read again")
    assert store.newest("time-zero").path == new
    assert CalibrationStore(tmp_path / "empty").newest("time-zero") is None


def test_a_calibration_dated_in_the_future_is_not_the_newest_for_ever(tmp_path):
    store = CalibrationStore(tmp_path)
    far = store.add(time_zero(created=NOON.replace(year=2526)))
    assert "dated 2526-03-04, in the future" in doubts(store.newest("time-zero").calibration)
    store.add(time_zero(created=NOON, electronics_delay_s=16e-9))
    state = RigState.resolve(
        built_in().model_copy(update={"calibration": CalibrationConfig(folder=tmp_path)})
    )
    assert state.calibrations.time_zero.electronics_delay_s == 16e-9
    assert any(str(far) in sentence and "not used" in sentence for sentence in state.doubts)


@pytest.mark.parametrize("days", [1e308, 10**400, -1, 0])
def test_a_calibration_cannot_be_good_for_longer_than_a_century(days):
    with pytest.raises(ValueError, match="valid_days"):
        time_zero(valid_days=days)


def test_nothing_is_measured_that_could_not_be_stored(rig, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "rig.toml").write_text('[simulation]\n[calibration]\nfolder = "file/calibrations"\n')
    done = rig("calibrate", "dark", "--config", "rig.toml", "--yes")
    assert done.code == 2
    assert "file/calibrations: the calibration cannot be stored (Not a directory)" in done.err
    assert "laser" not in done.err
