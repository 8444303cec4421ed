"""Trials of an attack: many in one process, where the program begins a new one for each.

A process that is late has given the answer that it does not end. One that dies or lacks memory has not
answered: the program's own trial decides then, with its own limits and words. A new process takes the trials
that follow.
"""

import faulthandler
import json
import multiprocessing
import signal
from contextlib import suppress
from pathlib import Path

from rig.errors import DataFileError
from rig.files import trial
from rig.files.trial_child import Outcome, Trial, function_of, most_memory

#: Seconds of computing that one trial may take here. Good files take milliseconds; what the library loops on
#: takes the whole time.
CPU_S = 0.3
#: Trials of one process: what a library lost in one must not gather.
AT_MOST = 500


class Shared:
    """What runs the trials of this process.

    Parameters
    ----------
    closed
        Connections of this process that the processes begun here may not hold open.
    """

    def __init__(self, *closed) -> None:
        self._closed = closed
        self._own = trial.run
        self._child = self._pipe = None
        self._count = 0

    @classmethod
    def install(cls, *closed) -> "Shared":
        """Let the program's trials in this process, which is there for an attack alone, be shared ones."""
        shared = cls(*closed)
        trial.run = shared
        return shared

    def __call__(self, one: Trial) -> Outcome:
        """Run a trial."""
        if self._child is None or self._count >= AT_MOST:
            self._begin()
        self._count += 1
        text = b""
        with suppress(EOFError, OSError):
            self._pipe.send((one.function.__module__, one.function.__name__, list(one.words), one.size))
            if self._pipe.poll(one.wait_s):
                text = self._pipe.recv_bytes()
        if text:
            return Outcome(text, 0)
        code = self.end()
        return Outcome(None, code) if code == -signal.SIGPROF else self._own(one)

    def end(self) -> int | None:
        """End the process, if there is one, and return its exit code."""
        if self._child is None:
            return None
        self._pipe.close()
        self._child.join(1.0)
        self._child.kill()
        self._child.join()
        code, self._child = self._child.exitcode, None
        return code

    def _begin(self) -> None:
        self.end()
        context = multiprocessing.get_context("fork")
        self._pipe, theirs = context.Pipe()
        self._child = context.Process(target=_serve, args=(theirs, self._pipe, *self._closed))
        self._child.start()
        theirs.close()
        self._count = 0


def _serve(pipe, *closed) -> None:
    """Answer trials until nobody asks; what else than an answer comes ends the process."""
    import resource

    for one in closed:
        one.close()
    faulthandler.disable()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    began_with = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    with suppress(Exception):
        while True:
            module, name, words, size = pipe.recv()
            function = function_of(module, name)
            most = began_with + 3 * most_memory(size)
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
            signal.setitimer(signal.ITIMER_PROF, CPU_S)
            try:
                answer = {"result": function(*words)}
            except DataFileError as error:
                answer = {"error": str(error)}
            signal.setitimer(signal.ITIMER_PROF, 0)
            pipe.send_bytes(json.dumps(answer).encode())
