"""The guard of the laser as a machine of states, on a scripted laser and a clock that is set by hand."""

import pytest

from drivers.errors import LinkError, RefusedError
from rig.errors import LightLostError
from rig.light.guard import LONGEST_LEASE_S, LOOK_S, Guard, Light
from rig.light.guarded import GuardedHere
from rig.light.words import as_error, from_words


class ScriptedLaser:
    """Emits when told to, unless something is wrong with it."""

    identity = "scripted"

    def __init__(self):
        self.lit = False
        self.mute = False  # answers nothing
        self.stuck = False  # does not obey
        self.stops = 0

    def arm(self):
        pass

    def emit(self):
        self.lit = True

    def stop(self):
        self.stops += 1
        if self.mute:
            raise LinkError("laser", "be dark", "no answer came", "Look.")
        if self.stuck:
            raise RefusedError("laser", "be dark", "it reports that it still emits", "Look.")
        self.lit = False

    def emitting(self):
        if self.mute:
            raise LinkError("laser", "report whether it emits", "no answer came", "Look.")
        return self.lit

    def settings(self):
        return {}


class HandClock:
    def __init__(self):
        self.time_s = 0.0

    def now_s(self):
        return self.time_s

    def sleep(self, duration_s):
        self.time_s += duration_s


@pytest.fixture
def world():
    laser, clock, told = ScriptedLaser(), HandClock(), []
    return laser, clock, told, Guard(laser, clock, told.append)


def pass_time(guard, clock, duration_s, beat=False):
    """Let time pass in the guard's own steps, with or without a program that says that all is well."""
    until_s = clock.time_s + duration_s
    while clock.time_s < until_s:
        clock.time_s += LOOK_S / 4
        if beat:
            guard.hold(clock.time_s + 0.5)
        guard.turn()


def lit(guard):
    guard.arm()
    guard.emit(1.0)
    assert guard.light is Light.LIT


def test_light_lasts_while_all_is_said_to_be_well(world):
    laser, clock, told, guard = world
    lit(guard)
    pass_time(guard, clock, 60.0, beat=True)
    assert laser.lit
    assert not told


def test_a_program_that_says_nothing_loses_the_light(world):
    laser, clock, told, guard = world
    lit(guard)
    pass_time(guard, clock, 1.0 + LOOK_S)
    assert not laser.lit
    assert guard.light is Light.DARK
    assert (told[0].dark, told[0].trip) == (True, False)


def test_a_laser_that_takes_its_time_to_light_takes_none_from_the_program(world):
    laser, clock, _, guard = world
    usual = laser.emit

    def emit():
        clock.sleep(5.0)
        usual()

    laser.emit = emit
    lit(guard)
    pass_time(guard, clock, 0.9)
    assert guard.light is Light.LIT
    pass_time(guard, clock, 0.2)
    assert guard.light is Light.DARK


def test_no_program_can_ask_for_light_without_end(world):
    laser, clock, _, guard = world
    lit(guard)
    guard.hold(1e9)
    pass_time(guard, clock, LONGEST_LEASE_S + LOOK_S)
    assert not laser.lit


def test_darkness_that_nobody_asked_for_is_noticed_and_is_a_trip(world):
    laser, clock, told, guard = world
    lit(guard)
    pass_time(guard, clock, 1.0, beat=True)
    laser.lit = False  # the interlock opened
    pass_time(guard, clock, 1.5 * LOOK_S, beat=True)
    assert told[0].trip
    assert told[0].dark
    laser.lit = True  # whatever happens there, the guard has put it out and does not light it again
    pass_time(guard, clock, 1.0, beat=True)
    assert guard.light is Light.DARK


def test_one_garbled_answer_does_not_end_the_light(world):
    laser, clock, told, guard = world
    lit(guard)
    answers = iter([LinkError("laser", "say", "garbage", "Look.")])
    usual = laser.emitting

    def emitting():
        for problem in answers:
            raise problem
        return usual()

    laser.emitting = emitting
    pass_time(guard, clock, 2.0, beat=True)
    assert laser.lit
    assert not told


@pytest.mark.parametrize("wrong", ["mute", "stuck"])
def test_a_laser_that_cannot_be_made_dark_is_told_and_tried_until_it_is(world, wrong):
    laser, clock, told, guard = world
    lit(guard)
    setattr(laser, wrong, True)
    with pytest.raises((LinkError, RefusedError)):
        guard.stop()
    assert guard.light is Light.ALARM
    with pytest.raises(RefusedError, match="EMITTING"):
        guard.arm()
    with pytest.raises(RefusedError, match="EMITTING"):
        guard.emit(1.0)
    before = laser.stops
    pass_time(guard, clock, 10.0)
    assert laser.stops - before >= 10.0 / LOOK_S / 2
    assert laser.lit
    setattr(laser, wrong, False)
    pass_time(guard, clock, 2 * LOOK_S)
    assert not laser.lit
    assert guard.light is Light.DARK
    assert told[-1].dark


def test_a_laser_that_cannot_be_asked_is_put_out(world):
    laser, clock, told, guard = world
    lit(guard)
    laser.mute = True
    pass_time(guard, clock, 2 * LOOK_S, beat=True)
    assert guard.light is Light.ALARM
    assert not told[0].dark


def test_light_that_does_not_come_is_put_out(world):
    laser, _, _, guard = world

    def emit():
        laser.lit = True
        raise RefusedError("laser", "emit", "it was not confirmed", "Look.")

    laser.emit = emit
    guard.arm()
    with pytest.raises(RefusedError):
        guard.emit(1.0)
    assert not laser.lit
    assert guard.light is Light.DARK


def test_an_interrupt_does_not_keep_the_light_on(world):
    laser, _, _, guard = world
    lit(guard)
    interrupts = iter([KeyboardInterrupt()])
    usual = laser.stop

    def stop():
        for interrupt in interrupts:
            raise interrupt
        usual()

    laser.stop = stop
    with pytest.raises(KeyboardInterrupt):
        guard.stop()
    assert not laser.lit


def test_failures_survive_the_way_between_processes():
    problem = LinkError("laser at X", "be dark", "no answer came", "Look.")
    problem.add_note("and another thing")
    again = from_words(as_error(problem))
    assert type(again) is LinkError
    assert str(again) == str(problem)
    assert again.__notes__ == ["and another thing"]
    assert type(from_words({**as_error(problem), "kind": "DeviceError"})).__name__ == "DeviceError"
    assert type(from_words({**as_error(problem), "kind": "TYPE_CHECKING"})).__name__ == "DeviceError"


def test_a_guard_in_the_same_process_stands_still_with_it_and_judges_the_laser_alone():
    laser, clock = ScriptedLaser(), HandClock()
    guarded = GuardedHere(laser, clock)
    guarded.arm()
    guarded.emit()
    clock.sleep(60.0)
    guarded.beat(0.5)
    assert laser.lit
    laser.lit = False  # the interlock opened
    clock.sleep(60.0)
    with pytest.raises(LightLostError, match="went dark without a command"):
        guarded.beat(0.5)
