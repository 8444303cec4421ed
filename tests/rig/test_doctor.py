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
    config = RigConfig.model_validate({"galvo": {"address": "sim://a"}, "laser": {"address": "sim://b"}})
    (finding,) = [one for one in examine(config, Path()) if one.what.startswith("detector")]
    assert finding.verdict == verdict
    assert words in finding.found
    assert (finding.remedy == "") == (verdict == "ok")
