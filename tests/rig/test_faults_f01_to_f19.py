"""Nineteen faults that this program once had, each as one test: light left on, data lost, hanging files.

What each fault was, and how it is met, is in docs/attacks.md. Where a fault has many forms, they are attacked
one by one elsewhere; here stands one form of each, as a person would meet it.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from attacks.exchanges import FAULTS, Attacked
from attacks.scene import attacked_rig, kept, scan, tiny_config, tiny_plan
from attacks.taps import Fault
from rig.acquire.events import StepDone
from rig.acquire.log import log_of
from rig.files.scan import ScanFile
from support.hanging import HANGING
from support.served_bench import rig_command, served
from support.thorough import some

CONFIG = tiny_config()
PLAN = tiny_plan(CONFIG)
posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")
SMALL = ("--grid", "6x4", "--spacing", "10cm", "--exposure", "1ms")

#: A second is promised for most of it; a busy machine may take longer, for ever is what must not be.
PATIENCE_S = 20.0


def after(index, act):
    """Return a consumer that acts once, after a step."""

    def consume(event):
        if isinstance(event, StepDone) and event.step.index == index:
            act()

    return consume


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with served(tmp_path_factory.mktemp("served")) as running:
        yield running


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    return Attacked(tmp_path_factory.mktemp("exchanges"))


def wait_for(happened):
    deadline_s = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def scanning(bench, folder, *options, program=()):
    """Start a scan with the served devices; return it when its laser is lit."""
    lit_before = len(bench.values("laser emission"))
    arguments = ["scan", "--config", bench.config, "--yes", *options, "--out", folder / "a.h5"]
    command = [sys.executable, "-c", *program, *map(str, arguments)] if program else rig_command(*arguments)
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_for(lambda: bench.values("laser emission")[lit_before:] == ["1"])
    return running


def dark(bench):
    return bench.values("laser emission")[-1] == "0"


LONG = ("--grid", "50x40", "--spacing", "3cm", "--exposure", "20ms")


def test_f01_a_laser_that_cannot_be_made_dark_is_not_given_back_to_its_knob(tmp_path):
    config = tiny_config({"laser": {"kind": "katana", "power_setpoint": 1.0}})
    with attacked_rig(config) as rig:
        rig.laser.turn_knob(10.0)

        def stick():
            rig.laser.emission_stuck = True

        end = scan(rig, config, PLAN, tmp_path / "a.h5", [after(3, stick)])
        assert end.emitting
        assert rig.bench.light.power <= 0.1  # of full power, as it was or lower
    assert end.code == 3
    assert "EMITTING" in end.said
    assert "EMITTING" in log_of(tmp_path / "a.h5").read_text()


@posix
def test_f02_a_closed_terminal_puts_the_light_out(bench, tmp_path):
    with scanning(bench, tmp_path, *LONG) as running:
        running.send_signal(signal.SIGHUP)
        assert running.wait(PATIENCE_S) == 6
    assert dark(bench)
    assert bench.values("detector bias")[-1] == "0"


@posix
def test_f03_a_killed_program_leaves_no_light(bench, tmp_path):
    with scanning(bench, tmp_path, *LONG) as running:
        running.kill()
        running.wait(PATIENCE_S)
    wait_for(lambda: dark(bench))
    wait_for(lambda: bench.values("detector bias")[-1] == "0")


@posix
def test_f04_a_call_that_never_returns_ends_in_the_dark(bench, tmp_path):
    with scanning(bench, tmp_path, *LONG, program=(HANGING,)) as running:
        wait_for(lambda: dark(bench))
        assert running.wait(2 * PATIENCE_S) == 3
    assert bench.values("detector bias")[-1] == "0"


@posix
def test_f05_interrupts_in_a_row_do_not_keep_the_light_on(bench, attacked, tmp_path):
    with scanning(bench, tmp_path, *LONG) as running:
        for _ in range(10):
            running.send_signal(signal.SIGINT)
            time.sleep(0.005)
        assert running.wait(PATIENCE_S) == 6
    assert dark(bench)
    last = [number for number, (device, _) in enumerate(attacked.exchanges) if device == "laser"]
    for first in last[-40::13]:  # while the laser is made dark
        one = attacked.outcome(FAULTS["10 in a row"], first)
        assert not one.end.emitting, one
        assert not one.end.sensitive, one


@posix
def test_f06_long_exposures_are_cut_and_watched(bench, tmp_path):
    with scanning(bench, tmp_path, "--grid", "2x2", "--spacing", "10cm", "--exposure", "60s") as running:
        running.send_signal(signal.SIGINT)
        assert running.wait(PATIENCE_S) == 6
    assert dark(bench)
    with attacked_rig(CONFIG, real_time=True) as rig:
        threading.Timer(3.0, rig.laser.close_interlock, [False]).start()
        end = scan(rig, CONFIG, tiny_plan(CONFIG, exposure_s=60.0), tmp_path / "b.h5")
        assert rig.bench.clock.now_s() < PATIENCE_S
    assert end.code == 4
    assert "went dark without a command" in end.said


def test_f07_which_library_is_loaded_is_not_taken_from_a_file(rig, tmp_path):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    (tmp_path / "gift.so").write_bytes(b"")
    with h5py.File("a.h5", "r+") as file:
        configuration = json.loads(file["start"].attrs["configuration"])
        configuration["simulation"] = None
        for name in ("galvo", "laser", "detector", "delayer"):
            configuration[name]["address"] = "/dev/rig-none"
        configuration["tcspc"]["library"] = str(tmp_path / "gift.so")
        file["start"].attrs["configuration"] = json.dumps(configuration)
        del file["stop"]
        file["transients/done"][-3:] = 0
    done = rig("resume", "a.h5")
    assert done.code == 2
    assert "never taken from a scan file" in done.err


def counts_of(path):
    with ScanFile(path) as file:
        return np.asarray(file.counts(range(file.steps))), file.done.copy(), file.status


@posix
@pytest.mark.parametrize("blocks", some(40, 120, 80, short=2))
def test_f08_what_could_not_be_written_is_not_marked(rig, tmp_path, blocks):
    options = ("--grid", "20x10", "--spacing", "5cm")
    assert rig("scan", *options, "--out", "whole.h5").code == 0
    whole, _, _ = counts_of("whole.h5")
    limited = f"ulimit -f {blocks}; exec " + " ".join(rig_command("scan", *options, "--out", "a.h5"))
    ended = subprocess.run(["bash", "-c", limited], capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode in (2, 5), ended.stderr
    assert "Traceback" not in ended.stderr
    if not Path("a.h5").exists():
        return  # not even a beginning had room
    counts, done, _ = counts_of("a.h5")
    assert np.array_equal(counts[done], whole[done])
    assert rig("resume", "a.h5").code == 0
    counts, done, status = counts_of("a.h5")
    assert status == "complete"
    assert np.array_equal(counts, whole)


def test_f09_a_full_disk_keeps_what_was_saved(rig, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96m", "tmpfs", str(disk)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this user cannot mount a small disk")
    try:
        started = rig_command("scan", "--grid", "100x40", "--spacing", "1cm", "--out", disk / "a.h5")
        with subprocess.Popen(started, stderr=subprocess.PIPE, text=True) as running:
            next(line for line in running.stderr if "exposing" in line)
            fill(disk / "hog")
            said = running.stderr.read()
        assert running.returncode in (2, 4, 5), said
        assert "Traceback" not in said
        (disk / "hog").unlink()
        with ScanFile(disk / "a.h5") as file:
            done = file.done
        told = re.search(r"([\d,]+) of [\d,]+ positions are safe", said)
        assert told is None or int(told[1].replace(",", "")) <= done.sum()
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def fill(path):
    """Write until the disk is full."""
    with path.open("wb", 0) as file, suppress(OSError):
        while file.write(bytes(1 << 16)):
            pass


def test_f10_a_rig_that_changes_ends_the_scan(tmp_path):
    with attacked_rig(CONFIG) as rig:
        end = scan(rig, CONFIG, PLAN, tmp_path / "a.h5", [after(5, lambda: rig.laser.receive(b"lp=3\n"))])
    assert end.code == 4
    assert "power_setpoint is 3.0, was" in end.said
    assert kept(tmp_path / "a.h5").done.sum() == 4  # the lines before


def test_f11_warnings_keep_their_positions_over_a_resumption(rig, tmp_path):
    with attacked_rig(CONFIG) as attacked:
        instrument = attacked.harp.instrument
        flags = instrument.flags

        def flag():
            instrument.flags = lambda: flags() | 4

        end = scan(
            attacked,
            CONFIG,
            PLAN,
            tmp_path / "a.h5",
            [after(1, flag), after(9, lambda: attacked.unplug("galvo"))],
        )
    assert end.code == 3
    assert rig("resume", "a.h5").code == 0
    with ScanFile(tmp_path / "a.h5") as file:
        (note,) = [one for one in file.events if "sync was lost" in one.sentence]
        assert (note.first, note.last) == (2, 9)
        assert file.status == "complete"


def test_f12_darkness_between_two_looks_is_noticed(tmp_path):
    with attacked_rig(CONFIG) as rig:
        off, on = (
            after(at, lambda to=to: rig.bench.change_light(emitting=to)) for at, to in ((4, False), (6, True))
        )
        end = scan(rig, CONFIG, PLAN, tmp_path / "a.h5", [off, on])
    file = kept(tmp_path / "a.h5")
    assert end.code == 4 or any("sync was lost" in one for one in file.warnings)


def test_f13_a_garbled_command_does_not_leave_the_gate_open(attacked):
    at = enumerate(attacked.exchanges)
    writes = [number for number, seen in at if seen in (("spad", "write"), ("delayer", "write"))]
    for first in writes[-6:]:
        assert not attacked.outcome(Fault("flip"), first).end.sensitive


def test_f14_too_much_light_closes_the_detector_and_bias_left_on_is_said(tmp_path):
    with attacked_rig(CONFIG) as rig:
        plan = tiny_plan(CONFIG, columns=10, rows=10)
        shine = after(2, lambda: rig.bench.change_light(lamp_hz=1e9))
        end = scan(rig, CONFIG, plan, tmp_path / "a.h5", [shine])
    assert (end.code, end.sensitive) == (4, False)
    assert "IT CANNOT SWITCH OFF THE BIAS: SWITCH IT OFF BY HAND, NOW" in end.said
    with attacked_rig(CONFIG) as rig:
        end = scan(rig, CONFIG, PLAN, tmp_path / "b.h5", [after(2, lambda: rig.unplug("spad"))])
    assert not end.sensitive  # the delayer no longer opens its gate
    assert "BIASED" in end.said
    assert "by hand" in end.said
    assert "BIASED" in log_of(tmp_path / "b.h5").read_text()
    assert any("BIASED" in one for one in kept(tmp_path / "b.h5").warnings)


def test_f15_a_scan_that_failed_after_its_last_position_is_given_an_end(rig, tmp_path):
    with attacked_rig(CONFIG) as attacked:
        end = scan(
            attacked,
            CONFIG,
            PLAN,
            tmp_path / "a.h5",
            [after(len(PLAN) - 1, lambda: attacked.unplug("galvo"))],
        )
    assert end.code == 3
    before, _, _ = counts_of("a.h5")
    assert rig("resume", "a.h5").code == 0
    counts, done, status = counts_of("a.h5")
    assert status == "complete"
    assert done.all()
    assert np.array_equal(counts[:8], before[:8])


@pytest.mark.parametrize("cut", [0.3, 0.6, 0.9])
def test_f16_damaged_files_are_refused_in_time(rig, cut):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    whole = bytearray(Path("a.h5").read_bytes())
    begin = int(len(whole) * cut)
    whole[begin : begin + 400] = bytes(255 - one for one in whole[begin : begin + 400])
    Path("b.h5").write_bytes(whole)
    began_s = time.monotonic()
    for verb in ("stats", "resume", "plot"):
        done = rig(verb, "b.h5")
        assert done.code in (0, 2, 5), done.err  # what was damaged may be beside what a verb reads
        assert "Traceback" not in done.err
    assert time.monotonic() - began_s < 60


def test_f17_other_files_are_not_read_through_a_scan_file(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    with h5py.File("a.h5", "r+") as file:
        shape = file["geometry/laser_m"].shape
        del file["geometry/laser_m"]
        file.create_dataset("geometry/laser_m", shape, "f8", external=[("secret.bin", 0, 10**6)])
    Path("secret.bin").write_bytes(bytes(10**6))
    for arguments in (("stats", "a.h5"), ("import", "a.h5", "b.h5")):
        done = rig(*arguments)
        assert done.code in (2, 5), done
        assert "Traceback" not in done.err
    assert not Path("b.h5").exists()


def test_f18_a_small_file_does_not_claim_gigabytes(rig):
    assert rig("scan", *SMALL, "--out", "a.h5").code == 0
    with h5py.File("a.h5", "r+") as file:
        attributes = dict(file["transients/counts"].attrs)
        steps = file["transients/counts"].shape[0]
        del file["transients/counts"]
        file.create_dataset(
            "transients/counts", (steps, 1, 2**26), "u4", chunks=(1, 1, 2**20), compression="gzip"
        ).attrs.update(attributes)
    for verb in ("stats", "plot"):
        done = rig(verb, "a.h5")
        assert done.code == 5, done
        assert "Traceback" not in done.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("--exposure", "10dB"),
        ("--exposure", "1e400s"),
        ("--grid", "9" * 5000 + "x2"),
        ("--grid", "99999999999x2"),
    ],
)
def test_f19_odd_options_are_refused_in_words(rig, arguments):
    done = rig("scan", "--dry-run", *arguments)
    assert done.code in (2, 4)
    assert "Traceback" not in done.err
    assert "rig:" in done.err
