"""The page about Python runs from top to bottom; so do the examples of the docstrings."""

import doctest
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

import rig

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/python.md").read_text(encoding="utf-8")


def with_examples() -> list[str]:
    """Return the modules whose docstrings have examples."""
    found = [path for package in ("rig/api", "recon") for path in sorted((ROOT / package).rglob("*.py"))]
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in found
        if ">>> " in path.read_text(encoding="utf-8")
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the page was run: its files are there afterwards."""
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def names(folder):
    """What the page leaves behind."""
    known: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number, block in enumerate(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)):
            exec(compile(block, f"docs/python.md, block {number + 1}", "exec"), known)
    return known


def test_the_page_runs(names, folder):
    assert names["image"].parameters["wavelength_m"] == 0.16
    for name in ("volume.h5", "front.png", "letters.npz", "letters.html"):
        assert (folder / name).stat().st_size > 1000, name


def test_the_letters_are_where_they_are(names):
    """Half of the pixels that show a surface are nearer to the truth than an eighth of a wavelength."""
    assert names["numbers"]["depth"]["median_absolute_m"] < 0.16 / 8
    assert names["numbers"]["overlap"] > 0.3


@pytest.mark.parametrize("module", with_examples())
def test_examples_of_docstrings(module, names, folder, tmp_path, monkeypatch):
    """Those of `rig` see a scan, open, and the folder that it lies in."""
    shutil.copy(folder / "letters.h5", tmp_path)
    monkeypatch.chdir(tmp_path)
    with rig.open_scan("letters.h5") as scan:
        known = {"rig": rig, "scan": scan} if module.startswith("rig.") else {}
        options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        result = doctest.testmod(import_module(module), extraglobs=known, optionflags=options)
    assert result.attempted > 0
    assert result.failed == 0
