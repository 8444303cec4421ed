"""Rules that hold for every laser, held against the bench's own light: above all, dark."""

from contextlib import suppress
from dataclasses import dataclass

import pytest

from drivers.errors import DeviceError, FoundEmittingError, LinkError, RefusedError
from drivers.katana.dialects import KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.nkt.laser import NktLaser
from drivers.nkt.settings import NktSettings
from drivers.two_step import TwoStepLaser
from rig.light.guard import Guard, Light
from simulators.wire.laser import Katana08Head, KatanaHead
from simulators.wire.laser_head import LaserHead
from simulators.wire.nkt import NktMainboard
from simulators.wire.serial_url import protocol_sim
from support.simulated_rig import WatchedBench
from support.slow_wire import Slow

GREEN = KatanaSettings(power=4.0, repetition_hz=10e6)
RED = KatanaSettings(model=KATANA_08HP, power=1.24, repetition_hz=20e6)
WHITE = NktSettings(level_percent=40.0, oscillator_hz=80e6, repetition_hz=10e6)


class AskedRed(Katana08Head):
    """One that says whether it emits."""

    def __init__(self, bench):
        super().__init__(bench)
        self.knows_emission = True


class Promising(KatanaHead):
    """One that answers an order as if it were a question, and as if the order was obeyed."""

    def _change(self, name, value):
        answer = super()._change(name, value)
        return f"leg status: {value:g}\n" if name == "leg" and "Error" not in answer else answer


#: Driver, settings and firmware of each laser; all are set to 0.4 of their full power.
LASERS = {
    "katana": (KatanaLaser, GREEN, KatanaHead),
    "katana that promises": (KatanaLaser, GREEN, Promising),
    "katana-08hp": (KatanaLaser, RED, Katana08Head),
    "katana-08hp that is asked": (KatanaLaser, RED, AskedRed),
    "nkt": (NktLaser, WHITE, NktMainboard),
}


@dataclass
class OnBench:
    """A laser on a bench of its own, on a wire whose answers may be slow."""

    bench: WatchedBench
    head: LaserHead
    wire: Slow
    laser: TwoStepLaser

    def ever_emitted(self):
        return self.bench.ever_emitted()

    @property
    def light(self):
        return self.bench.light


@pytest.fixture(params=LASERS)
def on(request):
    driver, settings, firmware = LASERS[request.param]
    bench = WatchedBench()
    head = firmware(bench)
    wire = Slow(head, bench.clock, 0.0)
    address = protocol_sim.attach("one/laser", wire, bench.clock)
    yield OnBench(bench, head, wire, driver(address, clock=bench.clock, settings=settings))
    protocol_sim.detach(address)


def light_up(laser):
    laser.arm()
    laser.emit()


def test_neither_connecting_nor_arming_nor_asking_emits(on):
    with on.laser as laser:
        laser.arm()
        laser.settings()
        assert not laser.emitting()
    assert not on.ever_emitted()


def test_emission_needs_arming(on):
    with on.laser as laser, pytest.raises(RefusedError, match="not armed"):
        laser.emit()
    assert not on.ever_emitted()


def test_its_light_is_as_configured_and_read_back(on):
    with on.laser as laser:
        light_up(laser)
        assert laser.emitting()
        assert on.light.emitting
        assert on.light.power == pytest.approx(0.4, abs=1e-9)
        told = laser.settings()
        assert told["emitting"] is True
        assert told["repetition_hz"] == on.bench.sync_rate_hz()
    assert not on.light.emitting


def test_emission_without_power_is_no_light_after_arming(on):
    """A laser whose light is known by what it measures looks dark while its power is zero."""
    on.head.switch_light(True)
    on.bench.change_light(power=0.0)
    with suppress(FoundEmittingError), on.laser as laser:
        laser.arm()
        assert not on.light.on_wall
    assert not on.light.emitting


def test_found_emitting_it_is_put_out_and_refused(on):
    on.bench.change_light(power=0.4)
    if isinstance(on.head, Katana08Head):
        on.head.turn_knob(4.0)  # it measures nothing of light without power
    on.head.switch_light(True)
    with pytest.raises(RefusedError, match="it was emitting; it has been switched off"), on.laser:
        pytest.fail("connected to a laser that emits")
    assert not on.light.emitting


@pytest.mark.parametrize("healthy", [1, 2, 3, 4])
def test_found_emitting_it_is_put_out_also_where_it_answers_badly_then(on, healthy):
    """As soon as it was recognised; what is not recognised may be anything."""
    if isinstance(on.head, Katana08Head):
        on.head.turn_knob(4.0)
    on.head.switch_light(True)
    good = on.head.obey

    def obey(line):
        nonlocal healthy
        healthy -= 1
        if healthy == -1:
            on.head.garble_answers = 1
        return good(line)

    on.head.obey = obey
    with pytest.raises(DeviceError), on.laser:
        pytest.fail("connected to a laser that emits")
    recognised = bool(on.laser.identity)
    assert recognised != on.light.emitting


@pytest.mark.parametrize("trip", ["close_interlock", "turn_key"])
def test_light_returns_after_a_trip_only_through_arming(on, trip):
    with on.laser as laser:
        light_up(laser)
        getattr(on.head, trip)(False)
        assert not laser.emitting()
        getattr(on.head, trip)(True)
        with pytest.raises(RefusedError, match="not armed"):
            laser.emit()
        assert not on.light.emitting
        if isinstance(on.head, NktMainboard):
            with pytest.raises(RefusedError, match="waits for its reset"):
                laser.arm()
            on.head.reset_interlock()  # a person, at the laser
        light_up(laser)
        assert on.light.emitting


def test_an_open_interlock_means_no_light_and_an_error(on):
    on.head.close_interlock(False)
    with on.laser as laser, pytest.raises(RefusedError, match="interlock"):
        light_up(laser)
    on.head.close_interlock(True)
    assert not on.ever_emitted()


@pytest.mark.parametrize("interruption", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_leaving_is_dark_whatever_happened(on, interruption):
    def work():
        with on.laser as laser:
            light_up(laser)
            raise interruption

    with pytest.raises(interruption):
        work()
    assert not on.light.emitting


@pytest.mark.parametrize("damage", ["drop_answers", "garble_answers"])
@pytest.mark.parametrize("how_many", [1, 2, 3, 5, 8])
def test_leaving_is_dark_also_when_answers_are_lost_or_garbled(on, damage, how_many):
    on.laser.__enter__()
    light_up(on.laser)
    setattr(on.head, damage, how_many)
    try:
        on.laser.__exit__(None, None, None)
    except DeviceError:
        refused = True
    else:
        refused = False
    assert not on.light.emitting
    assert not refused or how_many > 1  # one answer is made good by asking again


def test_unplugged_while_emitting_is_told_to_the_person(on):
    def work():
        with on.laser as laser:
            light_up(laser)
            protocol_sim.detach("sim://one/laser")

    with pytest.raises(LinkError, match="turn its key off by hand"):
        work()
    assert on.light.emitting  # and so it is


def test_light_that_cannot_be_ended_is_dimmed_and_told(on):
    def work():
        with on.laser as laser:
            light_up(laser)
            on.head.emission_stuck = True
            if isinstance(on.head, Katana08Head):
                on.head.dark_w = 0.5

    with pytest.raises(RefusedError, match=r"still emits.*turn its key off by hand"):
        work()
    assert on.light.emitting
    assert on.light.power == 0.0


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.03, 0.049, 0.06, 0.1, 0.15, 0.199, 0.25, 0.35, 0.45, 0.6])
@pytest.mark.parametrize("guarded", [False, True])
def test_a_late_answer_is_never_taken_for_darkness(on, delay_s, guarded):
    """The light stays on, whatever is ordered, and answers to earlier orders and questions come late."""
    told = []
    with on.laser as laser:
        guard = Guard(laser, on.bench.clock, told.append)
        guard.arm()
        guard.emit(on.bench.clock.now_s() + 1.0)
        on.head.emission_stuck = True
        on.wire.delay_s = delay_s
        with pytest.raises(DeviceError, match="turn its key off by hand"):
            (guard if guarded else laser).stop()
        assert guard.light is (Light.ALARM if guarded else Light.LIT)
        assert on.light.emitting
        on.wire.delay_s = 0.0
        on.head.emission_stuck = False
    assert not on.light.emitting


@pytest.mark.parametrize("delay_s", [0.03, 0.06, 0.1, 0.15])
def test_a_late_answer_is_never_taken_for_a_setting(on, delay_s):
    """The laser answers each order to set its power or level, and keeps what it had."""
    lie = "_levels" if isinstance(on.head, NktMainboard) else "_power"
    with on.laser as laser:
        on.wire.delay_s = delay_s

        def forget():
            value = getattr(on.head, lie)
            setattr(on.head, lie, dict.fromkeys(value, 0) if isinstance(value, dict) else 0.0)
            on.head._apply_power() if lie == "_power" else on.head._apply()

        apart = on.wire.receive

        def receive(data):
            apart(data)
            if b"lp=" in data or b"\x05\x37" in data:
                forget()

        on.wire.receive = receive
        with pytest.raises(DeviceError):
            laser.arm()
        with pytest.raises(RefusedError, match="not armed"):
            laser.emit()
        on.wire.delay_s = 0.0
    assert not on.ever_emitted()
