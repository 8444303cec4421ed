"""Devices without a data interface at a rig with addresses: the guard, a person at a terminal, and kill."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from rig.files.scan import ScanFile
from rig.light.state import forget_trip, trips, watchmen
from rig.model.config import load
from support.served_bench import rig_command, served

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a bench is served by POSIX alone")

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = ("--grid", "4x3", "--spacing", "30cm", "--exposure", "200ms")


@pytest.fixture
def external(tmp_path):
    with served(tmp_path, "--config", CONFIGS / "external.toml") as bench:
        yield bench


@pytest.fixture
def by_hand(tmp_path):
    """The same laser without a shutter; on the served bench it emits all the time."""
    text = (CONFIGS / "external.toml").read_text()
    start, end = text.index("[shutter]"), text.index("[detector]")
    config = tmp_path / "by_hand.toml"
    config.write_text(text[:start] + text[end:])
    with served(tmp_path, "--config", config) as bench:
        yield bench


class AtTerminal:
    """A program at a pseudo-terminal, and what is seen of it there."""

    def __init__(self, command, folder):
        self.seen = ""
        self._found = 0
        self._own, other = pty.openpty()
        self.process = subprocess.Popen(
            command, stdin=other, stdout=other, stderr=other, cwd=folder, start_new_session=True
        )
        os.close(other)

    def until(self, *words, within_s=40.0):
        """Read until one of the words is seen, after those that were seen before; return it."""
        until_s = time.monotonic() + within_s
        while time.monotonic() < until_s:
            for word in words:
                if (at := self.seen.find(word, self._found)) >= 0:
                    self._found = at + len(word)
                    return word
            if select.select([self._own], [], [], 0.2)[0]:
                try:
                    self.seen += os.read(self._own, 65536).decode(errors="replace")
                except OSError:
                    break
        raise AssertionError(f"none of {words} in: {self.seen[-3000:]}")

    def type(self, text):
        os.write(self._own, text.encode())

    def close(self):
        self.process.kill()
        self.process.wait(10)
        os.close(self._own)


@contextmanager
def at_terminal(folder, *arguments):
    one = AtTerminal(rig_command(*arguments), folder)
    try:
        yield one
    finally:
        one.close()


def waited_for(condition, within_s=8.0):
    until_s = time.monotonic() + within_s
    while not condition() and time.monotonic() < until_s:
        time.sleep(0.05)
    return condition()


def say_yes(program, times):
    """Answer so many questions as they come."""
    for _ in range(times):
        program.until("(y/n)", "[y/n]")
        program.type("y\n")


def test_a_person_at_a_terminal_scans_behind_a_shutter(external, tmp_path):
    scan = tmp_path / "s.h5"
    with at_terminal(tmp_path, "scan", "--config", external.config, "--out", scan, *SMALL) as program:
        say_yes(program, 3)  # light it, laser, detector
        program.until("LASER ON")
        program.until("laser dark, by its shutter")
        program.until("stays BIASED")
        program.until("only its shutter blocks")
        assert program.process.wait(20) == 0
    assert external.values("shutter open") == ["1", "0"]
    with ScanFile(scan) as file:
        assert file.devices["spad"]["answer"].startswith("a person, at 20")
        assert file.devices["laser"]["evidence"].startswith("none")  # on this bench it emits all the time


def test_a_program_that_is_killed_leaves_the_shutter_closed(external, tmp_path):
    with at_terminal(
        tmp_path, "scan", "--config", external.config, "--out", tmp_path / "s.h5", *SMALL, "--exposure", "60s"
    ) as program:
        say_yes(program, 3)  # light it, laser, detector
        assert waited_for(lambda: external.values("shutter open") == ["1"], 30.0)
        program.process.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        assert waited_for(lambda: external.values("shutter open") == ["1", "0"])
        assert time.monotonic() - killed_s < 3.0  # the guard looks every 0.05 s
        program.until("keeps its BIAS")
        assert "The laser is dark, by its shutter" in program.seen


def test_a_guard_that_is_killed_leaves_the_shutter_closed_too(external, tmp_path):
    """The program opens the shutter's line itself, which closes it."""
    with at_terminal(
        tmp_path, "scan", "--config", external.config, "--out", tmp_path / "s.h5", *SMALL, "--exposure", "60s"
    ) as program:
        say_yes(program, 3)  # light it, laser, detector
        assert waited_for(lambda: external.values("shutter open") == ["1"], 30.0)
        place = load(external.config).light_place
        (guard,) = (one for one in watchmen() if one.laser == place)
        os.kill(guard.pid, signal.SIGKILL)
        assert waited_for(lambda: external.values("shutter open") == ["1", "0"])
        assert program.process.wait(20) == 4


def test_a_shutter_is_closed_by_rig_laser_off_during_a_scan(external, tmp_path):
    with at_terminal(
        tmp_path, "scan", "--config", external.config, "--out", tmp_path / "s.h5", *SMALL, "--exposure", "60s"
    ) as program:
        say_yes(program, 3)  # light it, laser, detector
        assert waited_for(lambda: external.values("shutter open") == ["1"], 30.0)
        off = subprocess.run(
            rig_command("laser", "off", "--json"), capture_output=True, text=True, check=True
        )
        (told,) = json.loads(off.stdout)["lasers"]
        assert told["dark"] is True
        assert "port1/line0" in told["laser"]
        assert external.values("shutter open") == ["1", "0"]
        assert program.process.wait(20) == 4


def test_a_script_is_answered_by_yes_and_the_file_says_so(external, tmp_path):
    done = subprocess.run(
        rig_command("scan", "--config", external.config, "--out", "s.h5", *SMALL, "--yes", "--json"),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["unverified"]) == 2
    with ScanFile(tmp_path / "s.h5") as file:
        for device in ("spad", "laser"):
            assert file.devices[device]["answer"].startswith("--yes, at ")


def test_without_yes_a_script_is_refused_before_the_shutter_moves(external, tmp_path):
    done = subprocess.run(
        rig_command("scan", "--config", external.config, "--out", "s.h5", *SMALL),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 2
    assert "a person must be at the rig" in done.stderr
    assert "Traceback" not in done.stderr
    assert external.values("shutter open") == []
    assert not (tmp_path / "s.h5").exists()


def test_a_laser_by_hand_is_said_to_emit_when_nobody_says_otherwise(by_hand, tmp_path):
    """Killed: no program can put it out; the guard says so, and rig laser off too. A trip is left."""
    with at_terminal(
        tmp_path, "scan", "--config", by_hand.config, "--out", tmp_path / "s.h5", *SMALL, "--exposure", "60s"
    ) as program:
        say_yes(program, 4)  # light it, detector, ready, on
        program.until("LASER ON")
        off = subprocess.run(rig_command("laser", "off"), capture_output=True, text=True, check=False)
        assert off.returncode == 4
        assert "as EMITTING" in off.stderr
        program.until("SWITCH THE LASER OFF, NOW")
        program.type("n\n")
        program.until("Treat the laser as EMITTING: switch it off by hand, now")
        assert program.process.wait(30) in (3, 4)
    assert any("no program can switch it off" in trip.reason for trip in trips())
    forget_trip(load(by_hand.config))
    for guard in watchmen():  # it would shout for ten minutes
        with suppress(ProcessLookupError):  # the file of one that was killed before
            os.kill(guard.pid, signal.SIGKILL)


def test_rig_laser_off_cannot_reach_a_laser_by_hand(by_hand):
    off = subprocess.run(
        rig_command("laser", "off", "--config", by_hand.config), capture_output=True, text=True, check=False
    )
    assert off.returncode == 4
    assert "no program can switch it off" in off.stderr
    assert "as EMITTING" in off.stderr
