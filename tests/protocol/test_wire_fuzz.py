"""Whatever comes over the wire, parsers raise only what they say, and firmware never falls over."""

import re
from math import hypot, radians, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.katana.dialects import (
    parse_emission,
    parse_measured,
    parse_rate,
    parse_refusal,
    parse_value,
)
from drivers.lines.usbtmc import (
    FrameError,
    announced_size,
    message_out,
    next_tag,
    parse_answer,
    request_in,
)
from simulators.bench import Bench
from simulators.wire.galvo import GalvoBoard
from simulators.wire.laser import KatanaHead
from simulators.wire.spad import SpadInstrument
from simulators.wire.tmc import StallError, TmcInterface

TAGS = st.integers(1, 255)

GALVO_WORDS = [
    b"START",
    b"STATUS",
    b"XY=",
    b"X=",
    b"y= ",
    b"1.5",
    b"-0.3",
    b";",
    b"9e9",
    b"e",
    b"\r\n",
    b"GOPRO",
]
LASER_WORDS = [b"leg", b"=1", b"=0", b"?", b"lp=", b"10.01", b"7.5", b"\n", b"lps", b"ltg_freq=", b"h"]
SPAD_WORDS = [
    b"DEADTIME:",
    b"TIME",
    b"GATE:",
    b"REG:RUN",
    b"?",
    b" TRUE",
    b" 40",
    b" -1",
    b"\n",
    b"_CAPABILITY",
]


def bytes_like(words):
    """Bytes that are often nearly a command."""
    return st.lists(st.one_of(st.sampled_from(words), st.binary(max_size=70)), max_size=25).map(b"".join)


@given(TAGS, st.binary(min_size=1, max_size=300), st.booleans())
def test_a_message_frame_holds_the_message(tag, payload, ends):
    frame = message_out(tag, payload, end_of_message=ends)
    assert len(frame) % 4 == 0
    assert len(frame) - 12 - len(payload) in range(4)
    assert frame[:4] == bytes([1, tag, 255 - tag, 0])
    assert int.from_bytes(frame[4:8], "little") == len(payload)
    assert frame[8:12] == bytes([ends, 0, 0, 0])
    assert frame[12 : 12 + len(payload)] == payload


@given(TAGS, st.integers(1, 2**32 - 1))
def test_a_request_frame_asks_for_so_many_bytes(tag, most):
    assert request_in(tag, most) == bytes([2, tag, 255 - tag, 0]) + most.to_bytes(4, "little") + bytes(4)


@given(TAGS, st.binary(max_size=300), st.booleans(), st.binary(max_size=3))
def test_an_answer_comes_back_out_of_its_frame(tag, payload, ends, padding):
    head = bytes([2, tag, 255 - tag, 0]) + len(payload).to_bytes(4, "little") + bytes([ends, 0, 0, 0])
    answer = parse_answer(head + payload + padding, tag)
    assert (answer.payload, answer.end_of_message) == (payload, ends)
    for cut in range(len(head + payload)):
        with pytest.raises(FrameError):
            parse_answer((head + payload)[:cut], tag)


@given(st.binary(max_size=64), TAGS)
def test_anything_else_is_a_frame_error(frame, tag):
    try:
        answer = parse_answer(frame, tag)
    except FrameError:
        return
    assert frame[:3] == bytes([2, tag, 255 - tag])
    assert len(answer.payload) == announced_size(frame) <= len(frame) - 12


def test_tags_run_from_1_to_255_and_never_are_0():
    tag, seen = 0, []
    for _ in range(511):
        tag = next_tag(tag)
        seen.append(tag)
    assert seen == [*range(1, 256), *range(1, 256), 1]


@given(st.floats(-1e9, 1e9), st.text("\r\n\x00 >status:", max_size=8), st.text("\r\n\x00 >", max_size=8))
def test_a_value_is_found_among_stray_bytes(value, before, after):
    assert parse_value("lp", f"{before} lp={value!r}{after}") == value


@given(st.text(max_size=60))
def test_laser_answers_of_any_kind_are_parsed_or_not(text):
    assert parse_emission("leg", text) in (None, True, False)
    assert parse_measured("lpa", text) in (None, True, False)
    parse_rate("ltg_freq", text)
    assert parse_refusal(text) is None or parse_refusal(text) >= 0
    parse_value("lp", text)


def test_a_name_that_ends_like_another_is_not_mistaken():
    assert parse_value("lp", "xlp=3") is None
    assert parse_value("lp", "lps=1") is None
    assert parse_value("lp", "lps status: 1") is None
    assert parse_emission("leg", "ltg status: 0") is None


@given(st.integers(1, 10**9), st.sampled_from(["", " ", "  "]))
def test_a_rate_is_the_same_in_all_its_units(rate_hz, gap):
    for told in (f"{rate_hz}{gap}Hz", f"{rate_hz / 1e3!r}{gap}kHz", f"{rate_hz / 1e6!r}{gap}MHz"):
        assert parse_rate("lx_freq", f"lx_freq={told}\n") == pytest.approx(rate_hz, rel=1e-12)
        assert parse_rate("lx_freq", f"status: {told}\n") == pytest.approx(rate_hz, rel=1e-12)


@pytest.mark.parametrize("said", ["leg status: 2", "leg=10", "status: 10", "leg=0.5", "leg=", "status:"])
def test_what_is_neither_0_nor_1_says_nothing_of_emission(said):
    assert parse_emission("leg", said) is None


@given(bytes_like(GALVO_WORDS))
def test_the_board_answers_every_line_with_one_line_of_its_protocol(data):
    bench = Bench()
    board = GalvoBoard(bench)
    for i in range(0, len(data), 7):
        board.receive(data[i : i + 7])
    *answers, rest = bytes(board.output).split(b"\r\n")
    assert rest == b""
    for answer in answers:
        assert re.fullmatch(rb"OK|NO|OL|OU|[0-9A-F]{8}|MR-E-2 simulated", answer)
    # A position on the edge of the circle may exceed it by rounding.
    assert hypot(*map(tan, bench.target_rad)) <= tan(radians(50)) * (1 + 1e-12)


@given(bytes_like(GALVO_WORDS))
def test_the_board_is_back_in_step_after_one_line_end(data):
    board = GalvoBoard(Bench())
    board.receive(b"".join(piece for piece in re.split(rb"(?i)gopro|reset", data)) + b"\r\n")
    board.output.clear()
    board.receive(b"START\r\n")
    assert bytes(board.output) == b"OK\r\n"


@given(bytes_like(LASER_WORDS))
def test_the_head_survives_and_its_light_obeys_key_and_interlock(data):
    bench = Bench()
    head = KatanaHead(bench)
    head.turn_key(on=False)
    head.receive(data)
    assert not bench.light.emitting
    assert 0.0 <= bench.light.power <= 1.0
    assert bytes(head.output[-1:]) in (b"", b"\n")


@given(bytes_like(SPAD_WORDS))
def test_the_instrument_survives_and_keeps_its_ranges(data):
    bench = Bench()
    instrument = SpadInstrument(bench)
    instrument.receive(data)
    light = bench.light
    assert not light.gated
    assert 40e-9 <= light.hold_off_s <= 1e-3


@given(
    st.lists(
        st.one_of(st.binary(max_size=40), st.tuples(TAGS, st.binary(min_size=1, max_size=20))), max_size=8
    )
)
def test_the_interface_answers_frames_and_stalls_on_all_else(transfers):
    interface = TmcInterface(SpadInstrument(Bench()))
    for transfer in transfers:
        frame = transfer if isinstance(transfer, bytes) else message_out(*transfer)
        try:
            interface.bulk_out(frame)
        except StallError:
            assert interface.halted
    interface.halted = False
    assert interface.control(0xA1, 5, 0, 0, 1) == b"\x01"
    interface.bulk_out(message_out(9, b"REG:RUN?\n"))
    interface.bulk_out(request_in(10, 100))
    assert parse_answer(interface.bulk_in(512) or b"", 10).payload == b"FALSE\n"
