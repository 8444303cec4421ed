"""A data acquisition board, as far as it is needed here, and how a point clock and a galvo share one."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError, DeviceNotFoundError, LimitError, LinkError, RefusedError

#: Samples that fit into a computer's buffer with ease: 5 million ticks, and 200 MB of levels and voltages.
MOST_SAMPLES = 10_000_000

#: What NI-DAQmx's error codes mean (`nidaqmx.error_codes` has their names). UNCONFIRMED is which of the
#: second group comes when a board is unplugged.
_NOT_THERE = {-200220, -200170, -50300}  # no such device, no such line or channel, no board
_LOST = {-201003, -200045, -200175, -50405, -50401}  # not accessible, removed, not answering, transfer broken
_IN_USE = {-50103, -200022, -201105}  # reserved by another task

#: How much the real rate of samples may differ from what was asked, relatively: a board divides its clock by
#: whole numbers. One in ten thousand is far below what the exposure of a point is known to.
RATE_WITHIN = 1e-4


class Board(Protocol):
    """A board with digital lines and analogue channels that can be set, or played by one sample clock.

    Its methods raise an exception with an integer ``error_code`` when the board's driver refuses, as
    `nidaqmx.errors.DaqError` is one; codes are NI-DAQmx's.
    """

    @property
    def name(self) -> str:
        """What messages call it, e.g. ``DAQ board Dev1``."""
        ...

    @property
    def most_samples(self) -> int:
        """How many samples it plays at one go."""
        ...

    def identity(self) -> str:
        """Ask who it is: model and serial number."""
        ...

    def fastest_hz(self, *, analogue: bool) -> float:
        """Ask how many samples a second it plays at most, on lines, or on these and analogue channels."""
        ...

    def set_lines(self, lines: Sequence[str], levels: Sequence[bool]) -> None:
        """Set lines to levels, now."""
        ...

    def set_volts(self, channels: Sequence[str], volts: Sequence[float]) -> None:
        """Set channels to voltages, now; what is played on them ends, while lines are played on."""
        ...

    def play(
        self,
        rate_hz: float,
        lines: Sequence[str],
        levels: NDArray[np.bool_],
        channels: Sequence[str],
        volts: NDArray[np.float64],
    ) -> float:
        """Begin to play, once; return the samples a second that it really plays.

        Parameters
        ----------
        rate_hz
            Samples a second of the one clock.
        lines, levels
            Digital lines, and their levels (samples, lines).
        channels, volts
            Analogue channels, maybe none, and their voltages (samples, channels).
        """
        ...

    def playing(self) -> bool:
        """Return whether samples are still to come; raise if playing has failed."""
        ...

    def stop(self) -> None:
        """End what is played; lines and channels stay as they are then. Safe to call at any time."""
        ...

    def let_go_of_volts(self) -> None:
        """Let other programs have the channels, which stay as they are."""
        ...


@dataclass(frozen=True)
class _Lines:
    names: tuple[str, ...]
    levels: NDArray[np.bool_]
    rate_hz: float


@dataclass(frozen=True)
class _Volts:
    names: tuple[str, ...]
    volts: NDArray[np.float64]
    rate_hz: float


class SharedBoard:
    """A board that a point clock and an analogue galvo share: what both have loaded is played by one clock.

    Parameters
    ----------
    board
        The board itself.
    """

    def __init__(self, board: Board) -> None:
        self._board = board
        self._lines: _Lines | None = None
        self._volts: _Volts | None = None

    @property
    def name(self) -> str:
        """What messages call it."""
        return self._board.name

    @property
    def most_samples(self) -> int:
        """How many samples it plays at one go."""
        return self._board.most_samples

    def identity(self) -> str:
        """Ask who it is; this and all others raise `drivers.errors.DeviceError` if the board refuses."""
        with self._asked("report its identity"):
            return self._board.identity()

    def fastest_hz(self, *, analogue: bool) -> float:
        """Ask how many samples a second it plays at most."""
        with self._asked("report its highest sample rate"):
            return self._board.fastest_hz(analogue=analogue)

    def set_lines(self, lines: Sequence[str], level: bool) -> None:
        """Set lines to one level, now; what is loaded for some of them is forgotten."""
        if self._lines and set(lines) & set(self._lines.names):
            self._lines = None
        with self._asked(f"set {', '.join(lines)}"):
            self._board.set_lines(lines, [level] * len(lines))

    def set_volts(self, channels: Sequence[str], volts: Sequence[float]) -> None:
        """Set channels to voltages, now; what is loaded for or played on channels is dropped."""
        self._volts = None
        with self._asked(f"set {', '.join(channels)}"):
            self._board.set_volts(channels, volts)

    def load_lines(self, lines: Sequence[str], levels: NDArray[np.bool_], rate_hz: float) -> None:
        """Keep the levels (samples, lines) of digital lines, to be played once by the next `start`."""
        self._lines = _Lines(tuple(lines), levels, rate_hz)

    def load_volts(self, channels: Sequence[str], volts: NDArray[np.float64], rate_hz: float) -> None:
        """Keep the voltages (samples, channels) of channels, to be played once by the next `start`."""
        self._volts = _Volts(tuple(channels), volts, rate_hz)

    def start(self) -> None:
        """Play what is loaded.

        Raises
        ------
        LimitError
            If nothing is loaded for lines, or lines and channels are not loaded alike; nothing was sent.
        RefusedError
            If the board cannot play it, or not at this rate.
        """
        lines = self._lines
        if lines is None:
            raise LimitError(
                self.name, "start", "nothing is loaded", "Load marks before each start; they are played once."
            )
        volts = self._volts or _Volts((), np.empty((len(lines.levels), 0)), lines.rate_hz)
        if len(volts.volts) != len(lines.levels) or volts.rate_hz != lines.rate_hz:
            raise LimitError(
                self.name,
                "start galvo and point clock together",
                f"the galvo has {len(volts.volts)} samples at {volts.rate_hz:g} Hz, the point clock "
                f"{len(lines.levels)} at {lines.rate_hz:g} Hz",
                "Nothing was sent. Load as many positions as marks, with the same time between two.",
            )
        self._lines = self._volts = None
        with self._asked("play"):
            real_hz = self._board.play(lines.rate_hz, lines.names, lines.levels, volts.names, volts.volts)
        if abs(real_hz / lines.rate_hz - 1) > RATE_WITHIN:
            self.stop()
            raise RefusedError(
                self.name,
                f"play {lines.rate_hz:g} samples a second",
                f"it plays {real_hz:.9g}",
                "Choose an exposure of whole microseconds.",
            )

    def playing(self) -> bool:
        """Return whether samples are still to come."""
        with self._asked("keep playing"):
            return self._board.playing()

    def stop(self) -> None:
        """End what is played, and forget what is loaded."""
        self._lines = self._volts = None
        with self._asked("stop"):
            self._board.stop()

    def let_go_of_volts(self) -> None:
        """Let other programs have the analogue channels."""
        with self._asked("release its channels"):
            self._board.let_go_of_volts()

    @contextmanager
    def _asked(self, asked: str) -> Iterator[None]:
        """Turn what the board's driver raises into an error of ours."""
        try:
            yield
        except Exception as problem:
            code = getattr(problem, "error_code", None)
            if not isinstance(code, int):  # an error of ours, or a defect
                raise
            raise _meaning(self.name, asked, code, str(problem)) from problem


def _meaning(name: str, asked: str, code: int, message: str) -> DeviceError:
    """Return an error of ours for one of NI-DAQmx."""
    first_line = (message.strip().splitlines() or ["nothing"])[0].rstrip(".")
    answered = f"NI-DAQmx says: {first_line} ({code})"
    if code in _NOT_THERE:
        return DeviceNotFoundError(
            name, asked, answered, "Check its name, lines and channels: NI MAX or nilsdev lists them."
        )
    if code in _LOST:
        return LinkError(name, asked, answered, "Check its cable and power; then connect again.")
    if code in _IN_USE:
        return RefusedError(name, asked, answered, "Close the other program that uses it.")
    return RefusedError(name, asked, answered, "See NI's description of this code, and docs/point-clock.md.")
