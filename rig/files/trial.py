"""Trying in a process of its own what a library does with a file that may be anything.

The libraries that read HDF5 and MATLAB files crash on some damaged files, and go round without end in others;
no exception tells of either. So they are given an unknown file first in a child process with limits of time
and memory. It answers in JSON, which is data alone: a child that such a file has taken over can lie, but it
cannot make its parent run anything.
"""

import faulthandler
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from rig.errors import DataFileError

#: Seconds of computing that a small file may cost, and bytes a second of a large one. The largest files of
#: this program are walked through in 0.1 s; a slow disk gives 20 MB/s.
CPU_S, BYTES_PER_S = 5.0, 20e6
#: By the clock it may be longer: other programs want the processors, too.
WAIT_S = 8.0
#: Bytes that a reader may need beside the program itself: some for any file, and some for each byte of it.
#: Photon counts are packed 20 to 40 times smaller as a rule.
MEMORY_BYTES, MEMORY_PER_BYTE = 128 * 2**20, 32
#: How a process ends that the limit of computing time stops.
_STOPPED = {-getattr(signal, name) for name in ("SIGXCPU", "SIGKILL") if hasattr(signal, name)}
#: The longest answer: a report of names and shapes.
_ANSWER_BYTES = 2**24


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
    size = path.stat().st_size
    words = [str(path), *arguments]
    answer = _forked(function, words, size) if _can_fork() else _spawned(function, words, size)
    if isinstance(answer, str):
        raise DataFileError(
            f"{path} cannot be read: a trial in a separate process {answer}. The file is damaged, "
            "or was made to cause this: copy it again from where it came from"
        )
    if "error" in answer:
        raise DataFileError(answer["error"])
    return answer["result"]


def most_memory(file_bytes: int) -> int:
    """Return how many bytes a reader may need for a file of this size."""
    return MEMORY_BYTES + MEMORY_PER_BYTE * file_bytes


def _can_fork() -> bool:
    """Return whether a copy of this process is safe: on Linux, with no second thread of Python's own."""
    return sys.platform == "linux" and threading.active_count() == 1


def _forked(function: Callable[..., Any], words: list[str], size: int) -> dict[str, Any] | str:
    """Answer from a copy of this process: it has all modules already, and is there in milliseconds."""
    if sys.platform == "win32":
        raise OSError("Windows cannot copy a process")
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of native threads: the child has none
        child = os.fork()
    if child == 0:
        os.close(reading)
        _answer_and_leave(writing, function, words, size)
    os.close(writing)
    ended = None
    try:
        with open(reading, "rb", buffering=0) as pipe:
            text = _read_all(pipe.fileno(), time.monotonic() + WAIT_S + size / BYTES_PER_S)
        if text is not None:
            ended = os.waitpid(child, 0)[1]
    finally:
        if ended is None:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    return _told(text, None if ended is None else os.waitstatus_to_exitcode(ended))


def _spawned(function: Callable[..., Any], words: list[str], size: int) -> dict[str, Any] | str:
    """Answer from a new process: slower, for systems and moments where a copy is not safe."""
    command = [sys.executable, "-m", __name__, function.__module__, function.__name__, *words]
    root = str(Path(__file__).parents[2])
    paths = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=WAIT_S + size / BYTES_PER_S,
            env=os.environ | {"PYTHONPATH": paths},
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _told(None, None)
    return _told(done.stdout, done.returncode)


def _read_all(pipe: int, deadline_s: float) -> bytes | None:
    """Return all that comes from a pipe; None where its end does not come in time."""
    parts: list[bytes] = []
    while sum(map(len, parts)) <= _ANSWER_BYTES:
        left_s = deadline_s - time.monotonic()
        if left_s <= 0 or not select.select([pipe], [], [], left_s)[0]:
            return None
        part = os.read(pipe, 2**20)
        if not part:
            return b"".join(parts)
        parts.append(part)
    return None


def _told(text: bytes | None, code: int | None) -> dict[str, Any] | str:
    """Return a child's answer, or in words why there is none."""
    if text is None or code in _STOPPED:
        return "did not end"
    with suppress(ValueError, UnicodeDecodeError):
        answer = json.loads(text or b"")
        if isinstance(answer, dict) and code == 0:
            return "needed far more memory than such a file can need" if answer.get("memory") else answer
    return f"crashed (exit status {code})"


def _answer_and_leave(pipe: int, function: Callable[..., Any], words: list[str], size: int) -> NoReturn:
    """Give a function's answer, and end without what the parent had planned for its own end."""
    code = 1
    try:
        faulthandler.disable()  # the parent says what happened
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        text = _answer(function, words, size)
        while text:
            text = text[os.write(pipe, text) :]
        code = 0
    finally:
        os._exit(code)


def _answer(function: Callable[..., Any], words: list[str], size: int) -> bytes:
    _limit(size)
    try:
        answer = {"result": function(*words)}
    except DataFileError as error:
        answer = {"error": str(error)}
    except MemoryError:
        answer = {"memory": True}
    return json.dumps(answer).encode()


def _limit(size: int) -> None:
    """Limit this process's time and memory, where the system can."""
    if sys.platform == "win32":  # there is the deadline alone
        return
    import resource

    seconds = int(CPU_S + size / BYTES_PER_S)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pages = Path("/proc/self/statm")
    if pages.exists():  # a copy of a large program begins with all that this one has
        now = int(pages.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        most = now + 3 * most_memory(size)  # packed, unpacked, and as the program wants it
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _main() -> None:
    module, name, *words = sys.argv[1:]
    function = getattr(importlib.import_module(module), name)
    sys.stdout.buffer.write(_answer(function, words, Path(words[0]).stat().st_size))


if __name__ == "__main__":
    _main()
