"""Keeping the computer awake while a laser is held: one that sleeps looks at nothing, and the laser emits on.

Many computers fall asleep when nobody has typed for a while, as in the middle of a night's scan. Sources:
systemd-inhibit(1), caffeinate(8), and SetThreadExecutionState of Windows.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from rig.apart import apart

#: What keeps a system awake for as long as the command behind it runs. Each way to fall asleep is asked for
#: by itself, since not every person may forbid every one.
_INHIBIT = ("systemd-inhibit", "--mode=block", "--who=rig", "--why=a laser may emit")
_COMMANDS: dict[str, list[tuple[str, ...]]] = {
    "linux": [(*_INHIBIT, f"--what={way}") for way in ("idle", "sleep", "handle-lid-switch")],
    "darwin": [("caffeinate", "-i", "-s")],
}
#: Ends when nobody holds its input any more, however that came about.
_UNTIL_CLOSED = ("cat",)
#: For Windows: until told otherwise, the system is needed.
_CONTINUOUS, _SYSTEM_REQUIRED = 0x80000000, 0x00000001
#: The two clocks are read so shortly after each other.
_TOGETHER_S = 0.1


@contextmanager
def awake() -> Iterator[None]:
    """Ask the system to stay awake for as long as the block; one that cannot be asked is left as it is."""
    with ExitStack() as stack:
        if sys.platform == "win32":
            from ctypes import windll

            windll.kernel32.SetThreadExecutionState(_CONTINUOUS | _SYSTEM_REQUIRED)
            stack.callback(windll.kernel32.SetThreadExecutionState, _CONTINUOUS)
        for command in _COMMANDS.get(sys.platform, []):
            with suppress(OSError):  # it is not installed
                stack.callback(_end, _start(command))
        yield


def _start(command: tuple[str, ...]) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [*command, *_UNTIL_CLOSED],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        **apart(),
    )


def _end(process: "subprocess.Popen[bytes]") -> None:
    with suppress(OSError):
        assert process.stdin is not None
        process.stdin.close()
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def asleep_s() -> float:
    """Return how long the computer has slept since it was started; 0 where the system does not tell.

    Linux has a clock that goes on meanwhile, and one that does not: clock_gettime(2).
    """
    if sys.platform != "linux":
        return 0.0
    while True:
        before_s = time.clock_gettime(time.CLOCK_MONOTONIC)
        always_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        after_s = time.clock_gettime(time.CLOCK_MONOTONIC)
        if after_s - before_s < _TOGETHER_S:
            return max(0.0, always_s - after_s)
