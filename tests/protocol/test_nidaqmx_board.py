"""A board of National Instruments: the calls to its package, on a stand-in and on a board if there is one."""

import inspect
import os
import sys
import time

import numpy as np
import pytest

from drivers.clock import SystemClock, wait_until
from drivers.daq.analogue_galvo import AnalogueGalvo
from drivers.daq.board import SharedBoard
from drivers.daq.nidaqmx_board import NidaqmxBoard
from drivers.daq.point_clock import DaqPointClock, PulseLines
from drivers.errors import DeviceNotFoundError, LinkError, RefusedError
from support import nidaqmx_stand_in as stand_in

LINES = PulseLines(("port0/line0", "port0/line1", "port0/line2"), "port0/line4")
CLOCK = "/Dev1/Ctr0InternalOutput"


@pytest.fixture
def world():
    with stand_in.installed() as world:
        yield world
        assert not world.open, "each task was closed"


def on_board(device: str = "Dev1", lines: PulseLines = LINES):
    board = SharedBoard(NidaqmxBoard(device))
    return AnalogueGalvo(board, ("ao0", "ao1"), clock=SystemClock()), DaqPointClock(board, lines)


def test_it_says_who_it_is(world):
    _, clock = on_board()
    with clock:
        assert clock.identity == "NI PCIe-6343, serial number 01A2B3C4 (simulated by NI-DAQmx)"
        assert clock.settings()["fastest_samples_hz"] == 10e6


def test_lines_are_low_at_both_ends(world):
    _, clock = on_board()
    low = {f"Dev1/{line}": False for line in LINES.all}
    with clock:
        assert world.levels == low
        world.levels["Dev1/port0/line0"] = True  # as when it is stopped in the middle of a pulse
        clock.stop()
        assert world.levels == low
        world.levels["Dev1/port0/line4"] = True
    assert world.levels == low


def test_marks_are_played_by_the_counter(world):
    _, clock = on_board()
    with clock:
        clock.load(np.array([7, 0, 1], np.uint8), 1e-3)
        assert not world.played
        clock.start()
        assert world.pulses_hz == 2000.0
        assert world.played == [
            ("Dev1/port0/line0", [True, False, False, False, True, False], CLOCK),
            ("Dev1/port0/line1", [True, False, False, False, False, False], CLOCK),
            ("Dev1/port0/line2", [True, False, False, False, False, False], CLOCK),
            ("Dev1/port0/line4", [True, False, True, False, True, False], CLOCK),
        ]
        assert clock.running()
        world.finished = True
        assert not clock.running()
        clock.stop()
        assert world.pulses_hz is None


def test_a_single_line_is_played_too(world):
    """The package wants one row less of one line."""
    _, clock = on_board(lines=PulseLines(("port0/line0",)))
    with clock:
        clock.load(np.array([1, 0], np.uint8), 1e-3)
        clock.start()
        assert world.played == [("Dev1/port0/line0", [True, False, False, False], CLOCK)]


def test_galvo_and_marks_wait_for_the_same_counter(world):
    galvo, clock = on_board()
    angles = np.radians([[4.0, 0.0], [8.0, -4.0]])
    with galvo, clock:
        galvo.trajectory(angles, 1e-3)
        # 4 degrees of the beam are 2 of the mirror, at 0.5 V each
        assert world.levels["Dev1/ao0"] == pytest.approx(1.0)
        clock.load(np.array([1, 0], np.uint8), 1e-3)
        clock.start()
        played = {output: (samples, source) for output, samples, source in world.played}
        assert played["Dev1/ao0"] == (pytest.approx([1.0, 1.0, 2.0, 2.0]), CLOCK)
        assert played["Dev1/ao1"] == (pytest.approx([0.0, 0.0, -1.0, -1.0]), CLOCK)
        assert len(played["Dev1/port0/line0"][0]) == 4
        galvo.point(0.0, 0.0)  # the channels have another task from now on; lines are played on
        assert (world.levels["Dev1/ao0"], world.pulses_hz) == (0.0, 2000.0)
        assert clock.running()
    assert world.pulses_hz is None


def test_a_galvo_alone_opens_its_channels_once(world):
    galvo, _ = on_board()
    with galvo:
        galvo.point(0.1, 0.1)
        (first,) = world.open
        galvo.point(-0.1, 0.1)
        assert world.open == [first]


def test_the_next_sweep_can_begin_when_one_is_done(world):
    galvo, clock = on_board()
    with galvo, clock:
        for _ in range(3):
            world.finished = False
            galvo.trajectory(np.zeros((5, 2)), 1e-3)
            clock.load(np.ones(5, np.uint8), 1e-3)
            clock.start()
            world.finished = True
            assert not clock.running()


def test_a_rate_that_is_rounded_too_far_is_refused(world):
    world.rounds_to_hz = lambda rate_hz: rate_hz * 1.001
    _, clock = on_board()
    with clock:
        clock.load(np.ones(3, np.uint8), 1e-3)
        with pytest.raises(RefusedError, match="play 2000 samples a second, but it plays 2002"):
            clock.start()
        assert world.pulses_hz is None
        assert len(world.open) == 0


def test_another_program_on_its_lines_is_told(world):
    with stand_in.Task() as theirs:
        theirs.do_channels.add_do_chan("Dev1/port0/line0", line_grouping=stand_in.LineGrouping.CHAN_PER_LINE)
        theirs.write(True, auto_start=True)
        _, clock = on_board()
        with pytest.raises(RefusedError, match="Close the other program"), clock:
            pass


def test_a_failure_while_it_plays_is_told(world):
    _, clock = on_board()
    with clock:
        clock.load(np.ones(3, np.uint8), 1e-3)
        clock.start()
        world.fails_with = -201003
        with pytest.raises(LinkError, match=r"NI-DAQmx says: It failed \(-201003\)"):
            clock.running()


@pytest.mark.parametrize(
    ("device", "lines", "why"),
    [
        ("Dev2", LINES, r"DAQ board Dev2: asked to report its identity.*-200220.*NI MAX"),
        ("Dev1", PulseLines(("port0/line99",)), r"set port0/line99.*-200170"),
    ],
)
def test_what_is_not_there_is_named(world, device, lines, why):
    _, clock = on_board(device, lines)
    with pytest.raises(DeviceNotFoundError, match=why), clock:
        pass


def test_without_its_driver_it_says_what_to_install(world):
    world.installed = False
    _, clock = on_board()
    with (
        pytest.raises(DeviceNotFoundError, match=r"NI-DAQmx is not installed. Install"),
        clock,
    ):
        pass


def test_without_its_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    _, clock = on_board()
    with pytest.raises(DeviceNotFoundError, match="pip install nidaqmx"), clock:
        pass


def test_the_stand_in_takes_what_the_package_takes():
    """Each parameter that the stand-in has is one of the package's, at the same place or by its name."""
    nidaqmx = pytest.importorskip("nidaqmx", reason="the package nidaqmx is not installed")
    from nidaqmx.task._timing import Timing
    from nidaqmx.task.collections import AOChannelCollection, COChannelCollection, DOChannelCollection

    pairs = [
        (stand_in._Lines.add_do_chan, DOChannelCollection.add_do_chan),
        (stand_in._Voltages.add_ao_voltage_chan, AOChannelCollection.add_ao_voltage_chan),
        (stand_in._Counters.add_co_pulse_chan_freq, COChannelCollection.add_co_pulse_chan_freq),
        (stand_in._Timing.cfg_samp_clk_timing, Timing.cfg_samp_clk_timing),
        (stand_in._Timing.cfg_implicit_timing, Timing.cfg_implicit_timing),
        (stand_in.Task.write, nidaqmx.Task.write),
        (stand_in.Task.start, nidaqmx.Task.start),
        (stand_in.Task.is_task_done, nidaqmx.Task.is_task_done),
        (stand_in.Task.close, nidaqmx.Task.close),
    ]
    for ours, theirs in pairs:
        assert set(inspect.signature(ours).parameters) <= set(inspect.signature(theirs).parameters), theirs
    assert stand_in.LineGrouping.CHAN_PER_LINE.value == nidaqmx.constants.LineGrouping.CHAN_PER_LINE.value
    for mode in stand_in.AcquisitionType:
        assert nidaqmx.constants.AcquisitionType[mode.name].value == mode.value
    for name in ("product_type", "serial_num", "is_simulated", "do_max_rate", "ao_max_rate"):
        assert hasattr(nidaqmx.system.Device, name), name


@pytest.mark.moves
def test_a_board_of_ni_plays():
    """On a board that NI MAX simulates, or on a real one: ``RIG_TEST_NIDAQMX=Dev1``. 0.2 s of ticks."""
    device = os.environ.get("RIG_TEST_NIDAQMX")
    if not device:
        pytest.skip("no board: RIG_TEST_NIDAQMX names none")
    galvo, clock = on_board(device)
    with galvo, clock:
        galvo.trajectory(np.zeros((200, 2)), 1e-3)
        clock.load(np.ones(200, np.uint8), 1e-3)
        began_s = time.monotonic()
        clock.start()
        assert clock.running()
        assert wait_until(SystemClock(), lambda: not clock.running(), timeout_s=5.0, every_s=5e-3)
        assert time.monotonic() - began_s >= 0.2
        galvo.trajectory(np.zeros((5000, 2)), 1e-3)
        clock.load(np.ones(5000, np.uint8), 1e-3)
        clock.start()
        galvo.point(0.0, 0.0)
        clock.stop()
        assert not clock.running()
