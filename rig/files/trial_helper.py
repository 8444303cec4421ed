"""Trials beside threads: a process without any is started once, and each trial is a copy of a copy of it.

A copy of a process that runs threads is not safe: a lock that one of them holds is held for ever in the copy.
So a helper is started at the first trial, which has loaded what trials need and does nothing but wait. For
each trial it gets one end of a new connection (a file descriptor, over a local socket) and copies itself; the
copy runs the trial as a program without threads does, `rig.files.trial_child.forked`, and answers over that
connection. Neither the helper nor its copies read a file: only the trial does, which holds no connection.

The helper ends when its socket closes, however this program ends. It knows nothing of the script that runs
here, so it cannot run it again.
"""

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any, NoReturn

from rig.apart import apart
from rig.files.trial_child import ANSWER_BYTES, Outcome, Trial, clean_environment, forked, function_of

#: How long a helper may take to start and to answer, beside the trial itself: other programs want the
#: processors, too.
ANSWERING_S = 30.0
#: How long it may take to end.
ENDING_S = 1.0
#: The longest request: 50 paths.
_REQUEST_BYTES = 2**20


class Helper:
    """A process from which trials are copied, for any number of threads."""

    def __init__(self) -> None:
        self._requests, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=clean_environment(),
                pass_fds=[theirs.fileno()],
                **apart(),
            )

    def run(self, trial: Trial) -> Outcome | None:
        """Run a trial; None where no answer came."""
        if sys.platform == "win32":
            raise OSError("Windows cannot copy a process")
        ours, theirs = socket.socketpair()
        with ours:
            with theirs:
                socket.send_fds(self._requests, [b"+"], [theirs.fileno()])
            ours.sendall(_request(trial))
            answer = _received(ours, trial.wait_s + ANSWERING_S)
        head, found, text = answer.partition(b"\n")
        if not found:
            return None
        said = json.loads(head)
        return Outcome(text if said["ended"] else None, said["code"])

    def end(self) -> None:
        """End it."""
        self._requests.close()
        try:
            self._process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


_helper: Helper | None = None
_starting = threading.Lock()


def helped(trial: Trial) -> Outcome:
    """Try in a copy of the helper, which is started where there is none."""
    for _ in range(2):  # somebody may have ended it
        helper = _running()
        with suppress(OSError):
            outcome = helper.run(trial)
            if outcome is not None:
                return outcome
        _forget(helper)
    return Outcome(b"", None)


def _running() -> Helper:
    global _helper
    with _starting:
        if _helper is None:
            _helper = Helper()
        return _helper


def _forget(helper: Helper) -> None:
    """End a helper that did not answer; copies of it that other threads have asked go on."""
    with _starting:
        if _helper is helper:
            _end()


@atexit.register
def _end() -> None:
    global _helper
    if _helper is not None:
        _helper.end()
        _helper = None


def _request(trial: Trial) -> bytes:
    function, folder = trial.function, ""
    with suppress(OSError):  # it was removed
        folder = os.getcwd()
    asked = {
        "module": function.__module__,
        "name": function.__name__,
        "words": list(trial.words),
        "size": trial.size,
        "folder": folder,  # to which paths are relative
    }
    return json.dumps(asked).encode() + b"\n"


def _received(connection: socket.socket, wait_s: float) -> bytes:
    """Return all that comes; what comes in time, where that is less."""
    text, deadline_s = bytearray(), time.monotonic() + wait_s
    with suppress(TimeoutError):
        while len(text) <= 2 * ANSWER_BYTES and (left_s := deadline_s - time.monotonic()) > 0:
            connection.settimeout(left_s)
            part = connection.recv(2**20)
            if not part:
                break
            text += part
    return bytes(text)


def serve(number: int) -> None:
    """Be the helper: copy this process for each connection that comes, until no more can come."""
    if sys.platform == "win32":
        raise OSError("Windows cannot copy a process")
    import rig.files.inspection  # noqa: F401  what trials need: copies have it already

    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the system clears away copies that have ended
    with socket.socket(fileno=number) as requests:
        while True:
            came, numbers, _, _ = socket.recv_fds(requests, 1, 1)
            if not came:
                return
            for one in numbers:
                with socket.socket(fileno=one) as connection, suppress(Exception):
                    asked = _asked(connection)
                    function = function_of(asked["module"], asked["name"])
                    if os.fork() == 0:
                        requests.close()
                        _try_and_leave(connection, function, asked)


def _asked(connection: socket.socket) -> dict[str, Any]:
    with connection.makefile("rb") as lines:
        asked: dict[str, Any] = json.loads(lines.readline(_REQUEST_BYTES))
    return asked


def _try_and_leave(connection: socket.socket, function: Any, asked: dict[str, Any]) -> NoReturn:
    """Be the copy that runs one trial and answers for it."""
    try:
        if sys.platform != "win32":
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with suppress(OSError):  # a path that is whole needs no folder
            os.chdir(asked["folder"])
        trial = Trial(function, asked["words"], asked["size"])
        outcome = forked(trial, connection.fileno())
        said = {"ended": outcome.text is not None, "code": outcome.code}
        connection.sendall(json.dumps(said).encode() + b"\n" + (outcome.text or b""))
    finally:
        os._exit(0)
