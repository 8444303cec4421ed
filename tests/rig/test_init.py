"""``rig init``: from what is connected, and answers, to a configuration that a dry run accepts."""

import io
import json
import os
import re
import select
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.model.config import FaultsConfig, built_in, built_in_with, load
from rig.model.config.kinds import ROLES
from rig.setup import found
from rig.setup.commented import commented
from rig.setup.described import descriptions
from simulators.bench import Bench
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend
from support import nidaqmx_stand_in

CONFIGS = Path(__file__).parents[2] / "configs"
posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")


@pytest.fixture
def answering(rig, monkeypatch):
    """Run ``rig init`` with lines at its standard input."""

    def run(lines: list[str], *arguments):
        monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))
        return rig("init", *arguments)

    return run


def accepted(rig, name):
    done = rig("scan", "--config", name, "--dry-run")
    assert done.code == 0, done.err
    return load(Path(name))


def test_the_simulated_rig_is_written_out_with_comments(rig):
    done = rig("init", "--defaults", "--out", "d.toml")
    assert done.code == 0, done.err
    config = accepted(rig, "d.toml")
    assert config == built_in_with({"calibration": {"folder": str(Path("calibrations").absolute())}})
    text = Path("d.toml").read_text()
    assert '# Longest wait for the mirror to be stable after a move.\n# settle_timeout = "100ms"' in text
    again = rig("init", "--defaults", "--out", "d.toml")
    assert again.code == 2
    assert "d.toml exists and is not overwritten" in again.err
    assert Path("d.toml").read_text() == text


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_what_is_written_with_comments_is_read_to_the_same_values(tmp_path, path):
    config = load(path)
    again = tmp_path / "again.toml"
    again.write_text(commented(config, "A rig."), encoding="utf-8")
    assert load(again) == config


def test_each_default_that_stands_in_a_comment_is_the_default(tmp_path):
    """Without the sign before it, the line says the same."""
    text = re.sub(r"^# ([a-z_]+ = )", r"\1", commented(built_in(), ""), flags=re.MULTILINE)
    (tmp_path / "all.toml").write_text(text)
    again = load(tmp_path / "all.toml").model_copy(update={"calibration": built_in().calibration})
    assert again == built_in()
    assert len(tomllib.loads(text)["simulation"]["faults"]) == len(FaultsConfig.model_fields)


def test_each_key_of_each_kind_of_device_is_described():
    for role in ROLES.values():
        for section in role.kinds.values():
            assert set(section.model_fields) - {"kind"} == set(descriptions(section)) - {"kind"}, section


LAB = [
    "n",  # not the simulated rig
    "my lab",
    "katana",
    "/dev/rig-none-1",
    "1",  # the first kind of mirror
    "/dev/rig-none-2",
    "mpd",
    "/dev/rig-none-3",
    "psd",
    "/dev/rig-none-4",
    "multiharp",
    "none",
    "none",
    "1.2m",
    "20",  # a frequency without a unit
    "20MHz",
    "",
    "",
    "1 parsec",
    "20ms",
]


def test_a_real_rig_is_asked_for_and_answers_are_checked_at_once(rig, answering):
    done = answering([*LAB, "n"])
    assert done.code == 0, done.err
    assert "laser.repetition: '20' has no unit" in done.err
    assert "scan.exposure" in done.err
    config = accepted(rig, "lab.toml")
    assert not config.simulated
    assert (config.name, config.tcspc.kind, config.delayer.kind) == ("my lab", "multiharp", "psd")
    assert config.galvo.address == "/dev/rig-none-2"
    assert (config.galvo.position_m, config.detector.position_m) == ((-0.15, 0, 1.2), (0.15, 0, 1.2))
    assert config.scan.exposure_s == 20e-3
    # 12.3 ns, 2 x 1.209 m of light, and 2.5 ns; then to the next pulse after 50 ns
    assert config.detector.gate_delay_s == pytest.approx(22.87e-9, abs=1e-11)
    assert config.detector.gate_width_s == pytest.approx(27e-9, abs=1e-12)
    assert config.tcspc.bins * config.tcspc.bin_width_s <= 50e-9
    assert config.scan.columns < 180  # what the mirror reaches from there
    assert config.laser.fraction_of_full == 0


def test_the_end_of_the_answers_leaves_nothing_behind(answering):
    done = answering(LAB[:7])
    assert done.code == 2
    assert "there was no answer to" in done.err
    assert not list(Path().iterdir())


def test_answers_may_come_from_a_file(rig):
    Path("answers.toml").write_text(
        'name = "nkt"\nlaser = {kind = "nkt", address = "/dev/rig-none-1"}\n[galvo]\naddress = "/dev/rig-2"\n'
        '[detector]\nkind = "external"\n[tcspc]\nserial = "12"\n'
    )
    done = rig("init", "--answers", "answers.toml", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert (told["file"], told["simulated"], told["refused"]) == ("lab.toml", False, "")
    config = accepted(rig, "lab.toml")
    assert (config.laser.kind, config.detector.kind, config.tcspc.serial) == ("nkt", "external", "12")
    assert config.delayer is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('galvo.adress = "a"', "did you mean 'address'"),
        ('laser.repetition = "3kg"', "'3kg' is not a frequency"),
        ('galvo.address = "a"', "laser.address has no default"),
        ('[laser]\naddress = "a"\npower_setpoint = 11', "laser.power_setpoint"),
    ],
)
def test_wrong_answers_write_nothing(rig, text, told):
    Path("answers.toml").write_text(text)
    done = rig("init", "--answers", "answers.toml")
    assert done.code == 2
    assert re.search(told, done.err)
    assert not Path("lab.toml").exists()


@posix
def test_no_byte_goes_to_a_device_before_somebody_agrees(answering, monkeypatch):
    monkeypatch.setenv("HHLIB_PATH", "/nowhere/hhlib.so")
    pairs = [os.openpty() for _ in range(4)]
    ports = [os.ttyname(slave) for _, slave in pairs]
    galvo, laser, detector, other = (master for master, _ in pairs)

    def got(master):
        return os.read(master, 1000) if select.select([master], [], [], 0)[0] else b""

    lines = [
        "n",
        "lab",
        "katana",
        ports[1],
        "optotune",
        ports[0],
        "mpd",
        ports[2],
        "none",
        "hydraharp",
        "none",
    ]
    lines += ["none", "", "", "", "", ""]
    assert answering([*lines, "n"], "--out", "a.toml").code == 0
    assert not any(got(master) for master, _ in pairs)
    done = answering([*lines, "y"], "--out", "b.toml")
    assert done.code == 0, done.err
    assert b"GETID" not in got(laser)
    assert b"START" in got(galvo)
    assert got(detector)
    assert not got(other)
    assert "galvo, kind optotune: " in done.err
    for pair in pairs:
        for end in pair:
            os.close(end)


def test_instruments_and_boards_are_seen(monkeypatch):
    bus = UsbBackend([SpadInstrument(Bench())])
    extra = SimpleNamespace(get_libusb1_backend=lambda: bus)
    monkeypatch.setitem(sys.modules, "libusb_package", extra)
    with nidaqmx_stand_in.installed():
        seen = {one.way: one for one in found.connected()}
    assert (seen["usb"].address, seen["usb"].guess) == ("1ddc:0330", ("detector", "id120"))
    assert seen["daq"].address == "Dev1"


def test_a_secret_is_written_and_never_shown(rig):
    secret = "https://ntfy.example/hush"
    Path("answers.toml").write_text(f'[simulation]\n[notify]\nwebhook = "{secret}"\n')
    assert rig("init", "--answers", "answers.toml").code == 0
    assert load(Path("lab.toml")).notify.webhook.get_secret_value() == secret
    done = rig("config", "show", "--config", "lab.toml")
    assert done.code == 0, done.err
    assert "hush" not in done.out
    assert re.search(r"^notify +\(not shown\) +lab.toml", done.out, re.MULTILINE)


def test_a_configuration_shows_where_each_value_comes_from(rig):
    Path("base.toml").write_text("[laser]\npower_setpoint = 10.0\n[simulation]\n")
    Path("mine.toml").write_text(
        'extends = "base.toml"\n[scan]\nspacing = "2cm"\n[[channels]]\nname = "one"\n'
    )
    done = rig("config", "show", "--config", "mine.toml", "--json")
    assert done.code == 0, done.err
    values = {one["key"]: (one["text"], one["origin"]) for one in json.loads(done.out)["values"]}
    assert values["scan.spacing"] == ('"2cm"', "mine.toml")
    assert values["laser.power_setpoint"] == ("10.0", "base.toml")
    assert values["scan.columns"] == ("180", "default")
    assert values["channels[0].name"] == ('"one"', "mine.toml")
    plain = rig("config", "show")
    assert plain.code == 0
    assert re.search(r"^scan.spacing +\"1cm\" +built-in", plain.out, re.MULTILINE)
