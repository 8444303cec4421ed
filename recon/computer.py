"""What this process may use of its computer: cores and memory.

A batch system or a container gives a process a part of a computer. Counted by the whole, too many threads
share its cores, and the system ends it without a word when its memory is over.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from math import ceil, inf
from pathlib import Path, PurePosixPath

#: Where Linux says which control groups a process belongs to, and where they are.
_GROUPS, _MOUNTED = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
#: What is supposed where the system does not say [bytes].
_SUPPOSED_BYTES = 16e9


def cores() -> int:
    """Return how many cores this process may use: of the computer, its affinity and its control group."""
    allowed = os.cpu_count() or 1
    if sys.platform == "linux":
        allowed = len(os.sched_getaffinity(0))
    return max(1, min(allowed, ceil(min(group_cores(_GROUPS, _MOUNTED), allowed))))


def usual_threads() -> int:
    """Return how many threads compute: ``OMP_NUM_THREADS``, as other libraries take it, else all cores.

    It may be a list for nested loops, as ``4,2``: the first counts.
    """
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return int(asked) if asked.isdecimal() and int(asked) > 0 else cores()


def memory_bytes() -> float:
    """Return how much memory this process may use: of the computer, and of its control group."""
    whole = _SUPPOSED_BYTES
    if sys.platform != "win32":
        with suppress(OSError, ValueError):  # not every system says
            whole = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    return min(whole, group_bytes(_GROUPS, _MOUNTED))


@cache
def group_cores(groups: Path, mounted: Path) -> float:
    """Return how many cores' time the control groups of a process allow; infinity where they do not say."""
    least = inf
    for folder in _folders(groups, mounted, "cpu"):
        quota, period = (*_words(folder / "cpu.max"), "", "")[:2]
        quota = quota or next(_words(folder / "cpu.cfs_quota_us"), "")
        period = period or next(_words(folder / "cpu.cfs_period_us"), "")
        with suppress(ValueError, ZeroDivisionError):
            share = float(quota) / float(period)
            least = min(least, share if share > 0 else inf)  # -1: no limit
    return least


@cache
def group_bytes(groups: Path, mounted: Path) -> float:
    """Return how much memory the control groups of a process allow; infinity where they do not say."""
    least = inf
    for folder in _folders(groups, mounted, "memory"):
        for name in ("memory.max", "memory.limit_in_bytes"):
            with suppress(ValueError):
                least = min(least, float(next(_words(folder / name), "inf").replace("max", "inf")))
    return least


def _folders(groups: Path, mounted: Path, controller: str) -> Iterator[Path]:
    """Yield the folders of a process's control groups, of both versions, and those that they lie in."""
    lines: list[str] = []
    with suppress(OSError, UnicodeDecodeError):
        lines = groups.read_text().splitlines()
    for line in lines:
        _, controllers, path = (*line.split(":", 2), "", "")[:3]
        if controllers and controller not in controllers.split(","):
            continue
        root = mounted / controller if controllers else mounted
        place = PurePosixPath("/" + path.lstrip("/"))
        for within in (place, *place.parents):  # what a container does not see of it is not there
            yield root / str(within).lstrip("/")


def _words(path: Path) -> Iterator[str]:
    with suppress(OSError, UnicodeDecodeError):
        yield from path.read_text().split()
