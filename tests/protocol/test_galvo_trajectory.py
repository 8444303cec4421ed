"""The mirror follows a trajectory: driver, wire, firmware in Pro mode, and the bench's point clock."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LimitError, LinkError, ProtocolError, RefusedError
from drivers.lines.serial import SerialLine
from drivers.optotune import OptotuneLimits
from drivers.optotune.frames import framed, parsed
from drivers.optotune.pro_mode import ProMode
from drivers.optotune.registers import static_xy
from simulators.clock import BenchClock
from simulators.wire import galvo as board_bits
from simulators.wire import galvo_frames
from simulators.wire.serial_url import protocol_sim

TICK_S = 1e-3
W = 2 * np.pi * 400.0


def way(number, seed=0):
    """Positions of a trajectory, all over the limits."""
    return np.random.default_rng(seed).uniform(-0.25, 0.25, (number, 2))


def servo(targets, start, times_s, at_s):
    """Where a critically damped servo is, by its matrix exponential from tick to tick.

    With the error e and e' + w e as the state, it decays as exp(-w t) and e gains t times the other.
    """
    error, slope, last_s, target = np.zeros(2), np.zeros(2), times_s[0], np.array(start)
    found = []
    ticks = [*zip(times_s, targets, strict=True), (np.inf, None)]
    asked = iter(at_s)
    ask_s = next(asked)
    for tick_s, new in ticks:
        while ask_s is not None and ask_s < tick_s:
            t = ask_s - last_s
            found.append(target + (error + slope * t) * np.exp(-W * t))
            ask_s = next(asked, None)
        if new is None:
            break
        decay = np.exp(-W * (tick_s - last_s))
        error, slope = (error + slope * (tick_s - last_s)) * decay, slope * decay
        slope_rate = slope  # e' + w e is unchanged by a jump of the target but for w times the jump
        jump = target - np.array(new)
        error, slope, target, last_s = error + jump, slope_rate + W * jump, np.array(new), tick_s
    return np.array(found)


def run_ticks(rig, number, tick_s=TICK_S):
    rig.bench.start_ticks(np.ones(number, np.uint8), tick_s)
    return rig.bench.clock.now_s() + tick_s * np.arange(number)


def test_the_mirror_is_where_the_ticks_have_led_it(rig):
    """At 500 times, within the float32 of the wire: 1e-7 of a position, and what is held at rest."""
    angles = way(100)
    with rig.galvo() as mirror:
        mirror.trajectory(angles, TICK_S)
        assert rig.bench.target_rad == pytest.approx(angles[0], abs=1e-7)  # at once
        mirror.wait_settled(timeout_s=0.1)
        times_s = run_ticks(rig, 100)
        asked_s = times_s[0] + np.sort(np.random.default_rng(1).uniform(0, 0.12, 500))
        expected = servo(angles, angles[0], times_s, asked_s)
        assert rig.bench.mirror.positions(asked_s) == pytest.approx(expected, abs=1e-6)
        assert np.ptp(expected, axis=0).min() > 0.3
        rig.bench.clock.sleep(0.2)
        mirror.wait_settled(timeout_s=0.1)
        assert rig.bench.position_rad == pytest.approx(angles[-1], abs=1e-7)  # and it stays


def test_nothing_moves_without_ticks(rig):
    with rig.galvo() as mirror:
        mirror.trajectory(way(20), TICK_S)
        rig.bench.clock.sleep(1.0)
        assert rig.bench.position_rad == pytest.approx(way(20)[0], abs=1e-7)


def test_ticks_that_are_stopped_leave_it_where_it_is_and_go_on_later(rig):
    angles = way(30)
    with rig.galvo() as mirror:
        mirror.trajectory(angles, TICK_S)
        run_ticks(rig, 30)
        rig.bench.clock.sleep(9.5e-3)
        rig.bench.stop_ticks()
        rig.bench.clock.sleep(0.1)
        assert rig.bench.target_rad == pytest.approx(angles[9], abs=1e-7)
        assert mirror.settings()["trajectory_index"] == 9
        run_ticks(rig, 5)
        rig.bench.clock.sleep(0.1)
        assert rig.bench.target_rad == pytest.approx(angles[14], abs=1e-7)


def test_status_and_settings_can_be_asked_for_while_it_runs(rig):
    with rig.galvo() as mirror:
        mirror.trajectory(way(50), TICK_S)
        run_ticks(rig, 50)
        rig.bench.clock.sleep(20.5e-3)
        settings = mirror.settings()
        assert settings["trajectory_positions"] == 50
        assert settings["trajectory_index"] == 20
        assert settings["status"] == board_bits.NOT_STABLE
        rig.board.break_down(board_bits.HEAD_TEMPERATURE)
        with pytest.raises(RefusedError, match="head temperature"):
            mirror.wait_settled(timeout_s=0.1)
        rig.board.repair()


@pytest.mark.parametrize("waited_s", [0.0, 10.5e-3, 1.0])
def test_point_ends_a_trajectory_at_any_time(rig, waited_s):
    with rig.galvo() as mirror:
        mirror.trajectory(way(50), TICK_S)
        run_ticks(rig, 50)
        rig.bench.clock.sleep(waited_s)
        mirror.point(0.1, -0.2)
        rig.bench.clock.sleep(0.1)
        assert rig.bench.position_rad == pytest.approx((0.1, -0.2), abs=1e-8)
        assert "trajectory_index" not in mirror.settings()
        mirror.point(-0.1, 0.0)
        mirror.wait_settled(timeout_s=0.1)
        assert rig.bench.position_rad == pytest.approx((-0.1, 0.0), abs=1e-8)


def test_one_trajectory_after_the_other(rig):
    with rig.galvo() as mirror:
        for seed in (1, 2):
            angles = way(12, seed)
            mirror.trajectory(angles, TICK_S)
            run_ticks(rig, 12)
            rig.bench.clock.sleep(30e-3)
            assert rig.bench.target_rad == pytest.approx(angles[-1], abs=1e-7)
    assert rig.bench.target_rad == (0.0, 0.0)
    with rig.galvo() as mirror:  # in Simple mode again
        assert mirror.status() == 0 or mirror.status() == board_bits.NOT_STABLE


def test_a_second_program_finds_the_board_after_one_that_ended_in_the_middle(rig):
    """Of a trajectory, of an upload, and of a frame: nothing of it is taken for a command."""
    whole = framed(0x14, bytes(5))

    def ends_badly(sent):
        with rig.galvo() as mirror:
            mirror.trajectory(way(20), TICK_S)
            rig.board.receive(sent)
            raise ZeroDivisionError

    for sent in (b"", whole[:5], whole[:-1]):
        with pytest.raises(ZeroDivisionError):
            ends_badly(sent)
        stayed = rig.bench.target_rad
        assert stayed == pytest.approx(way(20)[0], abs=1e-7)
        with rig.galvo() as mirror:
            assert rig.bench.target_rad == stayed
            mirror.point(0.2, 0.1)
            mirror.wait_settled(timeout_s=0.1)
            assert rig.bench.position_rad == pytest.approx((0.2, 0.1), abs=1e-8)


@pytest.mark.parametrize("after_frames", [0, 1, 7, 20])
def test_a_lost_answer_in_an_upload_is_told_and_the_mirror_can_be_pointed(rig, after_frames):
    receive, count = rig.board.receive, [0]

    def receiving(data):
        if data[:1] == b"~":
            count[0] += 1
            if count[0] == after_frames + 1:
                rig.board.drop_answers = 1
        receive(data)

    rig.board.receive = receiving
    with rig.galvo() as mirror:
        with pytest.raises(LinkError, match="no answer came"):
            mirror.trajectory(way(60), TICK_S)
        mirror.point(0.05, 0.05)
        mirror.wait_settled(timeout_s=0.1)
        assert rig.bench.position_rad == pytest.approx((0.05, 0.05), abs=1e-8)
        mirror.trajectory(way(60), TICK_S)


def test_a_wrong_checksum_is_told_and_the_next_command_works(rig):
    with rig.galvo() as mirror:
        mirror.trajectory(way(5), TICK_S)
        rig.board.garble_answers = 1
        with pytest.raises(ProtocolError, match=r"came, and its (checksum|length) is wrong"):
            mirror.status()
        assert mirror.status() & ~board_bits.NOT_STABLE == 0


def test_samples_that_read_back_otherwise_are_told(rig):
    """A bit that flipped on its way to the board, in a frame without a checksum."""
    receive = rig.board.receive

    def receiving(data):
        if data[:3] == b"~\x00\x14":
            data = data[:12] + bytes([data[12] ^ 0x04]) + data[13:]
        receive(data)

    rig.board.receive = receiving
    with rig.galvo() as mirror:
        with pytest.raises(ProtocolError, match="keep samples 0 to 9, but it reads back"):
            mirror.trajectory(way(10), TICK_S)
        mirror.point(0.0, 0.1)


def test_a_board_with_less_memory_says_so(rig):
    small = type(rig.board)(rig.bench, memory=30)
    rig.board.receive, rig.board.output = small.receive, small.output
    with rig.galvo() as mirror, pytest.raises(RefusedError, match=r"vector index out of range \(0x0107\)"):
        mirror.trajectory(way(20), TICK_S)


@pytest.mark.parametrize(
    ("angles", "tick_s", "words"),
    [
        (np.empty((0, 2)), TICK_S, "memory holds from 1 to 8191"),
        (np.zeros((8192, 2)), TICK_S, "memory holds from 1 to 8191"),
        (np.array([[0.0, 0.0], [0.0, 0.3]]), TICK_S, "limit is 0.2800"),
        (np.array([[0.0, np.nan]]), TICK_S, "point y to nan"),
        (np.zeros((4, 2)), 0.1e-3, "needs two readings"),
    ],
)
def test_what_cannot_be_followed_is_refused_unsent(rig, angles, tick_s, words):
    with rig.galvo() as mirror:
        mirror.point(0.1, 0.1)
        heard = []
        receive = rig.board.receive
        rig.board.receive = lambda data: (heard.append(data), receive(data))
        with pytest.raises(LimitError, match=words):
            mirror.trajectory(angles, tick_s)
        assert heard == []


def test_the_longest_trajectory_of_a_board_is_known_without_it():
    assert OptotuneLimits().longest_trajectory == 8191
    assert OptotuneLimits(memory_samples=100).longest_trajectory == 49


def test_how_long_loading_takes_is_estimated_by_what_goes_over_the_wire(rig):
    """But for what is escaped, a byte in 128, and some dozen exchanges beside the positions."""
    carried = 0
    receive = rig.board.receive

    def receiving(data):
        nonlocal carried
        before = len(rig.board.output)
        receive(data)
        carried += len(data) + len(rig.board.output) - before

    with rig.galvo() as mirror:
        rig.board.receive = receiving
        mirror.trajectory(way(2000), TICK_S)
        assert mirror.loading_s(2000) == pytest.approx(carried * 10 / 256_000, rel=0.03)
    assert mirror.loading_s(8191) == pytest.approx(7.6, abs=0.1)


def test_a_board_that_leaves_pro_mode_without_a_word_will_do(rig):
    """Whether it answers is unconfirmed."""
    receive = rig.board.receive

    def receiving(data):
        if data == framed(0x06, bytes(2)):
            rig.board.drop_answers = 1
        receive(data)

    rig.board.receive = receiving
    with rig.galvo() as mirror:
        mirror.trajectory(way(5), TICK_S)
        mirror.point(0.1, 0.1)
        mirror.wait_settled(timeout_s=0.1)
    assert rig.bench.target_rad == (0.0, 0.0)


NOISE = st.binary(max_size=40) | st.builds(
    lambda command, payload: galvo_frames.answer(command, payload),
    st.sampled_from([0x11, 0x91, 0x12, 0x92, 0x15]),
    st.binary(max_size=12),
)


@given(st.lists(NOISE, max_size=4))
def test_whatever_a_board_in_pro_mode_says_is_an_answer_or_a_device_error(pieces):
    class Noise:
        """Says the same to everything."""

        def __init__(self):
            self.output = bytearray()

        def receive(self, data):
            self.output += b"".join(pieces)

    clock = BenchClock()
    address = protocol_sim.attach("test/noise", Noise(), clock)
    line = SerialLine(address, device="mirror", baudrate=9600, terminator=b"\r\n", timeout_s=0.01)
    try:
        line.open()
        pro = ProMode(line)
        for ask in (
            lambda: pro.value(0x1007),
            lambda: pro.vector(0x2600, 0, 3),
            lambda: pro.set({0x4000: 1}),
        ):
            try:
                ask()
            except (LinkError, ProtocolError, RefusedError):
                continue
    finally:
        protocol_sim.detach(address)


def asked(board, command, payload):
    """Send one frame, and return the board's answer."""
    board.receive(framed(command, payload))
    frame = parsed(bytes(board.output)[1:-1])
    board.output.clear()
    return frame


@pytest.mark.parametrize(
    ("command", "payload", "error"),
    [
        (0x10, struct.pack(">Hf", 0x5002, 1.5), 0x0103),
        (0x10, struct.pack(">Hf", 0x5002, float("nan")), 0x0103),
        (0x10, struct.pack(">Hi", 0x3B00, 0), 0x0106),
        (0x10, struct.pack(">Hi", 0x1007, 0), 0x0106),
        (0x10, struct.pack(">Hi", 0x680A, 0), 0x0106),
        (0x10, struct.pack(">Hi", 0x6899, 0), 0x0101),
        (0x10, struct.pack(">Hi", 0x4000, 0x99), 0x0202),
        (0x10, struct.pack(">Hi", 0x6803, 16384), 0x0103),
        (0x10, struct.pack(">Hi", 0x6801, 1), 0x0005),
        (0x10, b"\x50", 0x0003),
        (0x11, struct.pack(">H", 0x9900), 0x0101),
        (0x12, struct.pack(">HHf", 2, 0x5002, 0.1), 0x0003),
        (0x14, struct.pack(">HHBf", 0x2600, 0xFFFC, 8, 0.1) + bytes(4), 0x0107),
        (0x14, struct.pack(">HHBf", 0x2600, 2, 4, 0.1), 0x0108),
        (0x14, struct.pack(">HHBf", 0x2600, 0, 8, 0.1), 0x0003),
        (0x15, struct.pack(">HHB", 0x2700, 0, 8), 0x0101),
        (0x33, b"", 0x0002),
        (0x06, b"\x00\x07", 0x0103),
    ],
)
def test_the_board_names_what_is_wrong(rig, command, payload, error):
    rig.board.receive(b"GOPRO\r\n")
    rig.board.output.clear()
    assert asked(rig.board, command, payload) == (command | 0x80, error.to_bytes(4, "big"))
    assert rig.bench.target_rad == (0.0, 0.0)


def test_several_registers_are_set_and_read_at_once_or_not_at_all(rig):
    rig.board.receive(b"GOPRO\r\n")
    rig.board.output.clear()
    both = struct.pack(">3H", 2, static_xy(0), static_xy(1))
    assert asked(rig.board, 0x12, both + struct.pack(">2f", 0.25, -0.5)).command == 0x12
    assert asked(rig.board, 0x13, both).payload == struct.pack(">2f", 0.25, -0.5)
    rig.bench.clock.sleep(0.1)
    assert np.tan(rig.bench.position_rad) == pytest.approx(board_bits.TAN_PER_UNIT * np.array([0.25, -0.5]))
    measured = struct.unpack(">f", asked(rig.board, 0x11, b"\x3b\x01").payload)
    assert measured == pytest.approx((-0.5,))
    assert asked(rig.board, 0x12, both + struct.pack(">2f", 0.1, 7.0)).command == 0x92
    assert asked(rig.board, 0x13, both).payload == struct.pack(">2f", 0.25, -0.5)


@pytest.mark.parametrize(
    ("cycles", "trigger", "expected"),
    [(-1, 2, [0, 1, 2, 0, 1, 2, 0]), (2, 2, [0, 1, 2, 0, 1, 2, 2]), (-1, 1, [1, 0, 2, 1, 0, 2, 1])],
)
def test_a_pattern_goes_round_as_often_as_it_is_told(rig, cycles, trigger, expected):
    """With both edges a pulse is two steps."""
    rig.board.receive(b"GOPRO\r\n")
    rig.board.output.clear()
    samples = (0.1, 0.2, 0.3)
    asked(rig.board, 0x14, struct.pack(">HHB3f", 0x2600, 0, 12, *samples))
    registers = {0x6802: 0, 0x6803: 2, 0x6807: cycles, 0x6808: trigger, 0x6801: 1, 0x4000: 0x68}
    for register, value in registers.items():
        assert asked(rig.board, 0x10, struct.pack(">Hi", register, value)).command == 0x10
    times_s = run_ticks(rig, 7)
    rig.bench.clock.sleep(1.0)
    targets = [rig.bench.mirror.target(t + 1e-6)[0] for t in times_s]
    steps = [samples.index(pytest.approx(np.tan(t) / board_bits.TAN_PER_UNIT)) for t in targets]
    assert steps == expected
