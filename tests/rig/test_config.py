"""The configuration: the files that come with the program, and every way to get one wrong."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.errors import LimitError
from rig.devices.kinds import check_settings
from rig.errors import ConfigError
from rig.model.config import built_in, built_in_with, load, recorded
from rig.model.written import as_toml

CONFIGS = Path(__file__).parents[2] / "configs"


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_written_out_simulated_rig_is_the_built_in_one():
    config = load(CONFIGS / "simulated.toml")
    assert config.calibration.folder == CONFIGS / "calibrations"  # the built-in rig has no file to begin at
    assert config.model_copy(update={"calibration": built_in().calibration}) == built_in()


def test_the_lab_example_names_real_devices():
    config = load(CONFIGS / "lab.toml")
    assert not config.simulated
    assert config.galvo.address
    assert config.scan.exposure_s == 1.0


def test_the_example_without_interfaces_asks_a_person_for_laser_and_detector():
    config = load(CONFIGS / "external.toml")
    assert (config.laser.kind, config.detector.kind, config.galvo.kind) == (
        "external",
        "external",
        "analogue",
    )
    assert config.shutter is not None
    assert config.shutter.place == "Dev1 port1/line0"
    assert config.laser.repetition_hz == 10e6
    assert len(config.unverified) == 2


def test_all_problems_are_named_at_once(tmp_path):
    text = '[galvo]\nadress = "x"\n[scan]\nexposure = 10\nspacing = "3kg"\n[simulation]\nseed = -1\n'
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, text))
    message = str(caught.value)
    assert "unknown key 'galvo.adress'; did you mean 'address'?" in message
    assert "scan.exposure: a time needs a unit" in message
    assert "scan.spacing: '3kg' is not a length" in message
    assert "simulation.seed" in message


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[galvo\n", "not valid TOML"),
        ("", "galvo.address is missing"),
        ("[simulaton]\n", "did you mean 'simulation'"),
        ('[simulation]\n[galvo]\nposition = ["0m", "0m", "-2m"]\n', "in front of the wall"),
        ('[simulation]\n[galvo]\nposition = ["0m", "0m"]\n', "galvo.position"),
        ('[simulation]\n[galvo]\nmirrors = 2\nincidence = "45deg"\n', "is given for a pair"),
        ('[simulation]\n[galvo]\nincidence = "90deg"\n', "galvo.incidence"),
        ("[simulation]\n[tcspc]\nsync_divider = 3\n", r"tcspc\.sync_divider"),
        ("[simulation]\n[tcspc]\nbinz = 3\n", r"unknown key 'tcspc\.binz'; did you mean 'bins'"),
        ('[simulation]\ngloss = "phong"\n', "simulation.gloss"),
        (
            '[simulation]\n[tcspc]\nkind = "x"\n',
            "there is no kind x; choose among 'hydraharp', 'multiharp', .*'playback'",
        ),
        ('[simulation]\n[tcspc]\nkind = "playback"\n', r"tcspc\.file"),
        ("[simulation]\n[[channels]]\n[[channels]]\n", "channels: two have the name spad"),
        ("[simulation]\n[[channels]]\nspott = 1\n", "did you mean 'spot'"),
        ("channels = []\n[simulation]\n", "there is none"),
        ("[simulation]\n[laser]\npower_setpoint = 11\n", "laser.power_setpoint"),
        (
            '[simulation]\n[laser]\nkind = "katana-08hp"\npower_setpoint = 5\n',
            r"'laser.power_setpoint' is a key of kind 'katana'; "
            r"this laser is of kind 'katana-08hp', which has .*\bpower\b",
        ),
        ('[simulation]\n[laser]\npower = "1W"\n', r"'laser.power' is a key of kind 'katana-08hp'"),
        ('[simulation]\n[laser]\nkind = "nkt"\npower = "1W"\n', r"of kind 'nkt', which has .*level_percent"),
        ('[simulation]\n[laser]\nkind = "katana-08hp"\npower = 1.0\n', 'a power needs a unit.*"1.0W"'),
        ('[simulation]\n[laser]\nkind = "katana-08hp"\npower = "3.2W"\n', "laser.power"),
        (
            '[simulation]\n[laser]\nkind = "katana-08hp"\npower = "2W"\nmax_power = "1W"\n',
            "power 2 is above the rig's limit max_power 1",
        ),
        ('[simulation]\n[laser]\nkind = "katana-08hp"\nrepetition = "10MHz"\n', "laser.repetition"),
        (
            '[simulation]\n[laser]\nkind = "katana-08hp"\ntrigger = "external"\n',
            "'internal', 'level' or 'ttl'",
        ),
        (
            '[simulation]\n[laser]\nkind = "nkt"\noscillator = "78MHz"\n',
            r"the nearest is 9\.75 MHz, every 8th pulse",
        ),
        ('[simulation]\n[laser]\nkind = "nkt"\nlevel_percent = 101\n', "laser.level_percent"),
        ('[simulation]\n[laser]\nkind = "maser"\n', "there is no kind maser; choose among 'katana'"),
    ],
)
def test_a_wrong_file_is_refused_in_words(tmp_path, text, told):
    with pytest.raises(ConfigError, match=told):
        load(written(tmp_path, text))


@pytest.mark.parametrize("kind", ["katana", "katana-08hp", "nkt"])
def test_a_power_that_is_not_said_is_the_lowest(tmp_path, kind):
    text = f'[galvo]\naddress = "a"\n[laser]\naddress = "b"\nkind = "{kind}"\n[detector]\naddress = "c"\n'
    assert load(written(tmp_path, text)).laser.fraction_of_full == 0.0


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.toml: cannot be read"):
        load(tmp_path / "nowhere.toml")


def test_a_file_of_an_older_program_is_read_as_it_was_meant(tmp_path):
    """Before devices had kinds the detector was [spad], the timing instrument [hydraharp] with one input."""
    older = """
    [spad]
    spot = ["10cm", "0cm", "0cm"]
    hold_off = "90ns"
    [hydraharp]
    input_channel = 2
    bins = 3000
    [simulation]
    """
    newer = """
    [detector]
    hold_off = "90ns"
    [tcspc]
    bins = 3000
    [[channels]]
    input = 2
    spot = ["10cm", "0cm", "0cm"]
    [simulation]
    """
    assert load(written(tmp_path, older)) == load(written(tmp_path, newer))


@pytest.mark.parametrize(
    "detector",
    [
        'kind = "id120"\ngated = true',
        'kind = "id120"\ngate_delay = "30ns"',
        'serial = "1711007C030"\ngate_delay = "30ns"\nhold_off = "100ns"',
        'excess_bias = "5V"',
        'kind = "id120"\nexcess_bias = "5V"\ngated = false',
    ],
)
@pytest.mark.parametrize("section", ["detector", "spad"])
def test_an_id120_with_a_gate_gets_one_message_that_says_what_to_write(tmp_path, section, detector):
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, f"[{section}]\n{detector}\n"))
    message = str(caught.value)
    assert message.count("\n") == 0
    assert "detector.kind = 'mpd' (and a [delayer])" in message
    assert "detector.kind = 'id120' without gated" in message


def test_an_id120_that_runs_freely_is_read_and_written(tmp_path):
    text = '[detector]\nkind = "id120"\nserial = "1"\nhold_off = "160ns"\n[simulation]\n'
    config = load(written(tmp_path, text))
    assert (config.detector.gated, config.detector.hold_off_s) == (False, 160e-9)
    assert load(written(tmp_path, as_toml(config))) == config
    gated = config.model_copy(update={"detector": config.detector.model_copy(update={"gated": True})})
    with pytest.raises(LimitError, match=r"ID120: asked to be gated.*mpd \(with a \[delayer\]\), external"):
        check_settings(gated)


#: What an earlier program wrote of its detector.
OLD_ID120 = {
    "kind": "id120",
    "serial": None,
    "address": None,
    "position_m": [0.15, 0.0, 2.5],
    "gated": True,
    "gate_delay_s": 33e-9,
    "gate_width_s": 40e-9,
    "hold_off_s": 1e-7,
    "excess_bias_v": 5.0,
    "max_count_rate_hz": None,
}


@pytest.mark.parametrize("names", [("detector", "kind"), ("spad", None)])
def test_a_record_of_an_earlier_program_is_read_with_a_detector_that_there_is(names):
    section, kind = names
    detector = {key: value for key, value in OLD_ID120.items() if kind or key != "kind"}
    table = {**json.loads(built_in().model_dump_json()), section: detector}
    del table["delayer"]
    if section == "spad":
        del table["detector"]
    config = recorded(json.dumps(table))
    assert config == built_in_with({"detector": {"gate_delay": "33ns"}})
    real = recorded(json.dumps({**table, "simulation": None, "galvo": {**table["galvo"], "address": "a"},
                                "laser": {**table["laser"], "address": "b"}}))  # fmt: skip
    assert (real.detector.kind, real.detector.gated, real.detector.gate_delay_s) == ("id120", True, 33e-9)
    assert recorded(real.model_dump_json()) == real


def test_what_a_scan_holds_is_read_back():
    config = load(CONFIGS / "misaligned.toml")
    assert recorded(config.model_dump_json()) == config


@pytest.mark.parametrize("timing", [{"library": "{}/hhlib.so"}, {"kind": "playback", "file": "{}/a.h5"}])
def test_what_a_scan_holds_says_not_where_things_lie(tmp_path, timing):
    config = built_in_with(
        {
            "calibration": {"folder": str(tmp_path / "mine")},
            "cameras": {"addresses": ["rtsp://me:secret@camera"]},
            "tcspc": {key: value.format(tmp_path) for key, value in timing.items()},
        }
    )
    assert str(tmp_path) in config.model_dump_json()  # as earlier programs wrote it
    text = config.for_record()
    assert str(tmp_path) not in text
    assert "secret" not in text
    again = recorded(text)
    assert again.calibration.folder == Path("mine")
    assert config.differences(again) == []
    assert recorded(config.model_dump_json()) == config


def test_files_say_nothing_of_the_folders_they_were_made_in(rig, tmp_path):
    written(tmp_path, "[simulation]\n")
    assert (
        rig("scan", "--config", "rig.toml", "--grid", "3x3", "--spacing", "20cm", "--out", "a.h5").code == 0
    )
    assert rig("recon", "a.h5", "--wavelength", "60cm", "--depth", "0.6m:0.8m:20cm").code == 0

    def say(name, item):
        is_text = hasattr(item, "dtype") and h5py.check_string_dtype(item.dtype)
        texts = [*item.attrs.values(), *(np.ravel(item[()]) if is_text else [])]
        assert not any(str(tmp_path) in str(text) for text in texts), name

    for name in ("a.h5", "a-volume.h5"):
        with h5py.File(tmp_path / name) as file:
            say("/", file)
            file.visititems(say)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_what_is_written_is_read_back_to_the_same_values(tmp_path, path):
    config = load(path)
    again = tmp_path / "again.toml"
    again.write_text(as_toml(config), encoding="utf-8")
    assert load(again) == config


def test_texts_of_all_characters_are_written_so_that_they_are_read_back(tmp_path):
    changes = {"name": 'a "b" \\ \t \x7f \x01 ü 😀\n', "calibration": {"folder": str(tmp_path)}}
    config = built_in_with(changes)
    path = tmp_path / "again.toml"
    path.write_text(as_toml(config), encoding="utf-8", newline="")
    assert load(path) == config
