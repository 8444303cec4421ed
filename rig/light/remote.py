"""A laser whose guard is a process of its own, which outlives the program: what a real laser needs."""

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

from drivers.errors import DeviceError, LinkError
from rig.apart import apart
from rig.errors import LightLostError
from rig.light.dark import make_dark
from rig.light.guard import OVERDUE, Lost
from rig.light.guarded import FIRST_LEASE_S, in_words, raise_lost
from rig.light.silence import TURN_S, Silence, suspended
from rig.light.words import from_words
from rig.model.config import ExternalLaserConfig, RigConfig
from rig.model.devices import Settings

#: Longest wait for an answer of the guard: a laser takes up to 10 s to light, and several tries to go dark.
PATIENCE_S = 40.0

#: A beat is sent when it changes by more than this until when the light is granted.
WORTH_SENDING_S = 0.05

#: A program that has not said for so long that all is well hangs, in a call that never returns.
HANGS_S = 10.0

#: A guard that tells nothing for so long while there is light hangs: it looks at the laser's line, which has
#: time limits, and does nothing else.
GUARD_HANGS_S = 15.0

#: The same for a guard that somebody has suspended (SIGSTOP), beyond the second in which it need not tell.
GUARD_SUSPENDED_S = 1.0


class GuardedElsewhere:
    """A laser behind its guard's process; a context manager.

    Parameters
    ----------
    config
        The rig; its laser is opened by the guard.
    is_suspended
        Returns whether a process is suspended by a signal, where the system tells.

    Attributes
    ----------
    when_hanging
        What leaves the other devices safe when the program's main thread hangs, each tried once, in a thread
        of its own; the program is ended then.
    """

    def __init__(self, config: RigConfig, is_suspended: Callable[[int], bool] = suspended) -> None:
        self._config, self._is_suspended = config, is_suspended
        self._identity = ""
        self._numbers = 0
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._lost: list[Lost] = []
        self._granted_until_s = 0.0
        self._heard_s = 0.0
        self._asking = self._lit = self._leaving = False
        self._alone: Lost | None = None
        self._alone_lock = threading.Lock()
        self._closed = threading.Event()
        self._silence = Silence()
        self._hearing: threading.Thread | None = None
        self.when_hanging: list[Callable[[], None]] = []

    def __enter__(self) -> Self:
        try:
            self._process = start_guard()
        except OSError as problem:
            raise _cannot_start("its process", problem.strerror) from None
        try:
            self._hearing = _begun(self._hear)
            self._identity = str(self._ask("open", config=self._config.model_dump_json()))
            _begun(self._mind)
        except BaseException:
            self._hang_up()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leaving = True
        try:
            if not (self._alone and self._alone.dark):
                self._ask("end")
        except (DeviceError, LightLostError) as failure:
            if problem is None:
                raise
            problem.add_note(f"while leaving: {failure}")
        finally:
            self._hang_up()

    @property
    def identity(self) -> str:
        """As the laser reports it."""
        return self._identity

    def settings(self) -> Settings:
        """Return the settings as read back."""
        answer: Settings = self._ask("settings")
        return answer

    def arm(self) -> None:
        """Prepare the laser; still dark."""
        raise_lost(self._lost)  # somebody wants darkness
        self._ask("arm")

    def emit(self) -> None:
        """Light the laser."""
        self._granted_until_s = time.monotonic() + PATIENCE_S
        self._lit = True
        self._ask("emit", lease_s=FIRST_LEASE_S)
        self._silence.begin()
        self.beat(FIRST_LEASE_S)

    def stop(self) -> None:
        """Put the light out; where the guard is gone, that has been done."""
        self._lit = False
        if not (self._alone and self._alone.dark):
            self._ask("stop")
            self._lost.clear()

    def take_word(self) -> None:
        """Believe a person who has switched off a laser that nobody else can."""
        self._lit = False
        if not self._alone:
            self._ask("take word")

    def emitting(self) -> bool:
        """Ask the laser now."""
        return bool(self._ask("emitting"))

    def beat(self, lease_s: float) -> None:
        """Say that all is well for so long.

        Raises
        ------
        LightLostError
            If the light is lost.
        """
        until_s = time.monotonic() + lease_s
        self._silence.ends()
        if abs(until_s - self._granted_until_s) > WORTH_SENDING_S:
            self._granted_until_s = until_s
            self._tell({"do": "beat", "until_s": until_s})
        raise_lost([self._with_its_cause(lost) for lost in self._lost])

    def _with_its_cause(self, lost: Lost) -> Lost:
        """Return what the guard has told; of its own silence the program knows more."""
        return replace(lost, reason=f"{OVERDUE}: {self._silence}") if lost.reason == OVERDUE else lost

    def _ask(self, what: str, **details: object) -> Any:
        """Ask the guard, and return its answer or raise the failure of the device that it tells."""
        self._asking = True
        try:
            self._numbers += 1
            self._tell({"do": what, "id": self._numbers, **details})
            answer = self._answer()
        finally:
            self._heard_s = time.monotonic()
            self._asking = False
        if "error" in answer:
            raise from_words(answer["error"])
        return answer["answer"]

    def _answer(self) -> dict[str, Any]:
        """Wait for the answer to the question asked last; a guard that gives none is ended."""
        until_s = time.monotonic() + PATIENCE_S
        while (left_s := until_s - time.monotonic()) > 0:
            try:
                answer = self._answers.get(timeout=left_s)
            except queue.Empty:
                break
            if answer is None:
                raise self._guard_is_gone()
            if answer.get("id") == self._numbers:
                return answer
        self._process.kill()
        raise self._guard_is_gone()

    def _tell(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            raise self._guard_is_gone() from None

    def _hear(self) -> None:
        """Take in what the guard says, in a thread of its own; at its end, put the light out without it."""
        assert self._process.stdout is not None
        with suppress(OSError, ValueError, TypeError, KeyError), self._process.stdout as lines:
            for line in lines:
                self._heard_s = time.monotonic()
                said = json.loads(line)
                if "lost" in said:
                    self._lost.append(Lost(**said["lost"]))
                elif "id" in said:
                    self._answers.put(said)
        if not self._leaving and not self._closed.is_set():
            self._lost.append(self._without_guard())
        self._answers.put(None)

    def _guard_is_gone(self) -> LightLostError:
        """Put the light out without the guard, which was killed, and say so."""
        return LightLostError(in_words(self._without_guard()))

    def _without_guard(self) -> Lost:
        """Open the laser here, which puts it out; once, whichever thread is first."""
        with self._alone_lock:
            if self._alone is None:
                self._alone = self._put_out_here()
            return self._alone

    def _put_out_here(self) -> Lost:
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0)
        try:
            dark, found = True, make_dark(self._config)
        except DeviceError as problem:
            dark, found = False, str(problem)
        reason = f"the guard of the laser has ended unexpectedly: {found}"
        return Lost(reason, dark, trip=False, how=self._config.known_dark_by)

    def _mind(self) -> None:
        """End a guard that hangs, and a program whose main thread does: the guard has put the light out then.

        The thread's own turns are counted, not the time: nothing hangs in a program that was suspended.
        """
        program_s = guard_s = 0.0
        while not self._closed.wait(TURN_S):
            now_s = time.monotonic()
            self._silence.turn()
            program_s = program_s + TURN_S if self._lit and now_s > self._granted_until_s else 0.0
            stands = self._is_suspended(self._process.pid)
            silent = self._lit and (stands or not self._asking) and now_s - self._heard_s > 2 * TURN_S
            guard_s = guard_s + TURN_S if silent else 0.0
            if guard_s >= (GUARD_SUSPENDED_S if stands else GUARD_HANGS_S):
                self._process.kill()  # its end is heard, and the light put out
            if program_s >= HANGS_S:
                self._end_the_program()

    def _end_the_program(self) -> None:
        for safe in self.when_hanging:
            _in_time(safe, 3.0)
        sentence = (
            f"\nrig: a device's library, a disk or the terminal has not returned for {HANGS_S:.0f} s. "
            f"{_what_the_guard_did(self._config)}, and the program ends here. Finished lines are safe; "
            "switch the timing instrument off and on, and continue with rig resume.\n"
        )
        _in_time(lambda: os.write(2, sentence.encode()), 1.0)  # the terminal may be what hangs
        os._exit(3)

    def _hang_up(self) -> None:
        self._closed.set()
        with suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0)
            if self._hearing:
                self._hearing.join(2.0)


def _what_the_guard_did(config: RigConfig) -> str:
    """Return what is true of the light when the program has not said in time that all is well."""
    if isinstance(config.laser, ExternalLaserConfig) and config.shutter is None:
        return "No program can switch this laser off: TREAT IT AS EMITTING, switch it off by hand, now"
    return "The guard has switched the laser off"


def _cannot_start(what: str, problem: object) -> LinkError:
    return LinkError(
        "guard of the laser",
        f"start {what}",
        f"the system reports: {problem}",
        "The laser was not switched on. End other programs, and scan again.",
    )


def _begun(act: Callable[[], None]) -> threading.Thread:
    """Do something in a thread."""
    thread = threading.Thread(target=act, daemon=True)
    try:
        thread.start()
    except RuntimeError as problem:
        raise _cannot_start("its threads", problem) from None
    return thread


def start_guard() -> "subprocess.Popen[str]":
    """Start a guard that no terminal reaches, with the modules that this program has."""
    return subprocess.Popen(
        # -P: what lies in the folder where somebody works, a queue.py, is no module of the guard
        [sys.executable, "-P", "-m", "rig.light.process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        **apart(),
    )


def _in_time(act: Callable[[], object], limit_s: float) -> None:
    """Try something that may fail or never return."""

    def quietly() -> None:
        with suppress(Exception):
            act()

    helper = threading.Thread(target=quietly, daemon=True)
    with suppress(RuntimeError):  # the system has no more threads
        helper.start()
        helper.join(limit_s)
