"""``rig info`` and ``rig list``: what files are, told from what they say of themselves."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanFile, ScanWriter, Volume, write_volume
from rig.files.outline import ScanOutline
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.kinds import DarkRates
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import built_in_with
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from support.older_picoquant_files import thd
from support.picoquant_files import ptu, records_of, scan_events

CONFIG = built_in_with(
    {"scan": {"columns": 6, "rows": 4, "spacing": "10cm", "skip": "0cm"}, "notes": {"purpose": "a first try"}}
)
PLAN = ScanPlan.grid(CONFIG)
DARK = DarkRates(
    created="2026-01-02T03:04:05Z", valid_days=30, rig_name=CONFIG.name, devices={}, measured_from={},
    dark_hz=10, dark_error_hz=1, ambient_hz=100, ambient_error_hz=3, afterpulse_probability=0.01,
    afterpulse_probability_error=0.001, afterpulse_decay_s=None, afterpulse_decay_error_s=None,
    chi2_per_bin=1, hold_off_s=[], after_hold_off=[], after_hold_off_error=[],
)  # fmt: skip


def write_scan(path, steps=24, *, closed=True, dark=False):
    """Write a scan of PLAN with 3 photons a step; one that is not closed is as its program's kill left it."""
    state = RigState(CONFIG, Calibrations({"dark": DARK}) if dark else Calibrations())
    description = ScanDescription(
        PLAN.spots_m, np.zeros((1, 3)), 2000, 16e-12, 0.0, plan=PLAN, state=state, simulated=True
    )
    writer = ScanWriter.create(path, description)
    for _ in range(steps):
        writer.append(np.bincount([400, 500, 501], minlength=2000).astype("u4"), 0.01)
    writer.checkpoint()
    if closed:
        writer.close("complete" if steps == len(PLAN) else "interrupted", "as the test wants it")
    return writer


def told(rig, *arguments):
    done = rig(*arguments, "--json")
    assert done.code == 0, done.err
    document = json.loads(done.out)
    assert document.pop("schema_version") == 1
    return document


def test_a_scan_is_told(rig):
    write_scan(Path("a.h5"), dark=True)
    found = told(rig, "info", "a.h5")
    assert (found["kind"], found["rig"], found["status"]) == ("scan", CONFIG.name, "complete")
    assert (found["positions"], found["measured"], found["photons"]) == (24, 24, 72)
    assert (found["plan"][0]["columns"], found["plan"][0]["exposure_s"]) == (6, 0.01)
    assert found["notes"] == {"purpose": "a first try"}
    with ScanFile("a.h5") as scan:
        assert found["sha256"] == scan.digest
    (dark,) = found["calibrations"]
    assert dark["kind"] == "dark"
    assert dark["age_days"] > 300  # it is of January 2026, the scan is of now
    assert not dark["was_good"]
    text = rig("info", "a.h5").out
    for words in ("6 x 4 positions 10 cm apart, 10 ms each, step", "a first try", "NO LONGER VALID", "72"):
        assert words in text


def test_a_scan_whose_name_leaves_no_room_for_a_journal_is_told(rig):
    """The longest that a file system takes, as other programs write them."""
    name = "x" * 252 + ".h5"
    write_scan(Path("a.h5"))
    Path("a.h5").rename(name)
    assert rig("info", name).code == 0
    assert rig("list", ".").code == 0


def test_a_scan_that_grows_is_told_as_far_as_it_is(rig):
    writer = write_scan(Path("a.h5"), steps=12, closed=False)
    found = told(rig, "info", "a.h5")
    assert (found["status"], found["measured"], found["photons"], found["sha256"]) == (
        "running",
        12,
        36,
        None,
    )
    assert told(rig, "list", ".")["scans"][0]["status"] == "running"
    writer.close("interrupted", "stopped")
    found = told(rig, "info", "a.h5")
    assert (found["status"], found["measured"], found["photons"]) == ("interrupted", 12, 36)


def test_an_outline_says_of_a_killed_scan_what_its_file_says_when_read_in_full(tmp_path):
    write_scan(tmp_path / "a.h5", steps=17, closed=False, dark=True)._journal.close()
    with ScanOutline(tmp_path / "a.h5") as outline, ScanFile(tmp_path / "a.h5") as scan:
        assert outline.status == scan.status == "interrupted"
        np.testing.assert_array_equal(outline.marked, scan.done)
        np.testing.assert_array_equal(outline.live_time_s, scan.live_time_s)
        assert outline.marked.sum() == 17
        assert outline.plan == PLAN
        assert outline.calibrations == scan.calibrations
        assert outline.notes == {"purpose": "a first try"}


def a_volume(scan, digest=""):
    axes = np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 4), np.linspace(0.5, 1, 3)
    parameters = {"solver": "rsd", "wavelength_m": 0.04, "origin": {"positions": 20, "wall_m": [-0.5, 0.5]}}
    more = {"parameters": parameters, "scan": scan, "scan_digest": digest}
    return Volume(np.random.default_rng(1).random((3, 4, 5), "f4"), *axes, **more)


def test_a_volume_is_told_and_whether_its_scan_is_beside_it(rig):
    write_scan(Path("a.h5"))
    with ScanFile("a.h5") as scan:
        write_volume("a-volume.h5", a_volume("a.h5", scan.digest))
    found = told(rig, "info", "a-volume.h5")
    assert (found["kind"], found["scan"], found["voxels"]) == ("volume", "a.h5", [5, 4, 3])
    assert found["parameters"]["wavelength_m"] == 0.04
    assert "a.h5, in the same folder" in rig("info", "a-volume.h5").out
    assert "wavelength  4 cm" in rig("info", "a-volume.h5").out
    assert "positions 20, wall -50 cm; 50 cm" in " ".join(rig("info", "a-volume.h5").out.split())
    with h5py.File("a.h5", "r+") as file:
        file.attrs["software"] = "another"
    assert "is another" in rig("info", "a-volume.h5").out
    Path("a.h5").unlink()
    assert "not in the same folder" in rig("info", "a-volume.h5").out


def test_calibrations_and_configurations_are_told(rig):
    path = CalibrationStore(Path("calibrations")).add(DARK)
    found = told(rig, "info", path)
    assert (found["kind"], found["calibration"], found["was_good"]) == ("calibration", "dark", False)
    assert found["digest"] == json.loads(path.read_text())["digest"]
    Path("rig.toml").write_text('name = "bench 2"\n[simulation]\n[scan]\nspacing = "2cm"\n')
    found = told(rig, "info", "rig.toml")
    assert (found["kind"], found["rig"], found["simulated"]) == ("configuration", "bench 2", True)
    assert found["plan"][0]["spacing_m"] == 0.02
    Path("rig.toml").write_text("[simulation]\n[scan]\nspacng = 1\n")
    done = rig("info", "rig.toml")
    assert (done.code, "did you mean 'spacing'" in done.err) == (2, True)


def test_a_file_of_others_is_named_for_what_the_importers_recognise(rig):
    write_scan(Path("a.h5"))
    assert rig("export", "a.h5", "a.mat").code == 0
    assert rig("export", "a.h5", "a.ptu").code == 0
    found = told(rig, "info", "a.ptu")
    assert (found["kind"], found["scan"]) == ("records", "a.h5")
    with h5py.File("b.h5", "w") as file:
        file["something"] = [1.0]
    done = rig("info", "b.h5")
    assert (done.code, "something" in done.err) == (5, True)
    Path("c.txt").write_text("hello")
    assert rig("info", "c.txt").code == 5
    assert rig("info", "none.h5").code == 5
    np.save("d.npy", np.zeros(3))
    assert "an array of NumPy" in rig("info", "d.npy").err
    Path("e.thd").write_bytes(thd(np.ones((3, 4096), int)))
    assert "3 histograms (curves), the first of 4,096 bins of 4 ps" in " ".join(
        rig("info", "e.thd").out.split()
    )
    ptu(Path("f.ptu"), records_of(scan_events(4, 10)))
    assert "T3 records, bins of 16 ps" in " ".join(rig("info", "f.ptu").out.split())
    done = rig("info", ".")
    assert (done.code, "rig list . lists its scans" in done.err) == (5, True)


def test_a_folder_is_listed_newest_last_and_damaged_files_are_named(rig, tmp_path):
    for name, date in (("b.h5", "2026-03-01"), ("a.h5", "2026-02-01"), ("c.h5", "2025-12-31")):
        write_scan(Path(name), 20 if name == "a.h5" else 24)
        with h5py.File(name, "r+") as file:
            file.attrs["created"] = f"{date}T12:00:00+00:00"
    whole = Path("b.h5").read_bytes()
    Path("cut.h5").write_bytes(whole[: len(whole) // 2])
    Path("text.h5").write_text("no HDF5")
    write_volume("a-volume.h5", a_volume("a.h5"))
    Path("notes.txt").write_text("no scan")
    found = told(rig, "list", tmp_path)
    assert [Path(one["file"]).name for one in found["scans"]] == ["c.h5", "a.h5", "b.h5"]
    assert sorted(Path(one["file"]).name for one in found["damaged"]) == ["cut.h5", "text.h5"]
    lines = rig("list").out.splitlines()
    assert [line.split()[2] for line in lines[1:4]] == ["c.h5", "a.h5", "b.h5"]
    assert "20 of 24" in lines[2]
    assert "interrupted  a first try" in lines[2]
    assert all("damaged" in line for line in lines[4:])
    assert len(lines) == 6
    assert rig("list", "nowhere").code == 5


@pytest.mark.parametrize("what", ["a newer version", "a plan that is none"])
def test_one_bad_scan_does_not_hide_the_others(rig, what):
    for name in ("a.h5", "b.h5"):
        write_scan(Path(name))
    with h5py.File("a.h5", "r+") as file:
        if what == "a newer version":
            file.attrs["version"] = 99
        else:
            file["start"].attrs["plan"] = '{"passes": 3}'
    found = told(rig, "list")
    assert [Path(one["file"]).name for one in found["scans"]] == ["b.h5"]
    assert [Path(one["file"]).name for one in found["damaged"]] == ["a.h5"]


def test_a_sheet_shows_counts_and_images(rig):
    write_scan(Path("a.h5"))
    shutil.copy("a.h5", "b.h5")
    write_volume("a-volume.h5", a_volume("a.h5"))
    Path("c.h5").write_text("no HDF5")
    done = rig("list", "--sheet", "sheet.png")
    assert done.code == 0, done.err
    from matplotlib.image import imread

    drawn = imread("sheet.png")
    assert drawn.shape[1] == 1500
    assert len(np.unique(drawn.reshape(-1, drawn.shape[2]), axis=0)) > 20  # colours: there are pictures in it


def test_a_failure_is_one_document_too(rig):
    for arguments, code in ((("info", "none.h5"), 5), (("info", "--bogus"), 2), (("list", "nowhere"), 5)):
        done = rig(*arguments, "--json")
        assert done.code == code
        found = json.loads(done.out)
        assert (found["schema_version"], found["exit_code"]) == (1, code)
        assert found["error"]
