"""A short pass of all attacks, and what they found before."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from attacks import running, texts, wire
from attacks.running import attack, refused_badly

NUMBER = 150
PROJECT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.filterwarnings("ignore::RuntimeWarning", "ignore::DeprecationWarning"),
    pytest.mark.skipif(sys.platform == "win32", reason="time is limited by a POSIX signal"),
]
ALL = {one.name: one for one in (*texts.ATTACKS, *wire.ATTACKS)}


@pytest.mark.parametrize("name", ALL)
def test_spoiled_input_is_read_or_refused_in_words(name):
    assert attack(ALL[name], NUMBER) == []


@pytest.mark.parametrize(
    ("read", "good"),
    [
        (wire.read_galvo, wire.GALVO),
        (wire.read_laser, wire.LASER),
        (wire.read_spad, (wire.SPAD, None)),
        (wire.read_mpd, wire.MPD),
        (wire.read_psd, wire.PSD),
        (wire.read_harp, {"writes": wire.HARP, "codes": {}}),
        (wire.read_stream, {"writes": wire.HARP, "codes": {}}),
        (texts.read_quantity, ("10ms", "time")),
        (texts.read_grid, ("18x13", "10cm", "10ms")),
        (texts.read_voxels, ("0.5m:3m:2cm", "1m", "1m", "1cm", "4cm", 2.0)),
        (texts.read_list_of_jobs, texts.JOBS),
        (texts.read_record, json.dumps(texts.DONE)),
        (texts.read_scheduler, json.dumps(texts.SCHEDULER)),
        (texts.read_wall_marks, json.dumps(texts.MARKS)),
    ],
)
def test_the_input_that_is_spoiled_was_good(read, good):
    read(good)


def test_an_attack_finds_what_must_not_be():
    def read(given):
        raise ZeroDivisionError(given)

    found = attack(wire.Attack("broken", lambda random: random.random(), read, (ValueError,)), 3)
    assert [one.number for one in found] == [0, 1, 2]
    assert "ZeroDivisionError" in found[0].what


@pytest.mark.skipif(sys.platform != "linux", reason="peaks can be forgotten on Linux alone")
def test_an_attack_finds_too_much_memory(monkeypatch):
    monkeypatch.setattr(running, "MOST_BYTES", 10**8)
    # the second takes less than the first, and is found all the same; the third is stopped before it has it
    sizes = iter([12e7, 11e7, 5e8])
    greedy = wire.Attack("greedy", lambda _: int(next(sizes)), lambda size: np.ones(size, "u1"), ())
    found = attack(greedy, 3)
    assert [one.number for one in found] == [0, 1, 2]
    assert [("MiB of memory" in one.what, "MemoryError" in one.what) for one in found] == [
        (True, False),
        (True, False),
        (False, True),
    ]


def test_an_attack_finds_what_takes_too_long(monkeypatch):
    monkeypatch.setattr(running, "LONGEST_S", 0.2)
    waits = iter([0.0, 2.0, 0.0])
    slow = wire.Attack("slow", lambda _: next(waits), time.sleep, ())
    assert ["took more than" in one.what for one in attack(slow, 3)] == [True]


def test_options_are_taken_or_refused_in_words():
    """Give values of each kind, known and random, in a process of its own: it changes how verbs are found."""
    done = subprocess.run(
        [sys.executable, "-m", "attacks.options", "--number", "60", "--first", "1000000"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(PROJECT), str(PROJECT / "tests")])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("scan --dry-run --grid 4x3 --spacing 1e300m", "spacing_m: 1e+300 is not 1e+06 or less"),
        ("import a.h5 b.h5 --bounces " + "9" * 5000, "is not a list of bounces"),
        ("sim render point a.h5 --grid 3x2 --spacing 1nm", "the plan has no positions"),
        ("sim render \udcff a.h5", "is not UTF-8 text"),
    ],
)
def test_a_command_line_that_was_found_is_refused_in_words(rig, line, said):
    done = rig(*line.split())
    assert done.code in {2, 4}
    assert said in done.err


@pytest.mark.skipif(sys.platform != "linux", reason="peaks can be forgotten on Linux alone")
def test_many_bins_are_rendered_in_little_memory(rig, monkeypatch):
    monkeypatch.setattr(running, "MOST_BYTES", 45 * 10**7)  # all at once, they would take 650 MB
    line = "sim render point {}.h5 --grid 8x6 --spacing 10cm --bins {}"
    assert rig(*line.format("few", 100).split()).code == 0  # all that is needed is loaded
    words = line.format("a", 2**20).split()
    many = wire.Attack("render", lambda _: words, lambda words: rig(*words), ())
    assert attack(many, 1) == []
    assert Path("a.h5").exists()


#: Inputs that once ended in a traceback, in a hang, or in gigabytes.
FOUND = [
    ("quantity", ("10dB", "time")),
    ("quantity", ("1mdegC", "angle")),
    ("quantity", ("1e400s", "time")),
    ("quantity", ("9" * 5000 + "s", "time")),
    ("quantity", ("1.7976931348623157e308 V", "voltage")),
    ("quantity", ("\x1f10mm", "angle")),
    ("quantity", ("1\x1d Hz", "length")),
    ("grid", ("9" * 5000 + "x2", "1cm", "10ms")),
    ("grid", ("99999999999x2", "1cm", "10ms")),
    ("grid", ("2x2", "1cm", "1e400s")),
    ("voxels", ("0.5m:1e400m:1cm", "1m", "1m", "1cm", "4cm", 2.0)),
    ("voxels", ("0.5m:1e300m:1cm", "1m", "1m", "1cm", "4cm", 2.0)),
    ("voxels", ("0.5m:3m:1nm", "1m", "1m", "1cm", "4cm", 2.0)),
    ("voxels", ("0.5m:3m:2cm", "1m", "1m", "0.01mm", "4cm", 2.0)),
    ("voxels", ("0.01mm:1m:1nm", "1m", "1m", "1cm", "1e-300m", 1e308)),
    ("toml", "a = " + "[" * 100_000),
    ("toml", "a" + ".a" * 100_000 + " = 1"),
    ("toml", "a = " + "9" * 5000),
    ("toml", '[laser]\nkind = "nkt"\noscillator = "80MHz"\nrepetition = "1e-320MHz"\n'),
    ("recorded configuration", '{"a":' * 100_000),
    ("plan", "[" * 100_000),
    ("plan", '{"columns": 1e308, "rows": {}, "spacing_m": [], "exposure_s": null, "detector_spot_m": 1}'),
    ("calibration", "[" * 100_000),
    ("mesh", ("ply", b"ply\nformat ascii 1.0\nelement vertex 1\n"
              b"property float x\nproperty float y\nproperty float z\n"
              b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 1\n3 0 0 7\n")),
    ("hydraharp", {"writes": {**wire.HARP, "HH_GetBaseResolution": (0.0, 26)}, "codes": {}}),
    ("hydraharp", {"writes": {**wire.HARP, "HH_GetBaseResolution": (float("nan"), 26)}, "codes": {}}),
    ("hydraharp", {"writes": {**wire.HARP, "HH_GetResolution": (float("nan"),)}, "codes": {}}),
    ("hydraharp", {"writes": {**wire.HARP, "HH_GetNumOfInputChannels": (2**31 - 1,)}, "codes": {}}),
    ("hydraharp", {"writes": {**wire.HARP, "HH_GetCountRate": (-1,)}, "codes": {}}),
    ("laser", {**wire.LASER, "leg?": [b"(Error " + b"9" * 4320 + b")\n"]}),
    ("laser", {**wire.LASER, "ltg?": [b"ltg=0\n", b"ltg=1e400\n"]}),
    ("detector", ({**wire.SPAD, "BIAS:VOLTAGE?": [b"nan\n"]}, None)),
    ("detector", ({**wire.SPAD, "INFO:PRODUCT_NAME?": [b"ID\x00120\n"]}, None)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "given"), FOUND, ids=range(len(FOUND)))
def test_what_was_found_is_refused_in_words(name, given):
    one = ALL[name]
    assert refused_badly(one, given) == ""
    with pytest.raises(one.allowed):
        one.read(given)
