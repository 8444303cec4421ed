"""A computer is kept awake while a guard holds its laser; one that slept all the same has no light then."""

import os
import signal
import subprocess
import sys
import time

import pytest

from rig.errors import LightLostError
from rig.light.awake import asleep_s, awake
from rig.light.remote import GuardedElsewhere
from rig.model.config import load
from support.served_bench import served

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux tells how long it slept")

#: A busy machine may need longer than what is promised; for ever is what must not be.
PATIENCE_S = 20.0

#: Stands in for a program of the system: says who it is and what it is asked, and runs what it is given.
INHIBIT = """#!/bin/sh
echo $$ "$@" >> "$ASKED"
while [ "${1#-}" != "$1" ]; do shift; done
exec "$@"
"""

#: Sets the clock that goes on in sleep ahead by an hour, once there is a file.
SLEEPS = """
import os, time
true = time.clock_gettime

def clock_gettime(clock):
    slept = clock == time.CLOCK_BOOTTIME and os.path.exists(os.environ["SLEPT"])
    return true(clock) + 3600.0 * slept

time.clock_gettime = clock_gettime
"""


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The file in which the stand-in says what it was asked."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/systemd-inhibit").write_text(INHIBIT)
    (tmp_path / "bin/systemd-inhibit").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("ASKED", str(tmp_path / "asked.txt"))
    return tmp_path / "asked.txt"


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def lines(path):
    return path.read_text().splitlines() if path.exists() else []


def runs(line):
    """Return whether the process that said a line is there, and not ended."""
    try:
        with open(f"/proc/{line.split()[0]}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_system_is_asked_for_as_long_as_the_block(asked):
    with awake():
        wait_for(lambda: len(lines(asked)) == 3)
        assert all(map(runs, lines(asked)))
    assert not any(map(runs, lines(asked)))
    ways = {word for line in lines(asked) for word in line.split() if word.startswith("--what=")}
    assert ways == {"--what=idle", "--what=sleep", "--what=handle-lid-switch"}


def test_the_system_may_sleep_again_when_who_asked_is_killed(asked):
    code = (
        "import time; from rig.light.awake import awake\nwith awake(): print(1, flush=True); time.sleep(99)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as holder:
        holder.stdout.readline()
        wait_for(lambda: len(lines(asked)) == 3)
        holder.send_signal(signal.SIGKILL)
    wait_for(lambda: not any(map(runs, lines(asked))))


def test_a_system_that_cannot_be_asked_is_no_hindrance(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with awake():
        assert asleep_s() >= 0.0


def test_the_guard_keeps_awake_and_puts_out_a_light_that_was_on_in_sleep(asked, tmp_path, monkeypatch):
    (tmp_path / "clock").mkdir()
    (tmp_path / "clock/sitecustomize.py").write_text(SLEEPS)
    monkeypatch.setenv("SLEPT", str(tmp_path / "slept"))
    monkeypatch.setenv("RIG_STATE", str(tmp_path / "state"))
    with served(tmp_path) as bench:
        monkeypatch.syspath_prepend(str(tmp_path / "clock"))  # the guard has the path of its program
        with GuardedElsewhere(load(bench.config)) as laser:
            laser.arm()
            laser.emit()
            wait_for(lambda: len(lines(asked)) == 3)
            assert all(map(runs, lines(asked)))
            laser.beat(PATIENCE_S)
            assert bench.values("laser emission")[-1] == "1"
            (tmp_path / "slept").touch()
            wait_for(lambda: bench.values("laser emission")[-1] == "0")
            with pytest.raises(LightLostError, match="slept for 3600 s"):  # told meanwhile
                wait_for(lambda: laser.beat(1.0))
    wait_for(lambda: not any(map(runs, lines(asked))))
