"""Streams that are full, closed, or whose reader has gone: the work goes on, and the exit code is its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rig.files import ScanFile

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full here")
SCAN = ["scan", "--grid", "4x3", "--spacing", "10cm", "--out", "a.h5"]


def run(folder, *arguments, **streams):
    """Run ``rig`` as a program of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, "-m", "rig", *arguments],
        cwd=folder,
        env=environment,
        timeout=120,
        check=False,
        **streams,
    )


def positions_done(path):
    with ScanFile(path) as scan:
        return scan.status, int(scan.done.sum())


@needs_full
def test_a_scan_goes_on_when_its_messages_are_lost(tmp_path):
    with FULL.open("w") as full:
        done = run(tmp_path, *SCAN, stdout=subprocess.DEVNULL, stderr=full)
    assert done.returncode == 0
    assert positions_done(tmp_path / "a.h5") == ("complete", 12)


@needs_full
def test_results_that_cannot_be_written_are_told(tmp_path):
    with FULL.open("w") as full:
        done = run(tmp_path, *SCAN, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert "cannot be written to stdout" in done.stderr
    assert "Traceback" not in done.stderr
    assert positions_done(tmp_path / "a.h5") == ("complete", 12)


@pytest.mark.skipif(sys.platform == "win32", reason="descriptors of POSIX")
def test_a_reader_that_has_gone_is_no_failure(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    done = run(tmp_path, *SCAN, stdout=writer, stderr=writer)
    os.close(writer)
    assert done.returncode == 0
    assert positions_done(tmp_path / "a.h5") == ("complete", 12)


@pytest.mark.skipif(sys.platform == "win32", reason="descriptors of POSIX")
def test_closed_streams_are_not_taken_for_the_data_file(tmp_path):
    command = f"'{sys.executable}' -m rig {' '.join(SCAN)} >&- 2>&- <&-"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, shell=True, cwd=tmp_path, env=environment, timeout=120, check=False)
    assert done.returncode == 0
    assert positions_done(tmp_path / "a.h5") == ("complete", 12)


@needs_full
def test_an_error_keeps_its_code_when_nobody_hears_it(tmp_path):
    with FULL.open("w") as full:
        assert run(tmp_path, "stats", "nowhere.h5", stdout=full, stderr=full).returncode == 5


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="names there are always text")
def test_a_name_that_is_not_utf_8_is_told_as_escapes(tmp_path):
    run(tmp_path, *SCAN, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    name = os.fsdecode(b"x\xff[red]\x1b[31m.h5")
    (tmp_path / "a.h5").rename(tmp_path / name)
    done = run(tmp_path, "stats", name, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert rb"x\udcff[red]\x1b[31m.h5" in done.stdout
    assert b"\x1b" not in done.stdout + done.stderr
    told = run(tmp_path, "stats", name, "--json", capture_output=True).stdout
    assert json.loads(told)["scans"][0]["file"] == name


def test_markup_and_control_characters_in_messages_are_shown(rig, tmp_path):
    done = rig("stats", "no[/red]\x1b[31m\x07.h5")
    assert done.code == 5
    assert "no[/red]\\x1b[31m\\x07.h5" in done.err
