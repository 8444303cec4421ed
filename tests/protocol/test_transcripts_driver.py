"""The drivers against transcripts of what public documents say, with no simulator in sight."""

from math import atan, radians, tan

import numpy as np
import pytest

from drivers.errors import (
    DeviceNotFoundError,
    LimitError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.id120 import Id120Settings, Id120Spad
from drivers.katana.dialects import KATANA_08HP
from drivers.katana.laser import KatanaLaser
from drivers.katana.settings import KatanaSettings
from drivers.optotune import MirrorStatus, OptotuneLimits, OptotuneMirror
from support.scripted_usb import USB_WORDS, ScriptedUsb, framed
from support.wire_script import Step, StepClock, read_transcript


def lines(*exchanges):
    """Steps from (sent, answered) pairs."""
    return [step for sent, answered in exchanges for step in (Step(">", sent), Step("<", answered))]


HANDSHAKE = lines(
    (b"START\r\n", b"OK\r\n"),
    (b"GETID\r\n", b"MR-E-2\r\n"),
    (b"GETSN\r\n", b"NO\r\n"),
    (b"STATUS\r\n", b"00000000\r\n"),
)
PARK = lines((b"XY=0.000000000;0.000000000\r\n", b"OK\r\n"))


def test_mirror_session(play):
    clock = StepClock()
    with (
        play(read_transcript("galvo_session.txt")) as address,
        OptotuneMirror(address, clock=clock) as mirror,
    ):
        assert mirror.identity == "MR-E-2 simulated, serial SIM0001"
        mirror.point(radians(19.8), -radians(14.6))
        mirror.wait_settled(timeout_s=0.1)
        # Three looks at the status, one poll interval of 1 ms between them.
        assert clock.now_s() == pytest.approx(2e-3)


def test_mirror_follows_a_trajectory(play):
    units = np.array([[0.25, 0.125], [-0.25, 0.0]])
    with (
        play(read_transcript("galvo_trajectory.txt")) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
    ):
        mirror.trajectory(np.arctan(units * tan(radians(50))), 1e-3)
        assert mirror.status() == MirrorStatus.NOT_STABLE


def test_mirror_leaves_pro_mode_and_acknowledges_past_errors(play):
    with (
        play(read_transcript("galvo_from_pro_mode.txt")) as address,
        OptotuneMirror(address, clock=StepClock()),
    ):
        pass


@pytest.mark.parametrize(
    ("answer", "error", "words"),
    [
        (b"OL\r\n", RefusedError, "lower limit"),
        (b"OU\r\n", RefusedError, "upper limit"),
        (b"ERROR\r\n", RefusedError, "ERROR"),
        (b"NO\r\n", ProtocolError, "'NO' came"),
        (b"\xffK\r\n", ProtocolError, "xff"),
        (b"", LinkError, "no answer came in 0.5 s"),
        (b"OK", LinkError, "only b'OK' came"),
    ],
)
def test_mirror_tells_what_an_answer_to_a_move_means(play, answer, error, words):
    move = lines((b"XY=0.100000000;0.000000000\r\n", answer))
    x = 0.1 * 1.1917535925942100  # tan(50 degrees)
    with (
        play(HANDSHAKE + move + PARK) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
    ):
        with pytest.raises(error, match=words) as raised:
            mirror.point(atan(x), 0.0)
        assert raised.value.device == "steering mirror at script://wire"
        assert "XY=0.1" in raised.value.asked


@pytest.mark.parametrize("status", [b"0000001g", b"", b"123456789", b" 0000000", b"OKAY"])
def test_mirror_refuses_a_status_that_is_none(play, status):
    steps = HANDSHAKE + lines((b"STATUS\r\n", status + b"\r\n")) + PARK
    with (
        play(steps) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
        pytest.raises(ProtocolError, match="STATUS"),
    ):
        mirror.status()


@pytest.mark.parametrize(
    ("answer", "status"), [(b"OK", 0), (b"00000000 ", 0), (b"00000010  ", 16), (b"0x10 ", 16), (b"OK ", 0)]
)
def test_mirror_status_comes_in_more_than_one_form(play, answer, status):
    steps = HANDSHAKE + lines((b"STATUS\r\n", answer + b"\r\n")) + PARK
    with play(steps) as address, OptotuneMirror(address, clock=StepClock()) as mirror:
        assert mirror.status() == status


def test_mirror_status_has_the_bits_of_the_manual(play):
    steps = HANDSHAKE + lines((b"STATUS\r\n", b"0x00000115\r\n")) + PARK
    with play(steps) as address, OptotuneMirror(address, clock=StepClock()) as mirror:
        assert mirror.status() == (
            MirrorStatus.HEAD_DISCONNECTED
            | MirrorStatus.MIRROR_TEMPERATURE
            | MirrorStatus.NOT_STABLE
            | MirrorStatus.WAS_DISCONNECTED
        )


@pytest.mark.parametrize("angles", [(0.37, 0.0), (0.0, -0.29), (float("nan"), 0.0), (0.0, float("inf"))])
def test_mirror_limits_refuse_before_anything_is_sent(play, angles):
    with (
        play(HANDSHAKE + PARK) as address,
        OptotuneMirror(address, clock=StepClock()) as mirror,
        pytest.raises(LimitError, match="Nothing was sent"),
    ):
        mirror.point(*angles)


def test_mirror_refuses_what_is_outside_the_unit_circle(play):
    """Each axis is within its limit, but tan(40.2 degrees) * sqrt(2) = 1.195 > tan(50 degrees) = 1.192."""
    angle = radians(40.2)
    with (
        play(HANDSHAKE + PARK) as address,
        OptotuneMirror(address, clock=StepClock(), limits=OptotuneLimits((0.8, 0.8))) as mirror,
        pytest.raises(LimitError, match="range"),
    ):
        mirror.point(angle, angle)


GREEN = KatanaSettings(power=7.5, repetition_hz=10e6)
RED = KatanaSettings(model=KATANA_08HP, power=0.8, repetition_hz=40e6)


def katana(address, settings=GREEN, **options):
    return KatanaLaser(address, clock=StepClock(), settings=settings, **options)


def silent_on_settings(steps):
    """Leave out what a setting is answered."""
    settings = {number + 1 for number, step in enumerate(steps) if step.kind == ">" and b"?" not in step.data}
    return [step for number, step in enumerate(steps) if number not in settings or step.kind == ">"]


def retold(steps, *changes):
    """Change what a laser answers."""
    told = []
    for step in steps:
        data = step.data
        if step.kind == "<":
            for old, new in changes:
                data = data.replace(old, new)
        told.append(Step(step.kind, data))
    return told


STATUS = [(b"%s=" % name, b"status: ") for name in (b"lps", b"ltg", b"ltg_freq", b"lp")]


@pytest.mark.parametrize(
    "form",
    [
        lambda steps: steps,
        silent_on_settings,
        lambda steps: retold(steps, *STATUS),
        lambda steps: retold(steps, (b"leg status: ", b"leg=")),
        lambda steps: retold(steps, (b"=10000000", b"=10.0")),
        lambda steps: retold(steps, (b"=10000000", b"=10 MHz")),
        lambda steps: retold(steps, (b"=10000000", b"=10000.0 kHz")),
        lambda steps: retold(steps, (b"=10000000", b"=9999990 Hz")),
    ],
    ids=["as told", "settings unanswered", "status", "name", "MHz unsaid", "MHz", "kHz", "rounded Hz"],
)
def test_laser_session(play, form):
    with play(form(read_transcript("laser_session.txt"))) as address, katana(address) as laser:
        laser.arm()
        laser.emit()


def test_laser_with_its_key_off(play):
    with play(read_transcript("laser_key_off.txt")) as address, katana(address) as laser:
        laser.arm()
        with pytest.raises(RefusedError, match=r"Error 100.*key switch on"):
            laser.emit()


@pytest.mark.parametrize("form", [lambda steps: steps, silent_on_settings])
def test_laser_of_the_other_model_is_known_to_emit_by_what_it_measures(play, form):
    with play(form(read_transcript("laser_775.txt"))) as address, katana(address, RED) as laser:
        assert "775" in laser.identity
        laser.arm()
        laser.emit()


def test_laser_of_the_other_model_is_asked_for_its_emission_where_it_answers(play):
    """UNCONFIRMED: that le? is answered, and how."""
    steps = retold(
        read_transcript("laser_775.txt"),
        (b"unknown command, h for help", b"le status: 0"),
        (b"lpa=0.000", b"le status: 0"),
        (b"lpa=0.800", b"le status: 1"),
    )
    steps = [Step(step.kind, step.data.replace(b"lpa?", b"le?")) for step in steps]
    del steps[4:6]  # what it measures is not asked then
    with play(steps) as address, katana(address, RED) as laser:
        laser.arm()
        laser.emit()


def test_laser_whose_light_is_measured_is_not_armed_for_less_than_can_be_told_from_darkness(rig):
    with (
        rig.laser_08hp(power=0.004) as laser,
        pytest.raises(RefusedError, match=r"Configure a power above 0\.005 W"),
    ):
        laser.arm()


def test_laser_that_cannot_say_whether_it_emits_is_told_to_be_dark_and_refused(play):
    steps = lines((b"lip?\n", b"lip=0\n"), (b"le?\n", b"what\n"), (b"lpa?\n", b"what\n"), (b"le=0\n", b""))
    # what is no answer is read on for, until nothing comes
    with (
        play(steps) as address,
        pytest.raises(ProtocolError, match=r"whether it emits.*le\?.*lpa\?.*turn its key off by hand"),
        katana(address, RED),
    ):
        pytest.fail("connected to a laser that may emit")


@pytest.mark.parametrize(
    ("settings", "said", "told"),
    [
        (
            GREEN,
            lines((b"leg?\n", b"unknown\n"), (b"lip?\n", b"lip=0\n"), (b"le=0\n", b"")),
            "kind = .katana-08hp",
        ),
        (
            RED,
            lines((b"lip?\n", b"unknown\n"), (b"leg?\n", b"status: 1\n"), (b"leg=0\n", b"")),
            'kind = "katana"',
        ),
    ],
)
def test_laser_of_another_model_than_configured_is_told_to_be_dark_and_refused(play, settings, said, told):
    with play(said) as address, pytest.raises(RefusedError, match=told), katana(address, settings):
        pytest.fail("connected to another laser")


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (b"leg?\n", "returns what is sent to it: switch the echo"),
        (b"leg?\r\nleg status: 0\n", "returns what is sent to it: switch the echo"),
        (b"\xe1\x80\xfc\n", "line speed is wrong; the laser needs 38400 baud"),
        (b"\xe1\x80\xfc", "line speed is wrong; the laser needs 38400 baud"),
        (b"\x00\x03\x18\n", "line speed is wrong; the laser needs 38400 baud"),
        (b"", "the line runs at 38400 baud"),
        (b"MR-E-2\n", "another device"),
    ],
)
def test_laser_line_that_is_not_right_is_told_as_what_it_is(play, answer, told):
    steps = lines((b"leg?\n", answer), (b"lip?\n", answer.replace(b"leg", b"lip")))
    with play(steps) as address, pytest.raises(DeviceNotFoundError, match=told), katana(address):
        pytest.fail("connected to something else")


def test_laser_that_does_not_go_dark_is_told_five_times_then_dimmed_and_then_the_person(play):
    bright = lines((b"leg=0\n", b""), (b"leg?\n", b"status: 1\n"))
    found = lines(*2 * [(b"leg?\n", b"status: 1\n")])
    dimmed = lines((b"lp=0.00\n", b""), *2 * [(b"lp?\n", b"lp=0.00\n")])
    with (
        play(found + 5 * bright + dimmed) as address,
        pytest.raises(RefusedError, match="turn its key off by hand"),
        katana(address),
    ):
        pytest.fail("connected to a laser that emits")


@pytest.mark.parametrize(
    "wrong",
    [{"power": 10.1}, {"power": float("nan")}, {"repetition_hz": 0.0}, {"trigger": "x"}],
)
def test_laser_limits_refuse_before_there_is_a_laser(wrong):
    good = {"power": 5.0, "repetition_hz": 10e6}
    with pytest.raises(LimitError, match="Nothing was sent"):
        KatanaSettings(**{**good, **wrong})


@pytest.mark.parametrize(
    "wrong", [{"power": 3.2}, {"repetition_hz": 10e6}, {"repetition_hz": 81e6}, {"trigger": "external"}]
)
def test_laser_limits_are_those_of_its_model(wrong):
    good = {"power": 0.8, "repetition_hz": 40e6, "trigger": "ttl"}
    KatanaSettings(model=KATANA_08HP, **good)
    with pytest.raises(LimitError, match=r"Katana 08HP.*Nothing was sent"):
        KatanaSettings(model=KATANA_08HP, **{**good, **wrong})


def test_spad_session():
    message_script = framed(read_transcript("spad_session.txt"))
    backend = ScriptedUsb([*OPENING, *message_script])
    with Id120Spad(backend=backend, clock=StepClock(), settings=Id120Settings(hold_off_s=120e-9)) as spad:
        assert spad.identity == "ID Quantique,ID120 simulated,SIM0001,1.0"
        spad.enable()
    backend.finish()
    assert backend.claims == 0


OPENING = read_transcript("usbtmc_question.txt", words=USB_WORDS)[:3]
