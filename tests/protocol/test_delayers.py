"""Gate delayers: what goes over their wire, what they refuse, and the bench's gate that follows them."""

import re
import socket
import threading
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.delayers.dg645 import Dg645, Dg645Settings
from drivers.delayers.t560 import T560, T560Settings
from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from simulators.bench import Bench
from simulators.wire.dg645 import INSERTION_S as DG645_INSERTION_S
from simulators.wire.dg645 import Dg645Box
from simulators.wire.serial_url import protocol_sim
from simulators.wire.t560 import INSERTION_S as T560_INSERTION_S
from simulators.wire.t560 import T560Box
from support.wire_script import Step, read_transcript

DG645 = Dg645Settings(pulse_width_s=20e-9, amplitude_v=3.3, repetition_hz=5e6)
T560_AT = T560Settings(pulse_width_s=15e-9, repetition_hz=10e6)

#: Driver, settings, simulated box, what that adds to the delay, and its transcript.
KINDS = {
    "dg645": (Dg645, DG645, Dg645Box, DG645_INSERTION_S, "dg645_session.txt"),
    "t560": (T560, T560_AT, T560Box, T560_INSERTION_S, "t560_session.txt"),
}
_numbers = count()


@contextmanager
def plugged(firmware, bench):
    address = protocol_sim.attach(f"delayer{next(_numbers)}", firmware, bench.clock)
    try:
        yield address
    finally:
        protocol_sim.detach(address)


@contextmanager
def on_bench(name, **changes):
    """A driver that is connected to its simulated box, the box, and the bench."""
    driver, settings, box, _, _ = KINDS[name]
    bench = Bench()
    firmware = box(bench)
    with plugged(firmware, bench) as address, driver(address, settings=replace(settings, **changes)) as one:
        yield one, firmware, bench


@pytest.fixture(params=KINDS)
def name(request):
    return request.param


def lines(*exchanges):
    return [step for sent, answered in exchanges for step in (Step(">", sent), Step("<", answered))]


def session(address, name):
    driver, settings, *_ = KINDS[name]
    with driver(address, settings=settings) as delayer:
        delayer.set_delay(12.34e-9)
        delayer.enable()
        return delayer.settings()


def test_the_driver_says_what_the_transcript_says(play, name):
    with play(read_transcript(KINDS[name][-1])) as address:
        settings = session(address, name)
    assert settings["delay_s"] == pytest.approx(12.34e-9, abs=1e-15)
    assert settings["enabled"] is True


@pytest.mark.parametrize("piece", [1, 1000])
def test_the_box_answers_what_the_transcript_says(name, piece):
    box = KINDS[name][2](Bench())
    expected = b""
    for number, step in enumerate(read_transcript(KINDS[name][-1])):
        if step.kind == "<":
            expected += step.data
            continue
        assert bytes(box.output) == expected, f"before step {number}"
        box.output.clear()
        expected = b""
        for i in range(0, len(step.data), piece):
            box.receive(step.data[i : i + piece])
    assert bytes(box.output) == expected


def test_the_gate_opens_only_while_the_delayer_triggers_it(name):
    with on_bench(name) as (delayer, _, bench):
        bench.change_light(biased=True, gated=True)
        assert not bench.light.sensitive
        delayer.set_delay(20e-9)
        assert not bench.light.sensitive
        delayer.enable()
        assert bench.light.sensitive
        assert bench.light.gate_delay_s == pytest.approx(20e-9 + KINDS[name][3], abs=1e-12)
        delayer.set_delay(0.0)
        assert bench.light.gate_delay_s == pytest.approx(KINDS[name][3], abs=1e-12)
        delayer.disable()
        assert not bench.light.sensitive
        delayer.enable()
    assert not bench.light.triggered


@pytest.mark.parametrize("delay_s", [-1e-12, float("nan"), float("inf"), 1e4])
def test_a_delay_it_does_not_have_is_refused_before_anything_is_sent(name, delay_s):
    with on_bench(name) as (delayer, firmware, _):
        firmware.drop_answers = 1  # would be noticed
        with pytest.raises(LimitError, match="Nothing was sent"):
            delayer.set_delay(delay_s)
        firmware.drop_answers = 0


@pytest.mark.parametrize(
    ("name", "left_s"), [("dg645", 200e-9 - 100e-9 - 20e-9), ("t560", 100e-9 - 60e-9 - 15e-9)]
)
def test_a_pulse_that_ends_too_late_for_the_next_trigger_is_refused(name, left_s):
    """Of the period, the box needs its time to be ready again, and the pulse has its own length."""
    with on_bench(name) as (delayer, _, _):
        delayer.set_delay(left_s)
        with pytest.raises(LimitError, match="to be ready for the next one"):
            delayer.set_delay(left_s + 20e-12)


def test_a_delay_is_rounded_to_the_steps_of_the_box(name):
    with on_bench(name) as (delayer, _, _):
        delayer.set_delay(10.0049e-9)
        delayer.enable()
        step_s = {"dg645": 5e-12, "t560": 10e-12}[name]
        kept_s = delayer.settings()["delay_s"]
        assert kept_s == pytest.approx(round(10.0049e-9 / step_s) * step_s, abs=1e-15)


def test_without_a_delay_it_is_not_enabled(name):
    with on_bench(name) as (delayer, _, bench), pytest.raises(RefusedError, match="no delay was set"):
        delayer.enable()
    assert not bench.light.triggered


@pytest.mark.parametrize(
    ("name", "said"), [("dg645", b"DLAY 8,0,1E-6\n"), ("t560", b"CDELAY 1u;CSET ON;INSTALL\r")]
)
def test_another_output_that_keeps_it_busy_is_named(name, said):
    with on_bench(name) as (delayer, firmware, bench):
        firmware.receive(said)
        delayer.set_delay(0.0)
        with pytest.raises(LimitError, match=r"with output [GC] as it is set"):
            delayer.enable()
        assert not bench.light.triggered


def test_channels_that_are_delayed_from_each_other_are_added_up():
    with on_bench("dg645") as (delayer, firmware, _):
        firmware.receive(b"DLAY 4,0,60e-9\nDLAY 5,4,50e-9\n")
        delayer.set_delay(0.0)
        with pytest.raises(LimitError, match=r"output D as it is set.*ends 110 ns"):
            delayer.enable()


def test_a_t560_that_divides_its_triggers_is_set_right():
    with on_bench("t560") as (delayer, firmware, bench):
        firmware.receive(b"TDIV 4\r")
        delayer.set_delay(0.0)
        delayer.enable()
        assert bench.light.gate_every == 1
        assert delayer.settings()["divider"] == 1


def test_a_fast_laser_triggers_it_through_its_divider(name):
    """80 MHz are more than both take; of every eighth pulse the gate has 100 ns, of every sixteenth 200."""
    with on_bench(name, repetition_hz=80e6, divider=16, pulse_width_s=10e-9) as (delayer, _, bench):
        delayer.set_delay(20e-9)
        delayer.enable()
        assert bench.light.gate_every == 16
        assert delayer.settings()["divider"] == 16
        with pytest.raises(LimitError, match="to be ready for the next one"):
            delayer.set_delay(190e-9)


def test_a_t560_that_does_not_say_what_it_is_is_known_by_its_channels():
    bench = Bench()
    box = T560Box(bench)
    box.knows_identity = False
    with plugged(box, bench) as address, T560(address, settings=T560_AT) as delayer:
        assert delayer.identity == "Highland T560"


@pytest.mark.parametrize(
    ("settings", "wrong", "told"),
    [
        (DG645, {"amplitude_v": 0.4}, "amplitude goes from 0.5 to 5 V"),
        (DG645, {"trigger_level_v": float("nan")}, "trigger level"),
        (DG645, {"output": "IJ"}, "outputs are AB"),
        (DG645, {"polarity": "up"}, "polarity"),
        (DG645, {"repetition_hz": 10e6}, "to be ready for the next one it must end within 0 ns at 10 MHz"),
        (DG645, {"repetition_hz": 11e6}, "up to 10 MHz"),
        (DG645, {"repetition_hz": 120e6, "divider": 100}, "divides triggers of up to 100 MHz"),
        (DG645, {"divider": 0}, "divides triggers by 1 to"),
        (T560_AT, {"divider": 1000}, "divides triggers by 1 to 999"),
        (DG645, {"pulse_width_s": 0.0}, "pulses last"),
        (T560_AT, {"trigger_level_v": 5.0}, "trigger level goes from 0.25 to 3.3 V"),
        (T560_AT, {"output": "E"}, "outputs are A, B, C, D"),
        (T560_AT, {"trigger_edge": "both"}, "edge rising or falling"),
        (T560_AT, {"pulse_width_s": 1e-9}, "shortest pulse lasts 2 ns"),
        (T560_AT, {"repetition_hz": 20e6}, "up to 16 MHz"),
    ],
)
def test_settings_that_no_box_takes_are_refused_without_one(settings, wrong, told):
    with pytest.raises(LimitError, match=re.escape(told)):
        replace(settings, **wrong)


@pytest.mark.parametrize("fault", ["drop_answers", "garble_answers"])
@pytest.mark.parametrize("at", range(40))
def test_one_spoiled_answer_is_an_error_and_never_leaves_the_gate_running(name, fault, at):
    """Wherever it comes: what is read back is right, or the session ends with an error of ours."""
    bench = Bench()
    firmware = KINDS[name][2](bench)
    answers = count()
    honest = firmware.answer

    def spoiling(line):
        if next(answers) == at:
            setattr(firmware, fault, 1)
        return honest(line)

    firmware.answer = spoiling
    with plugged(firmware, bench) as address:
        with suppress(DeviceNotFoundError, LinkError, ProtocolError, RefusedError):
            session(address, name)
        assert not bench.light.triggered
        firmware.answer = honest
        firmware.drop_answers = firmware.garble_answers = 0
        assert session(address, name)["enabled"] is True


def test_a_box_that_stays_on_is_told_three_times_and_then_the_person(name):
    driver, settings, box, _, _ = KINDS[name]

    class Stuck(box):
        def move_gate(self, **_):
            super().move_gate(on=True, delay_s=0.0)

        def obey(self, line):
            if line in (b"TSRC 5", b"ASET OFF"):
                return b"" if name == "dg645" else b"OK\r\n"
            return super().obey(line)

    bench = Bench()
    firmware = Stuck(bench)
    firmware.receive(b"TSRC 1\n" if name == "dg645" else b"ASET ON\r")
    with (
        plugged(firmware, bench) as address,
        pytest.raises(RefusedError, match="Treat the detector's gate as RUNNING"),
        driver(address, settings=settings),
    ):
        pass


@pytest.mark.parametrize(
    ("name", "steps", "error", "told"),
    [
        ("dg645", lines((b"*IDN?\n", b"HEWLETT-PACKARD,8112A\r\n")), DeviceNotFoundError, "HEWLETT"),
        ("dg645", lines((b"*IDN?\n", b"")), DeviceNotFoundError, "port 5025"),
        ("t560", lines((b"ASET\r", b"Katana\r\n")), DeviceNotFoundError, "38400 baud"),
        ("t560", lines((b"ASET\r", b"Ch B  POS  ON  Dly 0.0  Wid 0.0\r\n")), DeviceNotFoundError, "Ch B"),
        ("t560", lines((b"ASET\r", b"Ch A  POS  ON  Dly 0.0.0  Wid 0\r\n")), DeviceNotFoundError, "0.0.0"),
    ],
)
def test_another_device_at_the_address_is_not_mistaken(play, name, steps, error, told):
    driver, settings, *_ = KINDS[name]
    with (
        play(steps) as address,
        pytest.raises(error, match=re.escape(told)),
        driver(address, settings=settings),
    ):
        pytest.fail("connected to something else")


def test_an_error_of_a_dg645_is_told_in_words(play):
    steps = lines(
        (b"*IDN?\n", b"Stanford Research Systems,DG645,s/n1,ver1\r\n"),
        (b"LERR?\n", b"30\r\n"),
        (b"LERR?\n", b"0\r\n"),
    )
    steps += [Step(">", b"DLAY 2,0,0.000000010000\n"), *lines((b"LERR?\n", b"12\r\n"))]
    steps += [Step(">", b"TSRC 5\n"), *lines((b"LERR?\n", b"0\r\n"), (b"TSRC?\n", b"5\r\n"))]
    with (
        play(steps) as address,
        Dg645(address, settings=DG645) as delayer,
        pytest.raises(RefusedError, match=r"error 12: illegal delay"),
    ):
        delayer.set_delay(10e-9)


def test_a_kept_delay_that_is_another_one_is_refused(play):
    steps = lines(
        (b"ASET\r", b"Ch A POS OFF Dly 0.0 Wid 0.0\r\n"),
        (b"ID\r", b"??\r\n"),
        (b"AUTOINSTALL 1\r", b"OK\r\n"),
        (b"ADELAY 10.00n\r", b"OK\r\n"),
        (b"ASET\r", b"Ch A POS OFF Dly 0.00000002 Wid 0.0\r\n"),
        (b"ASET OFF\r", b"OK\r\n"),
        (b"ASET\r", b"Ch A POS OFF Dly 0.00000002 Wid 0.0\r\n"),
    )
    with (
        play(steps) as address,
        T560(address, settings=T560_AT) as delayer,
        pytest.raises(RefusedError, match="delay by 10 ns, but it kept 20 ns"),
    ):
        delayer.set_delay(10e-9)


def test_a_delayer_on_the_network_is_reached_by_a_socket_address():
    """The same line serves: pyserial opens ``socket://host:port``."""
    bench = Bench()
    box = Dg645Box(bench)
    listening = socket.create_server(("127.0.0.1", 0))

    def serve():
        caller, _ = listening.accept()
        with caller:
            while data := caller.recv(256):
                box.receive(data)
                caller.sendall(bytes(box.output))
                box.output.clear()

    server = threading.Thread(target=serve, daemon=True)
    server.start()
    address = f"socket://127.0.0.1:{listening.getsockname()[1]}"
    assert session(address, "dg645")["enabled"] is True
    server.join(5.0)
    assert not server.is_alive()
    assert not bench.light.triggered
    listening.close()
    with pytest.raises(DeviceNotFoundError, match="there is no such port"):
        session(address, "dg645")


DG645_WORDS = [
    b"DLAY ",
    b"2",
    b"0",
    b",",
    b"1e-6",
    b"?",
    b"TSRC",
    b" 1",
    b"LAMP",
    b"\n",
    b"-",
    b"9e99",
    b"LERR?",
]
T560_WORDS = [
    b"A",
    b"DELAY ",
    b"SET ",
    b"ON",
    b"TRIGGER ",
    b"POS",
    b"12.5n",
    b";",
    b"\r",
    b"TLEVEL",
    b"AUTO",
    b"9s",
]


@pytest.mark.parametrize(("box", "words"), [(Dg645Box, DG645_WORDS), (T560Box, T560_WORDS)])
def test_the_box_survives_what_it_is_sent(box, words):
    pieces = st.lists(st.one_of(st.sampled_from(words), st.binary(max_size=30)), max_size=40)

    @given(pieces.map(b"".join))
    def survives(data):
        bench = Bench()
        firmware = box(bench)
        firmware.receive(data)
        assert 0 <= bench.light.gate_delay_s < 2001
        assert bytes(firmware.output[-2:]) in (b"", b"\r\n")
        firmware.output.clear()
        firmware.receive(b"\nLERR?\n" if box is Dg645Box else b"\rTDIV\r")
        assert bytes(firmware.output).endswith(b"\r\n")

    survives()


@pytest.mark.parametrize("name", KINDS)
@given(answers=st.lists(st.binary(max_size=80), max_size=6))
def test_whatever_is_answered_the_driver_raises_what_it_says(name, answers):
    class Nonsense:
        def __init__(self):
            self.output = bytearray()
            self.left = list(answers)

        def receive(self, _):
            if self.left:
                self.output += self.left.pop(0) + b"\r\n"

    bench = Bench()
    with plugged(Nonsense(), bench) as address, pytest.raises(DeviceError):
        session(address, name)
