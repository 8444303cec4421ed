"""The page about files shows the tables that the program works from, and its example runs."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanWriter, Volume, write_volume
from rig.files.layout import SCAN, VOLUME, as_markdown

PAGE = (Path(__file__).parents[2] / "docs" / "scan-file.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("layout", [SCAN, VOLUME], ids=["scan", "volume"])
def test_the_page_holds_the_table(layout):
    assert as_markdown(layout) in PAGE


@pytest.fixture
def scan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    description = ScanDescription(
        np.zeros((2, 3)), np.zeros((1, 3)), 5, 4e-12, 1e-9, devices={"laser": {"identity": "Laser 1"}}
    )
    with ScanWriter.create("scan.h5", description) as writer:
        writer.append(np.arange(5, dtype="u4"))
        writer.append(np.arange(5, dtype="u4"))
    return tmp_path / "scan.h5"


def test_the_examples_run(scan, capsys):
    first, second = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names = {}
    exec(first, names)
    np.testing.assert_array_equal(names["counts"], [[range(5)], [range(5)]])
    np.testing.assert_allclose(names["time_s"], 1e-9 + 4e-12 * (np.arange(5) + 0.5), rtol=1e-14)
    exec(second, {})
    assert "positions    2" in capsys.readouterr().out


def paths(file):
    """Return all paths of a file as a layout writes them."""
    found = {f"/@{name}" for name in file.attrs}

    def visit(name, member):
        found.add(f"/{name}")
        found.update(f"/{name}@{key}" for key in member.attrs if key != "description")

    file.visititems(visit)
    return found


def test_nothing_is_written_that_the_tables_do_not_name(scan, tmp_path):
    with h5py.File(scan) as file:
        written = {path.replace("/devices/laser", "/devices/*") for path in paths(file)}
    assert written <= set(SCAN)
    assert {path for path, entry in SCAN.items() if entry.required} <= written
    write_volume(
        tmp_path / "v.h5", Volume(np.ones((1, 2, 3), "f4"), np.arange(3.0), np.arange(2.0), np.ones(1))
    )
    with h5py.File(tmp_path / "v.h5") as file:
        written = paths(file)
    assert written <= set(VOLUME)
    assert {path for path, entry in VOLUME.items() if entry.required} <= written
