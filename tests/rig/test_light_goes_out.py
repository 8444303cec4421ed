"""Programs that die, hang or are stopped with the light on: judged by what the served devices did."""

import os
import signal
import subprocess
import sys
import time

import pytest

from attacks.latency import ATTACKS
from rig.files.scan import ScanFile
from support.hanging import HANGING
from support.served_bench import rig_command, served

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

#: Long enough to be in the middle of; 2 000 positions of 20 ms.
LONG = ("--grid", "50x40", "--spacing", "3cm", "--exposure", "20ms", "--yes")

#: A busy machine may need longer than the second that is promised; for ever is what must not be.
PATIENCE_S = 20.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with served(tmp_path_factory.mktemp("served")) as running:
        yield running


@pytest.fixture
def lit(bench, tmp_path):
    """A scan in a process of its own, some positions after its laser came on."""
    lit_before = len(bench.values("laser emission"))
    command = rig_command("scan", "--config", bench.config, *LONG, "--out", tmp_path / "a.h5")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as scan:
        wait_for(lambda: bench.values("laser emission")[lit_before:] == ["1"])
        moved = len(bench.values("galvo mirror"))
        wait_for(lambda: len(bench.values("galvo mirror")) > moved + 55)  # a line is finished
        yield scan
        if scan.poll() is None:
            scan.send_signal(signal.SIGCONT)
            scan.kill()
    wait_for(lambda: bench.values("detector bias")[-1] == "0")


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def dark(bench):
    return bench.values("laser emission")[-1] == "0"


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSEGV"])
def test_a_program_that_dies_leaves_laser_and_detector_off_and_can_be_resumed(
    rig, bench, lit, tmp_path, name
):
    lit.send_signal(getattr(signal, name))
    wait_for(lambda: dark(bench))
    wait_for(lambda: bench.values("detector bias")[-1] == "0")
    assert lit.wait(PATIENCE_S) == -getattr(signal, name)
    assert b"LASER GUARD" in lit.stderr.read()  # said by the guard, which is the only one left to say it
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.done.any()
        assert not scan.done.all()


@pytest.mark.parametrize("name", ["SIGHUP", "SIGINT", "SIGTERM", "SIGQUIT", "SIGTSTP"])
def test_a_program_that_is_asked_to_end_puts_the_light_out_itself(bench, lit, name):
    lit.send_signal(getattr(signal, name))
    wait_for(lambda: dark(bench))
    assert lit.wait(PATIENCE_S) == 6
    assert bench.values("detector bias")[-1] == "0"


def test_a_program_that_is_suspended_loses_the_light(bench, lit):
    lit.send_signal(signal.SIGSTOP)
    wait_for(lambda: dark(bench))
    lit.send_signal(signal.SIGCONT)
    assert lit.wait(PATIENCE_S) == 4
    said = lit.stderr.read()
    assert b"suspended by a signal" in said or b"did not run at all" in said  # as Linux alone can tell
    assert b"rig resume" in said
    assert bench.values("detector bias")[-1] == "0"


def test_a_guard_that_is_killed_takes_the_light_with_it(rig, bench, lit):
    (guard,) = subprocess.check_output(["pgrep", "-P", str(lit.pid), "-f", "rig.light.process"]).split()
    os.kill(int(guard), signal.SIGKILL)
    wait_for(lambda: dark(bench))
    assert lit.wait(PATIENCE_S) == 4
    assert b"guard of the laser has ended" in lit.stderr.read()


def test_a_laser_is_put_out_also_where_nothing_can_be_remembered(bench, rig, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("RIG_STATE", str(tmp_path / "file" / "state"))
    assert "No program on this computer" in rig("laser", "status").err
    assert "--config FILE" in rig("laser", "off").err
    put_out = rig("laser", "off", "--config", bench.config)
    assert put_out.code == 0
    assert "is dark" in put_out.err + put_out.out


def test_anybody_can_put_the_light_out_while_a_scan_runs(rig, bench, lit):
    told = rig("laser", "status")
    assert "is guarded by process" in told.err
    assert rig("laser", "off").code == 0
    assert dark(bench)
    assert lit.wait(PATIENCE_S) == 4
    assert b"switched off by rig laser off" in lit.stderr.read()
    again = rig("laser", "off", "--config", bench.config)  # now that no program has it
    assert again.code == 0
    assert "is dark" in again.err


def test_a_rig_is_used_by_one_program_at_a_time(rig, bench, lit):
    refused = rig("scan", "--config", bench.config, *LONG, "--out", "b.h5")
    assert refused.code == 4
    assert f"process {lit.pid}" in refused.err
    refused = rig("calibrate", "dark", "--config", bench.config, "--yes")
    assert refused.code == 4
    assert not dark(bench)  # whoever is refused changes nothing


def test_a_trip_is_acknowledged_by_a_person(rig, bench):
    from rig.light.state import forget_trip, remember_trip
    from rig.model.config import load

    config = load(bench.config)
    remember_trip(config, "the interlock opened")
    try:
        refused = rig("scan", "--config", bench.config, *LONG)
        assert refused.code == 4
        assert "the interlock opened" in refused.err
        assert "rig laser acknowledge" in refused.err
        assert "the interlock opened" in rig("laser", "status").err
        automatic = rig("laser", "acknowledge", "--config", bench.config)
        assert automatic.code == 2
        assert "by a person" in automatic.err
    finally:
        forget_trip(config)


def test_a_call_of_a_vendor_that_never_returns_ends_the_program_in_the_dark(bench, tmp_path):
    lit_before = len(bench.values("laser emission"))
    arguments = ["scan", "--config", bench.config, *LONG, "--out", tmp_path / "a.h5"]
    command = [sys.executable, "-c", HANGING, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as scan:
        wait_for(lambda: bench.values("laser emission")[lit_before:] == ["1"])
        wait_for(lambda: dark(bench))
        for _ in range(5):
            scan.send_signal(signal.SIGINT)  # which a call that never returns does not notice
        assert scan.wait(2 * PATIENCE_S) == 3
        assert b"has not returned" in scan.stderr.read()
    assert bench.values("detector bias")[-1] == "0"


@pytest.mark.parametrize("name", ["Ctrl-C once", "the interlock opens"])
def test_an_exposure_of_100_hours_is_cut_at_once(bench, tmp_path, name):
    times = ATTACKS[name](bench, tmp_path / "a.h5")
    assert times["end"] < PATIENCE_S
    assert times.get("live time", 1.0) > 0.5
    assert times.get("photons", 1) > 0
