"""The simulated devices in a process of their own, scanned from another."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Timer

import h5py
import numpy as np
import pytest
import serial

from rig.acquire.connect import open_devices
from rig.commands.documents import Served
from rig.files.scan import ScanFile
from rig.light.state import forget_trip
from rig.model.config import load
from support.served_bench import rig_command, scan_served, served

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

#: 12 positions of 10 ms, each of some 2 000 photons.
GRID = ("--grid", "4x3", "--spacing", "40cm", "--exposure", "10ms")

#: Long enough to be in the middle of.
MANY = ("--grid", "40x40", "--spacing", "2cm", "--yes")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    with served(tmp_path_factory.mktemp("served")) as running:
        yield running


def scan(rig, bench, name):
    return json.loads(scan_served(rig, bench, Path(name), *GRID, "--json").out)


def counts(path):
    """Return (positions, bins) counts."""
    with h5py.File(path) as file:
        return file["transients/counts"][()].sum(axis=1, dtype=float)


def test_addresses_and_configuration_are_told(bench):
    Served.model_validate(bench.told)
    assert bench.told["pid"] == bench.process.pid
    assert all(Path(bench.told[name]).exists() for name in ("galvo", "laser", "detector", "timing"))
    config = load(bench.config)
    assert config.galvo.address == bench.told["galvo"]
    assert config.laser.address == bench.told["laser"]
    assert not config.simulated  # what guards a real laser guards this one
    assert config.rehearsed


def test_a_scan_is_told_in_the_log(rig, bench, tmp_path):
    before = len(bench.changes())
    scan(rig, bench, "a.h5")
    with ScanFile(tmp_path / "a.h5") as file:
        assert file.simulated
        assert file.status == "complete"
    assert all(
        re.fullmatch(r"\d+\.\d{3} \w+ \w+ [-\d. ]+", line) for line in bench.log.read_text().splitlines()
    )
    changes = bench.changes()[before:]
    assert [at for at, _, _ in changes] == sorted(at for at, _, _ in changes)
    switched = [(what, value) for _, what, value in changes if what != "galvo mirror"]
    assert switched == [
        ("detector bias", "1"),
        ("laser power", "10.00"),
        ("laser emission", "1"),
        ("laser emission", "0"),
        ("detector bias", "0"),
        ("laser power", "0.00"),
    ]
    lit = [what for _, what, _ in changes]
    lit = lit[lit.index("laser emission") : len(lit) - lit[::-1].index("laser emission")]
    assert lit.count("galvo mirror") == 11  # the first position is aimed at in the dark


def test_photons_are_those_of_the_rig_in_one_process(rig, bench, tmp_path):
    scan(rig, bench, "first.h5")
    scan(rig, bench, "second.h5")
    assert rig("scan", *GRID, "--seed", "1", "--out", "here.h5").code == 0
    first, second, here = (counts(tmp_path / f"{name}.h5") for name in ("first", "second", "here"))
    assert (first != second).any()  # each visit draws anew
    for served_counts in (first, second):
        for mine, theirs in zip(sums(served_counts), sums(here), strict=True):
            # independent counts differ by the root of their sum; afterpulses (2 %) widen it by less than 10 %
            assert np.all(np.abs(mine - theirs) <= 5 * 1.1 * np.sqrt(mine + theirs + 1))


def sums(histograms):
    """Return the counts of all, of each position, and of each 2 ns."""
    return histograms.sum(), histograms.sum(1), np.add.reduceat(histograms.sum(0), np.arange(0, 15_000, 500))


def test_a_mirror_that_never_stops_is_scanned_too(rig, tmp_path):
    """An analogue galvo and the point clock, both on the served board: markers and voltages go together."""
    analogue = tmp_path / "analogue.toml"
    analogue.write_text('[galvo]\nkind = "analogue"\n[point_clock]\n[simulation]\nscene = "empty"\n')
    sweep = ("--mode", "continuous", "--grid", "12x5", "--spacing", "2cm", "--exposure", "5ms")
    with served(tmp_path, "--config", analogue) as bench:
        config = load(bench.config)
        assert config.point_clock.address == config.galvo.address == bench.told["timing"]
        done = rig("scan", "--config", bench.config, *sweep, "--out", "swept.h5", "--json", "--yes")
        assert done.code == 0, done.err
    with ScanFile(tmp_path / "swept.h5") as scan:
        assert scan.done.all()
        assert scan.devices["galvo"]["identity"].startswith("analogue galvo")
        assert scan.devices["point_clock"]["identity"].startswith("NI PCIe-6343 simulated")


def test_light_that_another_program_switches_off_is_missing_in_the_counts(bench):
    exposure_s = 0.6
    times = {}

    def darken():
        times["asked"] = time.monotonic()
        with serial.Serial(bench.told["laser"], timeout=5) as port:
            port.write(b"leg=0\nltg_freq?\n")
            assert port.readline()
        times["dark"] = time.monotonic()

    with open_devices(load(bench.config)) as devices:
        devices.galvo.point(0.1, 0.1)
        devices.laser.arm()
        devices.laser.emit()
        devices.spad.enable()
        whole = devices.tcspc.measure(exposure_s).photons
        timer = Timer(exposure_s / 3, darken)
        began_s = time.monotonic()
        timer.start()
        part = devices.tcspc.measure(exposure_s).photons
        ended_s = time.monotonic()
        timer.join()
    # the exposure began after began_s, and not later than its duration before its end
    least = (times["asked"] - (ended_s - exposure_s)) / exposure_s
    most = (times["dark"] - began_s) / exposure_s
    sigma = 1.1 * np.sqrt(2 * whole)
    assert whole > 10_000
    background = 510 * exposure_s  # dark counts and ambient light while ungated, at most
    assert least * whole - 5 * sigma < part < most * whole + background + 5 * sigma


def when_free(address):
    """Open a port as soon as no other process has it, as a guard that makes the laser dark."""
    for _ in range(300):
        try:
            return serial.Serial(address, timeout=5, exclusive=True)
        except serial.SerialException:
            time.sleep(0.1)
    raise AssertionError(f"{address} is still used")


def test_after_a_killed_client_the_next_can_connect(rig, bench):
    lit = len(bench.values("laser emission"))
    command = rig_command(
        "scan", "--config", bench.config, "--grid", "40x40", "--spacing", "2cm", "--yes", "--out"
    )
    with subprocess.Popen([*command, bench.log.parent / "killed.h5"], stderr=subprocess.PIPE) as client:
        wait_for(lambda: len(bench.values("laser emission")) > lit)
        client.kill()
    assert bench.process.poll() is None
    wait_for(lambda: bench.values("laser emission")[-1] == "0")  # by the guard that outlived its program
    for device, question in (("laser", b"leg?\n"), ("galvo", b"GETID\r\n")):
        with when_free(bench.told[device]) as port:
            port.write(question)
            assert port.readline()
    scans = [rig("scan", "--config", bench.config, *GRID, "--yes", "--out", f"after{n}.h5") for n in range(2)]
    assert scans[-1].code == 0, [one.err for one in scans]
    assert bench.values("laser emission")[-1] == "0"


def test_an_interrupted_scan_is_resumed(rig, bench, tmp_path):
    lit = len(bench.values("laser emission"))
    command = rig_command("scan", "--config", bench.config, "--grid", "8x6", "--spacing", "20cm", "--yes")
    with subprocess.Popen([*command, "--out", "a.h5"], cwd=tmp_path, stderr=subprocess.PIPE) as client:
        wait_for(lambda: len(bench.values("laser emission")) > lit)
        client.send_signal(signal.SIGINT)
        client.communicate(timeout=60)
    assert client.returncode == 6
    assert rig("resume", "a.h5").code == 2  # which devices are opened is not taken from a file
    resumed = rig("resume", "a.h5", "--config", bench.config, "--yes")
    assert resumed.code == 0, resumed.err


def test_garbage_on_every_wire_is_survived(rig, bench):
    noise = np.random.default_rng(0).integers(0, 256, 5000, dtype=np.uint8).tobytes()
    for device in ("galvo", "laser", "detector"):
        with serial.Serial(bench.told[device], write_timeout=5) as port:
            port.write(noise + b"\r\n")
    with pytest.raises(OSError):  # noqa: PT011 - closed by either side, before or after the last byte
        talk(bench.told["timing"], b"x" * 2_000_000)
    assert b"error" in talk(bench.told["timing"], b"nonsense\n")
    scan(rig, bench, "a.h5")


@pytest.mark.skipif(sys.platform != "linux", reason="processor time is read from /proc")
def test_an_idle_server_sleeps(bench):
    def used_s():
        fields = Path(f"/proc/{bench.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    before_s = used_s()
    time.sleep(1.5)
    assert used_s() - before_s <= 0.02 * 1.5


def test_a_server_that_goes_away_ends_a_scan_in_words(rig, tmp_path):
    with served(tmp_path) as bench:
        command = rig_command(
            "scan", "--config", bench.config, "--grid", "40x40", "--spacing", "2cm", "--yes"
        )
        with subprocess.Popen([*command, "--out", "a.h5"], cwd=tmp_path, stderr=subprocess.PIPE) as client:
            wait_for(lambda: len(bench.values("galvo mirror")) > 60)  # a line of 40 was vouched for
            bench.process.send_signal(signal.SIGTERM)
            _, said = client.communicate(timeout=60)
        assert bench.process.wait(20) == 0
        assert client.returncode in (3, 4)  # whichever is noticed first: a device, or the light
        assert b"Traceback" not in said
        assert not Path(bench.told["timing"]).parent.exists()
        tripped = rig("scan", "--config", bench.config, *GRID, "--yes", "--out", "b.h5")
        assert tripped.code == 4  # its laser could not be made dark any more
        assert "rig laser acknowledge" in tripped.err
        forget_trip(load(bench.config))
        gone = rig("scan", "--config", bench.config, *GRID, "--yes", "--out", "b.h5")
        assert gone.code == 3
        assert "rig sim serve" in gone.err
        with h5py.File(tmp_path / "a.h5") as file:
            assert file["stop"].attrs["status"] == "failed"
            assert file["transients/done"][()].any()


def test_a_real_rig_is_not_served(rig):
    Path("lab.toml").write_text(
        '[galvo]\naddress = "/dev/ttyACM0"\n[laser]\naddress = "/dev/ttyUSB0"\n[detector]\naddress = "c"\n'
    )
    refused = rig("sim", "serve", "--config", "lab.toml")
    assert refused.code == 2
    assert "real devices" in refused.err


def test_what_a_person_wrote_is_not_written_over(rig):
    Path("lab.toml").write_text("[simulation]\n")
    refused = rig("sim", "serve", "--write-config", "lab.toml")
    assert refused.code == 2
    assert Path("lab.toml").read_text() == "[simulation]\n"
    os.mkfifo("pipe.toml")
    for other in (".", "pipe.toml", "/dev/zero"):
        assert rig("sim", "serve", "--write-config", other).code == 2


def test_a_log_that_cannot_be_written_is_refused(rig):
    refused = rig("sim", "serve", "--log", "missing/changes.log")
    assert refused.code == 2
    assert "missing/changes.log" in refused.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_under_the_log_is_told_in_words(tmp_path):
    (tmp_path / "changes.log").symlink_to("/dev/full")
    with served(tmp_path) as bench:
        with serial.Serial(bench.told["galvo"], timeout=5) as port:
            port.write(b"X=0.1\r\n")
        assert bench.process.wait(20) == 2
    said = (tmp_path / "server.txt").read_text()
    assert "No space left" in said
    assert "Traceback" not in said


def wait_for(happened):
    deadline_s = time.monotonic() + 60  # a busy machine starts a program slowly
    while not happened():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def talk(path, data):
    import socket

    with socket.socket(socket.AF_UNIX) as there:
        there.settimeout(10)
        there.connect(path)
        there.sendall(data)
        if not (answer := there.recv(4096)):
            raise ConnectionResetError
        return answer
