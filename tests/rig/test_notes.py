"""Notes of people are kept with a scan, and decide nothing."""

import json
from pathlib import Path

import h5py
import pytest

from rig.errors import ConfigError
from rig.files import ScanFile
from rig.model.config import built_in_with, load

SMALL = ("--grid", "8x5", "--spacing", "10cm", "--exposure", "10ms")


def test_notes_of_the_configuration_and_of_the_command_are_kept_in_the_file(rig):
    Path("rig.toml").write_text('[simulation]\n[notes]\noperator = "Ada"\nsample = "two letters"\n')
    said = ("--sample", "an F, & <an R>", "--purpose", "night run\nwith lamps off")
    done = rig("scan", "--config", "rig.toml", *SMALL, *said, "--out", "a.h5")
    assert done.code == 0, done.err
    told = {"operator": "Ada", "sample": "an F, & <an R>", "purpose": "night run\nwith lamps off"}
    with ScanFile("a.h5") as scan:
        assert scan.notes == told
    with h5py.File("a.h5") as file:  # said once: an older program still reads the configuration
        assert "notes" not in json.loads(file["start"].attrs["configuration"])


def test_notes_do_not_decide_whether_a_scan_is_resumed(rig):
    Path("rig.toml").write_text('[simulation]\n[notes]\noperator = "Ada"\n')
    assert rig("scan", "--config", "rig.toml", *SMALL, "--out", "a.h5").code == 0
    with h5py.File("a.h5", "r+") as file:
        file["transients/done"][16:] = False
        del file["stop"]
    Path("rig.toml").write_text('[simulation]\n[notes]\noperator = "Grace"\nnote = "of the second day"\n')
    done = rig("resume", "a.h5", "--config", "rig.toml")
    assert done.code == 0, done.err
    with ScanFile("a.h5") as scan:
        assert scan.status == "complete"
        assert scan.notes == {"operator": "Ada"}


def test_a_scan_without_notes_has_no_group_for_them(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    with h5py.File("a.h5") as file, ScanFile("a.h5") as scan:
        assert "notes" not in file
        assert scan.notes == {}


def test_what_no_file_can_hold_is_written_as_escapes_and_a_book_is_refused(tmp_path):
    assert built_in_with({"notes": {"note": " a\0b "}}).notes.note == r"a\x00b"
    (tmp_path / "rig.toml").write_text(f'[simulation]\n[notes]\nnote = "{"x" * 5000}"\n')
    with pytest.raises(ConfigError, match=r"notes\.note: .* is not text of 4000 characters or fewer"):
        load(tmp_path / "rig.toml")
