"""Results on a disk that is full at any level: they are whole, or not there, and what is wrong is said."""

import json
import os
import re
import subprocess
import sys

import pytest

from rig.__main__ import exit_code, told

KINDS = (
    "volume.h5 film.h5 grown.h5 imported.h5 batch.jsonl scan.hdf5 scan.mat scan.ptu "
    "volume.npz volume.vti volume.html"
)


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    if sys.platform == "win32":
        pytest.skip("Windows has no limit on the size of files")
    command = [sys.executable, "-m", "support.full_disk", str(tmp_path_factory.mktemp("full"))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Exception ignored" not in done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", KINDS.split())
def test_a_result_is_whole_or_not_there(outcomes, name):
    found = outcomes[name]
    for said, left in found[:-1]:
        assert re.fullmatch(r"cannot write .*: File too large; check free space and permissions", said)
        assert "part" not in said
        assert left in ([], ["batch.jsonl"])
    assert found[-1] == ["", [name]]


def test_a_full_disk_is_no_defect_wherever_it_is_met():
    full = OSError(28, "No space left on device")
    assert exit_code(full) == 2
    assert "No space left on device; check free space" in told(full)
    assert "folder is gone" in told(FileNotFoundError(2, "No such file or directory"))
    assert exit_code(OSError(9, "Bad file descriptor")) is None
