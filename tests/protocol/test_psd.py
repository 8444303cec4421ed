"""MPD's Picosecond Delayer: the driver against transcripts, wrong answers, and the simulated unit."""

from contextlib import nullcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.delayers.psd import ERRORS, Psd, PsdSettings
from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from simulators.bench import Bench
from simulators.clock import BenchClock
from simulators.wire.psd import PsdFirmware
from simulators.wire.serial_url import protocol_sim
from support.wire_script import Step, StepClock, read_transcript

SESSION = read_transcript("psd_session.txt")
SETTINGS = PsdSettings(trigger_level_v=-0.25)

#: Echo off, three questions, output off, divider: what goes before everything else; and what comes last.
BEGIN = read_transcript("psd_session.txt")[:12]
END = read_transcript("psd_session.txt")[-4:]


def psd(address, settings=None):
    return Psd(address, clock=StepClock(), settings=settings)


def asked(sent, answered):
    return [Step(">", sent), Step("<", answered)]


def run(one):
    one.set_delay(31.5e-9)
    one.enable()
    one.set_delay(100.01e-9)


def test_session(play):
    with play(SESSION) as address, psd(address, SETTINGS) as one:
        run(one)


def test_a_unit_whose_echo_stays_on_is_understood(play):
    steps, sent = [], b""
    for step in SESSION:
        sent = step.data if step.kind == ">" else sent
        echoed = step.kind == "<" and not step.data.startswith(sent)
        steps.append(Step(step.kind, sent + step.data) if echoed else step)
    with play(steps) as address, psd(address, SETTINGS) as one:
        run(one)


@pytest.mark.parametrize(
    "answer", [b"", b"12", b"#", b"x#", b"1.5#", b"--1#", b"\xff#", b"9999999999#", b"ERR#"]
)
def test_an_answer_that_is_no_number_is_told_and_the_output_goes_off(play, answer):
    steps = [*BEGIN, *asked(b"EO1#", answer), *asked(b"EO0#", b"0#"), *END]
    with (
        play(steps) as address,
        pytest.raises((ProtocolError, LinkError), match="answer 'EO1'"),
        psd(address) as one,
    ):
        one.enable()


@pytest.mark.parametrize("number", [*ERRORS, 11, 99])
def test_errors_are_told_in_words(play, number):
    steps = [*BEGIN, *asked(b"SP10#", b"ERR%d#" % number), *END]
    told = ERRORS.get(number, f"answers error {number}")
    with play(steps) as address, pytest.raises(RefusedError, match=told), psd(address) as one:
        one.set_delay(31.5e-9)


@pytest.mark.parametrize(
    ("exchanges", "told"),
    [
        ([(b"SP10#", b"12#"), (b"SD19500#", b"19400#")], "set SD19500, but it kept 19400"),
        ([(b"SP10#", b"35#")], r"delay by 31\.5 ns, but with a pulse of 35 ns this is not possible"),
        (
            [(b"SP10#", b"11#"), (b"SD20500#", b"20500#"), (b"RP#", b"8#"), (b"RD#", b"20500#")],
            r"delay by 31\.5 ns, but it delays by 28\.5 ns",
        ),
    ],
)
def test_a_delay_that_is_not_kept_is_refused(play, exchanges, told):
    steps = [step for one in exchanges for step in asked(*one)]
    with (
        play([*BEGIN, *steps, *END]) as address,
        pytest.raises(RefusedError, match=told),
        psd(address) as one,
    ):
        one.set_delay(31.5e-9)


def test_an_unknown_longest_delay_is_no_reason_to_refuse(play):
    steps = list(SESSION)
    steps[3] = Step("<", b"ERR1#")
    with play(steps) as address, psd(address, SETTINGS) as one:
        assert "49.09 ns" in one.identity
        run(one)


@pytest.mark.parametrize("said", [b"", b"OK\r\n", b"VPOL1#", b"\x00\xff#", b"ERR1#"])
def test_what_is_no_delayer_is_not_taken_for_one(play, said):
    steps = [Step(">", b"EM0#"), Step("<", said), Step(">", b"RMD#"), Step("<", said)]
    if said == b"ERR1#":
        steps += asked(b"RP#", said)
    with (
        play(steps) as address,
        pytest.raises(DeviceNotFoundError, match=r"like a PSD delayer.*another device is at this address"),
        psd(address),
    ):
        pytest.fail("connected")


@pytest.mark.parametrize("delay_s", [0.0, 0.99e-9, 129.2e-9, -1e-9, float("nan"), float("inf")])
def test_limits_refuse_before_anything_is_sent(rig, delay_s):
    with rig.psd() as one, pytest.raises(LimitError, match=r"by 1 to 129\.09 ns.*It was not sent"):
        one.set_delay(delay_s)


@pytest.mark.parametrize("level_v", [2.01, -2.01, float("nan")])
def test_a_level_that_is_not_possible_is_refused_without_a_delayer(level_v):
    with pytest.raises(LimitError, match="Nothing was sent"):
        PsdSettings(trigger_level_v=level_v)


#: One unit for all examples: settings go over the wire, no example depends on the one before.
@pytest.fixture(scope="module")
def unit():
    bench = Bench(clock=BenchClock())
    address = protocol_sim.attach("all/psd", PsdFirmware(bench), bench.clock)
    with Psd(address, clock=bench.clock, settings=PsdSettings(repetition_hz=1e6)) as one:
        yield one, bench
    protocol_sim.detach(address)


@given(ps=st.integers(1000, 299_090))
def test_every_delay_is_made_within_half_a_fine_step(unit, ps):
    one, bench = unit
    one.set_delay(ps / 1e12)
    assert abs(bench.light.gate_delay_s * 1e12 - ps) <= 5 + 1e-6
    assert one.settings()["delay_s"] == bench.light.gate_delay_s


@given(ps=st.integers(1000, 299_090))
def test_the_same_delay_is_made_in_the_same_way_whatever_was_before(unit, ps):
    one, _ = unit
    one.set_delay(ps / 1e12)
    first = one.settings()
    one.set_delay(250e-9)
    one.set_delay(ps / 1e12)
    assert one.settings() == first


@pytest.mark.parametrize(("repetition_hz", "longest_ns"), [(80e6, 10 + 49.09), (10e6, 129.09), (1e6, 299.09)])
def test_a_pulse_leaves_room_before_the_next(rig, repetition_hz, longest_ns):
    """The longest delay is that of the longest pulse, 0.8 of the time between two, and of the fine delay."""
    with rig.psd(repetition_hz=repetition_hz) as one:
        for delay_ns in (1.0, 9.0, 12.5, 31.5, longest_ns - 2):
            one.set_delay(delay_ns * 1e-9)
            said = one.settings()
            assert said["delay_s"] == pytest.approx(delay_ns * 1e-9, abs=5.1e-12)
            assert said["pulse_width_s"] <= 0.8 / repetition_hz + 2e-9  # the unit's rounding
        with pytest.raises(LimitError, match="It was not sent"):
            one.set_delay(longest_ns * 1e-9 + 10e-12)


def test_a_fast_laser_goes_through_its_divider(rig):
    with rig.psd(repetition_hz=80e6, divider=8) as one:
        one.set_delay(60e-9)
        one.enable()
        assert rig.bench.light.gate_every == 8
        assert one.settings()["pulse_width_s"] <= 0.8 * 8 / 80e6 + 2e-9  # the unit's rounding


@pytest.mark.parametrize("divider", [0, 1000])
def test_a_divider_that_is_not_possible_is_refused_without_a_delayer(divider):
    with pytest.raises(LimitError, match="the range is 1 to 999"):
        PsdSettings(divider=divider)


def test_connecting_and_leaving_switch_the_output_off(rig):
    with rig.psd() as one:
        assert not rig.bench.light.triggered
        one.set_delay(31.5e-9)
        one.enable()
        assert rig.bench.light.triggered
        assert rig.bench.light.gate_delay_s == 31.5e-9
        one.disable()
        assert not rig.bench.light.triggered
        one.enable()
    assert not rig.bench.light.triggered
    assert rig.heads["psd"]._set["EM"] == 1


def test_an_output_that_stays_on_is_told_to_the_person(rig):
    def work():
        with rig.psd() as one:
            one.enable()
            rig.heads["psd"].output_stuck = True

    with pytest.raises(RefusedError, match=r"send no pulses, but it kept 1.*switch the delayer off by hand"):
        work()


@pytest.mark.parametrize("how_many", [1, 2, 3, 5])
def test_leaving_switches_off_also_when_answers_are_lost(rig, how_many):
    one = rig.psd().__enter__()
    one.enable()
    rig.heads["psd"].drop_answers = how_many
    told = nullcontext() if how_many < 3 else pytest.raises(DeviceError, match="by hand")
    with told:
        one.__exit__(None, None, None)
    assert not rig.bench.light.triggered


def test_a_unit_in_local_mode_is_told(rig):
    rig.plug_in("psd", PsdFirmware)
    rig.heads["psd"].local = True
    with pytest.raises(RefusedError, match=r"local mode.*front panel"), rig.psd():
        pytest.fail("connected")


@given(
    st.lists(
        st.one_of(
            st.sampled_from([b"SP", b"SD", b"EO1", b"EO0", b"EM0", b"#", b"40", b"-1", b"R", b"D", b"\n"]),
            st.binary(max_size=40),
        ),
        max_size=30,
    ).map(b"".join)
)
def test_the_unit_survives_and_keeps_its_ranges(data):
    bench = Bench()
    unit = PsdFirmware(bench)
    unit.receive(data)
    assert 1e-9 <= bench.light.gate_delay_s <= 299.09e-9
    assert bytes(unit.output[-1:]) in (b"", b"#")
