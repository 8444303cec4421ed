"""Whatever asks the program to end or to pause, it stops a scan and leaves it in order."""

import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from rig.acquire.interrupt import StopRequest
from rig.files import ScanDescription, ScanWriter

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX")


@pytest.fixture(autouse=True)
def ctrl_c_as_before():
    """After a request, Ctrl-C stays without effect until the program's end."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


#: Of all that end or suspend a program: terminal closed, Ctrl-C, Ctrl-Z, asked, timers, power, real time.
ASKING = (
    "SIGHUP", "SIGINT", "SIGQUIT", "SIGTERM", "SIGTSTP", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM",
    "SIGPROF", "SIGXCPU", "SIGPWR", "SIGIO", "SIGSTKFLT", "SIGRTMIN", "SIGRTMAX",
)  # fmt: skip


def numbers(names):
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


@pytest.mark.parametrize("number", numbers(ASKING), ids=lambda number: signal.Signals(number).name)
def test_every_way_to_ask_is_a_request_to_stop(number):
    told = []
    with StopRequest(told.append) as stop:
        assert not stop()
        os.kill(os.getpid(), number)
        assert stop()
    assert len(told) == 1


@pytest.mark.parametrize("number", numbers(("SIGTTIN", "SIGTTOU")))
def test_a_program_in_the_background_is_not_suspended(number):
    with StopRequest(lambda _: None) as stop:
        os.kill(os.getpid(), number)
        assert not stop()


def test_no_signal_raises_however_often_it_comes():
    told = []
    with StopRequest(told.append) as stop:
        for _ in range(10):
            for number in numbers(("SIGINT", "SIGTERM", "SIGHUP")):
                os.kill(os.getpid(), number)
        assert stop()
    assert told[0] == "Stopping after this position."
    assert set(told[1:]) == {"Stopping: the laser goes dark first."}


def test_a_ctrl_c_that_is_still_held_after_the_scan_does_nothing():
    with StopRequest(lambda _: None):
        os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGINT)


def test_a_terminal_that_is_gone_does_not_prevent_the_stop():
    def gone(sentence):
        raise OSError("Input/output error")

    with StopRequest(gone) as stop:
        os.kill(os.getpid(), signal.SIGHUP)
        assert stop()


def test_what_was_set_before_is_set_again():
    before = {number: signal.getsignal(number) for number in numbers(ASKING)}
    with StopRequest(lambda _: None):
        pass
    assert {number: signal.getsignal(number) for number in numbers(ASKING)} == before


@pytest.mark.parametrize("name", ["SIGHUP", "SIGTSTP"])
def test_a_scan_ends_in_order_when_its_terminal_is_closed_or_ctrl_z_is_pressed(tmp_path, name):
    command = [sys.executable, "-m", "rig", "scan", "--grid", "20x600", "--spacing", "2mm", "--out", "a.h5"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as scan:
        for line in scan.stderr:
            if "10 %" in line:
                break
        scan.stderr.close()  # as a closed terminal, nobody listens from now on
        scan.send_signal(getattr(signal, name))
        assert scan.wait(60) == 6
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["stop"].attrs["status"] == "interrupted"
        assert 0 < file["transients/done"][()].sum() < len(file["transients/done"])


@pytest.fixture(scope="module")
def long_to_export(tmp_path_factory):
    """A scan whose export takes seconds."""
    path = tmp_path_factory.mktemp("long") / "a.h5"
    described = ScanDescription(np.zeros((3000, 3)), np.zeros((1, 3)), 12_000, 16e-12, 0.0)
    with ScanWriter.create(path, described, journaled=False) as writer:
        for _ in range(3000):
            writer.append(np.zeros(12_000, "u4"))
    return path


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGINT, 130)]
)
def test_a_verb_that_is_asked_to_end_leaves_no_half_file(tmp_path, long_to_export, number, code):
    command = [sys.executable, "-m", "rig", "export", str(long_to_export), str(tmp_path / "e.mat")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as export:
        while not os.listdir(tmp_path):
            assert export.poll() is None, export.stderr.read()
            time.sleep(0.005)
        export.send_signal(number)
        said = export.stderr.read()
    assert export.returncode == code
    assert "Traceback" not in said
    assert os.listdir(tmp_path) == []


STOPS_IN_A_TEXT = """
import sys

class Stop:
    def find_spec(self, name, *_):
        if name == "pydantic":
            exec("raise KeyboardInterrupt")

sys.meta_path.insert(0, Stop())
"""


def test_ctrl_c_within_an_executed_text_has_its_code(tmp_path):
    """Python ends by the signal where such a text was interrupted, though somebody heard of it."""
    (tmp_path / "sitecustomize.py").write_text(STOPS_IN_A_TEXT)
    done = subprocess.run(
        [sys.executable, "-m", "rig", "list"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (130, "rig: stopped by Ctrl-C\n")
