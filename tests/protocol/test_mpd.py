"""MPD's Fast-Gated SPAD: the driver against transcripts, wrong answers, and the simulated module."""

import os
from contextlib import nullcontext
from itertools import pairwise

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    LinkError,
    RefusedError,
)
from drivers.mpd.detector import MpdSpad
from drivers.mpd.settings import MpdSettings
from drivers.mpd.status import NAMES, NEEDED, parse_piece
from simulators.bench import Bench
from simulators.wire.mpd import MpdModule
from simulators.wire.serial_url import protocol_sim
from support.slow_wire import Slow
from support.wire_script import Step, StepClock, read_transcript

SESSION = read_transcript("mpd_session.txt")
ASKED = SESSION[0]
GOOD = SESSION[1].data


def times(said):
    """Return how often it is asked: once more where something came that was spoiled."""
    return 2 if b"#" in said else 1


def spad(address, **options):
    return MpdSpad(address, clock=StepClock(), **options)


def retold(change):
    """Change what the module says of itself."""
    return [Step(one.kind, change(one.data)) if b"VPOL" in one.data else one for one in SESSION]


def test_session(play):
    with play(SESSION) as address, spad(address) as one:
        one.enable()
        assert one.identity == "MPD Fast-Gated SPAD"


@pytest.mark.parametrize(
    "change",
    [
        lambda said: b"".join(piece + b"#" for piece in reversed(said.split(b"#")[:-1])),
        lambda said: b"AQ;DC#" + said,
        lambda said: b"SN4711#" + said + b"FW1.2#",
        lambda said: said.replace(b"CC228#", b""),
        lambda said: said.replace(b"#", b"#\r\n"),
        lambda said: b"TO7#" + said,
    ],
    ids=["another order", "with an echo", "with more", "with less", "in lines", "after a late answer"],
)
def test_answers_of_other_forms_are_understood(play, change):
    with play(retold(change)) as address, spad(address) as one:
        one.enable()


def test_a_question_that_was_spoiled_by_what_a_killed_program_left_is_asked_again(play):
    with play([ASKED, Step("<", b"HO27#CT150#CE82#CC228#"), *SESSION]) as address, spad(address) as one:
        one.enable()


def test_settings_that_are_not_answered_are_waited_for_and_read_back(play):
    silent = [one for one in SESSION if not one.data.startswith((b"TS0#", b"TO10000#", b"TO40000#"))]
    clock = StepClock()
    with play(silent) as address, MpdSpad(address, clock=clock) as one:
        one.enable()
        assert clock.now_s() == pytest.approx(4 * 0.3)  # the published driver's wait, for each setting


@pytest.mark.parametrize("name", NEEDED)
@pytest.mark.parametrize("spoiled", ["", "{}", "{}x", "{}1.5", "{}--1", "{}99999999999"])
def test_an_answer_that_lacks_what_matters_is_told(play, name, spoiled):
    pieces = [one for one in GOOD.split(b"#")[:-1] if not one.startswith(name.encode())]
    said = b"".join(one + b"#" for one in [*pieces, spoiled.format(name).encode()])
    with (
        play([ASKED, Step("<", said)] * times(said)) as address,
        pytest.raises(DeviceNotFoundError, match=rf"Fast-Gated SPAD, but {name} did not come.*115200 baud"),
        spad(address),
    ):
        pytest.fail("connected")


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (b"", "no answer came"),
        (b"VPOL1", "only b'VPOL1' came"),
        (b"AQ;DC#", "VPOL, FR, ERR, GF, TO, HO did not come"),
        (b"\xe0\x80\x00#\x00\xff#", "VPOL, FR, ERR, GF, TO, HO did not come"),
        (b"ERR1#", "VPOL, FR, GF, TO, HO did not come"),
        (b"OK\r\n", "only b'OK"),
        (b"12#" * 60, r"VPOL, FR, ERR, GF, TO, HO did not come"),
    ],
)
def test_what_is_no_fast_gated_spad_is_not_taken_for_one(play, said, told):
    with (
        play([ASKED, Step("<", said)] * times(said)) as address,
        pytest.raises(DeviceNotFoundError, match=told),
        spad(address),
    ):
        pytest.fail("connected")


@given(st.text(max_size=20))
def test_pieces_of_any_kind_are_parsed_or_not(text):
    found = parse_piece(text)
    assert found is None or found[0] in NAMES


@given(st.sampled_from(NAMES), st.integers(-(10**9), 10**9))
def test_a_piece_is_a_name_and_a_number(name, number):
    assert parse_piece(f"{name}{number}") == (name, number)
    assert parse_piece(f" {name}{number}\r\n") == (name, number)
    assert parse_piece(f"X{name}{number}") is None


WORDS = [b"AQ", b";", b"DC", b"#", b"TS0", b"FR", b"GM", b"AD", b"TO", b"40000", b"TO12000", b"-1"]


@given(
    st.lists(st.one_of(st.sampled_from(WORDS), st.binary(max_size=40)), max_size=30).map(b"".join),
    st.integers(1, 9),
)
def test_the_module_survives_and_keeps_its_ranges(data, piece):
    bench = Bench()
    module = MpdModule(bench, biased=False)
    for start in range(0, len(data), piece):
        module.receive(data[start : start + piece])
    assert not bench.light.biased
    assert 10e-9 <= bench.light.gate_width_s <= 98e-9
    assert bench.light.hold_off_s == 100e-9
    assert bytes(module.output[-1:]) in (b"", b"#")


@pytest.mark.parametrize("width_s", [9.9e-9, 98.1e-9, 0.0, -1.0, float("nan"), float("inf")])
def test_limits_refuse_before_there_is_a_detector(rig, width_s):
    with pytest.raises(LimitError, match="Nothing was sent"):
        MpdSettings(gate_width_s=width_s)
    MpdSettings(gated=False, gate_width_s=width_s)  # without a gate it has no width
    with rig.mpd() as one, pytest.raises(LimitError, match=r"10 to 98 ns.*Nothing was sent"):
        one.set_gate(30e-9, width_s)


def module_of(rig):
    return rig.heads["mpd"]


def test_connecting_closes_the_gate_and_leaves_the_bias_to_the_person(rig):
    with rig.mpd() as one:
        assert (rig.bench.light.gated, rig.bench.light.gate_width_s) == (True, 10e-9)
        assert rig.bench.light.biased
        one.enable()
        assert (rig.bench.light.gated, rig.bench.light.gate_width_s) == (True, 40e-9)
        one.set_gate(0.0, 55e-9)
        assert rig.bench.light.gate_width_s == 55e-9
        one.disable()
        assert rig.bench.light.gate_width_s == 10e-9
        one.enable()
        assert rig.bench.light.gate_width_s == 55e-9
    assert (rig.bench.light.gated, rig.bench.light.gate_width_s) == (True, 10e-9)
    assert one.by_hand == {"bias", "hold_off", "gate_delay"}


def test_free_running(rig):
    with rig.mpd(gated=False) as one:
        assert rig.bench.light.gated
        one.enable()
        assert not rig.bench.light.gated
        assert one.settings()["gated"] is False
    assert rig.bench.light.gated


def test_what_it_says_of_itself(rig):
    with rig.mpd() as one:
        rig.bench.change_light(hold_off_s=101e-9)  # code 28, which the fit takes for 102 ns
        said = one.settings()
        assert said["hold_off_s"] == 100e-9
        assert said["temperature_c"] == pytest.approx(-20.0)
        assert said["excess_bias_v"] == pytest.approx(5.0, abs=0.02)
        rig.bench.change_light(hold_off_s=81e-9)
        assert one.settings()["hold_off_s"] == pytest.approx(81e-9)


@pytest.mark.parametrize(
    ("by_hand", "told"),
    [
        ({"biased": False}, r"the bias is off.*In MPD's program, switch the bias on; close it"),
        ({"error": 7}, r"it reports error 7.*In MPD's program, look up and clear its error"),
        (
            {"hold_off_s": 81e-9},
            r"hold off for 100 ns.*off for about 81 ns.*set the hold-off, or correct detector\.hold_off",
        ),
    ],
)
def test_what_a_person_has_not_set_is_asked_of_the_person(rig, by_hand, told):
    with rig.mpd() as one:
        module_of(rig).error = by_hand.pop("error", 0)
        rig.bench.change_light(**by_hand)
        with pytest.raises(RefusedError, match=told):
            one.enable()
        assert (rig.bench.light.gated, rig.bench.light.gate_width_s) == (True, 10e-9)


@pytest.mark.parametrize("rate_hz", [5e6, 10.2e6, 80e6])
def test_a_gate_that_follows_something_else_is_refused(rig, rate_hz):
    with rig.mpd() as one:
        module_of(rig).gate_hz = rate_hz
        with pytest.raises(
            RefusedError, match=r"gated at the laser's 10 MHz, but its gate opens at.*trigger cable"
        ):
            one.enable()
        assert rig.bench.light.gate_width_s == 10e-9
        module_of(rig).gate_hz = 10.05e6
        one.enable()


@pytest.mark.parametrize(("gated", "told"), [(True, "gated by its trigger"), (False, "close its gate")])
def test_a_gate_that_does_not_obey_is_told_to_the_person(rig, gated, told):
    """A module that stays free running: it cannot be enabled with a gate, nor closed."""

    def work():
        with rig.mpd(gated=gated) as one:
            module_of(rig)._set["FR"] = 1
            module_of(rig).gate_stuck = True
            one.enable()
            one.disable()

    with pytest.raises(RefusedError, match=told) as raised:
        work()
    said = "\n".join([str(raised.value), *raised.value.__notes__])
    assert "Treat the detector as SENSITIVE and BIASED: switch its bias off by hand, in MPD's program" in said


@pytest.mark.parametrize("how_many", [1, 2, 3, 8, 9])
def test_leaving_closes_also_when_answers_are_lost(rig, how_many):
    one = rig.mpd().__enter__()
    one.enable()
    module_of(rig).drop_answers = how_many
    told = nullcontext() if how_many < 9 else pytest.raises(DeviceError, match="SENSITIVE")
    with told:
        one.__exit__(None, None, None)
    assert (rig.bench.light.gated, rig.bench.light.gate_width_s) == (True, 10e-9)


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.29, 0.31, 0.4, 0.49, 0.51, 0.7, 1.0])
def test_a_late_answer_is_never_taken_for_a_closed_gate(delay_s):
    bench = Bench()
    module = MpdModule(bench)
    wire = Slow(module, bench.clock, 0.0)
    address = protocol_sim.attach("slow/mpd", wire, bench.clock)
    try:
        one = MpdSpad(address, clock=bench.clock, settings=MpdSettings(gated=False)).__enter__()
        one.enable()
        module.gate_stuck = True
        wire.delay_s = delay_s
        with pytest.raises(DeviceError, match="SENSITIVE and BIASED"):
            one.__exit__(None, None, None)
    finally:
        protocol_sim.detach(address)


def test_unplugged_while_sensitive_is_told_to_the_person(rig):
    def work():
        with rig.mpd() as one:
            one.enable()
            rig.unplug_all()

    with pytest.raises(LinkError, match=r"close its gate.*SENSITIVE and BIASED"):
        work()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_the_port_of_a_program_that_is_open_is_told():
    """A real pseudo-terminal, which another program holds."""
    near, far = os.openpty()
    address = os.ttyname(far)
    with (
        serial.Serial(address, exclusive=True),
        pytest.raises(LinkError, match=r"another program uses it.*Close MPD's program: it holds the port"),
        spad(address),
    ):
        pytest.fail("opened")
    for end in (near, far):
        os.close(end)


def test_the_port_is_free_while_a_person_sets_the_hold_off(rig):
    asked = []

    def person(hold_off_s):
        asked.append(hold_off_s)
        assert rig.bench.light.gate_width_s == 10e-9
        with pytest.raises(LinkError, match="not connected"):
            one.settings()
        with rig.mpd() as other:
            assert other.settings()["biased"]
        rig.bench.change_light(hold_off_s=160e-9)

    with rig.mpd(person=person) as one:
        one.enable()
        one.set_hold_off(100e-9)
        assert asked == []  # it is set already
        one.set_hold_off(160e-9)
        assert asked == [160e-9]
        assert one.settings()["hold_off_s"] == 160e-9
        with pytest.raises(RefusedError, match="hold off for 90 ns, but it holds off for about 159 ns"):
            one.set_hold_off(90e-9)
        assert asked == [160e-9, 90e-9]


def test_a_hold_off_that_nobody_sets_is_refused(rig):
    with rig.mpd() as one, pytest.raises(RefusedError, match=r"hold off for 90 ns.*In MPD's program, set"):
        one.set_hold_off(90e-9)


def test_a_person_who_leaves_the_program_open_is_told(rig):
    with rig.mpd(person=lambda hold_off_s: rig.unplug_all()) as one, pytest.raises(DeviceError):
        one.set_hold_off(90e-9)


def test_width_that_is_kept_otherwise_is_refused(rig):
    class Stubborn(MpdModule):
        def _want(self, match):
            said = super()._want(match)
            if match[1] == "TO" and self._wanted["TO"] > 10_000:
                self._wanted["TO"] -= 1000
            return said

    address = rig.plug_in("stubborn", Stubborn)
    with (
        MpdSpad(address, clock=rig.bench.clock) as one,
        pytest.raises(RefusedError, match=r"open its gate for 40 ns, but it keeps 39 ns"),
    ):
        one.enable()


def test_the_fits_are_monotonic_where_codes_are():
    """A code more is a hold-off of one step more; the step is what a person's value may differ by."""
    bench = Bench()
    module = MpdModule(bench)
    codes = []
    for nanoseconds in range(18, 120):
        bench.change_light(hold_off_s=nanoseconds * 1e-9)
        codes.append(int(module._codes()[0].removeprefix("HO")))
    assert all(0 <= later - before <= 1 for before, later in pairwise(codes))
    assert codes[0] == 0
