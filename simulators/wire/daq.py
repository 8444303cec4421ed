"""A board of NI-DAQmx as the bench's pulse source and, where a galvo is analogue, as what steers its mirror.

It stands behind the methods by which the driver speaks to a board, and refuses with NI-DAQmx's error codes
(`nidaqmx.error_codes`). UNCONFIRMED, and so a choice made here: which code comes when a board is unplugged.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Bench

NO_SUCH_DEVICE = -200220
NO_SUCH_CHANNEL = -200170
NOT_ACCESSIBLE = -201003
RESERVED = -50103
TOO_FAST = -200332
TOO_SLOW = -200331
VOLTS_OUT_OF_RANGE = -200561
WRONG_NUMBER_OF_CHANNELS = -200524
LINES_NOT_BUFFERED = -201062
NO_MEMORY = -50352

#: An output's range, and its smallest step: 16 bits [V].
LARGEST_V = 10.0
STEP_V = 2 * LARGEST_V / 2**16

#: Samples that it plays at one go.
MOST_SAMPLES = 10_000_000

#: Fewest samples a second: far fewer than a clock that is divided down by 32 bits gives.
SLOWEST_HZ = 0.01

#: Where a galvo's stop holds its mirrors, to either side [degrees].
STOP_DEG = 40.0

#: Board's lines and channels: the ports of an X Series board, and two of its analogue outputs.
LINES = (
    *(f"port0/line{number}" for number in range(32)),
    *(f"port{port}/line{number}" for port in (1, 2) for number in range(8)),
)
CHANNELS = ("ao0", "ao1")


#: From the call that starts to the first sample [s], in which NI-DAQmx programs its clock; UNCONFIRMED.
START_S = 0.02

#: The same where the bench's clock jumps: another device's thread may move it on while the board is started,
#: by as much as a timing instrument runs ahead of the program.
START_JUMPING_S = 0.2


class DaqFailure(Exception):  # noqa: N818 - what NI-DAQmx calls an error
    """What the board's driver raises.

    Attributes
    ----------
    error_code
        One of NI-DAQmx's.
    """

    def __init__(self, error_code: int, message: str) -> None:
        super().__init__(f"{message}\n\nStatus Code: {error_code}")
        self.error_code = error_code


@dataclass(frozen=True)
class DaqWiring:
    """What hangs on the board.

    Attributes
    ----------
    markers
        Lines that lead to the timing instrument's marker inputs M1, M2 and so on.
    step
        Line that leads to the mirror's step input; None where none does.
    channels
        Analogue channels that lead to the galvo's x and y; None where its voltages come from elsewhere.
    volts_per_degree
        The galvo's scale: volts for each degree by which its mirrors turn, for x and y.
    shutter
        Line that leads to the shutter in the laser's beam; None where none does.
    opens_high
        Whether the shutter is open at the line's high level.
    """

    markers: tuple[str, ...] = LINES[:4]
    step: str | None = LINES[4]
    channels: tuple[str, str] | None = None
    volts_per_degree: tuple[float, float] = (0.5, 0.5)
    shutter: str | None = None
    opens_high: bool = True


class SimulatedBoard:
    """The board behind its driver's methods.

    Parameters
    ----------
    bench
        It marks and steps, and maybe its mirror is steered; its clock is followed.
    wiring
        What hangs on it.
    device
        Its name.

    Attributes
    ----------
    clock_error
        By which fraction its ticks come too late: 5e-5 is a clock that is 50 ppm slow.
    lost_marks, double_marks
        Numbers of ticks whose markers get lost, or are followed by a second pulse.
    double_after_s
        How long after the first that second pulse comes; a ringing cable takes microseconds.
    start_after_s
        Time from the call that starts to the first sample.
    calls_until_unplugged
        After so many more calls its plug is pulled; None: it stays in.
    buffered_lines
        Whether it can play lines; many small boards cannot.
    """

    def __init__(self, bench: Bench, wiring: DaqWiring | None = None, *, device: str = "Dev1") -> None:
        self.name = f"DAQ board {device}"
        self.clock_error = 0.0
        self.lost_marks: set[int] = set()
        self.double_marks: set[int] = set()
        self.double_after_s = 2e-6
        self.start_after_s = START_S if bench.clock.real_time else START_JUMPING_S
        self.calls_until_unplugged: int | None = None
        self.buffered_lines = True
        self._bench = bench
        self._wiring = wiring or DaqWiring()
        self._plugged_in = True
        self._ends_s = 0.0
        self._played: tuple[str, ...] = ()
        self._volts = np.zeros(len(CHANNELS))

    def unplug(self) -> None:
        """Pull the plug: what is played ends, nothing is answered any more."""
        self._plugged_in = False
        self._halt()

    def plug_in(self) -> None:
        """Plug it in again."""
        self._plugged_in = True

    @property
    def most_samples(self) -> int:
        """How many samples it plays at one go."""
        return MOST_SAMPLES

    def identity(self) -> str:
        """Tell who it is."""
        self._require_plugged_in(DaqFailure(NO_SUCH_DEVICE, "Device identifier is invalid."))
        return "NI PCIe-6343 simulated, serial number 51A01ED5"

    def fastest_hz(self, *, analogue: bool) -> float:
        """Tell how many samples a second it plays: X Series, of two analogue channels and of lines."""
        self._require_plugged_in()
        return 840e3 if analogue else 10e6

    def set_lines(self, lines: Sequence[str], levels: Sequence[bool]) -> None:
        """Set lines to levels; an edge of a single line makes no tick. Lines that play are reserved."""
        self._require(lines, LINES, len(levels))
        if self._playing and set(lines) & set(self._played):
            raise DaqFailure(RESERVED, "The specified resource is reserved.")
        for line, level in zip(lines, levels, strict=True):
            if line == self._wiring.shutter:
                self._bench.change_light(shuttered=bool(level) != self._wiring.opens_high)

    def set_volts(self, channels: Sequence[str], volts: Sequence[float]) -> None:
        """Set channels to voltages."""
        self._require(channels, CHANNELS, len(volts))
        _require_range(np.array(volts))
        for channel, value in zip(channels, volts, strict=True):
            self._volts[CHANNELS.index(channel)] = value
        if self._wiring.channels is not None and set(channels) & set(self._wiring.channels):
            x, y = self._angles_rad(self._volts[[CHANNELS.index(one) for one in self._wiring.channels]])
            self._bench.steer(float(x), float(y))

    def play(
        self,
        rate_hz: float,
        lines: Sequence[str],
        levels: NDArray[np.bool_],
        channels: Sequence[str],
        volts: NDArray[np.float64],
    ) -> float:
        """Play, soon; return the rate that it takes itself to have."""
        self._require(lines, LINES, levels.shape[1])
        self._require(channels, CHANNELS, volts.shape[1])
        if self._playing:
            raise DaqFailure(RESERVED, "The specified resource is reserved.")
        if not self.buffered_lines:
            raise DaqFailure(
                LINES_NOT_BUFFERED, "Buffered operations are not supported on the selected lines."
            )
        if rate_hz > self.fastest_hz(analogue=bool(channels)):
            raise DaqFailure(TOO_FAST, "Sample rate is larger than the maximum sample rate of the device.")
        if not rate_hz >= SLOWEST_HZ:
            raise DaqFailure(TOO_SLOW, "Sample rate is smaller than the minimum sample rate of the device.")
        _require_range(volts)
        sample_s = (1 + self.clock_error) / rate_hz
        begin_s = self._bench.clock.now_s() + self.start_after_s
        self._ends_s = begin_s + len(levels) * sample_s
        self._played = tuple(lines)
        if len(channels):
            self._follow(begin_s + np.arange(len(volts)) * np.float64(sample_s), list(channels), volts)
        self._tick(begin_s, sample_s, list(lines), levels)
        return rate_hz

    def playing(self) -> bool:
        """Tell whether samples are still to come."""
        self._require_plugged_in()
        return self._playing

    def stop(self) -> None:
        """End what is played."""
        self._require_plugged_in()
        self._halt()

    def let_go_of_volts(self) -> None:
        """Do nothing: no other program is there."""
        self._require_plugged_in()

    @property
    def _playing(self) -> bool:
        return self._bench.clock.now_s() < self._ends_s

    def _halt(self) -> None:
        if self._playing:
            self._ends_s = self._bench.clock.now_s()
            self._bench.stop_ticks()
            self._bench.stop_following(self._ends_s)

    def _tick(self, begin_s: float, sample_s: float, lines: list[str], levels: NDArray[np.bool_]) -> None:
        """Turn rising edges into the ticks that step the mirror, and pulses at the marker inputs."""
        rising = levels & ~np.vstack([np.zeros_like(levels[:1]), levels[:-1]])
        at = {line: rising[:, column] for column, line in enumerate(lines)}
        masks = np.zeros(len(levels), np.uint8)
        for bit, line in enumerate(self._wiring.markers):
            if line in at:
                masks[at[line]] |= 1 << bit
        steps = at[self._wiring.step] if self._wiring.step in at else np.zeros(len(levels), np.bool_)
        edges = np.flatnonzero(steps | (masks != 0))
        if not len(edges):
            return
        every = int(np.gcd.reduce(np.diff(edges))) or 1
        marks = masks[edges[0] :: every][: (edges[-1] - edges[0]) // every + 1].copy()
        first_s, tick_s = begin_s + edges[0] * sample_s, every * sample_s
        for tick in sorted(self.double_marks):
            if tick < len(marks) and marks[tick]:
                self._bench.mark(int(marks[tick]), first_s + tick * tick_s + self.double_after_s)
        marks[[tick for tick in self.lost_marks if tick < len(marks)]] = 0
        self._bench.start_ticks(marks, tick_s, start_s=first_s)

    def _follow(self, times_s: NDArray[np.float64], channels: list[str], volts: NDArray[np.float64]) -> None:
        """Let the mirror follow its voltages; it stays at the last."""
        for column, channel in enumerate(channels):
            self._volts[CHANNELS.index(channel)] = volts[-1, column]
        if self._wiring.channels is not None and set(self._wiring.channels) <= set(channels):
            columns = [channels.index(one) for one in self._wiring.channels]
            # a held voltage is one command
            changes = np.append(True, (np.diff(volts, axis=0) != 0).any(axis=1))
            self._bench.follow(times_s[changes], self._angles_rad(volts[changes][:, columns]))

    def _angles_rad(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return optical angles (..., 2) for the galvo's voltages: twice those by which its mirrors turn."""
        given_v = STEP_V * np.round(volts / STEP_V)
        mirrors_deg = np.clip(given_v / np.array(self._wiring.volts_per_degree), -STOP_DEG, STOP_DEG)
        # contiguous: what is compiled for one order of memory would be compiled again for another
        return np.ascontiguousarray(2 * np.radians(mirrors_deg))

    def _require_plugged_in(self, otherwise: DaqFailure | None = None) -> None:
        if self.calls_until_unplugged is not None:
            if self.calls_until_unplugged == 0:
                self.unplug()
            else:
                self.calls_until_unplugged -= 1
        if not self._plugged_in:
            raise otherwise or DaqFailure(NOT_ACCESSIBLE, "Device cannot be accessed.")

    def _require(self, names: Sequence[str], known: Sequence[str], columns: int) -> None:
        self._require_plugged_in()
        for name in names:
            if name not in known:
                raise DaqFailure(
                    NO_SUCH_CHANNEL, f"Physical channel specified does not exist on this device: {name}"
                )
        if columns != len(names):
            raise DaqFailure(
                WRONG_NUMBER_OF_CHANNELS,
                "Write cannot be performed, because the number of channels in the data does not match the "
                "number of channels in the task.",
            )


def _require_range(volts: NDArray[np.float64]) -> None:
    if not (np.abs(volts) <= LARGEST_V).all():
        raise DaqFailure(VOLTS_OUT_OF_RANGE, "Attempted writing analog data that is too large or too small.")
