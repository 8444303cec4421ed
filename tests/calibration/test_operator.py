"""The person at a real rig is asked in words, and only for what changes."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest

from rig.acquire.connect import open_devices
from rig.commands.operator import ConsoleOperator
from rig.errors import UsageError
from rig.model.config import built_in
from rig.model.devices import Board, Preparation


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
    assert told.count("the rig as for a scan") == 1


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
    assert "freely before the cameras" in told


def test_without_a_terminal_nothing_waits_for_ever(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(UsageError, match="Run this in a terminal"):
        ConsoleOperator().prepare(Preparation.BLOCK)


def test_a_rig_of_several_channels_is_calibrated_channel_by_channel(rig):
    Path("two.toml").write_text('[[channels]]\n[[channels]]\nname = "b"\ninput = 1\n[simulation]\n')
    done = rig("calibrate", "irf", "--config", "two.toml")
    assert done.code == 2
    assert "measured with one channel, 2 are configured" in done.err
