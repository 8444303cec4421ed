"""``RIG_CONFIG``: which configuration a verb uses where none is given, and that it says so."""

import json
from pathlib import Path

import h5py
import pytest

FAST = ("--exposure", "1ms", "--grid", "6x4", "--spacing", "10cm")
SIMULATED = 'name = "mine"\n[simulation]\n[scan]\nspacing = "5cm"\n'
REAL = """
name = "real"
[galvo]
address = "/dev/rig-none-1"
[laser]
address = "/dev/rig-none-2"
[detector]
address = "/dev/rig-none-3"
"""


@pytest.fixture
def named(monkeypatch, tmp_path):
    """Give the variable a configuration."""

    def name(text: str) -> None:
        (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
        monkeypatch.setenv("RIG_CONFIG", "mine.toml")

    return name


def rig_of(done):
    """Return which rig's calibrations were shown."""
    return Path(json.loads(done.out)["folder"]).name


def test_it_is_the_default_of_config_and_is_named(rig, named):
    named(SIMULATED + '[calibration]\nfolder = "there"\n')
    done = rig("calibrate", "show", "--json")
    assert rig_of(done) == "there"
    assert done.err.splitlines() == [
        "Configuration: mine.toml (named by RIG_CONFIG; use --config FILE or --config simulated for "
        "another one)"
    ]
    Path("other.toml").write_text(SIMULATED + '[calibration]\nfolder = "elsewhere"\n')
    done = rig("calibrate", "show", "--json", "--config", "other.toml")
    assert (rig_of(done), done.err) == ("elsewhere", "")
    done = rig("calibrate", "show", "--json", "--config", "simulated")
    assert (rig_of(done), done.err) == ("calibrations", "")


def test_what_is_wrong_in_it_is_said_with_its_origin(rig, named):
    named("[galvo]\nspeed = 3\n")
    done = rig("doctor")
    assert done.code == 2
    assert "named by RIG_CONFIG" in done.err
    assert "mine.toml: unknown key 'galvo.speed'" in done.err


def test_a_simulated_scan_is_resumed_on_the_simulated_rig(rig, named):
    """Its configuration is in its file; one of a real rig is not asked for that."""
    assert rig("scan", *FAST, "--out", "a.h5").code == 0
    with h5py.File("a.h5", "r+") as file:
        del file["stop"]
        file["transients/done"][-3:] = 0
    named(REAL)
    done = rig("resume", "a.h5")
    assert done.code == 0, done.err
    assert "RIG_CONFIG" not in done.err


def test_options_of_the_simulated_rig_say_how_to_get_it(rig, named):
    named(REAL)
    for verb in (("scan", "--seed", "1"), ("calibrate", "dark", "--seed", "1")):
        done = rig(*verb)
        assert done.code == 2
        assert "--config simulated" in done.err


def test_the_verb_for_panic_does_not_go_by_it(rig, named):
    named(REAL)
    done = rig("laser", "off")
    assert done.code == 0
    assert "No program on this computer controls a laser" in done.err
