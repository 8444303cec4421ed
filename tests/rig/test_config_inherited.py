"""Configurations that extend others, and where what they say begins."""

import json
from pathlib import Path

import h5py
import pytest

from rig.errors import ConfigError
from rig.model.config import load, recorded

LAB = """
name = "lab"
[laser]
kind = "katana"
power_setpoint = 3.0
max_power_setpoint = 5.0
[tcspc]
bins = 2000
sync_level = "70mV"
[[channels]]
name = "left"
[[channels]]
name = "right"
input = 1
[scan]
columns = 20
rows = 10
spacing = "5cm"
[simulation]
scene = "letters"
"""


def files(folder: Path, **texts: str) -> Path:
    """Write files of these names; return the folder."""
    for name, text in texts.items():
        path = folder / f"{name.replace('__', '/')}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def test_tables_are_merged_and_lists_replaced(tmp_path):
    night = 'extends = "lab.toml"\n[scan]\nexposure = "1s"\n[[channels]]\nname = "only"\n'
    config = load(files(tmp_path, lab=LAB, night=night) / "night.toml")
    assert (config.name, config.scan.columns, config.scan.exposure_s) == ("lab", 20, 1.0)
    assert [one.name for one in config.channels] == ["only"]
    assert config.laser == load(tmp_path / "lab.toml").laser


def test_another_kind_drops_what_was_said_of_the_first(tmp_path):
    night = 'extends = "lab.toml"\n[tcspc]\nkind = "multiharp"\n[laser]\nkind = "katana"\n'
    config = load(files(tmp_path, lab=LAB, night=night) / "night.toml")
    assert (config.tcspc.kind, config.tcspc.bins) == ("multiharp", 12_000)
    assert config.laser.power_setpoint == 3.0  # the same kind, said again


def test_later_files_of_a_list_go_before_earlier_ones(tmp_path):
    few, many = "[scan]\ncolumns = 3\nrows = 4\n", "[scan]\ncolumns = 9\n"
    both = 'extends = ["lab.toml", "few.toml", "many.toml"]\n'
    config = load(files(tmp_path, lab=LAB, few=few, many=many, both=both) / "both.toml")
    assert (config.scan.columns, config.scan.rows) == (9, 4)


def test_a_path_begins_at_the_file_that_says_it(tmp_path, monkeypatch):
    files(
        tmp_path,
        rigs__lab=LAB,
        rigs__quick='extends = "lab.toml"\n',
        nights__n='extends="../rigs/quick.toml"',
    )
    monkeypatch.chdir(tmp_path / "rigs")
    assert load(Path("../nights/n.toml")).name == "lab"


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (
            {"a": 'extends = "b.toml"', "b": 'extends = "a.toml"'},
            r"a\.toml -> .*b\.toml -> .*a\.toml: .*loop",
        ),
        ({"a": 'extends = "a.toml"'}, "loop"),
        ({"a": 'extends = "none.toml"'}, r"none\.toml: cannot be read .* Correct extends in .*a\.toml"),
        ({"a": "extends = 3"}, "extends: write the path"),
        ({"a": 'extends = [""]'}, "extends: write the path"),
        ({"a": f"extends = {['x'] * 11}"}, "names 11 files; the limit is 10"),
        ({"a": 'extends = "b.toml"', "b": "[galvo"}, r"b\.toml: is not valid TOML"),
        ({"a": "[simulation]\n[galvo]\nextends = 'x'"}, r"unknown key 'galvo\.extends'"),
        (
            {f"{chr(97 + n)}": f'extends = "{chr(98 + n)}.toml"' for n in range(12)},
            "at most 10 files may extend one another",
        ),
    ],
)
def test_what_cannot_be_extended_is_refused_in_words(tmp_path, texts, told):
    with pytest.raises(ConfigError, match=told):
        load(files(tmp_path, **texts) / "a.toml")


def test_an_error_names_the_file_in_which_the_wrong_key_stands(tmp_path):
    lab = LAB.replace('spacing = "5cm"', "spacing = 5\nspeed = 3")
    night = 'extends = "lab.toml"\n[laser]\npower_setpoint = 7.0\n[simulation]\nseed = -1\n'
    with pytest.raises(ConfigError) as caught:
        load(files(tmp_path, lab=lab, night=night) / "night.toml")
    said = {
        line.partition(": ")[2]: Path(line.partition(": ")[0]).name for line in str(caught.value).splitlines()
    }
    assert {words.split(":")[0]: file for words, file in said.items()} == {
        "scan.spacing": "lab.toml",
        "unknown key 'scan.speed'": "lab.toml",
        "laser": "night.toml",  # its ceiling is in lab.toml, but this file asks for more
        "simulation.seed": "night.toml",
    }


def test_a_scan_holds_all_of_it_and_a_data_file_extends_nothing(rig, tmp_path):
    files(
        tmp_path, lab=LAB.replace('[[channels]]\nname = "right"\ninput = 1\n', ""), n='extends = "lab.toml"\n'
    )
    assert rig("scan", "--config", "n.toml", "--exposure", "1ms", "--grid", "4x3", "--out", "a.h5").code == 0
    with h5py.File("a.h5", "r+") as file:
        text = file["start"].attrs["configuration"]
        assert not recorded(text).differences(load(Path("n.toml")))
        file["start"].attrs["configuration"] = json.dumps({"extends": "lab.toml", **json.loads(text)})
        del file["stop"]
    with pytest.raises(ConfigError, match="unknown key 'extends'"):
        recorded(json.dumps({"extends": "lab.toml", **json.loads(text)}))
    done = rig("resume", "a.h5")
    assert done.code in (2, 5)
    assert "extends" in done.err


def test_calibrations_lie_where_the_file_that_says_it_lies(tmp_path, monkeypatch):
    said = '[calibration]\nfolder = "mine"\n'
    files(
        tmp_path,
        rigs__said=LAB + said,
        rigs__silent=LAB,
        parts__quick="[scan]\ncolumns = 2\n",
        nights__a='extends = "../rigs/said.toml"\n',
        nights__b='extends = ["../rigs/silent.toml", "../parts/quick.toml"]\n',
    )
    for here in (tmp_path, tmp_path / "nights"):
        monkeypatch.chdir(here)
        folders = [load(tmp_path / "nights" / f"{name}.toml").calibration.folder for name in "ab"]
        assert folders == [tmp_path / "rigs/mine", tmp_path / "rigs/calibrations"]


def test_a_mark_before_the_text_is_no_part_of_it(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf" + LAB.encode())
    assert load(path).name == "lab"
