"""Results on a disk that is full at any level: they are whole, or not there, and what is wrong is said."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rig.__main__ import exit_code, told
from rig.atomic import appearing, refusals_told
from rig.errors import DataFileError
from rig.files.fresh import FreshFile

KINDS = (
    "volume.h5 film.h5 grown.h5 imported.h5 batch.jsonl galvo-marks.json scan.hdf5 scan.mat scan.ptu "
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
    assert exit_code(OSError(9, "Bad file descriptor")) is None


def test_that_a_folder_is_gone_is_said_only_where_it_is(tmp_path, monkeypatch):
    nameless = FileNotFoundError(2, "No such file or directory")
    assert exit_code(nameless) is None
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert exit_code(nameless) == 2
    assert "folder is gone" in told(nameless)


@pytest.mark.parametrize(("name", "is_of_it"), [("a.h5", True), ("source.mat", False), (None, True)])
def test_what_is_refused_of_another_file_is_not_said_of_the_one_that_is_written(tmp_path, name, is_of_it):
    target = tmp_path / "a.h5"
    refused = PermissionError(13, "Permission denied", name and str(tmp_path / name))
    with pytest.raises(DataFileError if is_of_it else PermissionError), refusals_told(target):
        raise refused
    with (
        pytest.raises(DataFileError, match=r"write .*a\.h5"),
        refusals_told(target),
        appearing(target) as part,
    ):
        raise PermissionError(13, "Permission denied", str(part))


def test_ctrl_c_stays_ctrl_c_where_the_disk_was_full_before(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")

    def stopped():
        with FreshFile(Path("/dev/full")) as file:
            file["values"] = np.zeros(100_000)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
