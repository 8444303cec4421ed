"""Where the system gives no more threads, as a container with a limit: said in words, and no light."""

import os
import subprocess
import sys
import threading

import h5py
import numpy as np
import pytest

from rig.commands.notify import _post
from rig.files import ScanDescription, ScanFile, ScanWriter
from rig.light.process import shout
from support.served_bench import rig_command, served

SMALL = ("--grid", "3x2", "--spacing", "10cm")

#: Gives a Python program, and those that it starts, so many threads as an environment variable says.
FEW_THREADS = """
import os, threading
start, left = threading._start_new_thread, [int(os.environ["THREADS_LEFT"])]

def start_new_thread(*arguments, **keywords):
    if not left[0]:
        raise RuntimeError("can't start new thread")
    left[0] -= 1
    return start(*arguments, **keywords)

threading._start_new_thread = start_new_thread
"""


@pytest.fixture
def rig_with(tmp_path):
    """Run ``rig ARGUMENTS`` with so many threads."""
    (tmp_path / "few").mkdir()
    (tmp_path / "few/sitecustomize.py").write_text(FEW_THREADS)
    path = os.pathsep.join([str(tmp_path / "few"), *sys.path])

    def run(threads, *arguments):
        return subprocess.run(
            rig_command(*arguments),
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path, "THREADS_LEFT": str(threads)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=120,
        )

    return run


@pytest.fixture
def no_threads(monkeypatch):
    def start(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)


@pytest.mark.skipif(sys.platform == "win32", reason="served on pseudo-terminals")
def test_a_laser_is_not_lit_without_the_threads_that_watch_it(rig_with, tmp_path):
    """The program needs two, its guard three: it is the program that has too few, and then the guard."""
    with served(tmp_path) as bench:
        for threads in (0, 2):
            done = rig_with(threads, "scan", "--config", bench.config, *SMALL, "--yes", "--out", "a.h5")
            assert done.returncode in {3, 4}
            assert "can't start new thread" in done.stderr
            assert "Traceback" not in done.stderr
            assert "1" not in bench.values("laser emission")
            assert not (tmp_path / "a.h5").exists()
        done = rig_with(3, "scan", "--config", bench.config, *SMALL, "--yes", "--out", "a.h5")
        assert done.returncode == 0, done.stderr
        assert bench.values("laser emission")[-2:] == ["1", "0"]


def test_an_image_that_has_no_threads_is_refused_in_words(rig_with, tmp_path):
    made = rig_with(99, "sim", "render", "letters", "a.h5", "--grid", "6x6", "--spacing", "20cm")
    assert made.returncode == 0, made.stderr
    done = rig_with(0, "recon", "a.h5", "--depth", "0.8m:1m:10cm")
    assert (done.returncode, "no more threads or processes" in done.stderr) == (4, True)
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("*volume*"))


def test_a_scan_goes_on_without_a_live_view(rig_with, tmp_path):
    done = rig_with(0, "scan", *SMALL, "--live", "--out", "a.h5")
    assert (done.returncode, "live view: it cannot be followed" in done.stderr) == (0, True)
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.all()


def test_what_many_threads_pack_is_packed_by_one(tmp_path, no_threads):
    """Steps so large that they have several chunks."""
    channels, bins = 64, 20_000
    counts = np.random.default_rng(1).poisson(0.01, (2, channels, bins)).astype("u4")
    described = ScanDescription(np.zeros((2, 3)), np.zeros((1, channels, 3)), bins, 16e-12, 0.0)
    with ScanWriter.create(tmp_path / "a.h5", described) as writer:
        for step in counts:
            writer.append(step)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["transients/counts"].chunks[1:] < (channels, bins)
    with ScanFile(tmp_path / "a.h5") as scan:
        np.testing.assert_array_equal(scan.counts(range(2)), counts)


def test_the_guard_is_heard_without_a_thread(capfd, no_threads):
    shout("the laser cannot be made dark")
    assert "LASER GUARD: the laser cannot be made dark" in capfd.readouterr().err


def test_a_report_that_cannot_be_sent_is_said_so(no_threads):
    assert _post("http://127.0.0.1:1/", {}, 1.0) == "can't start new thread"
