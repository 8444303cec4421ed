"""The guard's process and the program's side of it, on a served bench: what comes in between."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from drivers.errors import DeviceError
from rig.errors import LightLostError
from rig.light import remote
from rig.light.guard import FILE_LEASE_S
from rig.light.process import Inbox
from rig.light.remote import GuardedElsewhere
from rig.light.silence import suspended
from rig.light.state import folder
from rig.model.config import load
from support.served_bench import rig_command, served

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

#: A busy machine may need longer than what is promised; for ever is what must not be.
PATIENCE_S = 20.0

SMALL = ("--grid", "12x9", "--spacing", "15cm")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with served(tmp_path_factory.mktemp("served")) as running:
        yield running


@pytest.fixture(autouse=True)
def state_of_its_own(tmp_path, monkeypatch):
    """No trip of one test is in the way of another."""
    monkeypatch.setenv("RIG_STATE", str(tmp_path / "state"))


def wait_for(happened, limit_s=PATIENCE_S):
    deadline_s = time.monotonic() + limit_s
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def emits(bench):
    return bench.values("laser emission")[-1:] == ["1"]


def guards_of(pid):
    found = subprocess.run(
        ["pgrep", "-P", str(pid), "-f", "rig.light.process"], capture_output=True, check=False
    )
    return [int(one) for one in found.stdout.split()]


def raised_by_beats(laser, limit_s=PATIENCE_S):
    """Say that all is well until that is refused; return why."""
    deadline_s = time.monotonic() + limit_s
    while time.monotonic() < deadline_s:
        try:
            laser.beat(1.0)
        except LightLostError as lost:
            return str(lost)
        time.sleep(0.02)
    raise AssertionError("the light was not lost")


def test_a_laser_whose_line_is_gone_is_never_said_to_be_dark(tmp_path):
    with served(tmp_path) as bench:
        laser = GuardedElsewhere(load(bench.config))
        with pytest.raises((DeviceError, LightLostError)), laser:  # noqa: PT012
            laser.arm()
            laser.emit()
            assert emits(bench)
            bench.process.kill()  # with its pseudo-terminals, as a plug that is pulled
            assert "EMITTING" in raised_by_beats(laser)
            time.sleep(5.0)  # its line is opened anew every 2 s, in vain
            with pytest.raises(LightLostError, match="EMITTING"):
                laser.beat(1.0)
            (guard,) = guards_of(os.getpid())
        try:
            os.kill(guard, 0)  # it goes on trying
        finally:
            os.kill(guard, signal.SIGKILL)
            laser._process.wait()


def test_light_that_was_switched_off_does_not_come_back(bench):
    with GuardedElsewhere(load(bench.config)) as laser:
        laser.arm()
        (guard,) = guards_of(os.getpid())
        os.kill(guard, signal.SIGTERM)  # as rig laser off, before there is light
        time.sleep(0.5)
        before = len(bench.values("laser emission"))
        with pytest.raises(LightLostError, match="switched off by rig laser off"):
            laser.arm()
        with pytest.raises(DeviceError):
            laser.emit()
        assert len(bench.values("laser emission")) == before
        laser.stop()
        with pytest.raises(DeviceError, match="switched off by rig laser off"):
            laser.arm()


def test_many_sigterms_do_not_lock_the_guard(bench):
    with GuardedElsewhere(load(bench.config)) as laser:
        laser.arm()
        laser.emit()
        (guard,) = guards_of(os.getpid())
        for _ in range(300):
            os.kill(guard, signal.SIGTERM)
            time.sleep(0.001)
        assert "switched off" in raised_by_beats(laser)
        assert not emits(bench)
        laser.stop()


@pytest.mark.parametrize("program_too", [False, True])
def test_a_guard_that_stood_still_hears_what_was_said_before_it_judges(bench, program_too):
    """As on a computer that is busy, or that stood still as a whole; the program is well, and says so."""
    with GuardedElsewhere(load(bench.config)) as laser:
        laser.arm()
        laser.emit()
        (guard,) = guards_of(os.getpid())
        os.kill(guard, signal.SIGSTOP)
        try:
            stopped_s = time.monotonic()
            while time.monotonic() - stopped_s < 1.3:
                if not program_too:
                    laser.beat(0.8)
                time.sleep(0.02)
        finally:
            os.kill(guard, signal.SIGCONT)
        for _ in range(25):
            laser.beat(0.8)
            time.sleep(0.02)
        assert emits(bench)
        wait_for(lambda: not emits(bench))  # now that nothing is said
        assert "silent for" in raised_by_beats(laser)
        laser.stop()


#: Lights the laser, and grants itself time as for writing a file.
WRITES = """
import sys, time
from pathlib import Path
from rig.light.guard import FILE_LEASE_S
from rig.light.remote import GuardedElsewhere
from rig.model.config import load
with GuardedElsewhere(load(Path(sys.argv[1]))) as laser:
    laser.arm()
    laser.emit()
    laser.beat(FILE_LEASE_S)
    print("writing", flush=True)
    while True:
        time.sleep(1)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells whether a process is suspended")
def test_a_suspended_program_has_no_light_also_while_it_writes_a_file(bench):
    command = [sys.executable, "-c", WRITES, bench.config]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as program:
        try:
            assert program.stdout.readline() == b"writing\n"
            assert emits(bench)
            granted_until_s = time.monotonic() + FILE_LEASE_S
            program.send_signal(signal.SIGSTOP)
            wait_for(lambda: not emits(bench))
            assert time.monotonic() < granted_until_s - 5
        finally:
            program.kill()


def test_only_a_process_that_was_stopped_by_a_signal_is_suspended():
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as program:
        try:
            assert not suspended(program.pid)
            program.send_signal(signal.SIGSTOP)
            if sys.platform == "linux":
                wait_for(lambda: suspended(program.pid))
            program.send_signal(signal.SIGCONT)
            wait_for(lambda: not suspended(program.pid))
        finally:
            program.kill()
    assert not suspended(program.pid)  # there is none


@pytest.mark.parametrize("system_tells", [True, False])
def test_a_guard_that_hangs_is_ended_and_the_light_with_it(bench, system_tells):
    # otherwise as systems other than Linux, or of a guard that hangs without being suspended
    is_suspended = suspended if system_tells else lambda _: False
    with GuardedElsewhere(load(bench.config), is_suspended) as laser:
        laser.arm()
        laser.emit()
        (guard,) = guards_of(os.getpid())
        stopped_s = time.monotonic()
        os.kill(guard, signal.SIGSTOP)
        assert "guard of the laser has ended" in raised_by_beats(laser, 60.0)
        took_s = time.monotonic() - stopped_s
        told = system_tells and sys.platform == "linux"
        assert (took_s < remote.GUARD_HANGS_S) is told
        assert not emits(bench)
        laser.stop()  # which is so already
    assert not guards_of(os.getpid())


def test_without_its_guard_a_program_that_says_nothing_has_no_light_either(bench):
    with GuardedElsewhere(load(bench.config)) as laser:
        laser.arm()
        laser.emit()
        (guard,) = guards_of(os.getpid())
        os.kill(guard, signal.SIGKILL)
        wait_for(lambda: not emits(bench))  # though the program is busy and does not say a word
        assert "it has been switched off" in raised_by_beats(laser)
        laser.stop()


@pytest.mark.parametrize(
    "line", ["no JSON", "5", "[]", '{"do": "beat"}', '{"do": "beat", "until_s": "x"}', "[" * 9999]
)
def test_a_program_that_talks_nonsense_has_no_light(bench, line):
    laser = GuardedElsewhere(load(bench.config))
    with pytest.raises((DeviceError, LightLostError)), laser:  # noqa: PT012
        laser.arm()
        laser.emit()
        laser._process.stdin.write(line + "\n")
        laser._process.stdin.flush()
        wait_for(lambda: not emits(bench))
        laser.settings()
    wait_for(lambda: not guards_of(os.getpid()))


def test_the_end_of_what_is_read_is_always_noticed():
    for line in ("5\n", "null\n", '"do"\n', "[" * 99999, ""):
        read, write = os.pipe()
        os.write(write, line.encode()[:60000])
        os.close(write)
        with os.fdopen(read) as source:
            inbox = Inbox(source)
            assert inbox.get(PATIENCE_S) is None
            assert inbox.urgent.is_set()


def test_a_file_in_the_folder_is_no_module_of_the_guard(bench, tmp_path, monkeypatch):
    (tmp_path / "queue.py").write_text("raise SystemExit('not this one')")
    (tmp_path / "rig").mkdir()
    monkeypatch.chdir(tmp_path)
    with GuardedElsewhere(load(bench.config)) as laser:
        laser.arm()


def test_a_terminal_that_takes_no_text_does_not_keep_the_guard_from_its_work(bench, tmp_path):
    """Its program is killed, and what it says goes to a full pipe that nobody reads."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    with suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    code = (
        "import sys, time; from pathlib import Path; from rig.light.remote import GuardedElsewhere\n"
        "from rig.model.config import load\n"
        f"with GuardedElsewhere(load(Path({str(bench.config)!r}))) as laser:\n"
        "    laser.arm(); laser.emit(); print(1, flush=True)\n"
        "    while True: laser.beat(1.0); time.sleep(0.1)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=write) as program:
        assert program.stdout.readline() == b"1\n"
        (guard,) = guards_of(program.pid)
        program.kill()
    wait_for(lambda: not emits(bench))
    wait_for(lambda: not os.path.exists(f"/proc/{guard}") or not guards_running(guard))
    os.close(read)
    os.close(write)


def guards_running(pid):
    with open(f"/proc/{pid}/stat") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"


def test_files_of_guards_that_are_gone_are_not_taken_for_guards(rig, bench):
    stale = folder() / "guard-999999.json"
    for content in (
        {"pid": 999999, "rig": "r", "laser": "/dev/x", "port": 1, "token": "t"},
        {"pid": 999999, "rig": "r", "laser": "/dev/x", "port": 99999, "token": "t"},
        {"pid": 999999, "rig": "r", "laser": "/dev/x", "port": None, "token": 5},
        {"pid": "x"},
        5,
    ):
        stale.write_text(json.dumps(content))
        assert rig("laser", "off").code == 0
        told = rig("laser", "status")
        assert told.code == 0
        assert "999999" not in told.err
    stale.unlink()


def test_a_guard_that_cannot_start_is_told_in_words(bench, tmp_path):
    """As where no process can be made any more, here because its interpreter is gone."""
    arguments = rig_command("scan", "--config", bench.config, *SMALL, "--yes", "--out", "a.h5")[2:]
    code = "import sys; from rig.__main__ import main; sys.executable = '/nowhere'; "
    code += f"sys.argv = {arguments}; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 3
    assert "start its process" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize("numbers", [1, 2, 10])
def test_ctrl_c_before_and_after_the_scan_is_one_message(bench, tmp_path, numbers):
    """While a person is asked, or at the countdown, at each of which nothing has begun."""
    command = rig_command("scan", "--config", bench.config, *SMALL, "--out", "a.h5")
    with subprocess.Popen(
        command, cwd=tmp_path, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as scan:
        for line in scan.stderr:
            if "in 5 s" in line:
                break
        for _ in range(numbers):
            scan.send_signal(signal.SIGINT)
        said = scan.stderr.read()
        assert scan.wait(PATIENCE_S) == 130
    assert "Traceback" not in said
    assert "rig: stopped" in said
    assert not (tmp_path / "a.h5").exists()
