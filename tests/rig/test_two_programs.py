"""Two programs at one scan file: the second is refused and changes nothing, also where HDF5 locks nothing."""

import os
import subprocess
import sys
import threading
import time

import pytest

from rig.errors import DataFileError
from rig.files import ScanFile
from rig.files.journal import Journal
from support.served_bench import rig_command
from support.thorough import THOROUGH

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no lock on the journal")

#: Long enough to be in the middle of, also of a busy machine: the bench keeps step with the clock on the
#: wall, and needs four minutes.
CONFIG = "[simulation]\nreal_time = true\n"
LONG = ("--config", "rig.toml", "--grid", "90x60", "--spacing", "2cm", "--exposure", "40ms", "--out", "a.h5")


@pytest.fixture(params=["", "FALSE"], ids=["HDF5 locks", "HDF5 does not lock"])
def running(request, tmp_path):
    """A scan in the middle of its positions, and the environment of all programs."""
    environment = {**os.environ, "HDF5_USE_FILE_LOCKING": request.param}
    if not request.param:
        del environment["HDF5_USE_FILE_LOCKING"]
    (tmp_path / "rig.toml").write_text(CONFIG)
    command = rig_command("scan", *LONG)
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as scan:
        for line in scan.stderr:
            if "exposing" in line:
                break
        while not measured(tmp_path / "a.h5"):
            assert scan.poll() is None
            time.sleep(0.2)
        yield scan, environment
        scan.kill()


def measured(path):
    with ScanFile(path) as file:
        return file.done.any()


SECOND = (
    (("resume", "a.h5"), 5, "being written by another program"),
    (("scan", *LONG), 2, "exists"),
)


#: Few voxels: whether there is an image matters here, and not which.
FEW = ("--voxel", "10cm", "--depth", "0.8m:1.2m:10cm")
#: What reads a scan file shows what is there, and leaves the scan alone.
READERS = (
    ("stats", "a.h5", "--json"),
    ("plot", "a.h5", "--image", "raw.png"),
    ("export", "a.h5", "a.mat"),
    ("recon", "a.h5", *FEW, "--out", "v.h5", "--image", "v.png"),
    *([("compare", "a.h5", *FEW, "--out", "compared")] if THOROUGH else []),
)


@pytest.mark.timeout(900)  # six programs that image while a seventh scans
def test_a_scan_that_runs_is_read_up_to_its_last_line(running, tmp_path):
    scan, environment = running
    positions = []
    locks = "HDF5_USE_FILE_LOCKING" not in environment
    for arguments in READERS if locks or THOROUGH else READERS[:1]:
        reader = a_second_program(arguments, tmp_path, environment)
        assert scan.poll() is None, "the scan ended before it was read"
        assert reader.returncode == 0, reader.stderr
        assert "being written by a scan" in reader.stderr
        with ScanFile(tmp_path / "a.h5") as file:
            assert file.status == "running"
            positions.append(int(file.done.sum()))
    assert positions == sorted(positions)
    assert positions[0] > 0
    scan.kill()
    scan.wait()
    with ScanFile(tmp_path / "a.h5") as file:
        assert file.status == "interrupted"
        assert file.done.sum() >= positions[-1]


def a_second_program(arguments, folder, environment):
    command = rig_command(*arguments)
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    return done


def test_a_second_program_is_refused_and_changes_nothing(running, tmp_path):
    scan, environment = running
    for arguments, code, said in SECOND:
        second = a_second_program(arguments, tmp_path, environment)
        assert scan.poll() is None
        assert second.returncode == code, second.stderr
        assert said in second.stderr
    scan.terminate()
    scan.stderr.read()
    assert scan.wait(60) == 6
    with ScanFile(tmp_path / "a.h5") as file:
        assert file.done.any()
        assert not file.altered.any()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="Linux has a device that is always full")
@pytest.mark.parametrize("full", [("stdout",), ("stderr",), ("stdout", "stderr")], ids="+".join)
def test_a_scan_whose_messages_nobody_takes_is_whole(tmp_path, full):
    command = rig_command("scan", "--grid", "12x9", "--spacing", "15cm", "--out", "a.h5")
    with open("/dev/full", "w") as nowhere:
        streams = dict.fromkeys(full, nowhere)
        code = subprocess.run(command, cwd=tmp_path, **streams, check=False).returncode
    assert code == (2 if "stdout" in full else 0)  # its results could not be told
    with ScanFile(tmp_path / "a.h5") as file:
        assert file.status == "complete"


def test_who_looks_at_a_journal_keeps_nobody_from_going_on(tmp_path):
    """However often and however long one looks: only who writes holds the lock."""
    path = tmp_path / "a.h5.journal"
    Journal(path, new=True).close()
    looks = Journal(path, alone=False)
    writer = Journal(path, alone=True)
    assert not looks.growing
    assert Journal(path, alone=False).growing
    with pytest.raises(DataFileError, match=r"a\.h5 is being written by another program"):
        Journal(path, alone=True)
    writer.close()


@pytest.mark.skipif(sys.platform == "win32", reason="there is no lock of a journal there")
def test_who_writes_asks_again_while_another_tries_the_lock(tmp_path):
    import fcntl

    path = tmp_path / "a.h5.journal"
    Journal(path, new=True).close()
    with path.open() as tried:
        fcntl.flock(tried, fcntl.LOCK_SH)
        ending = threading.Timer(0.1, lambda: fcntl.flock(tried, fcntl.LOCK_UN))
        ending.start()
        Journal(path, alone=True).close()
        ending.join()
