"""A file system without locks, as NFS without its daemon: scans are written and read, a rig is refused."""

import errno
import os
import shutil
import subprocess
import sys

import pytest

#: Stands before the C library: every lock is refused, with the number that the environment names.
NO_LOCKS = """
#include <errno.h>
#include <stdlib.h>
int flock(int descriptor, int operation) { errno = atoi(getenv("REFUSED_WITH")); return -1; }
"""

CHILD = """
import numpy as np
from rig.errors import DataFileError, RefusedError
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.light.lock import locked
from rig.model.config import built_in

description = ScanDescription(np.zeros((3, 3)), np.zeros((1, 3)), 9, 4e-12, 0.0)
try:
    with ScanWriter.create("a.h5", description) as writer:
        writer.append(np.ones(9, "u4"))
        writer.checkpoint()
    with ScanFile("a.h5") as scan:
        print(scan.status, scan.photons)
    with ScanWriter.resume("a.h5") as writer:
        for _ in range(2):
            writer.append(np.ones(9, "u4"))
    with ScanFile("a.h5") as scan:
        print(scan.status, scan.photons)
except DataFileError as error:
    print(error)
try:
    with locked(built_in()):
        print("locked")
except RefusedError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def shim(tmp_path_factory):
    compiler = shutil.which("cc")
    if not sys.platform.startswith("linux") or compiler is None:
        pytest.skip("the system's locks are taken away with a C compiler, on Linux")
    folder = tmp_path_factory.mktemp("shim")
    (folder / "shim.c").write_text(NO_LOCKS)
    made = folder / "shim.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", made, folder / "shim.c"], check=True)
    return made


@pytest.mark.parametrize("name", ["ENOLCK", "EOPNOTSUPP", "EINVAL", "EAGAIN"])
def test_scans_need_no_locks_but_a_rig_does(shim, tmp_path, name):
    environment = os.environ | {
        "LD_PRELOAD": str(shim),
        "REFUSED_WITH": str(getattr(errno, name)),
        "RIG_STATE": str(tmp_path / "state"),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    done = subprocess.run(
        [sys.executable, "-c", CHILD],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    *of_files, of_rig = done.stdout.splitlines()
    if name == "EAGAIN":  # another program has it
        assert "a.h5 is being written by another program" in "".join(of_files)
        assert "is in use by another program" in of_rig
    else:
        assert of_files == ["interrupted 9", "complete 27"]
        assert "Set RIG_STATE to a folder on a disk of this computer" in of_rig
