"""Quiet, verbose, logs, and the program's own verbs: at either place, the same."""

import json
import os
import re
import subprocess
import sys

import pytest

SCAN = ("scan", "--grid", "4x3", "--spacing", "10cm", "--out")
TIMED = re.compile(r"^ *\d+\.\d{3} s  \S")
LOGGED = re.compile(r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00 (\w+): (.*)$")


@pytest.mark.parametrize("place", ["before", "after"])
def test_quiet_leaves_results_and_what_concerns_the_light(rig, place):
    words = ("--quiet", *SCAN, "a.h5") if place == "before" else (*SCAN, "a.h5", "--quiet")
    done = rig(*words)
    assert done.code == 0
    assert "photons" in done.out
    said = done.err.splitlines()
    assert [line.split()[0] for line in said] == ["LASER", "laser"]  # on, and dark


def test_quiet_leaves_errors(rig):
    done = rig("stats", "nowhere.h5", "-q")
    assert done.code == 5
    assert done.err == "rig: nowhere.h5 does not exist; check the name\n"


def test_verbose_says_what_is_done_with_times(rig):
    rig(*SCAN, "a.h5")
    done = rig("recon", "a.h5", "--voxel", "10cm", "--depth", "0.9m:1.1m:10cm", "--verbose")
    assert done.code == 0
    timed = [line for line in done.err.splitlines() if TIMED.match(line)]
    assert any("imaging: done after" in line for line in timed)
    assert any("wrote a-volume.h5" in line for line in timed)
    assert "exit code 0" in timed[-1]
    assert done.out.splitlines()[0] == "a.png"  # results are as without


@pytest.mark.parametrize("place", ["before", "after"])
def test_a_log_has_all_that_was_said_with_times(rig, tmp_path, place):
    option = ("--log", "run.log")
    for name in ("a.h5", "b.h5"):
        rig(*option, *SCAN, name) if place == "before" else rig(*SCAN, name, *option)
    rig("--quiet", *option, "stats", "nowhere.h5")
    lines = [LOGGED.match(line) for line in (tmp_path / "run.log").read_text().splitlines()]
    assert all(lines)
    kinds = [line[1] for line in lines]
    assert kinds.count("command") == kinds.count("end") == 3  # appended
    assert kinds.count("light") == 4  # on and dark, twice
    assert "result" in kinds
    assert [line[2] for line in lines][-2:-1] == ["nowhere.h5 does not exist; check the name"]
    assert lines[-1][2].startswith("exit code 5 after ")


def test_a_log_never_spoils_another_file(rig, tmp_path):
    rig(*SCAN, "a.h5")
    before = (tmp_path / "a.h5").read_bytes()
    assert rig("stats", "a.h5", "--log", "a.h5").code == 2
    assert (tmp_path / "a.h5").read_bytes() == before


def test_what_was_chosen_ends_with_its_command(rig):
    assert rig("--quiet", "version").code == 0
    assert "scans" in rig("list").err


def test_the_version_is_a_verb_too(rig):
    assert rig("version").out == rig("--version").out
    assert json.loads(rig("version", "--json").out)["version"] in rig("version").out


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("rig cal", {"calibrate"}),
        ("rig scan --scene lett", {"letters", "letter-plane", "letters-rd"}),
        ("rig recon a.h5 --solver f", {"fresnel", "fk"}),
    ],
)
def test_the_shell_completes_names(words, wanted):
    asked = {
        "_RIG_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    done = subprocess.run(
        [sys.executable, "-m", "rig"], env={**os.environ, **asked}, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == wanted


def every_verb():
    """Return the words of every verb and group, and its command."""
    from typer.main import get_command

    from rig.commands import app

    def below(command, words):
        yield words, command
        for name, one in getattr(command, "commands", {}).items():
            yield from below(one, [*words, name])

    return [
        pytest.param(words, command, id=" ".join(words)) for words, command in below(get_command(app), [])
    ]


@pytest.mark.parametrize(("words", "command"), every_verb())
def test_help_fits_80_columns(rig, monkeypatch, words, command):
    monkeypatch.setenv("COLUMNS", "80")
    shown = rig(*words, "--help").out
    assert max(map(len, shown.splitlines())) <= 80
    assert "<bool>" not in shown
    examples = [line.strip() for line in shown.splitlines() if re.match(r" +rig [a-z]", line)]
    assert all(len(line) <= 76 for line in examples)  # two columns are left at each side
    for one in command.params:
        assert not re.search(r"\\\[(?!default: )", getattr(one, "help", None) or ""), (
            "defaults are said alike"
        )


@pytest.mark.parametrize(("words", "command"), every_verb())
def test_every_verb_has_the_options_for_what_is_said(words, command):
    if words and hasattr(command, "commands"):
        return  # a group of verbs: its verbs have them
    options = {option for one in command.params for option in one.opts}
    assert {"--quiet", "--verbose", "--log"} <= options
