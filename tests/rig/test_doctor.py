"""What ``rig doctor`` finds: of devices, calibrations, rights and disks, and what it says in all."""

import io
import json
import os
import re
import sys
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.model.calibrations.kinds import DarkRates
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import RigConfig, built_in_with
from rig.model.written import as_toml
from rig.setup.doctor import calibrations, devices, disk, examination, extras, permissions, terminal
from simulators.bench import Bench
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend
from support import nidaqmx_stand_in

posix = pytest.mark.skipif(os.name != "posix", reason="users and groups are POSIX")


class Oscilloscope(SpadInstrument):
    vendor_id, product_id, product = 0x0957, 0x1234, "DSO-1"


@pytest.mark.parametrize(
    ("instruments", "verdict", "words"),
    [
        ([SpadInstrument], "ok", "bus"),
        ([Oscilloscope], "warning", "0957:1234"),
        ([Oscilloscope, SpadInstrument], "ok", "bus"),
        ([SpadInstrument, SpadInstrument], "missing", "2 match among"),
        ([], "missing", "no devices"),
    ],
)
def test_the_detector_is_looked_for_as_a_scan_would(monkeypatch, instruments, verdict, words):
    """Also by the libusb that the extra brings, where the system has none."""
    bus = UsbBackend([kind(Bench()) for kind in instruments])
    extra = SimpleNamespace(get_libusb1_backend=lambda: bus)
    monkeypatch.setitem(sys.modules, "libusb_package", extra)
    config = RigConfig.model_validate(
        {"galvo": {"address": "sim://a"}, "laser": {"address": "sim://b"}, "detector": {"kind": "id120"}}
    )
    (finding,) = [one for one in devices.check(config) if one.what.startswith("detector")]
    assert finding.verdict == verdict
    assert words in finding.found
    assert (finding.remedy == "") == (verdict == "ok")


def test_ports_of_detector_and_delayer_are_looked_for():
    ports = {"galvo": "sim://a", "laser": "sim://b", "detector": "/dev/nowhere", "delayer": "sim://d"}
    config = RigConfig.model_validate({name: {"address": address} for name, address in ports.items()})
    found = {one.what: one for one in devices.check(config) if one.what.startswith(("detector", "delayer"))}
    assert list(found) == ["detector at /dev/nowhere", "delayer at sim://d"]
    assert found["detector at /dev/nowhere"].verdict == "missing"


def boards(galvo: dict, clock: str) -> list:
    config = RigConfig.model_validate(
        {
            "galvo": galvo,
            "laser": {"address": "sim://b"},
            "detector": {"kind": "id120"},
            "point_clock": {"device": clock},
        }
    )
    return [one for one in devices.check(config) if one.what.startswith("DAQ board")]


def test_the_board_of_galvo_and_point_clock_is_named():
    with nidaqmx_stand_in.installed():
        (both,) = boards({"kind": "analogue"}, "Dev1")
        (clock,) = boards({"address": "sim://a"}, "Dev1")
        (other,) = boards({"address": "sim://a"}, "Dev9")
    assert (both.what, both.verdict) == ("DAQ board Dev1", "ok")
    assert both.found == "NI PCIe-6343, serial number 01A2B3C4 (simulated by NI-DAQmx)"
    assert clock.what == "DAQ board Dev1"
    assert (other.what, other.verdict) == ("DAQ board Dev9", "missing")
    assert "-200220" in other.found


def test_a_board_without_its_driver_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    (board,) = boards({"address": "sim://a"}, "Dev1")
    assert board.verdict == "missing"
    assert "pip install nidaqmx" in board.remedy


REAL = {
    "name": "lab",
    "galvo": {"address": "/dev/rig-none"},
    "laser": {"address": "sim://b"},
    "detector": {"kind": "id120"},
    "tcspc": {"kind": "playback", "file": "a.h5"},
}


def real(**sections) -> RigConfig:
    return RigConfig.model_validate({**REAL, **sections})


def test_the_simulated_rig_needs_nothing(rig):
    done = rig("doctor")
    assert done.code == 0, done.out
    assert done.out.splitlines()[0].startswith("Simulated rig: nothing is missing")
    assert "Traceback" not in done.err
    absent = rig("doctor", "--out", "none")
    assert absent.code == 2
    assert "none is not a folder" in absent.err


def test_a_real_rig_is_named_with_how_much_is_missing(rig):
    text = as_toml(real(cameras={"addresses": ["/dev/rig-none-camera", "rtsp://10.0.0.1/"]}))
    Path("lab.toml").write_text(text)
    done = rig("doctor", "--config", "lab.toml", "--json")
    assert done.code == 3
    said = json.loads(done.out)
    assert said["schema_version"] == 1
    assert re.match(f"Real rig lab: {said['missing']} things are missing(, .* warnings?)?$", said["headline"])
    missing = {one["what"]: one for one in said["findings"] if one["verdict"] == "missing"}
    assert {"galvo at /dev/rig-none", "camera /dev/rig-none-camera"} <= missing.keys()
    assert all(one["remedy"] for one in missing.values())
    (guard,) = [one for one in said["findings"] if one["check"] == "light"]
    assert (guard["what"], guard["verdict"]) == ("guard", "ok")


DARK = DarkRates(
    created=datetime(2026, 1, 1, tzinfo=UTC), valid_days=30, rig_name="lab", measured_from={},
    devices={"detector": "ID120, number 77"}, simulated=True,
    dark_hz=10, dark_error_hz=1, ambient_hz=100, ambient_error_hz=3, afterpulse_probability=0.01,
    afterpulse_probability_error=0.001, afterpulse_decay_s=None, afterpulse_decay_error_s=None,
    chi2_per_bin=1, hold_off_s=[], after_hold_off=[], after_hold_off_error=[],
)  # fmt: skip


def test_calibrations_are_looked_through(tmp_path):
    CalibrationStore(tmp_path).add(DARK)
    tcspc = {"kind": "hydraharp"}

    def found(serial: str, **sections):
        detector = {"kind": "id120", "serial": serial}
        return list(
            calibrations.check(real(calibration={"folder": str(tmp_path)}, detector=detector, **sections))
        )

    old, absent = found("77")  # counts that are played are taken for those of a simulated rig
    assert (old.what, old.verdict) == ("calibration dark", "warning")
    assert "measure it again with rig calibrate dark" in old.found
    assert absent.verdict == "ok"
    assert "never measured: galvo, " in absent.found
    assert "of another device (ID120, number 77): it is not used" in found("88")[0].found
    simulated, absent = found("77", tcspc=tcspc)
    assert "of the simulated rig: it is not used" in simulated.found
    assert (absent.verdict, absent.remedy) == ("warning", "rig calibrate all --config FILE")
    next(tmp_path.glob("dark-*.json")).write_text("{}")
    assert found("77")[0].verdict == "missing"


@posix
def test_a_port_that_this_user_may_not_use_is_a_matter_of_a_group(tmp_path):
    port = tmp_path / "port"
    port.touch(mode=0)
    if os.access(port, os.R_OK):
        pytest.skip("this user may read everything")
    (finding,) = [
        one for one in permissions.check(real(galvo={"address": str(port)})) if str(port) in one.what
    ]
    assert finding.verdict == "missing"
    assert finding.remedy.startswith(f"sudo usermod -aG {port.group()} $USER")


def test_a_rule_for_udev_can_be_pasted():
    assert permissions.rule(0x1DDC) == (
        """echo 'SUBSYSTEM=="usb", ATTR{idVendor}=="1ddc", MODE="0666"' | sudo tee -a """
        "/etc/udev/rules.d/60-nlos-rig.rules && sudo udevadm control --reload && sudo udevadm trigger"
    )


def test_the_disk_is_measured_and_left_as_it_was(tmp_path):
    room, speed = disk.check(tmp_path)
    assert "GB free" in room.found
    assert re.search(r"\d+ MB/s, \d+ ms for a line", speed.found)
    assert not list(tmp_path.iterdir())


def test_an_extra_is_missing_only_where_the_rig_needs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)

    def mesh(scene: str):
        found = extras.check(built_in_with({"simulation": {"scene": scene}}))
        return next(one for one in found if one.what == "trimesh")

    assert mesh("letters").verdict == "optional"
    assert mesh("a/room.OBJ").verdict == "missing"
    assert mesh("a/room.OBJ").remedy.endswith("-m pip install 'trimesh>=4'")


def test_a_terminal_without_all_signs_is_named(monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding="latin-1"))
    (finding,) = terminal.check()
    assert (finding.verdict, finding.remedy) == ("warning", "export PYTHONUTF8=1 LANG=C.UTF-8")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps a folder where somebody is")
def test_a_working_folder_that_is_gone_is_a_finding(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    found = examination.examine(built_in_with({}), Path("."))
    (disk_found,) = found.findings["disk"]
    assert disk_found.verdict == "missing"
    assert disk_found.found == "cannot be looked at: No such file or directory"
    assert found.findings["software"]
