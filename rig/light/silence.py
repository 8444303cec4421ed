"""How long a program has been silent towards its guard, and whether it ran at all in that time."""

import time
from collections.abc import Callable
from contextlib import suppress

#: How often a thread of its own looks at program and guard.
TURN_S = 0.5

#: Standing still for less is not told.
WORTH_TELLING_S = 0.05


def suspended(process: int) -> bool:
    """Return whether a process was stopped by a signal, where the system tells (Linux does)."""
    with suppress(OSError, IndexError), open(f"/proc/{process}/stat", "rb") as stat:
        return stat.read().rpartition(b")")[2].split()[0] == b"T"  # the name before it may be anything
    return False


class Silence:
    """The longest pause between two words of a program.

    A thread that does nothing else calls `turn` each `TURN_S`. Where it comes late, the whole program was not
    running: the computer was busy, or the program was suspended.

    Parameters
    ----------
    now_s
        The time.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._turned_s = now_s()
        self._late_s = 0.0  # of all turns
        self.begin()

    def begin(self) -> None:
        """Forget what was; the program has just spoken."""
        self._spoke_s = self._now_s()
        self._late_before_s = self._late_until_now_s()
        self._longest_s = self._stood_s = 0.0

    def turn(self) -> None:
        """Take a turn, in a thread of its own."""
        self._late_s = self._late_until_now_s()
        self._turned_s = self._now_s()

    def ends(self) -> None:
        """Hear a word of the program."""
        late_s = self._late_until_now_s()
        silent_s = self._now_s() - self._spoke_s
        if silent_s > self._longest_s:
            self._longest_s, self._stood_s = silent_s, min(late_s - self._late_before_s, silent_s)
        self._spoke_s, self._late_before_s = self._now_s(), late_s

    def __str__(self) -> str:
        """Return in words how long it was, and what for."""
        words = f"it was silent for {self._longest_s:.2g} s"
        if self._stood_s < WORTH_TELLING_S:
            return f"{words}, in which it waited for a device, a library, a disk or the processor"
        return (
            f"{words}, and did not run at all for at least {self._stood_s:.2g} s of these: the computer was "
            "busy, or the program was suspended"
        )

    def _late_until_now_s(self) -> float:
        return self._late_s + max(self._now_s() - self._turned_s - TURN_S, 0.0)
