"""A stand-in of the package `nidaqmx`: tasks as NI documents them, that remember what they put out.

It has what a board's driver may use and nothing else, so that a call that the package does not have fails;
`tests/protocol/test_nidaqmx_board.py` holds its signatures against the package where that is installed.
Sources: documentation of nidaqmx 1.7 (reference of Task, error codes) and of NI-DAQmx's task states.
"""

import enum
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

LINES = tuple(f"port0/line{number}" for number in range(8))
CHANNELS = ("ao0", "ao1")


class AcquisitionType(enum.Enum):
    FINITE = 10178
    CONTINUOUS = 10123


class LineGrouping(enum.Enum):
    CHAN_PER_LINE = 0
    CHAN_FOR_ALL_LINES = 1


class DaqError(Exception):
    def __init__(self, message: str, error_code: int) -> None:
        super().__init__(f"{message}\n\nStatus Code: {error_code}")
        self.error_code = error_code


class DaqNotFoundError(Exception):
    pass


class DaqNotSupportedError(Exception):
    pass


class World:
    """What hangs on the board, and all tasks that are open.

    Attributes
    ----------
    levels
        Last value of each output.
    played
        (output, samples) in the order in which tasks were armed, with the source of their clock.
    pulses_hz
        Of the counter, while it gives pulses.
    finished
        Whether tasks with a clock are done.
    rounds_to_hz
        What rate the board makes of one.
    """

    def __init__(self) -> None:
        self.levels: dict[str, float] = {}
        self.played: list[tuple[str, list, str]] = []
        self.pulses_hz: float | None = None
        self.finished = False
        self.fails_with: int | None = None
        self.installed = True
        self.rounds_to_hz = lambda rate_hz: rate_hz
        self.open: list[Task] = []


world = World()


class _Channels:
    def __init__(self, task: "Task") -> None:
        self._task = task

    def _add(self, physical: str, known: tuple[str, ...]) -> None:
        device, _, output = physical.partition("/")
        if device != "Dev1":
            raise DaqError("Device identifier is invalid.", -200220)
        if output not in known:
            raise DaqError("Physical channel specified does not exist on this device.", -200170)
        self._task.outputs.append(physical)


class _Lines(_Channels):
    def add_do_chan(
        self, lines, name_to_assign_to_lines="", line_grouping=LineGrouping.CHAN_FOR_ALL_LINES
    ) -> None:
        assert line_grouping is LineGrouping.CHAN_PER_LINE, "else samples are numbers, one bit a line"
        self._task.sample = np.bool_
        self._add(lines, LINES)


class _Voltages(_Channels):
    def add_ao_voltage_chan(
        self, physical_channel, name_to_assign_to_channel="", min_val=-10.0, max_val=10.0
    ) -> None:
        self._task.sample = np.float64
        self._add(physical_channel, CHANNELS)


class _Pulses:
    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz

    @property
    def co_pulse_freq(self) -> float:
        return world.rounds_to_hz(self._rate_hz)


class _Counters(_Channels):
    def add_co_pulse_chan_freq(self, counter, freq=1.0) -> _Pulses:
        self._add(counter, ("ctr0", "ctr1"))
        self._task.pulses = _Pulses(freq)
        return self._task.pulses


class _Timing:
    def __init__(self, task: "Task") -> None:
        self._task = task

    def cfg_samp_clk_timing(
        self, rate, source="", sample_mode=AcquisitionType.FINITE, samps_per_chan=1000
    ) -> None:
        assert rate > 0
        assert sample_mode is AcquisitionType.FINITE
        self._task.source, self._task.samples_wanted = source, samps_per_chan

    def cfg_implicit_timing(self, sample_mode=AcquisitionType.FINITE, samps_per_chan=1000) -> None:
        assert self._task.pulses, "implicit timing is a counter's"
        assert sample_mode is AcquisitionType.CONTINUOUS


class Task:
    """Configured, written, started, closed; an output belongs to one task that runs."""

    def __init__(self, new_task_name="") -> None:
        if not world.installed:
            raise DaqNotFoundError("Could not find an installation of NI-DAQmx.")
        self.outputs: list[str] = []
        self.sample: type | None = None
        self.source = ""
        self.samples_wanted = 0
        self.samples: np.ndarray | None = None
        self.pulses: _Pulses | None = None
        self.running = False
        self.do_channels, self.ao_channels, self.co_channels = _Lines(self), _Voltages(self), _Counters(self)
        self.timing = _Timing(self)
        world.open.append(self)

    def __enter__(self) -> "Task":
        return self

    def __exit__(self, *raised) -> None:
        self.close()

    def write(self, data, auto_start=False, timeout=10.0) -> int:
        rows = np.asarray(data)
        if len(self.outputs) > 1:
            if rows.shape[0] != len(self.outputs):
                raise DaqError("The number of channels does not match.", -200524)
        else:
            rows = rows[None]
        first = data if np.ndim(data) == 0 else np.asarray(data, object).ravel()[0]
        assert self.sample is np.float64 or isinstance(first, bool | np.bool_), (
            "only booleans are written to lines"
        )
        rows = np.ascontiguousarray(rows, self.sample)
        if self.sample is np.float64 and not (np.abs(rows) <= 10).all():
            raise DaqError("Attempted writing analog data that is too large or too small.", -200561)
        if not self.source:
            assert rows.ndim == 1, "without a clock one sample is written"
            if not auto_start and not self.running:
                raise DaqError("Auto start is false, and the task is not running.", -200846)
            self.start()
            world.levels.update(zip(self.outputs, rows.tolist(), strict=True))
            return 1
        self.samples = rows
        return rows.shape[-1]

    def start(self) -> None:
        for other in world.open:
            if other is not self and other.running and set(other.outputs) & set(self.outputs):
                raise DaqError("The specified resource is reserved.", -50103)
        if self.source:
            if self.samples is None or self.samples.shape[-1] != self.samples_wanted:
                raise DaqError("Generation cannot be started, because the buffer is too small.", -200609)
            for output, row in zip(self.outputs, self.samples, strict=True):
                world.played.append((output, row.tolist(), self.source))
                world.levels[output] = row[-1]
        if self.pulses:
            world.pulses_hz = self.pulses.co_pulse_freq
        self.running = True

    def is_task_done(self) -> bool:
        if world.fails_with is not None:
            raise DaqError("It failed.", world.fails_with)
        return not self.running or (bool(self.source) and world.finished)

    def close(self) -> None:
        if self.pulses:
            world.pulses_hz = None
        self.running = False
        world.open.remove(self)


class _Device:
    name = "Dev1"
    product_type, serial_num, is_simulated = "PCIe-6343", 0x1A2B3C4, True
    do_max_rate, ao_max_rate = 10e6, 900e3


class _Devices:
    def __getitem__(self, name: str) -> _Device:
        if not world.installed:
            raise DaqNotFoundError("Could not find an installation of NI-DAQmx.")
        return _Device() if name == "Dev1" else _Absent()

    def __iter__(self) -> Iterator[_Device]:
        yield self["Dev1"]


class _Absent:
    def __getattr__(self, name: str) -> None:
        raise DaqError("Device identifier is invalid.", -200220)


class System:
    @staticmethod
    def local() -> "System":
        return System()

    devices = _Devices()


@contextmanager
def installed() -> Iterator[World]:
    """Let ``import nidaqmx`` give the stand-in; what hangs on its board is given."""
    global world
    world = World()
    package = types.ModuleType("nidaqmx")
    package.Task = Task
    package.constants = types.SimpleNamespace(AcquisitionType=AcquisitionType, LineGrouping=LineGrouping)
    package.errors = types.SimpleNamespace(
        DaqError=DaqError, DaqNotFoundError=DaqNotFoundError, DaqNotSupportedError=DaqNotSupportedError
    )
    package.system = types.ModuleType("nidaqmx.system")
    package.system.System = System
    before = {name: sys.modules.get(name) for name in ("nidaqmx", "nidaqmx.system")}
    sys.modules.update({"nidaqmx": package, "nidaqmx.system": package.system})
    try:
        yield world
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
