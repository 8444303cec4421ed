"""The steering mirror keeps its equation of motion, and lands."""

import numpy as np
import pytest
from scipy.optimize import brentq

from simulators.motion.mirror import HOLD, SteeringMirror

W = 2 * np.pi * 400.0


def integrate(commands, at_s, steps=40_000):
    """Runge and Kutta's fourth order on e'' = -2 w e' - w^2 e about the target in force, one axis."""
    position, rate, now_s = 0.0, 0.0, 0.0
    target = 0.0

    def slope(state):
        return np.array([state[1], -2 * W * state[1] - W**2 * (state[0] - target)])

    for (start_s, value), stop_s in zip(commands, [c[0] for c in commands[1:]] + [at_s], strict=True):
        assert start_s == now_s
        target = value
        n = max(int(steps * (stop_s - start_s) / at_s), 1)
        h = (stop_s - start_s) / n
        state = np.array([position, rate])
        for _ in range(n):
            k1 = slope(state)
            k2 = slope(state + h / 2 * k1)
            k3 = slope(state + h / 2 * k2)
            k4 = slope(state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        position, rate = state
        now_s = stop_s
    return position


@pytest.mark.parametrize("at_s", [0.4e-3, 0.9e-3, 1.6e-3])
def test_position_agrees_with_integration_through_a_change_of_mind(at_s):
    commands = [(0.0, 0.2), (0.3e-3, -0.1)]
    mirror = SteeringMirror()
    for start_s, value in commands:
        mirror.command(value, -value, start_s)
    # step w h = 1e-4: the method's error (w h)^4 is far below rounding of 4000 steps
    expected = integrate(commands, at_s, steps=4000)
    assert mirror.position(at_s) == pytest.approx((expected, -expected), abs=1e-10)


def test_it_starts_smoothly_and_never_overshoots():
    mirror = SteeringMirror()
    mirror.command(0.1, 0.0, 1e-3)
    assert mirror.position(1e-3) == (0.0, 0.0)
    travelled = np.array([mirror.position(1e-3 + t)[0] for t in np.linspace(0, 10e-3, 400)])
    assert (np.diff(travelled) >= 0).all()
    assert travelled.max() == 0.1


def test_it_lands_exactly_when_its_error_falls_below_hold():
    """The error of a step is step (1 + w t) exp(-w t); its rate falls below the limit before."""
    step = 0.01
    settled_s = brentq(lambda t: step * (1 + W * t) * np.exp(-W * t) - HOLD, 1e-4, 0.1)
    mirror = SteeringMirror()
    mirror.command(step, 0.0, 0.0)
    assert not mirror.settled(settled_s - 1e-6)
    assert mirror.settled(settled_s + 1e-6)
    assert mirror.position(settled_s + 1e-6) == (step, 0.0)
    assert 1e-3 < settled_s < 10e-3


def test_where_it_stands_does_not_depend_on_where_it_came_from():
    places = []
    for before in (-0.3, 0.0, 0.25):
        mirror = SteeringMirror()
        mirror.command(before, before, 0.0)
        mirror.command(0.0123, -0.0456, 2e-3)
        places.append(mirror.position(20e-3))
    assert places == [(0.0123, -0.0456)] * 3


def test_the_past_can_be_asked_until_it_is_forgotten():
    mirror = SteeringMirror()
    for i in range(5):
        mirror.command(0.01 * (i + 1), 0.0, 20e-3 * (i + 1))
    assert mirror.commands_between(20e-3, 80e-3) == pytest.approx([40e-3, 60e-3])
    before = [mirror.position(t) for t in (65e-3, 79e-3, 90e-3, 130e-3)]
    mirror.forget_before(65e-3)
    assert [mirror.position(t) for t in (65e-3, 79e-3, 90e-3, 130e-3)] == before
    assert mirror.commands_between(0.0, 1.0) == pytest.approx([60e-3, 80e-3, 100e-3])


def test_a_command_for_later_is_not_yet_the_target():
    mirror = SteeringMirror()
    mirror.follow([1.0, 2.0, 3.0], [(0.1, 0.0), (0.2, 0.0), (0.3, -0.1)])
    assert [mirror.target(t) for t in (0.5, 1.0, 2.5, 9.0)] == [(0, 0), (0.1, 0), (0.2, 0), (0.3, -0.1)]
    assert mirror.settled(0.5)
    assert not mirror.settled(2.001)
    assert mirror.settled(2.9)
    assert mirror.known_from_s == 0.0


def test_following_is_the_same_as_one_command_after_the_other():
    rng = np.random.default_rng(0)
    times_s, angles = 1e-3 * np.arange(1, 301), rng.uniform(-0.3, 0.3, (300, 2))
    at_once, one_by_one = SteeringMirror(), SteeringMirror()
    at_once.follow(times_s, angles)
    for at_s, (x, y) in zip(times_s, angles, strict=True):
        one_by_one.command(x, y, at_s)
    asked_s = rng.uniform(1e-3, 0.3, 1000)  # always moving
    places = at_once.positions(asked_s)
    assert places == pytest.approx(np.array([one_by_one.position(t) for t in asked_s]), abs=1e-15)
    assert len(np.unique(places[:, 0])) == 1000


def test_a_command_drops_what_is_still_to_come():
    mirror, other = SteeringMirror(), SteeringMirror()
    mirror.follow([1.0, 1.001, 1.002], [(0.1, 0.0), (0.2, 0.0), (0.3, 0.0)])
    mirror.command(-0.1, 0.1, 1.0015)
    for at_s, x, y in ((1.0, 0.1, 0.0), (1.001, 0.2, 0.0), (1.0015, -0.1, 0.1)):
        other.command(x, y, at_s)
    asked_s = np.linspace(0.9, 1.1, 2001)
    assert np.array_equal(mirror.positions(asked_s), other.positions(asked_s))
    assert mirror.target(9.0) == (-0.1, 0.1)


def test_many_commands_for_later_are_dropped_and_forgotten():
    mirror = SteeringMirror()
    mirror.follow(1.0 + 1e-3 * np.arange(30_000), np.tile([[0.1, 0.0], [0.0, 0.1]], (15_000, 1)))
    mirror.drop_after(21.0005)
    assert mirror.target(40.0) == (0.1, 0.0)
    assert mirror.commands_between(20.9975, 40.0) == pytest.approx([20.998, 20.999, 21.0])
    before = mirror.position(20.9991)
    mirror.forget_before(20.999)
    assert mirror.known_from_s == pytest.approx(20.999)
    assert mirror.position(20.9991) == before
    mirror.drop_after(0.0)  # the one in force is never dropped
    assert mirror.target(40.0) == (0.0, 0.1)
