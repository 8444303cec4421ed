"""Even ticks of a point clock, some of which are pulses at marker inputs."""

import numpy as np
from numpy.typing import NDArray


class Ticks:
    """Ticks to come; tick k is at ``start_s + k * tick_s``.

    Parameters
    ----------
    marks
        (n,) marker inputs of each tick, a bit each; 0 marks nothing.
    tick_s
        Time between two ticks [s].
    start_s
        Time of the first [s].

    Attributes
    ----------
    times_s
        (n,) when all of them come [s].
    end_s
        When the last comes that comes at all [s].

    Raises
    ------
    ValueError
        If there is no tick, no time between two, or a mark of another input than the four.
    """

    def __init__(self, marks: NDArray[np.uint8], tick_s: float, start_s: float) -> None:
        if not len(marks) or not tick_s > 0:
            raise ValueError(f"{len(marks)} ticks of {tick_s} s: both numbers must be above 0")
        if marks.max() > 15:
            raise ValueError(f"there are four marker inputs, with a mask of 1 to 15, not {marks.max()}")
        self.tick_s = tick_s
        self.times_s: NDArray[np.float64] = start_s + np.arange(len(marks)) * np.float64(tick_s)
        self.end_s = float(self.times_s[-1])
        marked = np.flatnonzero(marks)
        self._at_s, self._mask = self.times_s[marked], marks[marked]

    def stop(self, now_s: float) -> None:
        """Let none come after a time."""
        self.end_s = min(self.end_s, now_s)
        number = int(np.searchsorted(self._at_s, now_s, "right"))
        self._at_s, self._mask = self._at_s[:number], self._mask[:number]

    def take(self, before_s: float) -> list[tuple[float, int]]:
        """Take away time and mask of the marks that come before a time, in order."""
        number = int(np.searchsorted(self._at_s, before_s, "left"))
        taken = list(zip(self._at_s[:number].tolist(), self._mask[:number].tolist(), strict=True))
        self._at_s, self._mask = self._at_s[number:], self._mask[number:]
        return taken
