"""The point clock on a DAQ board, at the methods by which the driver speaks to a board."""

import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.daq.board import Board, SharedBoard
from drivers.daq.nidaqmx_board import NidaqmxBoard
from drivers.daq.point_clock import DaqPointClock, PulseLines
from drivers.errors import DeviceNotFoundError, LimitError, LinkError, RefusedError
from rig.acquire.connect import open_devices
from rig.errors import ConfigError
from rig.model import devices
from rig.model.config import built_in, built_in_with
from simulators.bench import Bench
from simulators.wire.daq import DaqWiring, SimulatedBoard

LINES = PulseLines(("port0/line0", "port0/line1", "port0/line2", "port0/line3"), "port0/line4")
WIRING = DaqWiring(LINES.markers, LINES.step)


class Desk:
    """A board on a bench, and the point clock on it."""

    def __init__(self, lines: PulseLines = LINES) -> None:
        self.bench = Bench()
        self.board = SimulatedBoard(self.bench, WIRING)
        self.board.start_after_s = 0.0  # what comes when is counted from the start
        self.clock = DaqPointClock(SharedBoard(self.board), lines)
        self.ticks_s: list[float] = []
        self.bench.tick_listeners.append(lambda times_s: self.ticks_s.extend(times_s.tolist()))

    def marks(self) -> list[tuple[float, int]]:
        """Take the marks of all time: (time, mask)."""
        return [(mark.at_s, mark.mask) for mark in self.bench.take_marks(np.inf)]


@pytest.fixture
def desk():
    return Desk()


@pytest.mark.parametrize("kind", [SimulatedBoard, NidaqmxBoard])
def test_a_board_is_what_the_driver_asks_for(kind):
    for member, asked in inspect.getmembers(Board, inspect.isfunction):
        if not member.startswith("_"):
            assert list(inspect.signature(getattr(kind, member)).parameters) == list(
                inspect.signature(asked).parameters
            ), member


def test_it_is_what_the_application_asks_for(desk):
    with desk.clock as clock:
        for member, asked in inspect.getmembers(devices.PointClock, inspect.isfunction):
            if not member.startswith("_"):
                offered = inspect.signature(getattr(clock, member))
                assert list(offered.parameters) == list(inspect.signature(asked).parameters)[1:], member


@given(
    marks=st.lists(st.integers(0, 15), min_size=1, max_size=60),
    tick_s=st.sampled_from([1e-5, 1e-3, 0.37]),
    step=st.sampled_from([None, "port0/line4"]),
)
def test_each_mark_comes_with_its_tick(marks, tick_s, step):
    desk = Desk(PulseLines(LINES.markers, step))
    desk.bench.clock.sleep(1.0)
    with desk.clock as clock:
        clock.load(np.array(marks, np.uint8), tick_s)
        clock.start()
        came = desk.marks()
    expected = [(1.0 + k * tick_s, mask) for k, mask in enumerate(marks) if mask]
    assert [mask for _, mask in came] == [mask for _, mask in expected]
    # rounding alone: a hundred ticks of up to 0.37 s, in numbers of 16 digits
    assert [at for at, _ in came] == pytest.approx([at for at, _ in expected], abs=1e-12)
    if step:
        assert desk.ticks_s == pytest.approx([1.0 + k * tick_s for k in range(len(marks))], abs=1e-12)


def test_a_tick_without_a_mark_steps_the_mirror_too(desk):
    with desk.clock as clock:
        clock.load(np.array([0, 0, 3, 0, 1, 0], np.uint8), 1e-3)
        clock.start()
    assert desk.ticks_s == pytest.approx([0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3])


def test_it_runs_as_long_as_its_ticks_last(desk):
    with desk.clock as clock:
        assert not clock.running()
        clock.load(np.ones(10, np.uint8), 1e-3)
        assert not clock.running()
        clock.start()
        assert clock.running()
        desk.bench.clock.sleep(9.5e-3)
        assert clock.running()
        desk.bench.clock.sleep(1e-3)
        assert not clock.running()


def test_a_stop_takes_what_is_still_to_come(desk):
    with desk.clock as clock:
        clock.load(np.ones(100, np.uint8), 1e-3)
        clock.start()
        desk.bench.clock.sleep(10.5e-3)
        clock.stop()
        clock.stop()
        assert not clock.running()
        assert len(desk.marks()) == 11
        with pytest.raises(LimitError, match="nothing is loaded"):
            clock.start()


def test_marks_are_played_once(desk):
    with desk.clock as clock:
        clock.load(np.ones(3, np.uint8), 1e-3)
        clock.start()
        desk.bench.clock.sleep(1)
        with pytest.raises(LimitError, match="nothing is loaded"):
            clock.start()


def test_leaving_ends_the_ticks(desk):
    with desk.clock as clock:
        clock.load(np.ones(100, np.uint8), 1e-3)
        clock.start()
    desk.bench.clock.sleep(1)
    assert len(desk.marks()) == 1


def test_an_exception_goes_through_unchanged_and_ends_the_ticks(desk):
    problem = KeyError("theirs")

    def fail():
        with desk.clock as clock:
            clock.load(np.ones(100, np.uint8), 1e-3)
            clock.start()
            raise problem

    with pytest.raises(KeyError) as raised:
        fail()
    assert raised.value is problem
    assert not hasattr(problem, "__notes__")
    assert len(desk.marks()) == 1


@pytest.mark.parametrize(
    ("marks", "tick_s", "why"),
    [
        (np.empty(0, np.uint8), 1e-3, "give 0 ticks"),
        (np.ones((2, 2), np.uint8), 1e-3, "in a one-dimensional array"),
        (np.ones(5_000_001, np.uint8), 1e-3, "give 5000001 ticks"),
        (np.ones(3, np.uint8), 1e-7, "2e-07 s to 60 s"),
        (np.ones(3, np.uint8), 61.0, "2e-07 s to 60 s"),
        (np.ones(3, np.uint8), float("nan"), "tick every nan s"),
        (np.ones(3, np.uint8), -1.0, "tick every -1 s"),
        (np.array([16], np.uint8), 1e-3, "only 4 have a line"),
    ],
)
def test_what_the_board_cannot_give_is_refused_unsent(desk, marks, tick_s, why):
    with desk.clock as clock:
        with pytest.raises(LimitError, match=why):
            clock.load(marks, tick_s)
        with pytest.raises(LimitError, match="nothing is loaded"):
            clock.start()
    assert not desk.marks()


def test_a_marker_input_without_a_line_is_refused():
    desk = Desk(PulseLines(("port0/line0", "port0/line1")))
    with desk.clock as clock, pytest.raises(LimitError, match=r"mark inputs 0101.*only 2 have a line"):
        clock.load(np.array([1, 4], np.uint8), 1e-3)


def test_a_line_that_does_not_exist_is_named():
    desk = Desk(PulseLines(("port7/line0",)))
    with pytest.raises(DeviceNotFoundError, match=r"port7/line0 \(-200170\)"), desk.clock:
        pass


def test_a_board_without_buffered_lines_is_named(desk):
    desk.board.buffered_lines = False
    with desk.clock as clock:
        clock.load(np.ones(3, np.uint8), 1e-3)
        with pytest.raises(
            RefusedError, match=r"Buffered operations are not supported.*-201062.*point-clock"
        ):
            clock.start()


def test_an_absent_board_is_named(desk):
    desk.board.unplug()
    with pytest.raises(DeviceNotFoundError, match="DAQ board Dev1: asked to report its identity"), desk.clock:
        pass


def test_unplugged_while_it_ticks_is_an_error_of_ours(desk):
    def work():
        with desk.clock as clock:
            clock.load(np.ones(100, np.uint8), 1e-3)
            clock.start()
            desk.bench.clock.sleep(10.5e-3)
            desk.board.unplug()
            clock.running()

    with pytest.raises(LinkError, match=r"keep playing, but NI-DAQmx says.*-201003") as raised:
        work()
    assert len(desk.marks()) == 11
    assert len(raised.value.__notes__) == 2  # neither a stop nor low lines were possible, and that is said


def test_it_connects_again_after_it_was_unplugged(desk):
    desk.board.unplug()
    desk.board.plug_in()
    with desk.clock as clock:
        assert clock.settings()["identity"] == clock.identity


def test_outside_its_with_block_it_says_so(desk):
    for use in (desk.clock.settings, desk.clock.start, desk.clock.running, desk.clock.stop):
        with pytest.raises(LinkError, match="with block"):
            use()


def test_a_slow_clock_ticks_late(desk):
    desk.board.clock_error = 50e-6
    with desk.clock as clock:
        clock.load(np.ones(1001, np.uint8), 1e-3)
        clock.start()
        # 50 ppm of a second, and rounding
        assert desk.marks()[-1][0] == pytest.approx(1.00005, abs=1e-10)


def test_lost_and_double_markers_come_so(desk):
    desk.board.lost_marks, desk.board.double_marks = {1}, {3}
    with desk.clock as clock:
        clock.load(np.array([7, 1, 1, 1], np.uint8), 1e-3)
        clock.start()
        assert desk.marks() == [
            (0.0, 7),
            (pytest.approx(2e-3), 1),
            (pytest.approx(3e-3), 1),
            (pytest.approx(3e-3 + 2e-6), 1),
        ]
    assert len(desk.ticks_s) == 4


def test_the_built_in_rig_has_one():
    with open_devices(built_in(), tagged=True) as opened:
        assert opened.identities()["point_clock"] == opened.point_clock.identity
        assert opened.read_back()["point_clock"]["step_line"] == "port0/line4"


def test_a_rig_without_one_opens_too():
    config = built_in_with({"simulation": {"scene": "letters"}}).model_copy(update={"point_clock": None})
    with open_devices(config, tagged=True) as opened:
        assert opened.point_clock is None
        assert "point_clock" not in opened.read_back()


def test_two_pulses_on_one_line_are_refused():
    with pytest.raises(ConfigError, match=r"point_clock: two pulses go to port0/line1"):
        built_in_with({"point_clock": {"step": "port0/line1"}})
