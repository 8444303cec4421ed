"""Frames of the mirror's Pro mode: whatever comes over the wire, what was sent is what is read."""

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.optotune.frames import LONGEST, Frame, FrameError, crc16, framed, parsed
from simulators.wire import galvo_frames
from simulators.wire.galvo_frames import Deframer, Request

PAYLOADS = st.binary(max_size=LONGEST) | st.lists(
    st.sampled_from([0x7D, 0x7E, 0x5D, 0x5E, 0x00]), max_size=LONGEST
).map(bytes)
COMMANDS = st.integers(0, 0x7F)


def taken(*pieces):
    """What the firmware makes of bytes that arrive so."""
    deframer = Deframer()
    return [request for piece in pieces for request, _ in deframer.take(piece)]


def test_the_maker_s_own_examples():
    """Frames written out in the documentation of the maker's SDK."""
    assert framed(0x06, bytes(2)) == bytes.fromhex("7E 00 06 02 00 00 00 00 7E")
    assert framed(0x11, bytes.fromhex("5001")) == bytes.fromhex("7E 00 11 02 50 01 00 00 7E")
    set_current = framed(0x10, struct.pack(">Hf", 0x5100, 0.1))
    assert set_current == b"~\x00\x10\x06Q\x00=\xcc\xcc\xcd\x00\x00~"
    assert parsed(bytes.fromhex("00 11 04 00 00 00 00 F2 81")) == Frame(0x11, bytes(4))


def test_the_checksum_is_the_usual_one_of_its_name():
    """CRC-16/ARC's check value in the catalogues of checksums."""
    assert crc16(b"123456789") == 0xBB3D


@given(COMMANDS, PAYLOADS, st.lists(st.integers(0, 120), max_size=5))
def test_the_board_reads_what_was_sent_however_it_is_cut(command, payload, cuts):
    sent = framed(command, payload)
    assert sent[0] == sent[-1] == 0x7E
    assert 0x7E not in sent[1:-1]
    places = [0, *sorted(cuts), len(sent)]
    pieces = [sent[a:b] for a, b in pairwise(places)]
    assert taken(*pieces) == [Request(command, payload, checked=True)]


@given(st.integers(0, 0xFF), PAYLOADS)
def test_the_driver_reads_what_the_board_answers(command, payload):
    sent = galvo_frames.answer(command, payload)
    assert sent[0] == sent[-1] == 0x7E
    assert parsed(sent[1:-1]) == Frame(command, payload)


@given(COMMANDS, PAYLOADS, st.data())
def test_a_part_of_a_frame_is_no_frame(command, payload, data):
    body = galvo_frames.answer(command, payload)[1:-1]
    with pytest.raises(FrameError):
        parsed(body[: data.draw(st.integers(0, len(body) - 1))])


@given(COMMANDS, PAYLOADS, st.data())
def test_a_changed_bit_is_seen(command, payload, data):
    """Of the content: CRC-16 finds every single bit; escapes may turn one byte into two."""
    content = bytes([0, command, len(payload)]) + payload
    content += crc16(content).to_bytes(2, "little")
    place = data.draw(st.integers(0, 8 * len(content) - 1))
    changed = bytearray(content)
    changed[place // 8] ^= 1 << place % 8
    escaped = bytes(changed).replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")
    with pytest.raises(FrameError):
        parsed(escaped)


@given(st.binary(max_size=200))
def test_garbage_is_a_frame_error_or_a_frame(body):
    try:
        frame = parsed(body)
    except FrameError:
        return
    assert len(frame.payload) <= 255


@given(st.binary(max_size=60).filter(lambda data: 0x7E not in data), COMMANDS, PAYLOADS)
def test_garbage_between_frames_is_not_part_of_them(garbage, command, payload):
    sent = framed(command, payload)
    assert taken(sent + garbage + sent)[-1] == Request(command, payload, checked=True)
    assert taken(garbage + sent) == [Request(command, payload, checked=True)]


@given(COMMANDS, PAYLOADS, st.data())
def test_half_a_frame_is_never_taken_for_a_command(command, payload, data):
    """Cut anywhere, and followed by the next frame: nothing that can be obeyed comes of it but that frame."""
    sent = framed(command, payload)
    half = sent[: data.draw(st.integers(1, len(sent) - 1))]
    *before, last = taken(half + framed(0x06, bytes(2)))
    assert last == Request(0x06, bytes(2), checked=True)
    # only the last flag was missing: then the frame was whole
    if half != sent[:-1]:
        assert all(one.payload is None or not one.checked for one in before)


def test_a_frame_that_is_too_long_for_the_board_is_never_made():
    with pytest.raises(ValueError, match="51 bytes"):
        framed(0x14, bytes(51))


def test_a_wrong_checksum_is_known_to_the_board():
    right = bytearray(framed(0x11, b"\x50\x02"))
    right[-3:-1] = b"\x12\x34"
    assert taken(bytes(right)) == [Request(0x11, b"\x50\x02", checked=False)]
