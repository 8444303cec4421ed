"""A board of National Instruments, through NI-DAQmx and its Python package `nidaqmx`.

Source: documentation of nidaqmx 1.7 and NI's manuals of the M, S and X Series; not yet run on a board.

A counter of the board is the one sample clock: digital and analogue samples are armed first and wait for its
pulses, then it starts. NI's manuals allow "Counter n Internal Output" as source of both clocks. It goes on
until it is stopped: a task with such a clock is done one pulse after its last sample (NI-DAQmx, device
considerations).

UNCONFIRMED, because it cannot be seen without a board: whether a certain model plays lines from a buffer at
all (many small USB boards, such as USB-6001 and USB-6009, do not; the X Series does, on port 0), whether it
takes a counter as clock of both, and whether lines and channels keep their last level when a task ends.
"""

from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.daq.board import MOST_SAMPLES
from drivers.errors import DeviceNotFoundError
from drivers.leaving import leave

INSTALL = "Install NI-DAQmx from ni.com, and its Python package: pip install nidaqmx."


class NidaqmxBoard:
    """A board as NI-DAQmx knows it, see `drivers.daq.board.Board`.

    Parameters
    ----------
    device
        Its name in NI MAX, e.g. ``Dev1``.
    counter
        The counter that is the sample clock.
    """

    def __init__(self, device: str, *, counter: str = "ctr0") -> None:
        self._device = device
        self._counter = counter
        self._tasks: dict[str, Any] = {}  # clock, lines and volts play; still holds voltages

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"DAQ board {self._device}"

    @property
    def most_samples(self) -> int:
        """How many samples it plays at one go."""
        return MOST_SAMPLES

    def identity(self) -> str:
        """Ask who it is."""
        device = self._found()
        simulated = " (simulated by NI-DAQmx)" if device.is_simulated else ""
        return f"NI {device.product_type}, serial number {device.serial_num:08X}{simulated}"

    def fastest_hz(self, *, analogue: bool) -> float:
        """Ask how many samples a second it plays at most."""
        device = self._found()
        fastest_hz = float(device.do_max_rate)
        return min(fastest_hz, float(device.ao_max_rate)) if analogue else fastest_hz

    def set_lines(self, lines: Sequence[str], levels: Sequence[bool]) -> None:
        """Set lines to levels, now."""
        with self._task() as task:
            self._add_lines(task, lines)
            task.write(_rows(np.array([levels], np.bool_))[..., 0].tolist(), auto_start=True)

    def set_volts(self, channels: Sequence[str], volts: Sequence[float]) -> None:
        """Set channels to voltages, now; a task for them stays open, because opening one takes long."""
        self._end("volts")  # a channel has one task at a time
        if "still" not in self._tasks:
            self._tasks["still"] = self._task()
            self._add_channels(self._tasks["still"], channels)
        self._tasks["still"].write(_rows(np.array([volts], np.float64))[..., 0].tolist(), auto_start=True)

    def play(
        self,
        rate_hz: float,
        lines: Sequence[str],
        levels: NDArray[np.bool_],
        channels: Sequence[str],
        volts: NDArray[np.float64],
    ) -> float:
        """Begin to play; return the rate to which the board has rounded."""
        self.stop()
        try:
            return self._play(rate_hz, lines, levels, channels, volts)
        except BaseException as problem:
            leave([self.stop], problem)
            raise

    def playing(self) -> bool:
        """Return whether samples are still to come; raise if a task has failed."""
        tasks = [self._tasks[name] for name in ("lines", "volts") if name in self._tasks]
        done = [task.is_task_done() for task in tasks]  # of all, because asking is what tells a failure
        return not all(done)

    def stop(self) -> None:
        """End what is played, its clock first, so that lines and channels end with the same sample."""
        leave([partial(self._end, name) for name in ("clock", "lines", "volts")], None)

    def let_go_of_volts(self) -> None:
        """Let other programs have the channels."""
        self._end("still")

    def _play(
        self,
        rate_hz: float,
        lines: Sequence[str],
        levels: NDArray[np.bool_],
        channels: Sequence[str],
        volts: NDArray[np.float64],
    ) -> float:
        clock = self._tasks["clock"] = self._task()
        pulses = clock.co_channels.add_co_pulse_chan_freq(f"{self._device}/{self._counter}", freq=rate_hz)
        clock.timing.cfg_implicit_timing(sample_mode=self._nidaqmx.constants.AcquisitionType.CONTINUOUS)
        if channels:
            self.let_go_of_volts()
            self._tasks["volts"] = self._task()
            self._add_channels(self._tasks["volts"], channels)
            self._arm(self._tasks["volts"], rate_hz, volts)
        self._tasks["lines"] = self._task()
        self._add_lines(self._tasks["lines"], lines)
        self._arm(self._tasks["lines"], rate_hz, levels)
        clock.start()
        return float(pulses.co_pulse_freq)

    def _arm(self, task: Any, rate_hz: float, samples: NDArray[Any]) -> None:
        """Give a task its samples (samples, outputs), and let it wait for the clock."""
        task.timing.cfg_samp_clk_timing(
            rate_hz,
            source=f"/{self._device}/{self._counter.capitalize()}InternalOutput",
            sample_mode=self._nidaqmx.constants.AcquisitionType.FINITE,
            samps_per_chan=len(samples),
        )
        task.write(_rows(samples), auto_start=False)
        task.start()

    def _add_lines(self, task: Any, lines: Sequence[str]) -> None:
        # a channel for each line: then a sample is a boolean, whatever port and place the line has
        grouping = self._nidaqmx.constants.LineGrouping.CHAN_PER_LINE
        for line in lines:
            task.do_channels.add_do_chan(f"{self._device}/{line}", line_grouping=grouping)

    def _add_channels(self, task: Any, channels: Sequence[str]) -> None:
        for channel in channels:
            task.ao_channels.add_ao_voltage_chan(f"{self._device}/{channel}", min_val=-10.0, max_val=10.0)

    def _task(self) -> Any:
        return self._nidaqmx.Task()

    def _end(self, name: str) -> None:
        if task := self._tasks.pop(name, None):
            task.close()

    def _found(self) -> Any:
        """Return what tells the board's properties."""
        nidaqmx = self._nidaqmx
        try:
            return nidaqmx.system.System.local().devices[self._device]
        except (nidaqmx.errors.DaqNotFoundError, nidaqmx.errors.DaqNotSupportedError) as problem:
            raise DeviceNotFoundError(self.name, "answer", "NI-DAQmx is not installed", INSTALL) from problem

    @cached_property
    def _nidaqmx(self) -> Any:
        """The package; it is big, and only needed with such a board."""
        try:
            import nidaqmx
            import nidaqmx.system
        except ImportError:
            raise DeviceNotFoundError(
                self.name, "answer", "the package nidaqmx is not installed", INSTALL
            ) from None
        return nidaqmx


def _rows(samples: NDArray[Any]) -> NDArray[Any]:
    """Turn (samples, outputs) round as nidaqmx wants it: a row for each output, none for one output."""
    rows = np.ascontiguousarray(samples.T)
    return rows if len(rows) > 1 else rows[0]
