"""An analogue galvo on a DAQ board, alone and together with the point clock on the same board."""

import inspect
from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.daq.analogue_galvo import AnalogueGalvo, AnalogueLimits, Settling
from drivers.daq.board import SharedBoard
from drivers.daq.point_clock import DaqPointClock, PulseLines
from drivers.errors import DeviceNotFoundError, LimitError, LinkError, RefusedError
from rig.acquire.connect import open_devices
from rig.errors import ConfigError
from rig.model import devices
from rig.model.config import built_in_with
from simulators.bench import Bench
from simulators.motion.mirror import SteeringMirror
from simulators.wire.daq import STEP_V, DaqWiring, SimulatedBoard

LINES = PulseLines(("port0/line0", "port0/line1", "port0/line2"))

#: Half a step of the board's outputs (16 bits of 20 V) as an angle of the beam, at 0.5 V a degree [rad].
ROUNDING = 2 * radians(STEP_V / 2 / 0.5) * 1.001


class Desk:
    """A board on a bench, with a galvo and a point clock."""

    def __init__(self, scale: tuple[float, float] = (0.5, 0.5)) -> None:
        self.bench = Bench()
        self.bench.mirror = SteeringMirror(natural_frequency_hz=2500.0)
        self.board = SimulatedBoard(self.bench, DaqWiring(LINES.markers, None, ("ao0", "ao1"), scale))
        self.board.start_after_s = 0.0  # what comes when is counted from the start
        shared = SharedBoard(self.board)
        self.clock = DaqPointClock(shared, LINES)
        self.galvo = AnalogueGalvo(
            shared,
            ("ao0", "ao1"),
            clock=self.bench.clock,
            limits=AnalogueLimits((radians(20), radians(15)), scale),
            settling=Settling(1e-3, 20e-3),
        )

    def target(self) -> tuple[float, float]:
        return self.bench.target_rad


@pytest.fixture
def desk():
    return Desk()


def test_it_is_what_the_application_asks_for(desk):
    with desk.galvo as galvo:
        for member, asked in inspect.getmembers(devices.SweepingGalvo, inspect.isfunction):
            if not member.startswith("_"):
                offered = inspect.signature(getattr(galvo, member))
                assert list(offered.parameters) == list(inspect.signature(asked).parameters)[1:], member
        assert galvo.longest_trajectory == 5_000_000


@given(
    x=st.floats(-radians(20), radians(20)),
    y=st.floats(-radians(15), radians(15)),
    scale=st.sampled_from([(0.5, 0.5), (0.8, 0.8), (1.0, 1.0), (-0.5, 0.8)]),
)
def test_an_angle_goes_through_volts_and_comes_back(x, y, scale):
    desk = Desk(scale)
    with desk.galvo as galvo:
        galvo.point(x, y)
        assert desk.target() == pytest.approx((x, y), abs=ROUNDING)


def test_volts_are_those_of_the_mechanical_angle():
    limits = AnalogueLimits((radians(40), radians(40)), (0.5, -0.8))
    # 10 degrees of the beam are 5 degrees of the mirror: 2.5 V, and 4 V the other way round
    assert limits.volts(np.radians([10.0, 10.0])) == pytest.approx([2.5, -4.0])


def test_it_is_found_and_left_in_the_middle(desk):
    desk.board.set_volts(("ao0", "ao1"), (1.0, -1.0))
    with desk.galvo as galvo:
        assert desk.target() == (0.0, 0.0)
        galvo.point(0.1, 0.1)
    assert desk.target() == (0.0, 0.0)


def test_after_a_failure_it_stays_where_it_is(desk):
    def fail():
        with desk.galvo as galvo:
            galvo.point(0.1, 0.05)
            raise KeyError

    with pytest.raises(KeyError) as raised:
        fail()
    assert desk.target() == pytest.approx((0.1, 0.05), abs=ROUNDING)
    assert not hasattr(raised.value, "__notes__")


@pytest.mark.parametrize("angles", [(0.36, 0.0), (0.0, -0.27), (float("nan"), 0.0), (0.0, float("inf"))])
def test_an_angle_outside_is_refused_unsent(desk, angles):
    with desk.galvo as galvo:
        galvo.point(0.1, 0.1)
        with pytest.raises(LimitError, match=r"asked to point [xy] to .*Nothing was sent"):
            galvo.point(*angles)
        assert desk.target() == pytest.approx((0.1, 0.1), abs=ROUNDING)


def test_more_than_ten_volts_are_refused_unsent():
    limits = AnalogueLimits((radians(45), radians(45)), (0.5, 0.5))
    assert limits.volts(np.radians([40.0, -40.0])) == pytest.approx([10.0, -10.0])
    with pytest.raises(LimitError, match=r"point by 10\.03 V.*10 V to either side"):
        limits.volts(np.radians([40.1, 0.0]))


@pytest.mark.parametrize(
    ("step_deg", "takes_s"),
    # from 1 ms for no step to 20 ms for the 40 degrees between the limits
    [(0.0, 1e-3), (0.23, 1e-3 + 19e-3 * 0.23 / 40), (20.0, 1e-3 + 19e-3 / 2)],
)
def test_it_waits_longer_after_a_longer_step(desk, step_deg, takes_s):
    with desk.galvo as galvo:
        galvo.wait_settled(1.0)
        began_s = desk.bench.clock.now_s()
        galvo.point(radians(step_deg), 0.0)
        galvo.wait_settled(1.0)
        assert desk.bench.clock.now_s() - began_s == pytest.approx(takes_s, rel=1e-9)
        galvo.wait_settled(0.0)
        assert desk.bench.settled


def test_a_second_step_does_not_cut_the_wait_of_the_first(desk):
    with desk.galvo as galvo:
        galvo.wait_settled(1.0)
        galvo.point(radians(20), 0.0)
        galvo.point(radians(20), 0.0)
        galvo.wait_settled(1.0)
        assert desk.bench.clock.now_s() == pytest.approx(20e-3 + 1e-3 + 19e-3 / 2, rel=1e-9)


def test_a_wait_beyond_the_timeout_is_refused(desk):
    with desk.galvo as galvo:
        galvo.wait_settled(1.0)
        galvo.point(radians(20), 0.0)
        with pytest.raises(RefusedError, match=r"settle within 0\.001 s, but .* 0\.0105 s more"):
            galvo.wait_settled(1e-3)


def test_its_settings_say_that_nothing_is_read_back(desk):
    with desk.galvo as galvo:
        galvo.point(0.1, -0.1)
        settings = galvo.settings()
    assert settings["identity"] == galvo.identity
    assert settings["settling"] == "a fixed waiting time, not read back"
    assert (settings["angle_x_rad"], settings["volts_per_degree_y"]) == (0.1, 0.5)
    assert all(type(value) in (str, int, float, bool) for value in settings.values())


def path(n: int) -> np.ndarray:
    """Return n positions along a line, 4 mrad apart, as 1 cm on a wall at 2.5 m."""
    return np.stack([4e-3 * (np.arange(n) - n / 2), np.full(n, 0.05)], axis=1)


def test_galvo_and_point_clock_go_together(desk):
    """At each mark the mirror is commanded to that tick's position, by the same clock."""
    angles, tick_s = path(50), 1e-3
    desk.board.clock_error = 2e-3  # so that two clocks would be seen: 0.1 ms at the end
    with desk.galvo as galvo, desk.clock as clock:
        galvo.trajectory(angles, tick_s)
        assert desk.target() == pytest.approx(tuple(angles[0]), abs=ROUNDING)
        galvo.wait_settled(1.0)
        clock.load(np.ones(50, np.uint8), tick_s)
        began_s = desk.bench.clock.now_s()
        clock.start()
        mirror = desk.bench.mirror
        for k, at_s in enumerate(began_s + np.arange(50) * tick_s * 1.002):
            assert mirror.target(at_s + 1e-9) == pytest.approx(tuple(angles[k]), abs=ROUNDING)
            assert k == 0 or mirror.target(at_s - 1e-9) == pytest.approx(tuple(angles[k - 1]), abs=ROUNDING)
        marks = [mark.at_s for mark in desk.bench.take_marks(np.inf)]
        assert marks == pytest.approx(began_s + np.arange(50) * tick_s * 1.002, abs=1e-12)
        desk.bench.clock.sleep(1.0)
        assert not clock.running()
        assert desk.target() == pytest.approx(tuple(angles[-1]), abs=ROUNDING)  # it stays at the last


def test_pointing_ends_a_trajectory_and_not_the_ticks(desk):
    with desk.galvo as galvo, desk.clock as clock:
        galvo.trajectory(path(50), 1e-3)
        clock.load(np.ones(50, np.uint8), 1e-3)
        clock.start()
        desk.bench.clock.sleep(10.5e-3)
        galvo.point(0.1, 0.1)
        desk.bench.clock.sleep(20e-3)
        assert desk.target() == pytest.approx((0.1, 0.1), abs=ROUNDING)
        assert clock.running()
        galvo.wait_settled(1.0)
    assert len(desk.bench.take_marks(np.inf)) > 30


def test_pointing_before_the_start_drops_the_trajectory(desk):
    with desk.galvo as galvo, desk.clock as clock:
        galvo.trajectory(path(50), 1e-3)
        galvo.point(0.1, 0.1)
        clock.load(np.ones(3, np.uint8), 1e-3)
        clock.start()
        desk.bench.clock.sleep(2e-3)
        assert desk.target() == pytest.approx((0.1, 0.1), abs=ROUNDING)


def test_a_stop_leaves_the_mirror_where_it_is(desk):
    with desk.galvo as galvo, desk.clock as clock:
        galvo.trajectory(path(50), 1e-3)
        clock.load(np.ones(50, np.uint8), 1e-3)
        clock.start()
        desk.bench.clock.sleep(10.5e-3)
        clock.stop()
        desk.bench.clock.sleep(1.0)
        assert desk.target() == pytest.approx(tuple(path(50)[10]), abs=ROUNDING)


@pytest.mark.parametrize(("positions", "tick_s"), [(49, 1e-3), (50, 2e-3)])
def test_a_trajectory_that_does_not_fit_the_marks_is_refused_unsent(desk, positions, tick_s):
    with desk.galvo as galvo, desk.clock as clock:
        galvo.trajectory(path(positions), tick_s)
        clock.load(np.ones(50, np.uint8), 1e-3)
        with pytest.raises(LimitError, match="as many positions as marks"):
            clock.start()
        assert not clock.running()
    assert not desk.bench.take_marks(np.inf)


@pytest.mark.parametrize(
    ("angles", "tick_s", "why"),
    [
        (np.empty((0, 2)), 1e-3, "shape"),
        (np.zeros((3, 3)), 1e-3, "shape"),
        (np.zeros(3), 1e-3, "shape"),
        (np.array([[0.0, 0.0], [0.5, 0.0]]), 1e-3, "point x to 0.5000 rad"),
        (np.array([[0.0, 0.0], [0.0, np.nan]]), 1e-3, "point y to nan rad"),
        (np.zeros((3, 2)), 1e-6, "the board needs at least 2.38e-06 s"),
        (np.zeros((3, 2)), np.nan, "move every nan s"),
    ],
)
def test_a_trajectory_that_cannot_be_is_refused_unsent(desk, angles, tick_s, why):
    with desk.galvo as galvo:
        galvo.point(0.1, 0.1)
        with pytest.raises(LimitError, match=why):
            galvo.trajectory(angles, tick_s)
        assert desk.target() == pytest.approx((0.1, 0.1), abs=ROUNDING)


def test_unplugged_is_an_error_of_ours(desk):
    def work():
        with desk.galvo as galvo:
            desk.board.unplug()
            galvo.point(0.1, 0.1)

    with pytest.raises(LinkError, match=r"analogue galvo|DAQ board"):
        work()


def test_an_absent_board_is_named(desk):
    desk.board.unplug()
    with pytest.raises(DeviceNotFoundError, match="DAQ board Dev1: asked to report its identity"), desk.galvo:
        pass


def test_outside_its_with_block_it_says_so(desk):
    for use in (desk.galvo.settings, lambda: desk.galvo.point(0, 0), lambda: desk.galvo.wait_settled(1)):
        with pytest.raises(LinkError, match="with block"):
            use()


def test_a_rig_with_an_analogue_galvo_opens_and_tells_it():
    config = built_in_with({"galvo": {"kind": "analogue", "volts_per_degree": [0.8, -0.8]}})
    with open_devices(config) as opened:
        opened.galvo.point(0.1, 0.2)
        opened.galvo.wait_settled(config.galvo.settle_timeout_s)
        said = opened.read_back()["galvo"]
    assert said["identity"].startswith("analogue galvo, 0.8 and -0.8 V per degree, on NI")
    assert said["angle_y_rad"] == 0.2


@pytest.mark.parametrize(
    ("galvo", "why"),
    [
        ({"volts_per_degree": [1.0, 0.5]}, r"galvo: max_angle_x is 12\.5 V at volts_per_degree 1"),
        ({"volts_per_degree": [0.5, 0.0]}, r"galvo: max_angle_y is 0 V"),
        ({"volts_per_degree": [0.5, float("nan")]}, r"galvo: max_angle_y is nan V"),
        (
            {"volts_pre_degree": [0.5, 0.5]},
            "unknown key 'galvo.volts_pre_degree'; did you mean 'volts_per_degree'",
        ),
        ({"adress": "/dev/ttyACM0"}, "unknown key 'galvo.adress'"),
        ({"channels": ["ao1", "ao1"]}, r"galvo: channels: x and y are both ao1"),
        ({"device": "Dev2"}, r"point_clock\.device is Dev1, galvo\.device is Dev2: .* on the same board"),
    ],
)
def test_a_wrong_section_is_refused(galvo, why):
    with pytest.raises(ConfigError, match=why):
        built_in_with({"galvo": {"kind": "analogue", **galvo}})


def test_an_unknown_kind_is_told_the_known_ones():
    with pytest.raises(ConfigError, match=r"there is no kind galvanic; choose among .*'analogue'"):
        built_in_with({"galvo": {"kind": "galvanic"}})
