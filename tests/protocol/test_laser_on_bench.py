"""The laser's driver with the simulated head at the other end of the wire: above all, dark."""

import pytest

from drivers.errors import DeviceError, LinkError, RefusedError
from simulators.wire.serial_url import protocol_sim


def test_neither_connecting_nor_arming_emits(rig):
    with rig.laser() as laser:
        laser.arm()
        laser.settings()
        assert not laser.emitting()
    assert not rig.bench.ever_emitted()


def test_emission_needs_arming(rig):
    with rig.laser() as laser, pytest.raises(RefusedError, match="not armed"):
        laser.emit()
    assert not rig.bench.ever_emitted()


def test_armed_and_emitting_the_light_is_as_configured(rig):
    with rig.laser(power=7.5, repetition_hz=10e6) as laser:
        laser.arm()
        laser.emit()
        assert laser.emitting()
        assert (rig.bench.light.emitting, rig.bench.light.power) == (True, 0.75)
        assert rig.bench.sync_rate_hz() == 10e6
        assert laser.settings() == {
            "identity": "Onefive Katana 05 (532 nm)",
            "power_setpoint": 7.5,
            "repetition_hz": 10e6,
            "trigger": "internal",
            "emitting": True,
            "emission_known_by": "asked (leg?)",
            "remote_control": True,
        }


def test_a_laser_found_emitting_is_switched_off_and_refused(rig):
    rig.head.receive(b"leg=1\n")
    assert rig.bench.light.emitting
    with pytest.raises(RefusedError, match="it was emitting; it has been switched off"), rig.laser():
        pytest.fail("connected to a laser that emits")
    assert not rig.bench.light.emitting


def test_found_emitting_while_arming(rig):
    with rig.laser() as laser:
        rig.head.receive(b"leg=1\n")
        with pytest.raises(RefusedError, match="switched off"):
            laser.arm()
        assert not rig.bench.light.emitting


def test_stop_can_be_called_at_any_time(rig):
    laser = rig.laser()
    laser.stop()
    with laser:
        laser.stop()
        laser.arm()
        laser.emit()
        laser.stop()
        assert not rig.bench.light.emitting
        laser.stop()
        with pytest.raises(RefusedError, match="not armed"):
            laser.emit()
    laser.stop()


def test_an_open_interlock_is_seen_as_light_that_does_not_come(rig):
    rig.head.close_interlock(False)
    with rig.laser(emission_timeout_s=3.0) as laser:
        laser.arm()
        before_s = rig.bench.clock.now_s()
        with pytest.raises(RefusedError, match=r"stayed dark for 3 s.*interlock"):
            laser.emit()
        assert rig.bench.clock.now_s() - before_s >= 3.0
        rig.head.close_interlock(True)
        assert not rig.bench.light.emitting


@pytest.mark.parametrize("trip", ["interlock", "key"])
def test_light_returns_after_a_trip_only_through_arming(rig, trip):
    with rig.laser() as laser:
        laser.arm()
        laser.emit()
        switch = rig.head.close_interlock if trip == "interlock" else rig.head.turn_key
        switch(False)
        assert not laser.emitting()
        switch(True)
        with pytest.raises(RefusedError, match="not armed"):
            laser.emit()
        assert not rig.bench.light.emitting
        laser.arm()
        laser.emit()
        assert rig.bench.light.emitting


@pytest.mark.parametrize("interruption", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_leaving_is_dark_whatever_happened(rig, interruption):
    def work():
        with rig.laser() as laser:
            laser.arm()
            laser.emit()
            raise interruption

    with pytest.raises(interruption):
        work()
    assert not rig.bench.light.emitting
    # The power belongs to the knob again.
    assert rig.bench.light.power == 0.0


@pytest.mark.parametrize("damage", ["drop_answers", "garble_answers"])
@pytest.mark.parametrize("how_many", [1, 2, 3, 4])
def test_leaving_is_dark_also_when_answers_are_lost_or_garbled(rig, damage, how_many):
    laser = rig.laser()
    laser.__enter__()
    laser.arm()
    laser.emit()
    setattr(rig.head, damage, how_many)
    try:
        laser.__exit__(None, None, None)
    except DeviceError:
        # One lost answer is made good by asking again; more are told. Dark it is in any case.
        assert how_many > 1
    assert not rig.bench.light.emitting


@pytest.mark.parametrize("damage", ["drop_answers", "garble_answers"])
def test_emission_that_cannot_be_confirmed_is_ended(rig, damage):
    with rig.laser() as laser:
        laser.arm()
        setattr(rig.head, damage, 2)  # of leg=1, and of the first leg?
        with pytest.raises(DeviceError):
            laser.emit()
        assert not rig.bench.light.emitting


def test_unplugged_while_emitting_tells_the_person_to_turn_the_key(rig):
    def work():
        with rig.laser() as laser:
            laser.arm()
            laser.emit()
            rig.unplug_all()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as raised:
        work()
    assert any("turn its key off by hand" in note for note in raised.value.__notes__)
    assert rig.bench.light.emitting  # and so it is


def test_unplugged_while_emitting_is_no_quiet_end(rig):
    def work():
        with rig.laser() as laser:
            laser.arm()
            laser.emit()
            rig.unplug_all()

    with pytest.raises(LinkError, match="turn its key off by hand"):
        work()


def test_light_that_cannot_be_ended_is_dimmed_and_never_given_to_the_front_knob(rig):
    """The knob stands at full power, the scan ran at a tenth of it, and the laser does not hear leg=0."""
    rig.head.turn_knob(10.0)

    def work():
        with rig.laser(power=1.0) as laser:
            laser.arm()
            laser.emit()
            rig.head.emission_stuck = True

    with pytest.raises(RefusedError, match=r"still emits.*turn its key off by hand"):
        work()
    assert rig.bench.light.emitting
    assert rig.bench.light.power == 0.0
    assert max(change.get("power", 0.0) for change in rig.bench.changes[1:]) <= 1.0
    lit = [change for change in rig.bench.changes if "emitting" in change]
    after = rig.bench.changes[rig.bench.changes.index(lit[0]) :]
    assert all(change["power"] <= 0.1 for change in after if "power" in change)


class DeafToPower:
    """The laser on a wire on which no command that sets its power arrives."""

    def __init__(self, head):
        self.head, self.output = head, head.output

    def receive(self, data):
        if not data.startswith(b"lp="):
            self.head.receive(data)


def test_a_setting_that_the_laser_does_not_take_is_refused(rig):
    rig.head.receive(b"lp=3\n")
    protocol_sim.detach(rig.laser_address)
    protocol_sim.attach("test/laser", DeafToPower(rig.head), rig.bench.clock)
    with rig.laser(power=7.5) as laser:
        with pytest.raises(RefusedError, match=r"set lp=7\.50, but it kept lp=3"):
            laser.arm()
        with pytest.raises(RefusedError, match="not armed"):
            laser.emit()
