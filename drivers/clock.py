"""The time a driver waits by. Injected, so that a simulated bench can run ahead of the wall clock."""

import time
from typing import Protocol


class Clock(Protocol):
    """Something that tells time and can wait."""

    def now_s(self) -> float:
        """Return a monotonic time in seconds, origin unspecified."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` seconds of this clock."""
        ...


class SystemClock:
    """The computer's own monotonic clock."""

    def now_s(self) -> float:
        """Return the monotonic time in seconds."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Wait for ``duration_s`` seconds."""
        time.sleep(duration_s)


def wait_until(clock: Clock, ready: "Ready", *, timeout_s: float, every_s: float) -> bool:
    """Poll ``ready`` every ``every_s`` seconds until it is true or ``timeout_s`` has passed.

    Returns
    -------
    bool
        True if ``ready`` became true; False on timeout.
    """
    deadline_s = clock.now_s() + timeout_s
    while not ready():
        if clock.now_s() >= deadline_s:
            return False
        clock.sleep(every_s)
    return True


class Ready(Protocol):
    """A question with a yes or no answer."""

    def __call__(self) -> bool:
        """Return True when the awaited state is reached."""
        ...
