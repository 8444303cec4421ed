"""The rules that the code itself keeps: style, types, imports between packages."""

import subprocess
import sys
from pathlib import Path

import pytest

from support.thorough import THOROUGH

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "command",
    [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        ["mypy"],
        pytest.param(
            ["mypy", "--platform", "win32", "--cache-dir", ".mypy_cache/windows"],
            marks=pytest.mark.skipif(not THOROUGH, reason="types for Windows: with RIG_TEST_THOROUGH=1"),
        ),
        ["lint-imports", "--no-cache"],
    ],
    ids=lambda command: " ".join(command),
)
def test_checker_is_content(command):
    tool = Path(sys.executable).parent / command[0]
    done = subprocess.run([tool, *command[1:]], cwd=ROOT, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr


def test_help_imports_nothing_heavy():
    """``rig --help`` stays quick: measured by what it imports, which does not depend on the machine."""
    script = "import sys, rig.commands; print([m for m in ('numpy', 'h5py', 'matplotlib', 'numba', 'scipy', "
    script += "'pint', 'pydantic', 'serial', 'usb') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.strip() == "[]", done.stdout + done.stderr
