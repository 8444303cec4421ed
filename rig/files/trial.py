"""Trying in a process of its own what a library does with a file that may be anything.

The libraries that read HDF5 and MATLAB files crash on some damaged files, and go round without end in others;
no exception tells of either. So they are given an unknown file first in a child process with limits of time
and memory (`rig.files.trial_child`): a copy of this process where that is safe, else a copy of a helper
without threads (`rig.files.trial_helper`).
"""

import json
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rig.errors import DataFileError
from rig.files.trial_child import STOPPED, Outcome, Trial, forked, spawned


def tried(path: Path, function: Callable[..., Any], *arguments: str) -> Any:
    """Return what a function makes of a file, called in a process of its own.

    Parameters
    ----------
    path
        The file; it is the function's first argument, as text.
    function
        One of a module's own functions, whose result JSON can hold.
    arguments
        Further ones.

    Raises
    ------
    DataFileError
        If the function raises one, or crashes, or takes too long, or needs too much memory.
    """
    answer = _told(run(Trial(function, [str(path), *arguments], path.stat().st_size)))
    if isinstance(answer, str):
        raise DataFileError(
            f"{path} cannot be read: a trial in a separate process {answer}. The file is damaged, "
            "or was made to cause this: copy it again from where it came from"
        )
    if "error" in answer:
        raise DataFileError(str(answer["error"]))
    return answer["result"]


def run(trial: Trial) -> Outcome:
    """Run a trial in the quickest process that is safe."""
    if sys.platform == "win32":
        return spawned(trial)
    if _can_fork():
        return forked(trial)
    from rig.files.trial_helper import helped

    return helped(trial)


def _can_fork() -> bool:
    """Return whether a copy of this process is safe: on Linux, with no second thread of Python's own."""
    return sys.platform == "linux" and threading.active_count() == 1


def _told(outcome: Outcome) -> dict[str, Any] | str:
    """Return a child's answer, or in words why there is none."""
    if outcome.text is None or outcome.code in STOPPED:
        return "did not end"
    with suppress(ValueError, RecursionError):
        answer = json.loads(outcome.text)
        if isinstance(answer, dict) and outcome.code == 0:
            if answer.get("memory"):
                return "needed far more memory than such a file can need"
            if "error" in answer or "result" in answer:
                return answer
    return f"crashed (exit status {outcome.code})"
