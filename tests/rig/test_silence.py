"""What a program knows of its own silence, on a clock that is set by hand."""

import pytest

from rig.light.silence import TURN_S, Silence


@pytest.fixture
def time_s():
    return [100.0]


@pytest.fixture
def silence(time_s):
    return Silence(lambda: time_s[0])


def run(silence, time_s, turns):
    for _ in range(turns):
        time_s[0] += TURN_S
        silence.turn()


def test_a_program_that_runs_and_waits(silence, time_s):
    run(silence, time_s, 4)
    silence.ends()
    assert str(silence).startswith("it was silent for 2 s, in which it waited")


def test_a_program_that_does_not_run(silence, time_s):
    run(silence, time_s, 2)
    silence.ends()
    time_s[0] += 3.0  # in the middle of a turn
    silence.ends()
    assert "silent for 3 s, and did not run at all for at least 2.5 s" in str(silence)
    run(silence, time_s, 1)
    silence.ends()  # a shorter one
    assert "silent for 3 s, and did not run at all for at least 2.5 s" in str(silence)


def test_what_was_before_the_light_is_forgotten(silence, time_s):
    time_s[0] += 3.0
    silence.begin()
    silence.turn()
    time_s[0] += 0.3
    silence.ends()
    assert str(silence).startswith("it was silent for 0.3 s, in which it waited")
