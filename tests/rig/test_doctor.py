"""What ``rig doctor`` says of the detector's bus, with the simulated instruments on it."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.acquire.doctor import examine
from rig.model.config import RigConfig
from simulators.bench import Bench
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend
from support import nidaqmx_stand_in


class Oscilloscope(SpadInstrument):
    vendor_id, product_id, product = 0x0957, 0x1234, "DSO-1"


@pytest.mark.parametrize(
    ("instruments", "verdict", "words"),
    [
        ([SpadInstrument], "ok", "bus"),
        ([Oscilloscope], "warning", "0957:1234"),
        ([Oscilloscope, SpadInstrument], "ok", "bus"),
        ([SpadInstrument, SpadInstrument], "missing", "2 fit among"),
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
    (finding,) = [one for one in examine(config, Path()) if one.what.startswith("detector")]
    assert finding.verdict == verdict
    assert words in finding.found
    assert (finding.remedy == "") == (verdict == "ok")


def test_ports_of_detector_and_delayer_are_looked_for():
    ports = {"galvo": "sim://a", "laser": "sim://b", "detector": "/dev/nowhere", "delayer": "sim://d"}
    config = RigConfig.model_validate({name: {"address": address} for name, address in ports.items()})
    found = {one.what: one for one in examine(config, Path()) if one.what.startswith(("detector", "delayer"))}
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
    return [one for one in examine(config, Path()) if one.what.startswith("DAQ board")]


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
    assert "pip install 'nlos-rig[nidaqmx]'" in board.remedy
