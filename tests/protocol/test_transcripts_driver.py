"""The drivers against what the manuals say, byte by byte, with no simulator in sight."""

from contextlib import contextmanager
from math import atan, radians

import pytest
import serial
from scripted import protocol_script
from scripted_usb import OUT, ScriptedUsb, framed
from wire_script import Script, Step, StepClock, read_transcript

from drivers.errors import (
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.galvo import MirrorStatus, OptotuneMirror
from drivers.laser import KatanaLaser
from drivers.spad import Id120Spad
from drivers.usb_finder import find_instrument
from drivers.usbtmc import UsbTmc

USB_WORDS = {"INTERFACE": "0001", "OUT": "0003", "IN": "0085"}


@pytest.fixture
def play(monkeypatch):
    """Play steps at an address and hold the driver to all of them."""
    monkeypatch.setattr(serial, "protocol_handler_packages", ["serial.urlhandler", "scripted"])

    @contextmanager
    def playing(steps):
        script = Script(list(steps))
        protocol_script.scripts["wire"] = script
        yield "script://wire"
        script.finish()

    return playing


def lines(*exchanges):
    """Steps from (sent, answered) pairs."""
    return [step for sent, answered in exchanges for step in (Step(">", sent), Step("<", answered))]


HANDSHAKE = lines((b"START\r\n", b"OK\r\n"), (b"GETID\r\n", b"MR-E-2\r\n"), (b"STATUS\r\n", b"00000000\r\n"))
PARK = lines((b"XY=0.000000000;0.000000000\r\n", b"OK\r\n"))


def test_mirror_session(play):
    clock = StepClock()
    with (
        play(read_transcript("galvo_session.txt")) as address,
        OptotuneMirror(address, clock=clock) as mirror,
    ):
        assert mirror.identity == "MR-E-2 simulated"
        mirror.point(radians(19.8), -radians(14.6))
        mirror.wait_settled(timeout_s=0.1)
        # Three looks at the status, one poll interval of 1 ms between them.
        assert clock.now_s() == pytest.approx(2e-3)


def test_mirror_leaves_pro_mode_and_acknowledges_past_errors(play):
    with (
        play(read_transcript("galvo_from_pro_mode.txt")) as address,
        OptotuneMirror(address, clock=StepClock()),
    ):
        pass


@pytest.mark.parametrize(
    ("answer", "error", "words"),
    [
        (b"OL\r\n", RefusedError, "lower limit"),
        (b"OU\r\n", RefusedError, "upper limit"),
        (b"ERROR\r\n", RefusedError, "ERROR"),
        (b"NO\r\n", ProtocolError, "'NO' came"),
        (b"\xffK\r\n", ProtocolError, "xff"),
        (b"", LinkError, "nothing came in 0.5 s"),
        (b"OK", LinkError, "only b'OK' came"),
    ],
)
def test_mirror_tells_what_an_answer_to_a_move_means(play, answer, error, words):
    move = lines((b"XY=0.100000000;0.000000000\r\n", answer))
    x = 0.1 * 1.1917535925942100  # tan(50 degrees)
    with (
        play(HANDSHAKE + move + PARK) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
    ):
        with pytest.raises(error, match=words) as raised:
            mirror.point(atan(x), 0.0)
        assert raised.value.device == "steering mirror at script://wire"
        assert "XY=0.1" in raised.value.asked


@pytest.mark.parametrize("status", [b"0000001g", b"", b"123456789", b"OK"])
def test_mirror_refuses_a_status_that_is_none(play, status):
    steps = HANDSHAKE + lines((b"STATUS\r\n", status + b"\r\n")) + PARK
    with (
        play(steps) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
        pytest.raises(ProtocolError, match="STATUS"),
    ):
        mirror.status()


def test_mirror_status_has_the_bits_of_the_manual(play):
    steps = HANDSHAKE + lines((b"STATUS\r\n", b"0x00000115\r\n")) + PARK
    with play(steps) as address, OptotuneMirror(address, clock=StepClock()) as mirror:
        assert mirror.status() == (
            MirrorStatus.HEAD_DISCONNECTED
            | MirrorStatus.MIRROR_TEMPERATURE
            | MirrorStatus.NOT_STABLE
            | MirrorStatus.WAS_DISCONNECTED
        )


@pytest.mark.parametrize("angles", [(0.37, 0.0), (0.0, -0.29), (float("nan"), 0.0), (0.0, float("inf"))])
def test_mirror_limits_refuse_before_anything_is_sent(play, angles):
    with (
        play(HANDSHAKE + PARK) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
        pytest.raises(LimitError, match="Nothing was sent"),
    ):
        mirror.point(*angles)


def test_mirror_refuses_what_is_outside_the_unit_circle(play):
    """Each axis is within its limit, but tan(40.2 degrees) * sqrt(2) = 1.195 > tan(50 degrees) = 1.192."""
    angle = radians(40.2)
    with (
        play(HANDSHAKE + PARK) as address,
        OptotuneMirror(address, clock=StepClock(), max_angle_rad=(0.8, 0.8)) as mirror,
        pytest.raises(LimitError, match="range"),
    ):
        mirror.point(angle, angle)


def test_laser_session(play):
    clock = StepClock()
    with (
        play(read_transcript("laser_session.txt")) as address,
        KatanaLaser(address, clock=clock, power_setpoint=7.5, repetition_hz=10e6) as laser,
    ):
        laser.arm()
        laser.emit()


def test_laser_with_its_key_off(play):
    with (
        play(read_transcript("laser_key_off.txt")) as address,
        KatanaLaser(address, clock=StepClock(), power_setpoint=7.5, repetition_hz=10e6) as laser,
    ):
        laser.arm()
        with pytest.raises(RefusedError, match=r"Error 100.*key switch on"):
            laser.emit()


def test_laser_of_the_other_model(play):
    with (
        play(read_transcript("laser_775.txt")) as address,
        KatanaLaser(address, clock=StepClock(), power_setpoint=2.0, repetition_hz=40e6) as laser,
    ):
        assert "775" in laser.identity
        laser.arm()


def test_laser_that_does_not_go_dark_is_told_twice_and_then_the_person(play):
    bright = lines((b"leg=0\n", b""), (b"leg?\n", b"status: 1\n"))
    found = lines((b"leg?\n", b"status: 1\n"))
    with (
        play(found + bright + bright) as address,
        pytest.raises(RefusedError, match="turn its key off by hand"),
        KatanaLaser(address, clock=StepClock(), power_setpoint=1, repetition_hz=1e7),
    ):
        pytest.fail("connected to a laser that emits")


@pytest.mark.parametrize(
    "wrong",
    [{"power_setpoint": 10.1}, {"power_setpoint": float("nan")}, {"repetition_hz": 0.0}, {"trigger": "x"}],
)
def test_laser_limits_refuse_before_anything_is_sent(play, wrong):
    good = {"power_setpoint": 5.0, "repetition_hz": 10e6}
    with play([]) as address, pytest.raises(LimitError, match="Nothing was sent"):
        KatanaLaser(address, clock=StepClock(), **{**good, **wrong})


def test_spad_session():
    message_script = framed(read_transcript("spad_session.txt"))
    backend = ScriptedUsb([*OPENING, *message_script])
    with Id120Spad(backend=backend, clock=StepClock(), gate_delay_s=20e-9) as spad:
        assert spad.identity == "ID Quantique,ID120 simulated,SIM0001,1.0"
        spad.enable()
    backend.finish()
    assert backend.claims == 0


OPENING = read_transcript("usbtmc_question.txt", words=USB_WORDS)[:3]


def test_usbtmc_question():
    backend = ScriptedUsb(read_transcript("usbtmc_question.txt", words=USB_WORDS))
    link = usbtmc(backend)
    link.open()
    assert link.usb488
    # Section 4.2.1.7: after a clear the host clears the halt of the bulk-out endpoint.
    assert backend.halts_cleared == [OUT]
    link.write(b"*IDN?\n")
    assert link.read("answer") == b"ID Quantique,ID120 simulated,SIM0001,1.0\n"
    link.write(b"OH,NO?\n")
    with pytest.raises(LinkError, match="nothing came in 1 s"):
        link.read("answer 'OH,NO?'")
    backend.finish()


def usbtmc(backend):
    device = find_instrument("SPAD", vendor_product=(0x1DDC, 0x0330), serial=None, backend=backend)
    return UsbTmc(device, name="SPAD", clock=StepClock(), timeout_s=1.0)


def test_usbtmc_puts_an_answer_of_many_frames_and_transfers_together():
    """Frames of 100 and 3 bytes, the first in two transfers of one and of several packets."""
    text = bytes(range(103))
    first = bytes.fromhex("02 01 FE 00 64 00 00 00 00 00 00 00") + text[:100]
    second = bytes.fromhex("02 02 FD 00 03 00 00 00 01 00 00 00") + text[100:] + b"\0"
    backend = ScriptedUsb(
        [
            *OPENING,
            Step(">", bytes.fromhex("02 01 FE 00 00 10 00 00 00 00 00 00")),
            Step("<", first[:64]),
            Step("<", first[64:]),
            Step(">", bytes.fromhex("02 02 FD 00 00 10 00 00 00 00 00 00")),
            Step("<", second),
        ]
    )
    link = usbtmc(backend)
    link.open()
    assert link.read("answer") == text
    backend.finish()


@pytest.mark.parametrize(
    "frame",
    [
        "02 07 F8 00 01 00 00 00 01 00 00 00 41 00 00 00",  # another tag
        "02 01 FF 00 01 00 00 00 01 00 00 00 41 00 00 00",  # the inverse is none
        "01 01 FE 00 01 00 00 00 01 00 00 00 41 00 00 00",  # another kind of message
        "02 01 FE",  # cut short
        "02 01 FE 00 00 00 00 00 00 00 00 00",  # empty, and not the end
    ],
)
def test_usbtmc_clears_after_a_frame_that_is_none(frame):
    ask = Step(">", bytes.fromhex("02 01 FE 00 00 10 00 00 00 00 00 00"))
    backend = ScriptedUsb([*OPENING, ask, Step("<", bytes.fromhex(frame)), *OPENING[1:]])
    link = usbtmc(backend)
    link.open()
    with pytest.raises(ProtocolError, match="asked to answer"):
        link.read("answer")
    backend.finish()


def test_usbtmc_needs_its_interface():
    link = usbtmc(ScriptedUsb([], tmc=False))
    with pytest.raises(ProtocolError, match="no USBTMC interface"):
        link.open()


def test_a_detector_that_is_not_there_lists_what_is():
    backend = ScriptedUsb([], vendor=0x0403, product=0x6001, tmc=False)
    with pytest.raises(DeviceNotFoundError, match="none fits among 0403:6001"):
        Id120Spad(backend=backend, clock=StepClock()).__enter__()


def test_a_detector_of_another_maker_is_found_by_its_class():
    backend = ScriptedUsb([], vendor=0x9999)
    assert (
        find_instrument("SPAD", vendor_product=(0x1DDC, 0x0330), serial=None, backend=backend).idVendor
        == 0x9999
    )


def control(request, answer, *, to=0xA1, value=0, index=1):
    data = bytes.fromhex(answer)
    return Step("control", data, control=(to, request, value, index, len(data)))


def test_usbtmc_clear_waits_and_empties_what_is_queued():
    """USBTMC 1.0, table 28: status 2 is pending; bit 0 of the second byte: read until a short packet."""
    steps = [
        control(5, "01"),
        control(6, "02 01"),
        Step("<", bytes(64)),
        Step("<", bytes(3)),
        control(6, "01 00"),
    ]
    backend = ScriptedUsb([OPENING[0], *steps])
    usbtmc(backend).open()
    backend.finish()


@pytest.mark.parametrize("steps", [[control(5, "80")], [control(5, "01"), control(6, "80 00")]])
def test_usbtmc_clear_that_fails_is_told(steps):
    backend = ScriptedUsb([OPENING[0], *steps])
    with pytest.raises(ProtocolError, match="clear its buffers, but status 0x80 came"):
        usbtmc(backend).open()
    backend.finish()


def test_usbtmc_aborts_a_message_that_is_not_taken_in_time():
    """USBTMC 1.0, tables 15 to 17: abort of tag 1, success, done after one pending; then clear the halt."""
    done = "01" + " 00" * 7
    steps = [
        Step("late"),
        control(1, "01 01", to=0xA2, value=1, index=OUT),
        control(2, "02" + " 00" * 7, to=0xA2, index=OUT),
        control(2, done, to=0xA2, index=OUT),
    ]
    backend = ScriptedUsb([*OPENING, *steps])
    link = usbtmc(backend)
    link.open()
    with pytest.raises(LinkError, match="in 1 s"):
        link.write(b"*IDN?")
    assert backend.halts_cleared == [OUT, OUT]
    backend.finish()
