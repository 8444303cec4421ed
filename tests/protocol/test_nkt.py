"""NKT's register protocol: telegrams to bytes and back, and what the driver makes of what comes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DeviceNotFoundError, LimitError, LinkError, ProtocolError, RefusedError
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from drivers.nkt.telegram import Kind, Telegram, TelegramError, decoded, encoded
from simulators.bench import Bench
from simulators.wire import nkt
from support.wire_script import Step, StepClock, read_transcript

BYTES = st.integers(0, 255)
TELEGRAMS = st.builds(Telegram, BYTES, BYTES, BYTES, BYTES, st.binary(max_size=240))
#: Often made of the bytes that have to be escaped.
AWKWARD = st.builds(
    Telegram,
    *4 * [st.sampled_from([0x0A, 0x0D, 0x5E, 0x4A, 0x4D, 0x9E])],
    st.lists(st.sampled_from([0x0A, 0x0D, 0x5E, 0x4A, 0x4D, 0x9E, 0x00]), max_size=20).map(bytes),
)
SETTINGS = NktSettings(level_percent=35.0, oscillator_hz=80e6, repetition_hz=10e6)


def body(telegram):
    return bytes([telegram.destination, telegram.source, telegram.kind, telegram.register]) + telegram.data


@given(st.one_of(TELEGRAMS, AWKWARD))
def test_a_telegram_comes_back_out_of_its_frame(telegram):
    frame = encoded(telegram)
    assert frame[:1] == b"\r"
    assert frame[-1:] == b"\n"
    assert b"\r" not in frame[1:]
    assert b"\n" not in frame[:-1]
    assert decoded(frame[:-1]) == telegram


@given(st.one_of(TELEGRAMS, AWKWARD))
def test_driver_and_simulator_frame_alike_though_neither_knows_the_other(telegram):
    frame = nkt.framed(body(telegram))
    assert encoded(telegram) == frame
    assert nkt.unframed(frame[:-1])[:-2] == body(telegram)


def test_the_checksum_is_the_published_one():
    """The check value of CRC-16/XMODEM in the catalogues of CRCs."""
    assert nkt.checksum(b"123456789") == 0x31C3


@given(st.one_of(TELEGRAMS, AWKWARD), st.binary(max_size=20).filter(lambda noise: b"\n" not in noise))
def test_what_came_before_a_telegram_is_left_out(telegram, noise):
    assert decoded(noise + encoded(telegram)[:-1]) == telegram


@given(TELEGRAMS, st.data())
def test_one_wrong_bit_is_noticed(telegram, data):
    """A CRC of 16 bits finds every single one."""
    whole = body(telegram)
    whole += nkt.checksum(whole).to_bytes(2, "big")
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    spoiled = bytearray(whole)
    spoiled[bit // 8] ^= 1 << bit % 8
    escaped = b"".join(bytes([0x5E, one + 0x40]) if one in b"\n\r^" else bytes([one]) for one in spoiled)
    with pytest.raises(TelegramError, match="CRC"):
        decoded(b"\r" + escaped)


@given(st.one_of(TELEGRAMS, AWKWARD), st.data())
def test_a_telegram_that_is_cut_is_noticed(telegram, data):
    frame = encoded(telegram)[:-1]
    cut = frame[: data.draw(st.integers(0, len(frame) - 1))]
    try:
        found = decoded(cut)
    except TelegramError:
        return
    # one cut in 65 536 has a CRC that fits by chance: then it is shorter
    assert len(found.data) < len(telegram.data)


@given(st.binary(max_size=300))
def test_other_bytes_are_no_telegram(line):
    try:
        found = decoded(line)
    except TelegramError:
        return
    assert nkt.unframed(line)[:-2] == body(found)


@given(st.lists(st.one_of(st.binary(max_size=40), TELEGRAMS.map(encoded), AWKWARD.map(encoded)), max_size=20))
def test_the_mainboard_survives_and_its_light_obeys_the_interlock(pieces):
    bench = Bench()
    board = nkt.NktMainboard(bench)
    board.close_interlock(False)
    for piece in pieces:
        board.receive(piece)
    assert not bench.light.emitting
    assert 0.0 <= bench.light.power <= 1.0
    for answer in bytes(board.output).split(b"\n")[:-1]:
        decoded(answer)


SESSION = read_transcript("nkt_session.txt")
TYPE_ASKED = SESSION[0]


def laser(address, settings=SETTINGS, clock=None):
    return NktLaser(address, clock=clock or StepClock(), settings=settings)


def asked(host, register, kind=Kind.READ, data=b""):
    return Step(">", encoded(Telegram(0x0F, host, kind, register, data)))


def said(host, register, data=b"", kind=Kind.DATAGRAM):
    return Step("<", encoded(Telegram(host, 0x0F, kind, register, data)))


def test_session(play):
    with play(SESSION) as address, laser(address) as one:
        assert one.identity == "NKT SuperK EXTREME or FIANIUM SIM0001"
        one.arm()
        one.emit()


def test_answers_to_earlier_questions_are_left_out(play):
    """Before each answer comes one to the question before, which says the contrary about emission."""
    steps = []
    for step in SESSION:
        if step.kind == "<":
            mine = decoded(step.data[:-1])
            lie = b"\x00" if mine.data[:1] != b"\x00" else b"\x03"
            steps.append(said(mine.destination - 1, mine.register, lie))
        steps.append(step)
    with play(steps) as address, laser(address) as one:
        one.arm()
        one.emit()


def test_a_busy_laser_is_asked_again_after_a_while(play):
    clock = StepClock()
    steps = [TYPE_ASKED, said(0xA1, 0x61, kind=Kind.BUSY), asked(0xA2, 0x61)]
    with (
        play([*steps, said(0xA2, 0x61, b"\x74")]) as address,
        pytest.raises(DeviceNotFoundError, match="type 74"),
        laser(address, clock=clock),
    ):
        pytest.fail("connected to another module")
    assert clock.now_s() == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (lambda host: b"", "no answer came"),
        (lambda host: asked(host, 0x61).data, "the request itself came back.*Switch the echo"),
        (lambda host: b"\xe0\x80\x00\n", "115200 baud"),
        (lambda host: b"OK\r\n", "115200 baud"),
        (lambda host: said(host, 0x61, kind=Kind.CRC_ERROR).data, "telegrams of type 1"),
        (lambda host: said(host, 0x61).data, "the register is empty"),
    ],
)
def test_a_line_that_is_not_right_is_told_as_what_it_is(play, answer, told):
    tries = (0xA1,) if told == "the register is empty" else (0xA1, 0xA2, 0xA3)
    steps = [one for host in tries for one in (asked(host, 0x61), Step("<", answer(host)))]
    with play(steps) as address, pytest.raises(DeviceNotFoundError, match=told), laser(address):
        pytest.fail("connected to something else")


@pytest.mark.parametrize(
    "wrong",
    [
        {"level_percent": 100.1},
        {"level_percent": float("nan")},
        {"repetition_hz": 0.0},
        {"repetition_hz": 81e6},
        {"repetition_hz": 30e6},
        {"repetition_hz": 1e3},
        {"repetition_hz": 1e-320},
        {"oscillator_hz": float("inf")},
    ],
)
def test_limits_refuse_before_there_is_a_laser(wrong):
    good = {"level_percent": 10.0, "oscillator_hz": 80e6, "repetition_hz": 10e6}
    NktSettings(**good)
    with pytest.raises(LimitError, match="Nothing was sent"):
        NktSettings(**{**good, **wrong})


def test_the_interlock_is_asked_and_never_reset(rig):
    with rig.laser_nkt() as one:
        board = rig.heads["nkt"]
        board.close_interlock(False)
        with pytest.raises(
            RefusedError, match=r"interlock is open: door switch.*nobody is in the path of the beam"
        ):
            one.arm()
        board.close_interlock(True)
        for _ in range(2):
            with pytest.raises(RefusedError, match="interlock waits for its reset"):
                one.arm()
        board.reset_interlock()
        board.turn_key(False)
        with pytest.raises(RefusedError, match="front panel or key switch"):
            one.arm()


def test_the_laser_itself_goes_dark_when_nobody_asks_any_more(rig):
    with rig.laser_nkt() as one:
        one.arm()
        one.emit()
        for _ in range(100):
            rig.bench.clock.sleep(0.2)
            assert one.emitting()
        rig.bench.clock.sleep(6.0)
        assert not one.emitting()
        assert one.settings()["watchdog_s"] == 5
    assert rig.heads["nkt"]._watchdog_s == 0


def test_light_is_ordered_only_once(rig):
    """An order that was not answered may have been heard; a second one could come when it is not wanted."""
    with rig.laser_nkt() as one:
        one.arm()
        rig.heads["nkt"].drop_answers = 1
        with pytest.raises(LinkError, match="write register 30"):
            one.emit()
        assert not rig.bench.light.emitting
    assert sum(change.get("emitting") is True for change in rig.bench.changes) == 1


@pytest.mark.parametrize(("mode", "level"), [(0, 0x38), (1, 0x37)])
def test_the_level_goes_where_the_mode_takes_it_from(rig, mode, level):
    with rig.laser_nkt(level_percent=12.3) as one:
        board = rig.heads["nkt"]
        board.mode = mode
        one.arm()
        assert board._levels[level] == 123
        assert rig.bench.light.power == pytest.approx(0.123)
        assert one.settings()["level_percent"] == 12.3


def test_a_mode_that_takes_its_level_from_elsewhere_is_refused(rig):
    with rig.laser_nkt() as one:
        rig.heads["nkt"].mode = 4
        with pytest.raises(RefusedError, match=r"mode 4.*constant current or constant power"):
            one.arm()


def test_a_laser_without_pulse_picker_has_its_oscillators_rate(rig):
    class Plain(nkt.NktMainboard):
        def _read(self, register):
            return None if register == 0x34 else super()._read(register)

    nkt_address = rig.plug_in("plain", Plain)
    with (
        laser(nkt_address, clock=rig.bench.clock) as one,
        pytest.raises(RefusedError, match="no pulse picker"),
    ):
        one.arm()
    whole = NktSettings(level_percent=5.0, oscillator_hz=80e6, repetition_hz=80e6)
    with laser(nkt_address, whole, rig.bench.clock) as one:
        one.arm()
        assert one.settings()["repetition_hz"] == 80e6


def test_many_wrong_answers_are_no_answer(rig):
    with rig.laser_nkt() as one:
        rig.heads["nkt"].garble_answers = 3
        with pytest.raises(ProtocolError, match="115200 baud"):
            one.emitting()
        rig.heads["nkt"].garble_answers = 2
        assert not one.emitting()
