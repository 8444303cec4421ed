"""The point clock on a DAQ board: a pulse for the mirror and pulses for the markers, at even times.

Samples are played at twice the rate of the ticks: at each tick lines go high for half a tick, then low. So
each tick has rising edges, which is what mirror and markers count.
"""

from dataclasses import dataclass
from math import isfinite
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.daq.board import SharedBoard
from drivers.errors import LimitError, LinkError
from drivers.leaving import leave

SAMPLES_PER_TICK = 2

#: Longest time between two ticks: far beyond any exposure of a point, and within a counter's range.
LONGEST_TICK_S = 60.0


@dataclass(frozen=True)
class PulseLines:
    """Which digital lines the pulses go to, as the board names them, e.g. ``port0/line0``.

    Attributes
    ----------
    markers
        Of marker inputs M1, M2 and so on, four at most.
    step
        Of the mirror's step input; None where no mirror has one.
    """

    markers: tuple[str, ...]
    step: str | None = None

    @property
    def all(self) -> tuple[str, ...]:
        """All lines, the mirror's last."""
        return self.markers if self.step is None else (*self.markers, self.step)

    def levels(self, marks: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return the levels (2 n, lines) of n ticks with these marks."""
        levels = np.zeros((SAMPLES_PER_TICK * len(marks), len(self.all)), np.bool_)
        for bit in range(len(self.markers)):
            levels[::SAMPLES_PER_TICK, bit] = marks & (1 << bit) != 0
        if self.step is not None:
            levels[::SAMPLES_PER_TICK, -1] = True
        return levels


class DaqPointClock:
    """Pulses of a DAQ board; a context manager that finds and leaves all lines low.

    Parameters
    ----------
    board
        The board, maybe shared with an analogue galvo.
    lines
        Where the pulses go.

    Attributes
    ----------
    identity
        The board's model and serial number.
    """

    def __init__(self, board: SharedBoard, lines: PulseLines) -> None:
        self._board = board
        self._lines = lines
        self._fastest_hz = 0.0
        self._open = False
        self.identity = ""

    def __enter__(self) -> Self:
        self.identity = self._board.identity()
        self._fastest_hz = self._board.fastest_hz(analogue=False)
        self._board.set_lines(self._lines.all, False)
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False
        leave([self._board.stop, self._low], problem)

    def load(self, marks: NDArray[np.uint8], tick_s: float) -> None:
        """Load what is marked, for the next start.

        Parameters
        ----------
        marks
            (n,) marker inputs of each tick, a bit each: M1 is 1, M2 is 2, M3 is 4, M4 is 8.
        tick_s
            Time between two ticks.

        Raises
        ------
        LimitError
            There are no ticks or too many, they are too fast or too slow, or a marker has no line. Nothing
            was sent.
        """
        self._require_open("load marks")
        self._check(marks, tick_s)
        self._board.load_lines(self._lines.all, self._lines.levels(marks), SAMPLES_PER_TICK / tick_s)

    def start(self) -> None:
        """Begin with the first tick, now, and with an analogue galvo's trajectory if one is loaded.

        Raises
        ------
        LimitError
            Nothing is loaded, or the galvo has another number of positions; nothing was sent.
        RefusedError
            The board cannot play it, or not at this rate.
        LinkError
            The board is gone.
        """
        self._require_open("start")
        self._board.start()

    def running(self) -> bool:
        """Return whether ticks are still to come; raise `DeviceError` if the board failed meanwhile."""
        self._require_open("report whether it ticks")
        return self._board.playing()

    def stop(self) -> None:
        """End the ticks, all lines low; safe to call at any time."""
        self._require_open("stop")
        leave([self._board.stop, self._low], None)

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return where the pulses go, and what the board says of itself."""
        self._require_open("report its settings")
        return {
            "identity": self._board.identity(),
            "marker_lines": ", ".join(self._lines.markers),
            "step_line": self._lines.step or "none",
            "fastest_samples_hz": self._fastest_hz,
        }

    def _low(self) -> None:
        self._board.set_lines(self._lines.all, False)

    def _require_open(self, asked: str) -> None:
        if not self._open:
            raise LinkError(self._board.name, asked, "it is not open", "Use the point clock in a with block.")

    def _check(self, marks: NDArray[np.uint8], tick_s: float) -> None:
        """Raise `LimitError` unless the board can give these pulses."""
        most = self._board.most_samples // SAMPLES_PER_TICK
        shortest_s = SAMPLES_PER_TICK / self._fastest_hz
        marked = int(np.bitwise_or.reduce(marks, axis=None))
        if marks.ndim != 1 or not 0 < len(marks) <= most:
            asked, limit = f"give {marks.size} ticks", f"it accepts 1 to {most}, in a one-dimensional array"
        elif not isfinite(tick_s) or not shortest_s <= tick_s <= LONGEST_TICK_S:
            asked = f"tick every {tick_s:g} s"
            limit = f"its interval can be {shortest_s:.3g} s to {LONGEST_TICK_S:g} s"
        elif marked >> len(self._lines.markers):
            asked = f"mark inputs {marked:04b} (M1 is the last digit)"
            limit = f"only {len(self._lines.markers)} have a line"
        else:
            return
        raise LimitError(
            self._board.name,
            asked,
            limit,
            "Nothing was sent. Change exposure or grid, or point_clock.markers.",
        )
