"""The process that meets an unknown file: its limits, its answer, and how it is started.

It answers in JSON, which is data alone: a child that such a file has taken over can lie, but it cannot make
its parent run anything.
"""

import faulthandler
import gc
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from rig.errors import DataFileError

#: Seconds of computing that a small file may cost, and bytes a second of a large one. The largest files of
#: this program are walked through in 0.1 s; a slow disk gives 20 MB/s.
CPU_S, BYTES_PER_S = 5.0, 20e6
#: By the clock it may be longer: other programs want the processors, too. So often it is looked whether there
#: is an answer; a longer time between two looks is this process's, or the computer's, and not the file's.
WAIT_S, LOOK_S = 8.0, 0.25
#: A child whose parent is gone ends by itself so much later.
ALONE_S = 20.0
#: Bytes that a reader may need beside the program itself: some for any file, and some for each byte of it.
#: Photon counts are packed 20 to 40 times smaller as a rule.
MEMORY_BYTES, MEMORY_PER_BYTE = 128 * 2**20, 32
#: How a process ends that a limit of time stops.
STOPPED = {-getattr(signal, name) for name in ("SIGXCPU", "SIGKILL", "SIGALRM") if hasattr(signal, name)}
#: The longest answer: a report of names and shapes.
ANSWER_BYTES = 2**24


@dataclass(frozen=True)
class Trial:
    """What is tried.

    Attributes
    ----------
    function
        One of a module's own functions, whose result JSON can hold.
    words
        Its arguments: the file, and further ones.
    size
        Bytes of the file.
    """

    function: Callable[..., Any]
    words: Sequence[str]
    size: int

    @property
    def wait_s(self) -> float:
        """How long it may take by the clock."""
        return WAIT_S + self.size / BYTES_PER_S


@dataclass(frozen=True)
class Outcome:
    """How a trial ended.

    Attributes
    ----------
    text
        All that the child wrote; None where it did not come to an end in time.
    code
        Its exit status, negative for a signal; None where it was ended from here.
    """

    text: bytes | None
    code: int | None


def most_memory(file_bytes: int) -> int:
    """Return how many bytes a reader may need for a file of this size."""
    return MEMORY_BYTES + MEMORY_PER_BYTE * file_bytes


def clean_environment() -> dict[str, str]:
    """Return an environment in which a new process finds what this one does, and starts no threads."""
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join([root, *filter(None, sys.path)])
    return os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}


def forked(trial: Trial, asker: int | None = None) -> Outcome:
    """Try in a copy of this process: it has all modules already, and is there in milliseconds.

    Parameters
    ----------
    trial
        What is tried.
    asker
        A pipe or socket that closes when nobody wants the answer any more; the trial ends then.
    """
    if sys.platform == "win32":
        raise OSError("Windows cannot copy a process")
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of native threads: the child has none
        child = os.fork()
    if child == 0:
        for other in (reading, asker):  # what it holds of others it could answer for
            if other is not None:
                os.close(other)
        _answer_and_leave(writing, trial)
    os.close(writing)
    ended = None
    try:
        with open(reading, "rb", buffering=0) as pipe:
            text = _read_all(pipe.fileno(), trial.wait_s, asker)
        if text is not None:
            ended = os.waitpid(child, 0)[1]
    finally:
        if ended is None:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    return Outcome(text, None if ended is None else os.waitstatus_to_exitcode(ended))


def spawned(trial: Trial) -> Outcome:
    """Try in a new process: slow, for a system that copies none."""
    function = trial.function
    command = [sys.executable, "-P", "-c", f"from {__name__} import main; main()"]
    try:
        done = subprocess.run(
            [*command, function.__module__, function.__name__, *trial.words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=trial.wait_s,
            env=clean_environment(),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome(None, None)
    return Outcome(done.stdout, done.returncode)


def _read_all(
    pipe: int, wait_s: float, asker: int | None, clock: Callable[[], float] = time.monotonic
) -> bytes | None:
    """Return all that comes from a pipe; None where its end does not come in time, or nobody wants it."""
    parts: list[bytes] = []
    waited_for = [pipe] if asker is None else [pipe, asker]
    looked_s = clock()
    while wait_s > 0 and sum(map(len, parts)) <= ANSWER_BYTES:
        there, _, _ = select.select(waited_for, [], [], min(wait_s, LOOK_S))
        now_s = clock()
        wait_s -= min(now_s - looked_s, 2 * LOOK_S)
        looked_s = now_s
        if pipe in there:
            part = os.read(pipe, 2**20)
            if not part:
                return b"".join(parts)
            parts.append(part)
        elif there:
            return None
    return None


def _answer_and_leave(pipe: int, trial: Trial) -> NoReturn:
    """Give a function's answer, and end without what the parent had planned for its own end."""
    code = 1
    try:
        gc.freeze()  # garbage is looked for among its own objects: those of a large program are many
        faulthandler.disable()  # the parent says what happened
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        text = _answer(trial)
        while text:
            text = text[os.write(pipe, text) :]
        code = 0
    finally:
        os._exit(code)


def _answer(trial: Trial) -> bytes:
    _limit(trial)
    try:
        answer = {"result": trial.function(*trial.words)}
    except DataFileError as error:
        answer = {"error": str(error)}
    except MemoryError:
        answer = {"memory": True}
    return json.dumps(answer).encode()


def _limit(trial: Trial) -> None:
    """Limit this process's time and memory, where the system can."""
    if sys.platform == "win32":  # there is the deadline alone
        return
    import resource

    seconds = int(CPU_S + trial.size / BYTES_PER_S)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, trial.wait_s + ALONE_S)  # should its parent be gone by then
    pages = Path("/proc/self/statm")
    if pages.exists():  # a copy of a large program begins with all that this one has
        now = int(pages.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        most = now + 3 * most_memory(trial.size)  # packed, unpacked, and as the program wants it
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def function_of(module: str, name: str) -> Callable[..., Any]:
    """Return one of a module's own functions."""
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def main() -> None:
    """Answer on standard output, as a new process."""
    module, name, *words = sys.argv[1:]
    trial = Trial(function_of(module, name), words, Path(words[0]).stat().st_size)
    sys.stdout.buffer.write(_answer(trial))
