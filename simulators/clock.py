"""The bench's one clock: as fast as the computer can, or in step with the wall clock."""

import threading
import time


class BenchClock:
    """Simulated time in seconds from the moment the bench was built; several threads may use it.

    Parameters
    ----------
    real_time
        False: waiting costs nothing, the clock jumps ahead. True: waiting takes as long as it says.
    begin_s
        Bench time now, of a bench that goes on where another one ended.
    """

    def __init__(self, *, real_time: bool = False, begin_s: float = 0.0) -> None:
        self.real_time = real_time
        self._now_s = begin_s
        self._started_s = time.monotonic() - begin_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Return the bench time in seconds."""
        return self._at_least(time.monotonic() - self._started_s) if self.real_time else self._now_s

    def sleep(self, duration_s: float) -> None:
        """Let ``duration_s`` seconds of bench time pass."""
        until_s = self.now_s() + max(duration_s, 0.0)
        if self.real_time:
            time.sleep(max(until_s - self.now_s(), 0.0))
        self._at_least(until_s)

    def _at_least(self, now_s: float) -> float:
        with self._lock:  # or one thread would put back what another has put forward
            self._now_s = max(self._now_s, now_s)
            return self._now_s
