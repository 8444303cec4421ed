"""Attacks on the command line: every option of every verb, with values that nobody means.

PYTHONPATH=tests python -m attacks.options --number 2000
"""

import io
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from random import Random
from typing import Any

import numpy as np
import typer

from attacks.running import Attack, main
from attacks.spoiled import NUMBERS, WORDS
from attacks.texts import folder
from rig.commands import app

_VALUES = [*NUMBERS, *(word for word in WORDS if "\0" not in word)]
_VALUES += [
    "1e400s",
    "1e300m",
    "1nm",
    "0.01mm",
    "0m",
    "-1m",
    "1fs",
    "1e-300s",
    "1e300s",
    "10dB",
    "1mdegC",
    "0s",
    "9GB",
]
_VALUES += [
    "99999999999x2",
    "9999x999",
    "2x2",
    "0.5m:1e400m:1cm",
    "0.5m:3m:1nm",
    "1m:1m:0m",
    "0ns:1e300s:1ps",
    "1B",
]
_VALUES += [
    "0ns:1s:1fs",
    "1,2",
    "1,1,1",
    "0",
    "5",
    "wall",
    "scene:x",
    "scene:letters",
    "3",
    "1e-9m",
    "1km",
    "90ns",
    "1THz",
]

#: What each verb is called with, so that one option alone is hostile; those of real work are small.
_BASE: dict[str, list[str]] = {
    "scan": ["--dry-run", "--grid", "4x3", "--spacing", "10cm"],
    "resume": ["small.h5"],
    "recon": ["small.h5", "--voxel", "10cm", "--depth", "0.5m:1m:10cm", "--out", "v.h5", "--image", "p.png"],
    "batch": ["nothing.toml"],
    "measure": ["volume.h5"],
    "compare": ["nothing.h5"],
    "stats": ["small.h5"],
    "plot": ["small.h5"],
    "import": ["small.h5", "imported.h5"],
    "export": ["volume.h5", "exported.npz"],
    "init": ["--answers", "nothing.toml"],
    "config show": [],
    "doctor": [],
    "sim render": ["point", "rendered.h5", "--grid", "3x2", "--spacing", "10cm", "--bins", "100"],
    "calibrate galvo": ["--from", "nothing.h5"],
    "calibrate dark": ["--from", "nothing.h5"],
    "calibrate gate": ["--from", "nothing.h5"],
    "calibrate dnl": ["--from", "nothing.h5"],
    "calibrate time-zero": ["--from", "nothing.h5"],
    "calibrate irf": ["--from", "nothing.h5"],
    "calibrate show": [],
}


def _verbs(command: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each verb's name and command."""
    if hasattr(command, "commands"):
        for part, inner in command.commands.items():
            yield from _verbs(inner, f"{name} {part}".strip())
    else:
        yield name, command


@cache
def _options() -> tuple[tuple[str, str], ...]:
    """Return (verb, option) for each option that takes a value; an argument's option is empty."""
    found = []
    for verb, command in _verbs(typer.main.get_command(app)):
        for one in command.params:
            if not getattr(one, "is_flag", False) and verb in _BASE:
                found.append((verb, one.opts[0] if one.opts[0].startswith("-") else ""))
    return tuple(found)


def command_line(random: Random) -> list[str]:
    """Return a command line with one or two hostile values."""
    verb, option = random.choice(_options())
    base = list(_BASE[verb])
    value = random.choice(_VALUES)
    if option:
        base += [f"{option}={value}" if value.startswith("-") else option, value][
            : 1 if value.startswith("-") else 2
        ]
    elif base and not base[0].startswith("-"):
        base[0] = value
    return [*verb.split(), *base]


def run(arguments: list[str]) -> None:
    """Run ``rig``; a defect or a traceback is an error."""
    from rig.__main__ import main as rig

    _prepare()
    before, here, on_ctrl_c = sys.argv, os.getcwd(), signal.getsignal(signal.SIGINT)
    out, err = io.StringIO(), io.StringIO()
    code: Any = 0
    os.chdir(folder())
    sys.argv = ["rig", *arguments]
    try:
        with redirect_stdout(out), redirect_stderr(err):
            rig()
    except SystemExit as ended:
        code = ended.code
    finally:
        sys.argv = before
        os.chdir(here)
        signal.signal(signal.SIGINT, on_ctrl_c)
    assert "Traceback" not in err.getvalue(), err.getvalue()[-400:]
    assert code in {0, 2, 3, 4, 5, 6}, f"exit code {code}: {err.getvalue()[-300:]}"
    assert code == 0 or err.getvalue(), "no message"


@cache
def _prepare() -> None:
    """Make the small files that verbs are called with, once."""
    from rig.files import ScanDescription, ScanWriter
    from rig.files.volume import Volume, write_volume

    x, y = np.meshgrid(np.arange(4) * 0.1, np.arange(3) * 0.1)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(12)], axis=1)
    with ScanWriter.create(
        folder() / "small.h5", ScanDescription(laser_m, np.zeros((1, 3)), 1000, 16e-12, 0.0)
    ) as writer:
        for step in range(12):
            writer.append(np.full(1000, step, np.uint32))
    axis = np.linspace(-0.1, 0.1, 5)
    write_volume(
        folder() / "volume.h5", Volume(np.ones((3, 5, 5), np.float32), axis, axis, np.array([0.5, 0.6, 0.7]))
    )


ATTACKS = (Attack("options", command_line, run, ()),)

if __name__ == "__main__":
    main(ATTACKS)
