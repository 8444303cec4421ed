"""What happens in a scan is told: in its file with positions, in its log, by the message at its end."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rig.acquire.acquisition import Recorder
from rig.acquire.events import Ended, LineDone, Outcome, Phase, PhaseChanged, Ready, StepDone
from rig.acquire.log import ScanLog, log_of
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.model.config import built_in
from rig.model.plan import ScanPlan

PLAN = ScanPlan.grid(built_in(), columns=10, rows=3, spacing_m=0.1, skip_m=0.0)
FULL, LOST = "A bin is full.", "Sync was lost."


def steps(first, last, warnings):
    """Return the events of some steps; warnings are (sentence, steps)."""
    for step in PLAN.steps(first):
        if step.index == last:
            return
        said = tuple(sentence for sentence, where in warnings if step.index in where)
        exposure = SimpleNamespace(counts=np.ones(8, "u4"), photons=8, live_time_s=0.01, warnings=said)
        yield StepDone(step, exposure)
        if step.ends_line:
            yield LineDone(step.index + 1)


def ready():
    return Ready(0, SimpleNamespace(sync_hz=1e7, input_hz=2e5), ("The input rate is low.",), {})


def test_warnings_are_kept_with_their_positions_over_a_kill_and_a_resumption(tmp_path):
    path = tmp_path / "a.h5"
    warnings = [(FULL, range(2, 17)), (LOST, {4, 5, 25})]
    killed = Recorder(ScanWriter.create(path, ScanDescription(PLAN.spots_m, np.zeros((1, 3)), 8, 4e-12, 0.0)))
    for event in (ready(), *steps(0, 15, warnings)):
        killed(event)
    del killed  # as a killed program, it closes nothing: what came after the line's end is lost
    with ScanFile(path) as scan:
        assert scan.done.sum() == 10
        assert [(note.sentence, note.first, note.last) for note in scan.events] == [
            ("The input rate is low.", 0, 0), (FULL, 2, 9), (LOST, 4, 5)
        ]  # fmt: skip
        assert all(note.kind == "warning" and note.utc.endswith("+00:00") for note in scan.events)
    writer = ScanWriter.resume(path)
    again = Recorder(writer)
    for event in (ready(), *steps(10, 30, warnings), Ended(Outcome.COMPLETE, 30, "all positions measured")):
        again(event)
    with ScanFile(path) as scan:
        assert [(note.sentence, note.first, note.last) for note in scan.events] == [
            ("The input rate is low.", 0, 0), (FULL, 2, 16), (LOST, 4, 5),
            ("The input rate is low.", 10, 10), (LOST, 25, 25),
        ]  # fmt: skip
        assert scan.warnings == ["The input rate is low.", FULL, LOST]
        assert scan.status == "complete"


def test_the_log_tells_what_happened_and_when(tmp_path):
    path = log_of(tmp_path / "a.h5")
    with ScanLog(path, PLAN, 0) as log:
        for event in (
            PhaseChanged(Phase.LIGHTING), ready(), *steps(0, 12, [(FULL, range(2, 8))]),
            PhaseChanged(Phase.CLOSING), Ended(Outcome.INTERRUPTED, 12, "stopped by the operator"),
        ):  # fmt: skip
            log(event)
        so_far = path.read_text().splitlines()
    assert all(re.match(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00 \S", line) for line in so_far)
    told = [line.split(" ", 1)[1] for line in so_far]
    assert told[0] == "started by: a Python program"  # which this test is
    assert told[1].startswith("plan: 30 positions, from 0 on; {")
    assert told[2:] == [
        "lighting",
        "pass 0, from position 0 on",
        "sync 10 MHz, 200 kcounts/s",
        "warning from position 0 on: The input rate is low.",
        "warning of positions 0 to 0 ended: The input rate is low.",
        f"warning from position 2 on: {FULL}",
        f"warning of positions 2 to 7 ended: {FULL}",
        "10 of 30 positions measured",
        "closing",
        "interrupted after 12 of 30 positions: stopped by the operator",
    ]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
@pytest.mark.parametrize("name", ["/dev/full", "/nowhere/a.log"])
def test_a_log_that_cannot_be_written_stops_no_scan(name):
    with ScanLog(Path(name), PLAN, 0) as log:
        for event in (ready(), *steps(0, 12, []), Ended(Outcome.COMPLETE, 12, "")):
            log(event)


def test_a_log_is_never_the_scan_file():
    assert log_of(Path("a.log")) == Path("a.log.log")
    assert log_of(Path("a.b.h5")) == Path("a.b.log")


def started(folder):
    """Start a scan; return it when a tenth is measured."""
    command = [sys.executable, "-m", "rig", "scan", "--grid", "30x120", "--spacing", "9mm", "--out", "a.h5"]
    scan = subprocess.Popen(
        command, cwd=folder, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )  # fmt: skip
    for line in scan.stderr:
        if "10 %" in line:
            return scan
    raise AssertionError(f"the scan ended: {scan.wait()}")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_a_killed_scan_is_read_from_its_journal_and_goes_on(rig, tmp_path):
    with started(tmp_path) as scan:
        scan.kill()
        scan.stderr.read()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(before) == {"a.h5", "a.h5.journal", "a.log"}
    done = rig("stats", "a.h5")
    assert done.code == 0, done.err
    assert "read from its journal, a.h5.journal, and was not changed" in done.err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    done = rig("resume", "a.h5")
    assert done.code == 0, done.err
    assert {path.name for path in tmp_path.iterdir()} == {"a.h5", "a.log"}
    assert " resumed by: rig " in Path("a.log").read_text()
    assert rig("stats", "a.h5").err.startswith("Counted")


@pytest.mark.skipif(sys.platform != "linux", reason="that a file was moved, and where to, is found on Linux")
def test_a_scan_whose_file_is_deleted_ends_and_says_where_its_data_is(rig, tmp_path):
    with started(tmp_path) as scan:
        (tmp_path / "a.h5").unlink()
        rest = scan.stderr.read()
    assert scan.returncode == 5
    assert re.search(
        r"a\.h5 was deleted .* saved as .*a-saved\.h5; continue with rig resume .*a-saved\.h5", rest
    )
    assert "Nothing was measured" not in rest
    assert {path.name for path in tmp_path.iterdir()} == {"a-saved.h5", "a.log"}
    with ScanFile(tmp_path / "a-saved.h5") as file:
        assert file.status == "failed"
        assert file.done.sum() >= 360
    assert "was deleted while the scan ran" in (tmp_path / "a.log").read_text()


def test_a_scan_that_could_not_begin_says_that_nothing_was_measured(rig, tmp_path):
    Path("rig.toml").write_text(
        '[galvo]\naddress = "/dev/rig-none"\n[laser]\naddress = "/dev/rig-none"\n'
        '[detector]\naddress = "/dev/rig-none"\n[tcspc]\nlibrary = "no.so"\n'
    )
    done = rig("scan", "--config", "rig.toml", "--out", "a.h5")
    assert done.code == 3
    assert "Nothing was measured, and no scan file was made." in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]


@pytest.mark.parametrize("name", ["x" * 250 + ".h5", "x" * 300 + ".h5", "rig.toml/a.h5"])
def test_a_name_that_cannot_be_is_refused_in_words(rig, tmp_path, name):
    Path("rig.toml").write_text("")
    for command in (("scan", "--grid", "3x3", "--out", name), ("stats", name), ("resume", name)):
        done = rig(*command)
        assert done.code in {2, 4, 5}, done.err
        assert "Traceback" not in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
