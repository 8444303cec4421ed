"""The detector's driver with the simulated instrument on the simulated bus."""

import errno
import sys

import pytest
import usb.backend.libusb0
import usb.backend.libusb1
import usb.backend.openusb
from usb.core import USBError

from drivers.errors import DeviceNotFoundError, LimitError, LinkError, RefusedError
from drivers.id120 import Id120Spad
from simulators.clock import BenchClock
from simulators.wire.spad import SpadInstrument
from simulators.wire.usb import UsbBackend


def test_connecting_sets_the_dead_time_and_leaves_no_bias(rig):
    rig.instrument.receive(b"REG:RUN TRUE\n")
    with rig.spad(hold_off_s=160e-9):
        light = rig.bench.light
        assert (light.biased, light.gated) == (False, False)
        assert light.hold_off_s == pytest.approx(160e-9, rel=1e-12)


def test_enabled_disabled_and_left(rig):
    with rig.spad() as spad:
        spad.enable()
        assert rig.bench.light.biased
        assert spad.settings()["running"] is True
        spad.disable()
        assert not rig.bench.light.biased
        spad.disable()
        spad.enable()
    assert not rig.bench.light.biased
    spad.disable()


def test_it_runs_freely_and_has_no_gate(rig):
    with rig.spad() as spad:
        spad.enable()
        assert (rig.bench.light.biased, rig.bench.light.gated) == (True, False)
        assert spad.settings()["gated"] is False
        with pytest.raises(LimitError, match=r"open a gate, but it is free-running.*Nothing was sent"):
            spad.set_gate(30e-9, 40e-9)


def test_its_state_is_asked_so_that_a_change_is_noticed(rig):
    with rig.spad() as spad:
        assert (spad.settings()["state"], spad.settings()["bias_error"]) == ("OFF", False)
        spad.enable()
        assert spad.settings()["state"] == "RUNNING"
        rig.bench.change_light(biased=False)
        assert spad.settings()["state"] == "OFF"


def test_no_bias_is_left_after_an_exception(rig):
    def work():
        with rig.spad() as spad:
            spad.enable()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert not rig.bench.light.biased


@pytest.mark.parametrize("wrong_s", [39e-9, 1.1e-3, -1e-9, float("nan"), float("inf")])
def test_the_instruments_own_limits_are_kept_before_anything_is_set(rig, wrong_s):
    with pytest.raises(LimitError, match=r"range is 4e-08 to 0\.001 s"), rig.spad(hold_off_s=wrong_s):
        pytest.fail("accepted")
    assert rig.bench.light.hold_off_s == 40e-9


def test_a_bias_error_is_refused_and_the_bias_removed(rig):
    with rig.spad() as spad:
        rig.instrument.bias_error = True
        with pytest.raises(RefusedError, match="bias error"):
            spad.enable()
        assert spad.settings()["running"] is False


def test_a_limit_itself_is_taken(rig):
    with rig.spad() as spad:
        spad.set_hold_off(40e-9)
        assert rig.bench.light.hold_off_s == pytest.approx(40e-9)
        spad.set_hold_off(100e-9)  # between two steps
        assert spad.settings()["hold_off_s"] == pytest.approx(80e-9)


def test_a_lost_answer_is_told_and_the_next_question_works(rig):
    with rig.spad(timeout_s=2.0) as spad:
        rig.instrument.drop_answers = 1
        before_s = rig.bench.clock.now_s()
        with pytest.raises(LinkError, match=r"'DEADTIME:CAPABILITY\?', but no answer came in 2 s"):
            spad.set_hold_off(120e-9)
        assert rig.bench.clock.now_s() - before_s >= 2.0
        spad.set_hold_off(120e-9)


def test_unplugged_in_the_middle(rig):
    def work():
        with rig.spad() as spad:
            spad.enable()
            rig.unplug_all()
            spad.settings()

    with pytest.raises(LinkError, match="unplugged") as raised:
        work()
    assert any("Treat the detector as BIASED" in note for note in raised.value.__notes__)


def test_of_two_detectors_the_serial_number_says_which(rig):
    second = SpadInstrument(rig.bench, serial_number="SIM0002")
    bus = UsbBackend([rig.instrument, second])
    with Id120Spad(backend=bus, clock=rig.bench.clock, serial="SIM0002") as spad:
        assert spad.settings()["serial_number"] == "SIM0002"
    seen = r"1ddc:0330 \(serial SIM0001\), 1ddc:0330 \(serial SIM0002\)"
    with pytest.raises(DeviceNotFoundError, match=f"2 match among {seen}.*serial number"):
        Id120Spad(backend=bus, clock=rig.bench.clock).__enter__()
    with pytest.raises(DeviceNotFoundError, match=f"SIM0003, but none matches among {seen}"):
        Id120Spad(backend=bus, clock=rig.bench.clock, serial="SIM0003").__enter__()


def test_nothing_on_the_bus():
    with pytest.raises(DeviceNotFoundError, match="none matches among no devices"):
        Id120Spad(backend=UsbBackend([]), clock=BenchClock()).__enter__()


def test_an_oscilloscope_on_the_bus_is_asked_its_name_and_nothing_else(rig):
    class Oscilloscope(SpadInstrument):
        vendor_id, product_id, product = 0x0957, 0x1234, "DSO-1"

        def receive(self, data):
            self.heard = [*getattr(self, "heard", []), data]
            super().receive(data)

    scope = Oscilloscope(rig.bench)
    with pytest.raises(DeviceNotFoundError, match="be 'ID120', but its identity is 'ID Quantique,DSO-1"):
        Id120Spad(backend=UsbBackend([scope]), clock=rig.bench.clock).__enter__()
    assert scope.heard == [b"*IDN?\n"]


def test_without_libusb_the_extra_is_named(monkeypatch):
    for module in (usb.backend.libusb0, usb.backend.libusb1, usb.backend.openusb):
        monkeypatch.setattr(module, "get_backend", lambda *_, **__: None)
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    with pytest.raises(DeviceNotFoundError, match=r"libusb is missing.*pip install libusb-package"):
        Id120Spad(clock=BenchClock()).__enter__()


@pytest.mark.parametrize(
    ("code", "words"),
    [(errno.EACCES, "udev"), (errno.EBUSY, "another program"), (errno.EIO, "connection broke")],
)
@pytest.mark.parametrize("serial", [None, "SIM0001"])
def test_a_bus_that_refuses_is_explained(rig, code, words, serial):
    class Refusing(UsbBackend):
        """A bus that opens nothing where rights are missing, and else lets nobody claim an instrument."""

        def open_device(self, dev):
            return self._refuse() if code == errno.EACCES else super().open_device(dev)

        def claim_interface(self, dev_handle, intf):
            self._refuse()

        def _refuse(self):
            raise USBError("refused", -1, code)

    with pytest.raises(LinkError, match=words):
        Id120Spad(backend=Refusing([rig.instrument]), clock=rig.bench.clock, serial=serial).__enter__()
