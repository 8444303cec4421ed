"""The USBTMC driver against transfers written from the standard, with no simulator in sight."""

import pytest

from drivers.errors import DeviceNotFoundError, LinkError, ProtocolError
from drivers.id120 import Id120Spad
from drivers.lines.usb_finder import find_instrument
from drivers.lines.usbtmc import UsbTmc
from support.scripted_usb import OUT, USB_WORDS, ScriptedUsb
from support.wire_script import Step, StepClock, read_transcript

OPENING = read_transcript("usbtmc_question.txt", words=USB_WORDS)[:3]


def test_usbtmc_question():
    backend = ScriptedUsb(read_transcript("usbtmc_question.txt", words=USB_WORDS))
    link = usbtmc(backend)
    link.open()
    assert link.usb488
    # USBTMC 1.0: after a clear the host clears the halt of the bulk-out endpoint.
    assert backend.halts_cleared == [OUT]
    link.write(b"*IDN?\n")
    assert link.read("answer") == b"ID Quantique,ID120 simulated,SIM0001,1.0\n"
    link.write(b"OH,NO?\n")
    with pytest.raises(LinkError, match="no answer came in 1 s"):
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
    with pytest.raises(DeviceNotFoundError, match="none matches among 0403:6001"):
        Id120Spad(backend=backend, clock=StepClock()).__enter__()


def test_a_detector_of_another_maker_is_found_by_its_class():
    backend = ScriptedUsb([], vendor=0x9999)
    device = find_instrument("SPAD", vendor_product=(0x1DDC, 0x0330), serial=None, backend=backend)
    assert device.idVendor == 0x9999


def control(request, answer, *, to=0xA1, value=0, index=1):
    data = bytes.fromhex(answer)
    return Step("control", data, control=(to, request, value, index, len(data)))


def test_usbtmc_clear_waits_and_empties_what_is_queued():
    """CHECK_CLEAR_STATUS: status 2 is pending; bit 0 of the second byte: read until a short packet."""
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
    """INITIATE_ABORT_BULK_OUT of tag 1: success; done after one pending; then the halt is cleared."""
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
