"""Many images from one file: what is made, kept, reported, and taken up again after a kill."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from rig.cluster.batch import RECORD, Record, run
from rig.cluster.jobs import SETTINGS, read_jobs
from rig.errors import ConfigError, DataFileError, UsageError
from rig.image.asked import OPTIONS, ImageOptions, asked
from rig.image.request import Request
from support.point_scans import write_point_scan


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """Two scans, and a file that is none."""
    folder = tmp_path_factory.mktemp("scans")
    for name in ("one", "two"):
        write_point_scan(folder / f"{name}.h5", shape=(12, 10), spacing_m=0.06)
    (folder / "broken.h5").write_bytes(b"no scan")
    return folder


def jobs_file(folder, text):
    path = folder / "jobs.toml"
    path.write_text(text)
    return path


def sweep(scans, which="[ot][nw]*.h5", wavelengths='["16cm", "20cm"]'):
    return f"""
[[job]]
scans = ["{scans}/{which}"]
wavelength = {wavelengths}
depth = "0.6m:0.8m:10cm"
"""


def test_lists_are_multiplied_and_name_the_results(scans, tmp_path):
    text = sweep(scans) + "solver = ['rsd', 'direct']\ncycles = 3\n"
    jobs = read_jobs(jobs_file(tmp_path, text))
    assert len(jobs) == 2 * 2 * 2
    assert jobs[1].name == "one-wavelength=16cm-solver=direct"
    assert jobs[1].request == Request(wavelength_m=0.16, depth_m=(0.6, 0.8, 0.1), solver="direct", cycles=3.0)


def test_what_a_killed_worker_began_to_write_is_removed(scans, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    jobs = read_jobs(jobs_file(tmp_path, sweep(scans, "one.h5", '"16cm"')))
    for path in jobs[0].files(out):
        (out / f".{path.stem}.4242.part{path.suffix}").write_bytes(b"half a file")
    assert [one.status for one in run(jobs, out)] == ["done"]
    assert {path.name for path in out.iterdir()} == {RECORD, *(path.name for path in jobs[0].files(out))}


def test_each_option_of_imaging_is_a_setting(tmp_path):
    """What a file can say is what the calls take, all of which has its place in a request."""
    assert set(OPTIONS) == set(ImageOptions.__annotations__)
    assert {option.field for option in OPTIONS.values()} == {one.name for one in fields(Request)}
    assert {name.replace("_", "-") for name in OPTIONS} - set(SETTINGS) == {"calibrations", "however-long"}
    text = "[[job]]\nscans = ['jobs.toml']\nrelight = '10cm,0cm,1m'\nmemory = '2GB'\nframes = '2ns:20ns:2ns'"
    (job,) = read_jobs(jobs_file(tmp_path, text), however_long=True)
    assert job.request == asked(
        relight=(0.1, 0.0, 1.0), memory=2e9, frames=(2e-9, 20e-9, 2e-9), however_long=True
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "tables \\[\\[job\\]\\]"),
        ("job = 3", "tables"),
        ("[[job]]\nscans = ['*.nothing']", "no file is called"),
        ("[[job]]\nscans = ['']", "pattern|no file"),
        ("[[job]]\nscans = 3", "list of names"),
        ("[[job]]\nscans = ['jobs.toml']\nwavelenght = '4cm'", "unknown key wavelenght"),
        ("[[job]]\nscans = ['jobs.toml']\nwavelength = 4", "text with a unit"),
        ("[[job]]\nscans = ['jobs.toml']\nwavelength = '4'", "no unit"),
        ("[[job]]\nscans = ['jobs.toml']\nsolver = 'best'", "not one of rsd"),
        ("[[job]]\nscans = ['jobs.toml']\nwavelength = ''", "wavelength: '' must be text with a unit"),
        ("[[job]]\nscans = ['jobs.toml']\ncycles = '3'", "cycles: '3' is not a number"),
        ("[[job]]\nscans = ['jobs.toml']\ncycles = true", "cycles: True is not a number"),
        ("[[job]]\nscans = ['jobs.toml']\neven-bins = 1", "even-bins: 1 is neither true nor false"),
        ("[[job]]\nscans = ['jobs.toml']\nover = 'all'", "over: 'all' is not one of"),
        ("[[job]]\nscans = ['jobs.toml']\nrelight = '1cm'", "relight: '1cm' is not a place"),
        ("[[job]]\nscans = ['jobs.toml']\ncalibrations = 'mine'", "unknown key calibrations"),
        ("[[job]]\nscans = ['jobs.toml']\nwavelength = []", "empty list"),
        ("[[job]]\nscans = ['jobs.toml']\n[[job]]\nscans = ['jobs.toml']", "name of another"),
        ("[[job", "is not valid TOML"),
        ("job = " + "[" * 100_000, "nested too deeply"),
        ("[[job]]\nscans = ['jobs.toml']\ndepth = " + "[" * 200 + "]" * 200, "text with a unit"),
        ("# " + "x" * 1_000_000, "at most 1 MB"),
        (
            f"[[job]]\nscans = ['jobs.toml']\nwavelength = {['4cm'] * 9000}\nvoxel = {['1cm'] * 9000}",
            r"8\.1e\+07 images",
        ),
        ("job = [3]", "tables"),
    ],
)
def test_what_is_wrong_in_the_file_is_said(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said):
        read_jobs(jobs_file(tmp_path, text))


def test_a_failing_image_is_reported_and_the_others_are_made(rig, scans, tmp_path):
    text = sweep(scans, "*.h5", '"16cm"')
    done = rig("batch", jobs_file(tmp_path, text), "--json")
    told = json.loads(done.out)
    assert {one["name"]: one["status"] for one in told["images"]} == {
        "broken": "failed",
        "one": "done",
        "two": "done",
    }
    assert done.code == 5
    assert "broken: " in done.err
    assert (tmp_path / "jobs" / "one-volume.h5").is_file()
    assert (tmp_path / "jobs" / "one.png").is_file()
    # once more: what is done is kept, what failed is tried again
    again = rig("batch", tmp_path / "jobs.toml")
    assert again.code == 5
    assert "2 kept, 1 failed" in again.err


def test_other_settings_or_another_scan_make_an_image_anew(scans, tmp_path):
    scan = tmp_path / "mine.h5"
    scan.write_bytes((scans / "one.h5").read_bytes())

    def statuses(text):
        jobs = read_jobs(jobs_file(tmp_path, text))
        return [one.status for one in run(jobs, tmp_path / "out")]

    text = sweep(tmp_path, "mine.h5", '"16cm"')
    assert statuses(text) == ["done"]
    assert statuses(text) == ["kept"]
    assert statuses(text.replace("16cm", "18cm")) == ["done"]
    os.utime(scan, (1, 1))
    assert statuses(text.replace("16cm", "18cm")) == ["done"]
    (tmp_path / "out" / "mine.png").unlink()
    assert statuses(text.replace("16cm", "18cm")) == ["done"]


def test_a_mark_of_an_editor_before_the_text_is_no_fault(scans, tmp_path):
    path = tmp_path / "jobs.toml"
    path.write_text(sweep(scans), encoding="utf-8-sig")
    assert len(read_jobs(path)) == 4


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are POSIX")
def test_what_never_ends_is_no_list_of_jobs_and_no_record(scans, tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(ConfigError, match="is a pipe"):
        read_jobs(tmp_path / "pipe.toml")
    with pytest.raises(ConfigError, match="at most 1 MB"):
        read_jobs(Path("/dev/zero"))
    os.mkfifo(tmp_path / RECORD)
    with pytest.raises(DataFileError, match="pipe or a device"):
        Record(tmp_path)
    (tmp_path / RECORD).unlink()
    (tmp_path / RECORD).symlink_to("/dev/zero")
    with pytest.raises(DataFileError, match="pipe or a device"):
        Record(tmp_path)


def test_a_record_that_somebody_wrote_is_not_believed(scans, tmp_path):
    """Only a done image with what was found in it, and files of its size, is kept."""
    jobs = read_jobs(jobs_file(tmp_path, sweep(scans, "one.h5", '"16cm"')))
    assert [one.status for one in run(jobs, tmp_path)] == ["done"]
    record = tmp_path / RECORD
    entry = json.loads(record.read_text().splitlines()[-1])
    for found in (None, 3, [], "x"):
        record.write_text("[" * 100_000 + "\n" + json.dumps({**entry, "found": found}) + "\n")
        assert Record(tmp_path).kept(jobs[0]) is None


def test_files_of_others_are_not_replaced(scans, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "one.png").write_text("somebody's")
    jobs = read_jobs(jobs_file(tmp_path, sweep(scans, "one.h5", '"16cm"')))
    with pytest.raises(UsageError, match="exists, and is not in"):
        list(run(jobs, tmp_path / "out"))
    assert (tmp_path / "out" / "one.png").read_text() == "somebody's"


def test_half_a_line_of_the_record_is_not_believed(scans, tmp_path):
    jobs = read_jobs(jobs_file(tmp_path, sweep(scans, "one.h5", '"16cm"')))
    assert [one.status for one in run(jobs, tmp_path)] == ["done"]
    record = tmp_path / RECORD
    whole = record.read_bytes()
    record.write_bytes(whole[:-20])  # killed while the last line was written
    assert Record(tmp_path).kept(jobs[0]) is None
    assert [one.status for one in run(jobs, tmp_path)] == ["done"]
    assert [one.status for one in run(jobs, tmp_path)] == ["kept"]


def test_a_killed_batch_goes_on_where_it_was(scans, tmp_path):
    wavelengths = json.dumps([f"{number}mm" for number in range(160, 180)])
    path = jobs_file(tmp_path, sweep(scans, "one.h5", wavelengths))
    record, out = tmp_path / "jobs" / RECORD, tmp_path / "jobs"
    running = subprocess.Popen([sys.executable, "-m", "rig", "batch", str(path)], stderr=subprocess.DEVNULL)
    deadline_s = time.monotonic() + 60
    while not record.exists() or record.read_text().count('"done"') < 2:
        assert time.monotonic() < deadline_s
        assert running.poll() is None
        time.sleep(0.02)
    running.send_signal(signal.SIGKILL)
    running.wait()
    jobs = read_jobs(path)
    before = {job.name: job.files(out)[0].stat().st_mtime_ns for job in jobs if Record(out).kept(job)}
    assert 2 <= len(before) < len(jobs)
    some = [job for job in jobs if job.name in before] + [job for job in jobs if job.name not in before][:2]
    outcomes = {one.name: one.status for one in run(some, out)}
    assert [outcomes[name] for name in before] == ["kept"] * len(before)
    assert list(outcomes.values()).count("done") == 2
    for job in some:
        volume = job.files(out)[0]
        assert volume.is_file()
        assert volume.stat().st_mtime_ns == before.get(job.name, volume.stat().st_mtime_ns)
    assert not [one for one in Path(out).iterdir() if one.suffix == ".h5" and one.stat().st_size == 0]


def test_dry_run_lists_and_makes_nothing(rig, scans, tmp_path):
    done = rig("batch", jobs_file(tmp_path, sweep(scans)), "--dry-run", "--json")
    assert done.code == 0
    assert [one["status"] for one in json.loads(done.out)["images"]] == ["to do"] * 4
    assert not (tmp_path / "jobs").exists()


def test_names_hold_no_sign_that_a_file_cannot_have(scans, tmp_path):
    text = f"[[job]]\nscans = ['{scans}/one.h5']\neven-bins = [true, false]\n"
    text += "depth = ['0.5m:1m:1cm', '1m:2m:1cm']"
    names = {job.name for job in read_jobs(jobs_file(tmp_path, text))}
    assert "one-even-bins=true-depth=0.5m_1m_1cm" in names
    assert len(names) == 4
    assert np.all([":" not in name for name in names])
