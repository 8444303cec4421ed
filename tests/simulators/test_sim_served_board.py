"""The DAQ board of a served bench, over its socket."""

import json
import socket
import threading
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.daq.analogue_galvo import AnalogueGalvo, AnalogueLimits
from drivers.daq.board import SharedBoard
from drivers.daq.point_clock import DaqPointClock, PulseLines
from drivers.errors import DeviceNotFoundError, LimitError, LinkError, RefusedError
from rig.bench.reached import board_at
from simulators.bench import Bench
from simulators.wire.daq import STEP_V, DaqWiring, SimulatedBoard
from simulators.wire.harp import Timing
from simulators.wire.served import NO_REQUEST
from simulators.wire.served.board import BoardAnswers, ServedBoard
from simulators.wire.served.server import BenchServer
from simulators.wire.served.timing import TimingFaults

#: Half a step of the board's outputs (16 bits of 20 V) as an angle of the beam, at 0.5 V a degree [rad].
ROUNDING = 2 * np.radians(STEP_V / 2 / 0.5) * 1.001

LINES = PulseLines(("port0/line0", "port0/line1", "port0/line2"), "port0/line4")
WIRING = DaqWiring(LINES.markers, LINES.step, ("ao0", "ao1"), (0.5, -0.8))


@contextmanager
def served():
    """Serve a bench; give it and its address."""
    bench = Bench()  # its clock stands still while nobody sleeps: what comes when is exact
    with BenchServer(bench, TimingFaults(Timing(), 65535), WIRING) as server:
        loop = threading.Thread(target=server.run)
        loop.start()
        try:
            yield bench, server.addresses.timing
        finally:
            server.stop()
            loop.join(20)


def galvo_on(board, bench) -> AnalogueGalvo:
    limits = AnalogueLimits(volts_per_degree=WIRING.volts_per_degree)
    return AnalogueGalvo(board, ("ao0", "ao1"), clock=bench.clock, limits=limits)


def test_marks_and_positions_arrive_as_they_were_sent():
    angles = np.radians([[4.0, 0.0], [8.0, -4.0], [8.0, 4.0]])
    with (
        served() as (bench, address),
        board_at(address) as board,
        galvo_on(board, bench) as galvo,
        DaqPointClock(board, LINES) as clock,
    ):
        assert clock.identity.startswith("NI PCIe-6343 simulated")
        galvo.trajectory(angles, 1e-3)
        assert bench.target_rad == pytest.approx(angles[0], abs=ROUNDING)
        clock.load(np.array([7, 0, 1], np.uint8), 1e-3)
        clock.start()
        assert clock.running()
        marks = bench.take_marks(np.inf)
        assert [mark.mask for mark in marks] == [7, 1]
        assert marks[1].at_s - marks[0].at_s == pytest.approx(2e-3, abs=1e-12)
        bench.clock.sleep(1.0)
        assert not clock.running()
        assert bench.target_rad == pytest.approx(angles[2], abs=ROUNDING)


def test_as_much_as_it_says_is_played_and_no_more():
    rng = np.random.default_rng(0)
    with (
        served() as (bench, address),
        board_at(address) as board,
        galvo_on(board, bench) as galvo,
        DaqPointClock(board, LINES) as clock,
    ):
        ticks = galvo.longest_trajectory
        assert ticks == 100_000  # four times the paper's scan
        galvo.trajectory(rng.uniform(-0.2, 0.2, (ticks, 2)), 1e-3)  # what cannot be compressed
        clock.load(rng.integers(0, 8, ticks).astype(np.uint8), 1e-3)
        clock.start()
        assert bench.ticks_end_s - bench.clock.now_s() == pytest.approx(100.0, abs=0.5)
        with pytest.raises(LimitError, match="give 100001 ticks"):
            clock.load(np.ones(ticks + 1, np.uint8), 1e-3)
        clock.stop()
        levels = np.zeros((2 * ticks + 1, 1), np.bool_)
        board.load_lines(("port0/line0",), levels, 2000.0)
        with pytest.raises(RefusedError, match=r"Not enough memory.*-50352"):
            board.start()


def test_what_the_board_refuses_comes_with_its_code():
    with served() as (_, address), board_at(address) as board:
        with pytest.raises(DeviceNotFoundError, match=r"port9/line0.*-200170"):
            board.set_lines(("port9/line0",), False)
        with pytest.raises(RefusedError, match=r"too large or too small.*-200561"):
            board.set_volts(("ao0", "ao1"), (11.0, 0.0))


def test_ticks_end_with_the_program_that_started_them():
    with served() as (bench, address):
        with board_at(address) as board:
            board.load_lines(LINES.all, LINES.levels(np.ones(100, np.uint8)), 2000.0)
            board.start()
            assert bench.ticks_end_s > bench.clock.now_s()
        with board_at(address) as other:
            for _ in range(1000):  # the server learns of it in its own time
                if not other.playing():
                    break
            assert not other.playing()
            other.set_lines(LINES.all, False)


def test_without_a_server_it_is_said():
    with pytest.raises(DeviceNotFoundError, match="Start rig sim serve"), board_at("/nowhere/timing"):
        pass


def test_a_server_that_goes_away_is_told():
    with served() as (_, address), ServedBoard(address) as there:
        board = SharedBoard(there)
        assert not board.playing()
        there._bench._socket.shutdown(socket.SHUT_RDWR)  # as when the server's process is gone
        with pytest.raises(LinkError, match=r"the served bench (is gone|was asked)"):
            board.playing()


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)
KEYS = ["names", "values", "rate_hz", "samples", "lines", "levels", "channels", "volts", "analogue"]
CALLS = ["identity", "fastest_hz", "set_lines", "set_volts", "play", "playing", "stop", "burn"]
NAMES = st.lists(st.sampled_from(["port0/line0", "port0/line4", "ao0", "ao1", "ai7"]), max_size=3)


@given(
    call=st.sampled_from(CALLS),
    names=NAMES,
    rest=st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=9),
    rate_hz=st.floats() | st.integers(),
    samples=st.integers(-1, 3),
)
def test_every_request_is_answered_or_is_none(call, names, rest, rate_hz, samples):
    """Whatever comes, the bench goes on: the server answers an error for what `NO_REQUEST` names."""
    bench = Bench()
    answers = BoardAnswers(SimulatedBoard(bench, WIRING))
    request = {"names": names, "lines": names, "rate_hz": rate_hz, "samples": samples, **rest, "call": call}
    try:
        answer = answers.tell(request)
    except NO_REQUEST:
        pass
    else:
        json.dumps(answer)
        assert set(answer) <= {"told", "refused"}
    assert np.isfinite(bench.target_rad).all()
    answers.leave()


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf"), 1e-300, 1e9])
def test_a_rate_that_no_board_has_is_refused(rate_hz):
    board = SimulatedBoard(Bench(), WIRING)
    with pytest.raises(Exception, match=r"Sample rate is (larger|smaller)") as refused:
        board.play(rate_hz, LINES.all, LINES.levels(np.ones(3, np.uint8)), (), np.empty((0, 0)))
    assert refused.value.error_code in (-200332, -200331)
