"""``rig scan`` from the command line to the file, through the real drivers and the simulated wires."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.optimize import fsolve

from rig.files.scan import ScanFile
from rig.model.config import built_in_with
from support.misaligned import true_spots_m

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = ("--grid", "20x12", "--spacing", "5cm", "--exposure", "10ms")


def counts_of(path):
    with h5py.File(path) as file:
        return file["transients/counts"][:, 0]


def test_a_scan_becomes_a_file_that_tells_its_whole_story(rig, tmp_path):
    done = rig("scan", *SMALL, "--out", "a.h5")
    assert done.code == 0, done.err
    assert "built-in simulated rig" in done.err
    assert "240 of 240" in done.out
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["format"] == "rig-scan"
        assert file["transients/counts"].shape == (240, 1, 15_000)
        assert file["transients/done"][()].all()
        assert file["transients"].attrs["time_origin"] == "laser"
        assert file["transients"].attrs["bin_width_s"] == pytest.approx(4e-12)
        assert file["stop"].attrs["status"] == "complete"
        assert set(file["devices"]) == {"galvo", "laser", "spad", "tcspc"}
        assert all(file["devices"][name].attrs["identity"] for name in file["devices"])
        assert json.loads(file["start"].attrs["plan"])["passes"][0]["exposure_s"] == 0.01
        assert json.loads(file["start"].attrs["configuration"])["timing"]["electronics_delay_s"] == 12.3e-9
        # 10 ms at every position, as the instrument's own clock counts it
        assert file["transients/live_time_s"][()] == pytest.approx(0.01, abs=1e-3)


def test_the_same_seed_gives_the_same_photons_and_another_seed_others(rig):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert rig("scan", *SMALL, "--seed", seed, "--out", f"{name}.h5").code == 0
    a, b, c = (counts_of(f"{name}.h5") for name in "abc")
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)
    # two Poisson totals of the same mean differ by less than 5 standard deviations
    assert abs(int(a.sum()) - int(c.sum())) < 5 * np.sqrt(float(a.sum()) + float(c.sum()))


def test_exposure_scales_the_photons(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    assert rig("scan", *SMALL[:4], "--exposure", "40ms", "--out", "b.h5").code == 0
    a, b = counts_of("a.h5").sum(), counts_of("b.h5").sum()
    # b has mean 4 a: the variance of b - 4 a is b + 16 a
    assert abs(float(b) - 4.0 * float(a)) < 5 * np.sqrt(float(b) + 16 * float(a))


def test_an_empty_room_gives_only_background(rig):
    assert rig("scan", *SMALL, "--out", "letters.h5").code == 0
    assert rig("scan", *SMALL, "--scene", "empty", "--out", "empty.h5").code == 0
    assert counts_of("empty.h5").sum() < 0.02 * counts_of("letters.h5").sum()


def test_json_is_one_document(rig):
    done = rig("scan", *SMALL, "--out", "a.h5", "--json")
    result = json.loads(done.out)
    assert result["status"] == "complete"
    assert result["photons"] == counts_of("a.h5").sum()


def test_a_dry_run_shows_the_plan_and_leaves_nothing(rig, tmp_path):
    done = rig("scan", "--config", CONFIGS / "lab.toml", "--dry-run")
    assert done.code == 0, done.err
    for told in ("23,364 of 180 x 130", "6 h", "1.4 GB", "deg, limits"):
        assert told in done.out
    assert list(tmp_path.iterdir()) == []


def test_a_dry_run_as_json(rig):
    plan = json.loads(rig("scan", "--dry-run", "--json").out)
    assert plan["positions"] + plan["skipped"] == 23_400
    assert plan["exposure_total_s"] == pytest.approx(233.84)


def test_a_dry_run_knows_the_angle_of_incidence(rig, tmp_path):
    """Met at 45 degrees in the plane of x, a mirror has to turn farther in y than 20 degrees."""
    path = tmp_path / "turned.toml"
    galvo = 'name = "turned"\n[simulation]\n[galvo]\nincidence = "45deg"\n'
    path.write_text(galvo)
    refused = rig("scan", "--config", path, "--dry-run")
    assert refused.code == 4
    assert "of mirror angle in y, but the limit is 20.0 deg" in refused.err
    path.write_text(galvo + 'max_angle_y = "30deg"\n')
    told = json.loads(rig("scan", "--config", path, "--dry-run", "--json").out)["mirror_angle_deg"]
    config = built_in_with({"galvo": {"incidence": "45deg"}})
    corners = [
        fsolve(lambda angles, at=(x_m, y_m): true_spots_m(config, [angles])[0] - at, (0.0, 0.0))
        for x_m in (-0.895, 0.895)
        for y_m in (-0.645, 0.645)
    ]  # by the bench's own mirror, which says only where an angle leads
    assert told == pytest.approx(np.degrees(np.abs(corners)).max(axis=0), abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (("--exposure", "10"), 2, "write a time with its unit, e.g. 10ms"),
        (("--exposure", "10mm"), 2, "not a time"),
        (("--grid", "180by130"), 2, "--grid 180x130"),
        (("--grid", "9" * 5000 + "x2"), 2, "--grid 180x130"),
        (("--grid", "99999999x99"), 2, "more than the 5,000,000"),
        (("--exposure", "1e400s"), 2, "is too large"),
        (("--exposure", "10dB"), 2, "unknown unit 'dB'"),
        (("--exposure", "1mdegC"), 2, "unit"),
        (("--spacing", "4cm"), 4, "deg of mirror angle in x"),
        (("--exposure", "1500us"), 4, "whole ms from 1"),
        (("--scene", "kitchen"), 2, "letters"),
        (("--config", "missing.toml"), 2, "missing.toml: cannot be read"),
        (("--config", CONFIGS / "lab.toml", "--seed", "1"), 2, "real devices"),
        (("--bogus",), 2, "it has no option --bogus"),
        (("--out", "nowhere/a.h5"), 2, "the folder nowhere does not exist"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_message(rig, tmp_path, arguments, code, told):
    done = rig("scan", *arguments)
    assert done.code == code, done.err
    assert told in done.err
    assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_key_is_named(rig, tmp_path):
    Path("rig.toml").write_text("[simulation]\nseeed = 1\n")
    done = rig("scan", "--config", "rig.toml")
    assert done.code == 2
    assert "unknown key 'simulation.seeed'; did you mean 'seed'?" in done.err


def test_a_missing_device_is_named_and_leaves_no_file(rig, tmp_path):
    (tmp_path / "hhlib.so").write_bytes(b"")
    nowhere = 'address = "/dev/rig-no-such-port"'
    text = f"[galvo]\n{nowhere}\n[laser]\n{nowhere}\n[detector]\n{nowhere}\n"
    Path("rig.toml").write_text(text)
    done = rig("scan", "--config", "rig.toml", "--out", "a.h5")
    assert done.code == 3
    assert "Traceback" not in done.err
    assert not (tmp_path / "a.h5").exists()


def test_an_existing_file_is_not_overwritten(rig, tmp_path):
    (tmp_path / "a.h5").write_bytes(b"precious")
    done = rig("scan", *SMALL, "--out", "a.h5")
    assert done.code == 2
    assert "exists" in done.err
    assert (tmp_path / "a.h5").read_bytes() == b"precious"


def stopped_scan(rig, target, lines):
    """Make a scan whose program was killed after some lines: no closing record, no mark beyond."""
    assert rig("scan", *SMALL, "--out", target).code == 0
    with h5py.File(target, "r+") as file:
        done = file["transients/done"][()]
        done[20 * lines :] = False
        file["transients/done"][...] = done
        counts = file["transients/counts"][()]
        counts[20 * lines :] = 0
        file["transients/counts"][...] = counts
        del file["stop"]


def test_a_resumed_scan_equals_an_uninterrupted_one(rig):
    assert rig("scan", *SMALL, "--out", "whole.h5").code == 0
    stopped_scan(rig, "a.h5", lines=5)
    done = rig("resume", "a.h5")
    assert done.code == 0, done.err
    assert "240 of 240" in done.out
    assert np.array_equal(counts_of("a.h5"), counts_of("whole.h5"))
    with h5py.File("a.h5") as file:
        assert file["stop"].attrs["status"] == "complete"
        assert file["stop"].attrs["photons"] == counts_of("whole.h5").sum()


def test_a_complete_scan_is_not_resumed(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    done = rig("resume", "a.h5")
    assert done.code == 2
    assert "complete" in done.err


def test_a_scan_that_was_killed_before_its_end_is_given_one(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    whole = counts_of("a.h5")
    with h5py.File("a.h5", "r+") as file:
        del file["stop"]
        file["devices/spad"].attrs["identity"] = "away"  # no device is needed
    done = rig("resume", "a.h5")
    assert done.code == 0, done.err
    assert f"{whole.sum():,}" in done.out
    with h5py.File("a.h5") as file:
        assert file["stop"].attrs["status"] == "complete"
        assert file["stop"].attrs["photons"] == whole.sum()
        assert "the program ended before the scan did" in file["stop"].attrs["warnings"]
    assert np.array_equal(counts_of("a.h5"), whole)
    assert rig("resume", "a.h5").code == 2


def as_of_a_real_rig(path, **of_harp):
    """Make a scan file say that it comes from a real rig."""
    with h5py.File(path, "r+") as file:
        configuration = json.loads(file["start"].attrs["configuration"])
        configuration["simulation"] = None
        for name in ("galvo", "laser", "detector", "delayer"):
            configuration[name]["address"] = "/dev/of-the-file"
        configuration["tcspc"] |= of_harp
        file["start"].attrs["configuration"] = json.dumps(configuration)


HERE = (
    '[galvo]\naddress = "/dev/rig-none"\n[laser]\naddress = "/dev/rig-none"\npower_setpoint = 10\n'
    '[tcspc]\nlibrary = "here.so"\n[delayer]\naddress = "/dev/rig-none"\n'
    '[detector]\naddress = "/dev/rig-none"\n'
)


def test_which_library_and_which_ports_are_opened_is_never_taken_from_a_scan_file(rig, tmp_path):
    stopped_scan(rig, "a.h5", lines=5)
    (tmp_path / "gift.so").write_bytes(b"")
    as_of_a_real_rig("a.h5", library=str(tmp_path / "gift.so"))
    done = rig("resume", "a.h5")
    assert done.code == 2
    assert "are never taken from a scan file" in done.err
    Path("rig.toml").write_text(HERE)
    done = rig("resume", "a.h5", "--config", "rig.toml")
    assert done.code == 3
    assert "/dev/rig-none" in done.err
    assert "gift.so" not in done.err
    assert "of-the-file" not in done.err


def test_a_scan_is_not_resumed_with_other_settings(rig):
    stopped_scan(rig, "a.h5", lines=5)
    as_of_a_real_rig("a.h5", offset_s=29e-9)
    Path("rig.toml").write_text(HERE + "gated = false\n")
    done = rig("resume", "a.h5", "--config", "rig.toml")
    assert done.code == 4
    assert "detector.gated is False, was True" in done.err
    assert "tcspc.offset_s is 2.8e-08, was 2.9e-08" in done.err
    assert "address" not in done.err.split("other settings")[1]


def test_a_scan_is_not_resumed_with_another_device(rig):
    stopped_scan(rig, "a.h5", lines=5)
    with h5py.File("a.h5", "r+") as file:
        file["devices/spad"].attrs["identity"] = "another detector"
    before = counts_of("a.h5")
    done = rig("resume", "a.h5")
    assert done.code == 4
    assert "another detector" in done.err
    assert np.array_equal(counts_of("a.h5"), before)


def test_ctrl_c_finishes_the_position_and_keeps_the_file(tmp_path):
    command = [sys.executable, "-m", "rig", "scan", "--out", "a.h5", "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True) as scan:
        assert scan.stderr is not None
        assert scan.stdout is not None
        for line in scan.stderr:  # wait until the first tenth is measured
            if "10 %" in line:
                break
        scan.send_signal(signal.SIGINT)
        rest = scan.stderr.read()
        document = json.loads(scan.stdout.read())  # exactly one, or this fails
    assert scan.returncode == 6
    assert document["status"] == "interrupted"
    assert "Stopping after this position" in rest
    assert "safe in the file" in rest
    with h5py.File(tmp_path / "a.h5") as file:
        done = file["transients/done"][()]
        assert file["stop"].attrs["status"] == "interrupted"
        assert 2338 <= done.sum() < 23_384  # a tenth was reported
        assert (np.diff(done.astype(int)) <= 0).all()  # measured from the first on, without gaps
        assert file["transients/counts"][int(done.sum()) - 1].sum() > 0


def test_frames_are_planned_scanned_resumed_and_told(rig, tmp_path):
    small = ("--grid", "4x3", "--spacing", "20cm", "--exposure", "10ms", "--frames", "3")
    told = json.loads(rig("scan", *small, "--dry-run", "--json").out)
    assert (told["frames"], told["positions"]) == (3, 36)
    assert "3 of 12 positions" in rig("scan", *small, "--dry-run").out
    done = rig("scan", *small, "--out", "a.h5")
    assert done.code == 0, done.err
    assert "3 of 3" in done.out
    with ScanFile(tmp_path / "a.h5") as scan:
        assert "36, 3 frames" in str(scan)
    with h5py.File(tmp_path / "a.h5") as file:
        counts = file["transients/counts"][()].reshape(3, 12, -1).sum(axis=2)
    assert not np.array_equal(counts[0], counts[1])  # every visit draws its own photons
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["transients/done"][20:] = False
        del file["stop"]
    resumed = rig("resume", "a.h5")
    assert resumed.code == 0, resumed.err
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["transients/done"][()].all()
        again = file["transients/counts"][()].reshape(3, 12, -1).sum(axis=2)
    assert np.array_equal(again[0], counts[0])
    assert not np.array_equal(again[2], again[0])  # nor does a new bench give the first visit's again
