"""What each verb loads: help loads nothing heavy, and a cheap verb only what it reads with."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from rig.files import ScanDescription, ScanWriter
from rig.files.volume import Volume, write_volume

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process is made of another by a fork")

#: Libraries whose import takes a person's time, or that an install may lack.
HEAVY = [
    *("cupy", "dask", "distributed", "ducc0", "h5py", "matplotlib", "numba", "numpy", "pint", "PIL"),
    *("pydantic", "scipy", "starlette", "torch", "trimesh", "uvicorn"),
]

#: Runs each run of command lines of its input in a process of its own, from one that has loaded the commands
#: alone. What a line loads is there for those after it, too.
PROGRAM = """
import json, os, sys
from rig.commands import app
from rig.__main__ import main
nothing = os.open(os.devnull, os.O_WRONLY)

def ran(line):
    sys.argv = ["rig", *line]
    try:
        main()
    except SystemExit as ended:
        return [ended.code, sorted({name.partition(".")[0] for name in sys.modules} & set(HEAVY))]

found = []
for lines in json.load(sys.stdin):
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        os.write(writer, json.dumps([ran(line) for line in lines]).encode())
        os._exit(0)
    os.close(writer)
    with open(reader) as said:
        found += json.loads(said.read())
    os.waitpid(child, 0)
print(json.dumps(found))
"""

#: The library of the command line reads the values of options with it.
OPTIONS = {"pydantic"}
READS_CONFIGURATIONS = OPTIONS | {"numpy"}
READS_HDF5 = READS_CONFIGURATIONS | {"h5py"}
#: Layouts of volumes are in one table, those that draw among them.
WRITES_LAYOUTS = READS_HDF5 | {"matplotlib", "PIL", "scipy"}
#: Cheap verbs, and what each may load.
CHEAP = {
    "version": OPTIONS,
    "version --json": READS_CONFIGURATIONS,
    "scan --preset list": READS_CONFIGURATIONS,
    "laser status": READS_CONFIGURATIONS,
    "calibrate show": READS_CONFIGURATIONS,
    "info scan.h5": READS_HDF5,
    "info volume.h5": READS_HDF5,
    "list": READS_HDF5,
    "stats scan.h5": READS_HDF5,
    "export volume.h5 volume.npz": WRITES_LAYOUTS,
    "recon": OPTIONS,
}


def verbs():
    """Return the words of every verb, and of every group of verbs."""
    from typer.main import get_command

    from rig.commands import app

    def below(command, words):
        yield words
        for name, one in getattr(command, "commands", {}).items():
            yield from below(one, [*words, name])

    return list(below(get_command(app), []))


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Return, for each command line, its exit code and the heavy libraries that it loaded."""
    folder = tmp_path_factory.mktemp("imports")
    laser_m = np.array([[0.1 * x, 0.1 * y, 0.0] for y in range(2) for x in range(3)])
    with ScanWriter.create(
        folder / "scan.h5", ScanDescription(laser_m, np.zeros((1, 3)), 1000, 16e-12, 0.0)
    ) as writer:
        for _ in range(6):
            writer.append(np.ones(1000, np.uint32))
    axis = np.array([-0.1, 0.0, 0.1])
    volume = Volume(np.ones((2, 3, 3), np.float32), axis, axis, np.array([0.5, 0.6]))
    write_volume(folder / "volume.h5", volume)
    # help loads next to nothing, so that all of it in one process tells as much as each in its own
    runs = [[[*words, "--help"] for words in verbs()], *([line.split()] for line in CHEAP)]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("HEAVY", repr(HEAVY))],
        input=json.dumps(runs),
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    lines = (line for run in runs for line in run)
    return {" ".join(line): found for line, found in zip(lines, json.loads(done.stdout), strict=True)}


def test_help_loads_nothing_heavy(loaded):
    helps = {line: found for line, found in loaded.items() if line.endswith("--help")}
    assert len(helps) > 25
    assert helps.pop("--help") == [0, []]
    assert {line: found for line, found in helps.items() if found[0] or set(found[1]) - OPTIONS} == {}


@pytest.mark.parametrize("line", CHEAP)
def test_a_cheap_verb_loads_what_it_needs_alone(loaded, line):
    code, heavy = loaded[line]
    assert code in {0, 2}
    assert set(heavy) <= CHEAP[line]


def test_imaging_begins_without_what_it_needs_later():
    """Compiled loops and what draws are loaded while the record is read."""
    script = "import sys, rig.commands.recon, rig.image.asked, rig.image.reconstruct; "
    script += "print([one for one in ('matplotlib', 'numba', 'pint', 'scipy') if one in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("[]\n", "")
