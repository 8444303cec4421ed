"""The person at a real rig is asked in words, and only for what changes."""

import io
import re
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from rig.acquire.connect import open_devices
from rig.commands import operator
from rig.commands.operator import ConsoleOperator
from rig.errors import InterruptedScanError, RefusedError, UsageError
from rig.model.config import built_in
from rig.model.devices import Board, Preparation, Request


class Terminal(io.StringIO):
    """What a person types."""

    def isatty(self):
        return True


@pytest.fixture
def typed(monkeypatch):
    def prepare(text):
        terminal = Terminal(text)
        monkeypatch.setattr(sys, "stdin", terminal)
        return terminal

    return prepare


def test_each_preparation_is_asked_for_once(typed, capsys):
    terminal = typed("\n\n")
    person = ConsoleOperator()
    person.prepare(Preparation.MEASURE)  # as it is at first: nothing to ask
    person.prepare(Preparation.COVER)
    person.prepare(Preparation.COVER)
    person.prepare(Preparation.MEASURE)
    assert terminal.read() == ""
    told = " ".join(capsys.readouterr().err.split())
    assert told.count("cover the detector's lens") == 1
    assert told.count("the rig is then as for a scan") == 1


def test_the_beam_goes_where_the_person_says(typed, capsys):
    typed("3.25 -1.5\nleft\n3.5 -1.25\n\n")
    with open_devices(built_in()) as devices:
        angles = ConsoleOperator().aim_at(devices.galvo, (0.3, -0.1), lambda: None)
        settings = devices.galvo.settings()
    assert np.degrees(angles) == pytest.approx((3.5, -1.25))
    assert np.degrees([settings["angle_x_rad"], settings["angle_y_rad"]]) == pytest.approx((3.5, -1.25))
    assert "'left' is not two numbers" in capsys.readouterr().err


def test_the_board_is_asked_for_with_its_place(typed, capsys):
    typed("\n\n")
    person = ConsoleOperator()
    person.show_board(Board(9, 6, 0.08), (-0.32, 0.2))
    person.show_board(Board(9, 6, 0.08), None)
    told = " ".join(capsys.readouterr().err.split())
    assert "9 x 6 inner corners at 8 cm flat on the wall" in told
    assert "x = -32 cm, y = 20 cm" in told
    assert "freely in front of the cameras" in told


def test_without_a_terminal_nothing_waits_for_ever(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(UsageError, match="Run this in a terminal"):
        ConsoleOperator().prepare(Preparation.BLOCK)


def test_a_rig_of_several_channels_is_calibrated_channel_by_channel(rig):
    Path("two.toml").write_text('[[channels]]\n[[channels]]\nname = "b"\ninput = 1\n[simulation]\n')
    done = rig("calibrate", "irf", "--config", "two.toml")
    assert done.code == 2
    assert "measured with one channel, 2 are configured" in done.err


BIAS = Request("detector", "Set the detector: bias on", {"biased": True})
DARKNESS = Request("laser", "Switch the laser OFF, now", {"emitting": False}, urgent=True)


class Waiting(Terminal):
    """A terminal at which nobody types anything."""

    def __init__(self):
        super().__init__("")
        self._never = threading.Event()

    def readline(self, *_):
        self._never.wait(20.0)
        return ""


def test_what_is_set_by_hand_is_asked_for_until_there_is_an_answer(typed, capsys):
    terminal = typed("what?\n\nY\n")
    answer = ConsoleOperator().set_by_hand(BIAS)
    assert terminal.read() == ""
    assert re.fullmatch(r"a person, at \d{4}-\d\d-\d\dT\d\d:\d\d:\d\d.*", answer)
    assert capsys.readouterr().err.count("Set the detector: bias on. Done? (y/n)") == 3


def test_a_no_is_a_refusal(typed):
    typed("n\n")
    with pytest.raises(RefusedError, match="you answered no to this: Set the detector: bias on"):
        ConsoleOperator().set_by_hand(BIAS)


def test_the_end_of_what_is_typed_is_nobody(typed, capsys):
    typed("")
    with pytest.raises(UsageError, match=r"there was no answer to.*--yes answers in scripts"):
        ConsoleOperator().set_by_hand(BIAS)
    assert "Traceback" not in capsys.readouterr().err


def test_a_stop_ends_a_question(monkeypatch):
    monkeypatch.setattr(sys, "stdin", Waiting())
    stops = iter([False, False, True])
    with pytest.raises(InterruptedScanError, match="stopped at the question"):
        ConsoleOperator(lambda: next(stops)).set_by_hand(BIAS)


def test_a_stop_does_not_end_the_question_for_darkness(monkeypatch, capsys):
    """Ctrl-C asks for darkness, too; what ends this question is an answer, or pulses that end."""
    monkeypatch.setattr(sys, "stdin", Waiting())
    looks = iter([False, False, True])
    answer = ConsoleOperator(lambda: True).set_by_hand(DARKNESS, lambda: next(looks))
    assert answer.startswith("seen by the program at ")
    assert "SWITCH THE LASER OFF, NOW" in capsys.readouterr().err


def test_yes_answers_what_is_set_and_says_that_it_was_no_person(typed, capsys):
    terminal = typed("n\n")
    answer = ConsoleOperator(yes=True).set_by_hand(BIAS)
    assert terminal.read() == "n\n"
    assert answer.startswith("--yes, at ")
    assert answer.endswith("and no person")
    assert "Set the detector: bias on: assumed to be done (--yes)." in capsys.readouterr().err


def test_yes_never_says_that_a_laser_is_off(monkeypatch):
    monkeypatch.setattr(operator, "SILENCE_S", 0.3)
    with pytest.raises(UsageError, match="nobody was asked"):
        ConsoleOperator(yes=True).set_by_hand(DARKNESS)
    looks = iter([False, True])
    assert ConsoleOperator(yes=True).set_by_hand(DARKNESS, lambda: next(looks)).startswith("seen by")


def test_what_must_not_be_missed_is_a_warning(capsys):
    ConsoleOperator().tell("The detector stays biased.")
    assert "warning: The detector stays biased." in capsys.readouterr().err
