"""The registry names what exists, loads nothing until it is asked, and the pages show what it says."""

import subprocess
import sys
from pathlib import Path

import pytest

from recon import registry

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", registry.SOLVERS)
def test_every_place_is_there(name):
    entry = registry.SOLVERS[name]
    for place in (entry.place, entry.needs, entry.warnings):
        assert place is None or callable(registry.load(place))
    assert set(entry.refuses) <= set(registry.CAMERAS)


def test_the_pages_show_the_tables():
    assert registry.wave_table() in (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")
    assert registry.classic_table() in (ROOT / "docs" / "baselines.md").read_text(encoding="utf-8")


def test_names_are_offered_without_any_library():
    script = "import sys, recon.registry; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], cwd=ROOT, timeout=60).returncode == 0
