"""The clocks by which scans are timed and dated."""

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime

from rig.setup.doctor.finding import Finding

#: Waits are of milliseconds.
COARSEST_S = 1e-3


def check() -> Iterator[Finding]:
    """Return the step of the clock that times, and whether the one that dates is right."""
    step_s = time.get_clock_info("monotonic").resolution
    yield Finding(
        "clock",
        "ok" if step_s <= COARSEST_S else "warning",
        f"steps of {step_s:.1g} s",
        ""
        if step_s <= COARSEST_S
        else "Waiting times are uncertain by that; close programs that slow the timer",
    )
    now = datetime.now().astimezone()
    yield Finding("time", *_dated(f"{now:%Y-%m-%d %H:%M} {now.tzname()}", _synchronized()))


def _dated(now: str, synchronized: bool | None) -> tuple:
    if synchronized is False:
        return (
            "warning",
            f"{now}, not synchronized: dates in files may be wrong",
            "sudo timedatectl set-ntp true",
        )
    return "ok", f"{now}, {'synchronized' if synchronized else 'whether it is synchronized is not known'}"


def _synchronized() -> bool | None:
    """Return whether the system keeps its clock by others; None where it does not say."""
    if shutil.which("timedatectl") is None:
        return None
    command = ["timedatectl", "show", "--property=NTPSynchronized", "--value"]
    with suppress(OSError, subprocess.TimeoutExpired):
        said = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False).stdout.strip()
        return {"yes": True, "no": False}.get(said)
    return None
