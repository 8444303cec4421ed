"""Shutters on a line of a board or of a serial port: closed at the beginning, at the end, and in doubt."""

import inspect
import os
import sys

import numpy as np
import pytest

from drivers.daq.board import SharedBoard
from drivers.errors import DeviceError, DeviceNotFoundError, LinkError, RefusedError
from drivers.shutters.daq import DaqShutter
from drivers.shutters.serial_port import SerialShutter
from rig.model import devices
from simulators.bench import Bench
from simulators.wire.daq import DaqWiring, SimulatedBoard
from simulators.wire.serial_url import protocol_sim
from simulators.wire.shutter import PortShutter

LINE = "port1/line0"


class OnBoard:
    """A shutter on a simulated DAQ board."""

    def __init__(self, opens_high=True):
        self.bench = Bench()
        self.bench.change_light(shuttered=True, emitting=True)
        self.board = SimulatedBoard(self.bench, DaqWiring(shutter=LINE, opens_high=opens_high))
        self.shared = SharedBoard(self.board)
        self.shutter = DaqShutter(self.shared, LINE, clock=self.bench.clock, opens_high=opens_high)

    def unplug(self):
        self.board.unplug()

    def close(self):
        pass


class OnPort:
    """A shutter on a simulated serial port, which tells where it is."""

    def __init__(self, opens_high=True, read_back="cts", line="rts"):
        self.bench = Bench()
        self.bench.change_light(shuttered=True, emitting=True)
        self.firmware = PortShutter(self.bench, line=line, opens_high=opens_high)
        self.address = protocol_sim.attach("shutter", self.firmware, self.bench.clock)
        self.shutter = SerialShutter(
            self.address, clock=self.bench.clock, line=line, read_back=read_back, opens_high=opens_high
        )

    def unplug(self):
        protocol_sim.detach(self.address)

    close = unplug


@pytest.fixture(params=[OnBoard, OnPort])
def kind(request):
    return request.param


@pytest.fixture
def placed(kind):
    one = kind()
    yield one
    one.close()


def test_it_is_what_the_application_asks_for(placed):
    with placed.shutter as shutter:
        for member, asked in inspect.getmembers(devices.Shutter, inspect.isfunction):
            if not member.startswith("_"):
                offered = inspect.signature(getattr(shutter, member))
                assert list(offered.parameters) == list(inspect.signature(asked).parameters)[1:], member
        assert "shutter" in shutter.identity
        assert shutter.settings()["identity"] == shutter.identity


def test_light_passes_only_while_it_is_open(placed):
    with placed.shutter as shutter:
        assert not shutter.is_open()
        assert placed.bench.light.on_wall == 0
        shutter.let_through()
        assert shutter.is_open()
        assert placed.bench.light.on_wall == 1
        assert placed.bench.light.sync_hz > 0
        shutter.close()
        assert placed.bench.light.on_wall == 0
        shutter.let_through()
    assert placed.bench.light.on_wall == 0


def test_it_is_closed_when_it_is_reached(placed):
    placed.bench.change_light(shuttered=False)
    with placed.shutter:
        assert placed.bench.light.on_wall == 0


@pytest.mark.parametrize("opens_high", [True, False])
def test_the_level_at_which_it_opens_is_chosen(kind, opens_high):
    placed = kind(opens_high)
    with placed.shutter as shutter:
        assert placed.bench.light.shuttered
        shutter.let_through()
        assert not placed.bench.light.shuttered
    # an output of a closed port is low, whatever was wanted
    assert placed.bench.light.shuttered == (kind is OnBoard or opens_high)
    placed.close()


def test_opening_and_closing_take_their_time(kind):
    placed = kind()
    with placed.shutter as shutter:
        before_s = placed.bench.clock.now_s()
        shutter.let_through()
        assert placed.bench.clock.now_s() - before_s == pytest.approx(20e-3)
    placed.close()


def test_an_exception_closes_it(placed):
    def interrupted():
        with placed.shutter as shutter:
            shutter.let_through()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert placed.bench.light.on_wall == 0


def test_outside_its_with_block_it_says_so(placed):
    with pytest.raises(LinkError, match="with block"):
        placed.shutter.let_through()
    placed.shutter.close()  # safe at any time


def test_unplugged_while_open_it_is_said_to_be_open(placed):
    def used():
        with placed.shutter as shutter:
            shutter.let_through()
            placed.unplug()

    with pytest.raises(DeviceError, match="Treat the shutter as OPEN"):
        used()


def test_absent_it_is_named(placed):
    placed.unplug()
    with pytest.raises(DeviceNotFoundError, match=r"shutter|DAQ board"):
        placed.shutter.__enter__()


def test_one_that_is_stuck_is_told_three_times_and_then_the_person():
    placed = OnPort()

    def used():
        with placed.shutter as shutter:
            shutter.let_through()
            placed.firmware.stuck = True

    with pytest.raises(RefusedError, match=r"reports that it is open.*Treat the shutter as OPEN"):
        used()
    placed.close()


def test_one_that_stays_closed_is_told_as_that():
    placed = OnPort()
    with placed.shutter as shutter:
        placed.firmware.stuck = True
        with pytest.raises(RefusedError, match="it stays closed"):
            shutter.let_through()
    placed.close()


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX alone has pseudo-terminals")
def test_a_port_without_such_a_line_is_told_as_open():
    """A pseudo-terminal is opened by the system's driver, and has neither RTS nor DTR."""
    here, there = os.openpty()
    try:
        shutter = SerialShutter(os.ttyname(there), clock=Bench().clock)
        with pytest.raises(LinkError, match=r"that it has this line|Treat the shutter as OPEN"):
            shutter.__enter__()
    finally:
        os.close(here)
        os.close(there)


def test_without_read_back_it_is_where_it_was_told_to_be():
    placed = OnPort(read_back=None)
    with placed.shutter as shutter:
        assert shutter.settings()["read_back"] is False
        placed.firmware.stuck = True
        shutter.let_through()
        assert shutter.is_open()
    placed.close()


def test_it_can_hang_on_dtr():
    placed = OnPort(line="dtr", read_back="dsr")
    with placed.shutter as shutter:
        shutter.let_through()
        assert placed.bench.light.on_wall == 1
    placed.close()


def test_it_moves_while_the_board_plays_and_what_is_loaded_stays_loaded():
    placed = OnBoard()
    levels = np.zeros((100, 1), np.bool_)
    levels[::2] = True
    with placed.shutter as shutter:
        placed.shared.load_lines(["port0/line0"], levels, 1000.0)
        shutter.let_through()
        placed.shared.start()  # what was loaded is still there
        assert placed.shared.playing()
        shutter.close()
        assert placed.shared.playing()
        assert placed.bench.light.on_wall == 0
