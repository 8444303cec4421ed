"""The simulated firmware against what the manuals say, byte by byte, with no driver in sight."""

import pytest
from wire_script import read_transcript

from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.spad import SpadInstrument
from simulators.wire.tmc import TmcInterface

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
        ("spad_session.txt", SpadInstrument),
    ],
)
@pytest.mark.parametrize("piece", [1, 1000])
def test_firmware_answers_as_the_transcript_says(name, build, piece):
    """Whether the bytes come one by one or all at once; messages over USB are never cut."""
    bench = Bench(photons=None)
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
    interface = TmcInterface(SpadInstrument(Bench(photons=None)))
    for step in read_transcript("usbtmc_question.txt", words=USB_WORDS):
        if step.kind == ">":
            interface.bulk_out(step.data)
        elif step.kind == "<":
            assert (interface.bulk_in(4608) or b"") == step.data
        else:
            *request, length = step.control
            assert interface.control(*request, length) == step.data
