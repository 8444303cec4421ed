"""Results on stdout: whole and clean in files and pipes, whole on narrow terminals."""

from types import SimpleNamespace

import pytest

from rig.acquire.events import StepDone
from rig.commands import console
from rig.commands.calibrate_run import _facts as facts
from rig.model.plan import Step
from rig.setup.doctor.finding import Finding

DIGEST = "305fe8e8f779b0933c86895f1933f0a773b17a68f677a7" + 18 * "0"
COMMAND = "/a/folder/with a long name/python -m pip install 'opencv-python-headless>=4.8'"


def print_all():
    console.print_facts("/data/" + 20 * "long/" + "scan.h5", {"photons": "12", "sha256": DIGEST})
    console.print_table(["date", "scan", "purpose"], [["today", "a.h5", ""], ["today", "雪の日.h5", "snow"]])
    found = Finding("opencv-python-headless", "missing", "not installed", COMMAND)
    console.print_findings("Real rig: 1 thing is missing", [found])


@pytest.mark.parametrize("columns", ["30", "80"])
def test_a_pipe_gets_whole_lines_without_spaces_at_their_ends(capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    print_all()
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line != line.rstrip()] == []
    assert sum(DIGEST in line for line in lines) == 1
    assert sum(COMMAND in line for line in lines) == 1
    assert "…" not in "".join(lines)


def test_a_narrow_terminal_cuts_nothing_short(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")  # a terminal without colours
    print_all()
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line != line.rstrip()] == []
    assert "…" not in "".join(lines)
    told = "".join(line.strip().removeprefix("sha256").strip() for line in lines)
    assert DIGEST in told


def test_progress_without_a_terminal_tells_the_truth(capsys):
    told = console.ScanProgress(4)
    for index in range(4):
        exposure = SimpleNamespace(photons=5, live_time_s=0.01)
        told(StepDone(Step(index, (0.0, 0.0, 0.0), 0.01, 0, False), exposure))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" %")[0].strip() for line in lines] == ["25", "50", "75", "100"]
    assert [line for line in lines if line != line.rstrip()] == []


def test_what_a_calibration_found_is_in_words():
    found = facts({"simulated": True, "counts": 498_703, "fwhm_s": 66.15e-12, "shape": [1.0]})
    assert found == {"simulated": "yes", "counts": "498,703", "fwhm": "66.15 ps"}
