"""The simulated firmware against transcripts of what public documents say, with no driver in sight."""

import pytest

from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import Katana08Head, KatanaHead
from simulators.wire.mpd import MpdModule
from simulators.wire.nkt import NktMainboard
from simulators.wire.psd import PsdFirmware
from simulators.wire.spad import SpadInstrument
from simulators.wire.tmc import TmcInterface
from support.wire_script import read_transcript

USB_WORDS = {"INTERFACE": "0000", "OUT": "0001", "IN": "0082"}


def key_off(bench):
    head = KatanaHead(bench)
    head.turn_key(on=False)
    return head


@pytest.mark.parametrize(
    ("name", "build"),
    [
        ("galvo_session.txt", GalvoBoard),
        ("galvo_board.txt", GalvoBoard),
        ("laser_session.txt", KatanaHead),
        ("laser_key_off.txt", key_off),
        ("laser_775.txt", Katana08Head),
        ("nkt_session.txt", NktMainboard),
        ("mpd_session.txt", MpdModule),
        ("mpd_module.txt", MpdModule),
        ("psd_session.txt", PsdFirmware),
        ("psd_unit.txt", PsdFirmware),
        ("spad_session.txt", SpadInstrument),
        ("spad_instrument.txt", SpadInstrument),
    ],
)
@pytest.mark.parametrize("piece", [1, 1000])
def test_firmware_answers_as_the_transcript_says(name, build, piece):
    """Whether the bytes come one by one or all at once; messages over USB are never cut."""
    bench = Bench()
    firmware = build(bench)
    expected = b""
    for number, step in enumerate(read_transcript(name)):
        if step.kind == "<":
            expected += step.data
            continue
        assert bytes(firmware.output) == expected, f"before step {number} of {name}"
        firmware.output.clear()
        expected = b""
        if step.kind == ".":
            bench.clock.sleep(step.pause_s)
        elif build is SpadInstrument:
            firmware.receive(step.data)
        else:
            for i in range(0, len(step.data), piece):
                firmware.receive(step.data[i : i + piece])
    assert bytes(firmware.output) == expected


def test_usbtmc_interface_answers_as_the_transcript_says():
    interface = TmcInterface(SpadInstrument(Bench()))
    for step in read_transcript("usbtmc_question.txt", words=USB_WORDS):
        if step.kind == ">":
            interface.bulk_out(step.data)
        elif step.kind == "<":
            assert (interface.bulk_in(4608) or b"") == step.data
        else:
            *request, length = step.control
            assert interface.control(*request, length) == step.data


def frame(kind, tag, size, payload=b"", attributes=0):
    header = bytes([kind, tag, 255 - tag, 0]) + size.to_bytes(4, "little") + bytes([attributes, 0, 0, 0])
    return header + payload + bytes(-len(payload) % 4)


def test_a_long_answer_comes_in_frames_of_the_size_asked_for():
    interface = TmcInterface(SpadInstrument(Bench()))
    interface.bulk_out(frame(1, 1, 9, b"REG:RUN?\n", 1))
    interface.bulk_out(frame(2, 2, 4))
    assert interface.bulk_in(512) == frame(2, 2, 4, b"FALS")
    interface.bulk_out(frame(2, 3, 4))
    assert interface.bulk_in(512) == frame(2, 3, 2, b"E\n", 1)
    interface.bulk_out(frame(2, 4, 4))
    assert interface.bulk_in(512) is None


def test_a_message_may_come_in_several_frames():
    interface = TmcInterface(SpadInstrument(Bench()))
    interface.bulk_out(frame(1, 1, 5, b"REG:R", 0))
    interface.bulk_out(frame(1, 2, 4, b"UN?\n", 1))
    interface.bulk_out(frame(2, 3, 100))
    assert interface.bulk_in(512) == frame(2, 3, 6, b"FALSE\n", 1)


def test_a_new_message_breaks_off_an_answer_that_was_not_read():
    interface = TmcInterface(SpadInstrument(Bench()))
    interface.bulk_out(frame(1, 1, 6, b"*IDN?\n", 1))
    interface.bulk_out(frame(2, 2, 100))
    assert interface.bulk_in(16) == frame(2, 2, 41, b"ID Q", 1)
    interface.bulk_out(frame(1, 3, 9, b"REG:RUN?\n", 1))
    assert interface.bulk_in(512) is None
    interface.bulk_out(frame(2, 4, 100))
    assert interface.bulk_in(512) == frame(2, 4, 6, b"FALSE\n", 1)
