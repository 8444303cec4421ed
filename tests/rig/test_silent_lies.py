"""Devices that lie in the middle of a scan: it ends, or it is told; never complete without a word.

The bench is changed behind the drivers' backs, at its wires and in its physics.
"""

import re
from dataclasses import dataclass, field

import pytest

from attacks.scene import attacked_rig, kept, scan, tiny_config, tiny_plan
from rig.acquire.events import Noticed, StepDone

CONFIG = tiny_config()
#: Lines of 10 positions of 10 ms; the lie begins in the middle of the second.
PLAN = tiny_plan(CONFIG, columns=10, rows=5, exposure_s=10e-3)
BEGINS, FIRST_IN_DOUBT = 14, 10


@dataclass
class Lie:
    """Changes the bench after a step, and perhaps back again after another; remembers what was noticed."""

    begin: object
    end: object = None
    begins: int = BEGINS
    ends: int = -1
    noticed: list = field(default_factory=list)

    def __call__(self, event):
        match event:
            case StepDone(step=step) if step.index == self.begins - 1:
                self.begin()
            case StepDone(step=step) if step.index == self.ends - 1 and self.end:
                self.end()
            case Noticed(kind="warning"):
                self.noticed.append(event)


def lied_to(rig, target, begin, config=CONFIG, plan=PLAN, **options):
    """Return how a scan ended in which something lied, what was noticed, and its file."""
    lie = Lie(begin, **options)
    end = scan(rig, config, plan, target, [lie])
    assert not end.emitting
    assert not end.sensitive
    return end, lie.noticed, kept(target)


def fail_bias(rig):
    rig.bench.change_light(biased=False)


def open_gate(rig):
    rig.spad.receive(b"TS0;FR;AD#")


def move_gate(rig):
    rig.delayer.receive(b"SD9000#")


#: Lies that end a scan, and the words that tell them.
ENDING = {
    "the bias fails": (fail_bias, "nothing was recorded"),
    "the gate falls open": (open_gate, "gated is False, was True|may harm it"),
    "the gate jumps onto the first bounce": (move_gate, "gate_delay_s is 2e-08|may harm it"),
    "the power halves": (lambda rig: rig.laser.receive(b"lp=3\n"), "power_setpoint is 3"),
    "the repetition rate doubles": (
        lambda rig: rig.bench.change_light(repetition_hz=20e6),
        "repetition_hz is 20000000",
    ),
}


@pytest.mark.parametrize("name", ENDING)
def test_the_scan_ends_and_what_is_in_doubt_is_taken_back(tmp_path, name):
    begin, words = ENDING[name]
    with attacked_rig(CONFIG) as rig:
        end, _, file = lied_to(rig, tmp_path / "a.h5", lambda: begin(rig))
    assert end.code == 4, end
    assert re.search(words, end.said), end.said
    assert f"Positions {FIRST_IN_DOUBT} to" in end.said
    assert file.status == "failed"
    assert file.done.sum() == FIRST_IN_DOUBT


def test_a_power_that_rises_tenfold_ends_the_scan(tmp_path):
    config = tiny_config({"laser": {"kind": "katana", "power_setpoint": 1.0}})
    with attacked_rig(config) as rig:
        end, _, file = lied_to(rig, tmp_path / "a.h5", lambda: rig.bench.change_light(power=1.0), config)
    assert end.code == 4
    assert "power_setpoint is 10.0, was 1.0" in end.said
    assert file.done.sum() == FIRST_IN_DOUBT


def test_an_overload_closes_the_detector_at_once(tmp_path):
    plan = tiny_plan(CONFIG, columns=20, rows=10, exposure_s=1e-3)
    with attacked_rig(CONFIG) as rig:
        began_s = []

        def shine():
            began_s.append(rig.bench.clock.now_s())
            rig.bench.change_light(lamp_hz=1e9)

        end, _, file = lied_to(rig, tmp_path / "a.h5", shine, plan=plan)
        took_s = rig.bench.clock.now_s() - began_s[0]
    assert end.code == 4
    assert "may harm it" in end.said
    assert "SWITCH IT OFF BY HAND, NOW" in end.said
    assert file.done.sum() <= 20  # no line after the one in which it began
    assert took_s < 1  # two looks 0.2 s apart at most, and 0.4 s in which the sync's end is waited for


@pytest.mark.parametrize(("lamp_hz", "words"), [(5e6, "photons/s to"), (1e6, "pile-up")])
def test_a_lamp_is_told_with_its_positions(tmp_path, lamp_hz, words):
    with attacked_rig(CONFIG) as rig:
        end, noticed, file = lied_to(rig, tmp_path / "a.h5", lambda: rig.bench.change_light(lamp_hz=lamp_hz))
    assert end.code == 0, end
    assert any(words in one.sentence and (one.first, one.last) == (10, 19) for one in noticed), noticed
    assert any(words in one for one in file.warnings)


FLAGS = {
    0x01: "A bin of the histogram is full",
    0x02: "buffer was full",
    0x04: "The sync was lost",
    0x08: "reference clock was lost",
    0x40: "flags 0x40",
}


@pytest.mark.parametrize("bit", FLAGS)
def test_flags_are_told_those_that_nobody_knows_too(tmp_path, bit):
    with attacked_rig(CONFIG) as rig:
        instrument = rig.harp.instrument
        flags = instrument.flags

        def raise_flag():
            instrument.flags = lambda: flags() | bit

        end, _, file = lied_to(rig, tmp_path / "a.h5", raise_flag)
    assert end.code == 0
    assert any(FLAGS[bit] in one for one in file.warnings), file.warnings


@pytest.mark.parametrize("positions", [1, 3])
def test_a_laser_that_is_dark_between_two_looks_is_seen_by_its_sync(tmp_path, positions):
    """One whole exposure in the dark is the smallest gap that is seen for sure: it ends without a sync."""
    with attacked_rig(CONFIG) as rig:
        end, _, file = lied_to(
            rig,
            tmp_path / "a.h5",
            lambda: rig.bench.change_light(emitting=False),
            end=lambda: rig.bench.change_light(emitting=True),
            ends=BEGINS + positions,
        )
    assert end.code == 4 or any("The sync was lost" in one for one in file.warnings), (end, file.warnings)
    if end.code == 4:
        assert file.done.sum() == FIRST_IN_DOUBT


def test_a_mirror_without_read_back_that_stays_cannot_be_seen(tmp_path):
    """The Optotune's simple mode tells only that it is stable: this is said in docs/safety.md."""
    with attacked_rig(CONFIG) as rig:

        def stay():
            rig.bench.steer = lambda x_rad, y_rad: None

        end, noticed, file = lied_to(rig, tmp_path / "a.h5", stay)
    assert (end.code, noticed) == (0, [])
    assert file.warnings == ()


def test_a_mirror_without_read_back_that_goes_elsewhere_is_told_by_its_light_at_most(tmp_path):
    with attacked_rig(CONFIG) as rig:
        steer = rig.bench.steer

        def wander():
            rig.bench.steer = lambda x_rad, y_rad: steer(0.4, 0.3)

        end, noticed, _ = lied_to(rig, tmp_path / "a.h5", wander)
    assert end.code == 0
    assert all("photons/s" in one.sentence for one in noticed)


def test_a_mirror_that_says_that_it_is_broken_ends_the_scan(tmp_path):
    with attacked_rig(CONFIG) as rig:
        end, _, file = lied_to(rig, tmp_path / "a.h5", lambda: rig.galvo.break_down(1))
    assert end.code == 3
    assert "mirror" in end.said
    assert file.done.sum() == BEGINS
