"""Attacks on the command line: every option and argument of every verb, with values that nobody means.

PYTHONPATH=tests python -m attacks.options --number 100000

The first inputs give each option each of a list of values, once; those that follow have values made of
random parts.
"""

import io
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import typer

from attacks.running import Attack, main
from attacks.spoiled import NUMBERS, WORDS, spoiled_text
from attacks.texts import folder, quantity
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
    "30m",
    "90ns",
    "1THz",
]

#: Names of what never ends where a file is meant: pipes that nobody writes to, and links to a device.
_PIPES, _DEVICES = (
    [kind + ending for ending in ("", ".toml", ".json", ".obj", ".h5")] for kind in ("pipe", "endless")
)
_VALUES += [*_PIPES, *_DEVICES]

#: Texts that some option takes, to be spoiled.
_GOOD = [
    "10ms", "4cm", "0.5m", "100ps", "2MHz", "30deg", "18x13", "2x2", "5%", "12", "0.7", "1GB", "letters",
    "0.5m:1m:10cm", "0ns:10ns:1ns", "90ns,120ns,160ns", "1,2,3", "30cm,-10cm", "0.1,0.2,0.3", "x,-y",
    "confocal", "transient", "raster", "step", "wall", "laser", "cpu", "0.0.0.0:8642", "v.h5", "p.png",
]  # fmt: skip
_UNITS = ["", "s", "ms", "ps", "m", "cm", "mm", "MHz", "deg", "GB"]
_BETWEEN = [":", ",", "x", ";", "-", "..", " ", "/", "="]
_REFUSED = ["--config", "nothing.toml"]

#: What each verb is called with, so that one option alone is hostile; those of real work are small, and what
#: would go on until it is stopped is refused.
_BASE: dict[str, list[str]] = {
    "scan": ["--dry-run", "--grid", "4x3", "--spacing", "10cm"],
    "resume": ["small.h5"],
    "watch": ["nothing.h5"],
    "align": _REFUSED,
    "recon": ["small.h5", "--voxel", "10cm", "--depth", "0.5m:1m:10cm", "--out", "v.h5"],
    "batch": ["nothing.toml"],
    "measure": ["volume.h5"],
    "compare": ["nothing.h5"],
    "stats": ["small.h5"],
    "info": ["small.h5"],
    "list": ["."],
    "report": ["nothing.h5", "volume.h5"],
    "plot": ["small.h5"],
    "import": ["small.h5", "imported.h5"],
    "export": ["volume.h5", "exported.npz"],
    "init": ["--answers", "nothing.toml"],
    "version": [],
    "config show": [],
    "doctor": [],
    "devices probe": _REFUSED,
    "laser off": _REFUSED,
    "laser status": [],
    "laser acknowledge": _REFUSED,
    "sim render": ["point", "rendered.h5", "--grid", "3x2", "--spacing", "10cm", "--bins", "100"],
    "sim serve": _REFUSED,
    "calibrate galvo": ["--from", "nothing.h5"],
    "calibrate dark": ["--from", "nothing.h5"],
    "calibrate gate": ["--from", "nothing.h5"],
    "calibrate dnl": ["--from", "nothing.h5"],
    "calibrate time-zero": ["--from", "nothing.h5"],
    "calibrate lag": ["--from", "nothing.h5"],
    "calibrate irf": ["--from", "nothing.h5"],
    "calibrate all": _REFUSED,
    "calibrate show": [],
}


def verbs(command: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each verb's name and command."""
    if hasattr(command, "commands"):
        for part, inner in command.commands.items():
            yield from verbs(inner, f"{name} {part}".strip())
    else:
        yield name, command


#: What makes an image as large as somebody likes; its making is then left out.
_SIZES = {"--depth", "--width", "--height", "--voxel"}


@cache
def _places() -> tuple[tuple[str, str | int], ...]:
    """Return (verb, option) for each option that takes a value, and (verb, 0) for its first argument, ..."""
    found: list[tuple[str, str | int]] = []
    for verb, command in verbs(typer.main.get_command(app)):
        valued = [one.opts[0] for one in command.params if not getattr(one, "is_flag", False)]
        found += [(verb, name) for name in valued if name.startswith("-")]
        found += [(verb, place) for place in range(sum(not name.startswith("-") for name in valued))]
    return tuple(found)


@cache
def each() -> tuple[list[str], ...]:
    """Return a command line for each place and each hostile value."""
    return tuple(
        [*verb.split(), *_given(verb, _BASE[verb], place, value)]
        for verb, place in _places()
        for value in _VALUES
    )


def command_line(random: Random) -> list[str]:
    """Return a command line with one or two hostile values."""
    verb, place = random.choice(_places())
    given = _given(verb, _BASE[verb], place, _hostile(random))
    if random.random() < 0.3:
        place = random.choice([other for its, other in _places() if its == verb])
        given = _given(verb, given, place, _hostile(random))
    return [*verb.split(), *given]


def _hostile(random: Random) -> str:
    """Return a known value, a number with a unit, several of these, or a good text that was spoiled."""
    kind = random.random()
    if kind < 0.2:
        return random.choice(_VALUES)
    if kind < 0.4:
        return random.choice([*NUMBERS, "10", "4.5"]) + random.choice(_UNITS)
    if kind < 0.6:
        count = random.choice([1, 1, 2, 3, 5])
        return _argument(random.choice(_BETWEEN).join(quantity(random)[0] for _ in range(count)))
    return _argument(spoiled_text(random, random.choice(_GOOD)))


def _argument(text: str) -> str:
    """Return what of a text a command line can hold."""
    return text.replace("\0", "")[:100_000]


def _given(verb: str, base: list[str], place: str | int, value: str) -> list[str]:
    """Return a verb's arguments with a value in one place."""
    if verb == "recon" and place in _SIZES:
        base = [*base, "--dry-run"]
    if isinstance(place, str):
        return [*base, f"{place}={value}"] if value.startswith("-") else [*base, place, value]
    count = next((number for number, word in enumerate(base) if word.startswith("--")), len(base))
    arguments = [*base[:count], *["x"] * (place + 1 - count)]
    arguments[place] = value
    return [*arguments, *base[count:]]


def run(arguments: list[str]) -> None:
    """Run ``rig``; a defect or a traceback is an error."""
    from rig.__main__ import main as rig

    there, _ = _prepare()
    before, here, on_ctrl_c = sys.argv, os.getcwd(), signal.getsignal(signal.SIGINT)
    out, err = io.StringIO(), io.StringIO()
    code: Any = 0
    _lay_out_the_endless(there)
    os.chdir(there)
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
        _tidy()
    assert "Traceback" not in err.getvalue(), err.getvalue()[-400:]
    assert code in {0, 2, 3, 4, 5, 6}, f"exit code {code}: {err.getvalue()[-300:]}"
    assert code == 0 or err.getvalue(), "no message"


@cache
def _prepare() -> tuple[Path, frozenset[str]]:
    """Make the small files that verbs are called with, once; return their folder and what lies in it."""
    from rig.files import ScanDescription, ScanWriter
    from rig.files.volume import Volume, write_volume

    typer.main.get_command = cache(typer.main.get_command)  # each run would build the whole command line
    here = folder() / "so" / "deep" / "here"  # so that ../.. is ours, too
    here.mkdir(parents=True)
    os.environ |= {"XDG_STATE_HOME": str(folder() / "state"), "XDG_CACHE_HOME": str(folder() / "cache")}
    x, y = np.meshgrid(np.arange(4) * 0.1, np.arange(3) * 0.1)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(12)], axis=1)
    with ScanWriter.create(
        here / "small.h5", ScanDescription(laser_m, np.zeros((1, 3)), 1000, 16e-12, 0.0)
    ) as writer:
        for step in range(12):
            writer.append(np.full(1000, step, np.uint32))
    axis = np.linspace(-0.1, 0.1, 5)
    write_volume(
        here / "volume.h5", Volume(np.ones((3, 5, 5), np.float32), axis, axis, np.array([0.5, 0.6, 0.7]))
    )
    return here, frozenset([*os.listdir(here), *_PIPES, *_DEVICES])


def _lay_out_the_endless(here: Path) -> None:
    """Make pipes, and links to a device, where the last input replaced them."""
    for name in _PIPES:
        if not (here / name).is_fifo():
            (here / name).unlink(missing_ok=True)
            os.mkfifo(here / name)
    for name in _DEVICES:
        if not (here / name).is_symlink():
            (here / name).unlink(missing_ok=True)
            (here / name).symlink_to("/dev/zero")


def _tidy() -> None:
    """Remove what a verb wrote: the next input must find the same files."""
    here, kept = _prepare()
    for name in set(os.listdir(here)) - kept:
        path = here / name
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


ATTACKS = (Attack("options", command_line, run, (), each),)

if __name__ == "__main__":
    main(ATTACKS)
