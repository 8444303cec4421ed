"""The guard's own process: ``python -m rig.light.process``, in a session of its own.

The program writes lines of JSON to its standard input: questions with a number, which are answered, and
beats. When the input ends without an ``end``, the program is gone: the light is put out, and then the bias of
the detector is taken away, which nobody else can do any more. Signals do not end a guard while there may be
light.
"""

import json
import os
import queue
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict
from math import inf
from types import FrameType
from typing import Any, TextIO

from drivers.clock import SystemClock
from drivers.errors import DeviceError, LinkError, RefusedError
from rig.devices.wires import detector_by_address, laser_by_address
from rig.errors import printable
from rig.light.awake import asleep_s, awake
from rig.light.guard import Guard, Light, Lost
from rig.light.guarded import in_words
from rig.light.silence import suspended
from rig.light.state import remember_trip
from rig.light.switch import Switch
from rig.light.words import as_error
from rig.model.config import RigConfig, recorded
from rig.model.devices import Laser

#: Longest pause between two looks at what has come and at the light.
PAUSE_S = 0.05

#: So long a program whose word is overdue is listened to, before its light is put out.
HEAR_OUT_S = 0.1

#: A program that was suspended (SIGSTOP) for so long has no light, however long its last word was to hold.
SUSPENDED_S = 0.3

#: Nor has one that was on while the computer slept for longer than two clocks may disagree.
ASLEEP_S = 1.0

#: So often the program hears, while there is light, that the guard is there.
PULSE_S = 0.5

#: Longest wait for a terminal that takes no text.
SHOUT_S = 0.5

#: A laser that cannot be made dark: how often its line is opened anew, and how often a person is told.
REOPEN_S = 2.0
TELL_AGAIN_S = 30.0

#: After so long, a guard whose program has ended gives up on a laser that cannot be made dark.
GIVE_UP_S = 600.0


class Inbox:
    """What the program says, read by a thread of its own so that its end is noticed at any time.

    Parameters
    ----------
    source
        Lines of JSON.

    Attributes
    ----------
    urgent
        Set when the program is gone, or somebody wants darkness; what waits for the laser gives up then.
    """

    def __init__(self, source: TextIO) -> None:
        self.urgent = threading.Event()
        self._queue: queue.Queue[dict[str, Any] | None] = queue.Queue()
        threading.Thread(target=self._read, args=(source,), daemon=True).start()

    def get(self, timeout_s: float) -> dict[str, Any] | None:
        """Return the next message; an empty one if none came in time, None at the end of all."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return {}

    def put(self, message: dict[str, Any]) -> None:
        """Add a message from elsewhere that cannot wait."""
        self.urgent.set()
        self._queue.put(message)

    def _read(self, source: TextIO) -> None:
        with suppress(OSError, ValueError, RecursionError):
            for line in source:
                message = json.loads(line)
                if not isinstance(message, dict):  # what is no message is the end, as what is no JSON
                    break
                if message.get("do") == "stop":
                    self.urgent.set()
                self._queue.put(message)
        self.urgent.set()
        self._queue.put(None)


class AbandonedError(Exception):
    """Raised into the wait for light that nobody wants any more."""


class GuardClock(SystemClock):
    """The time a guarded laser waits by; a wait for light ends when the laser must stay dark.

    Attributes
    ----------
    lighting
        Whether the laser is being lit.
    """

    def __init__(self, urgent: threading.Event) -> None:
        self._urgent = urgent
        self.lighting = False

    def sleep(self, duration_s: float) -> None:
        """Wait, and give up where light is waited for in vain."""
        if not self.lighting:
            time.sleep(duration_s)
        elif self._urgent.wait(duration_s):
            self.lighting = False
            raise AbandonedError("the laser must stay dark")


class GuardProcess:
    """Serves one program, until that ends."""

    def __init__(self, config: RigConfig, inbox: Inbox, replies: TextIO) -> None:
        self._config = config
        self._inbox = inbox
        self._replies = replies
        self._clock = GuardClock(inbox.urgent)
        self._laser_stack = ExitStack()
        self._guard = Guard(self._open(), self._clock, self._lost, config.known_dark_by)
        self._told_s = self._reopened_s = self._pulsed_s = time.monotonic()
        self._overdue_s = self._suspended_s = inf
        self._asleep_s = asleep_s()
        self._program = os.getppid()
        self._alone = False
        self._off = False

    def serve(self, number: int) -> None:
        """Answer the question that began all, and then all others, until the end."""
        with awake(), ExitStack() as stack:
            stack.callback(self._leave)
            try:
                switch = Switch(self._config, self._inbox.put)
            except (OSError, RuntimeError) as problem:
                self._say({"id": number, "error": as_error(cannot_begin(problem))})
                return
            stack.callback(switch.close)
            self._say({"id": number, "answer": self._laser.identity})
            try:
                self._converse()
            except Exception as defect:  # whatever is wrong here, it must not leave the light on
                self._guard.lose("the guard of the laser has a defect", trip=False)
                shout(f"a defect: {defect!r}")
            self._try_on()

    def _converse(self) -> None:
        """Do what the program asks, and watch, until that ends.

        What the program has said is heard before its silence is judged: this process may be what stood still,
        or the whole computer.
        """
        while (message := self._inbox.get(PAUSE_S)) is not None:
            if message.get("do") == "end":
                self._alone = True
                self._answer(message, self._guard.stop)
                return
            self._obey(message)
            if self._heard_out():
                self._watch()
        self._program_is_gone()

    def _heard_out(self) -> bool:
        """Return whether nothing is overdue, or has been for so long that what was said would have come."""
        if not self._guard.overdue:
            self._overdue_s = inf
            return True
        now_s = time.monotonic()
        self._overdue_s = min(self._overdue_s, now_s)
        return now_s - self._overdue_s > HEAR_OUT_S

    def _leave(self) -> None:
        try:
            self._laser_stack.close()
        except DeviceError as problem:
            shout(f"while leaving: {problem}")

    def _open(self) -> Laser:
        self._laser = self._laser_stack.enter_context(laser_by_address(self._config, self._clock))
        return self._laser

    def _obey(self, message: dict[str, Any]) -> None:
        match message.get("do"):
            case "beat":
                self._guard.hold(message["until_s"])
            case "arm":
                self._inbox.urgent.clear()
                self._answer(message, self._arm)
            case "emit":
                self._answer(message, lambda: self._emit(message["lease_s"]))
            case "stop":
                self._answer(message, self._guard.stop)
            case "take word":
                self._answer(message, self._guard.take_word)
            case "emitting":
                self._answer(message, self._guard.emitting)
            case "settings":
                self._answer(message, lambda: dict(self._guard.settings()))
            case "off":
                self._switched_off(message)

    def _arm(self) -> None:
        if self._off:
            raise RefusedError("laser", "arm", "it was switched off by rig laser off", "Scan again.")
        self._guard.arm()

    def _emit(self, lease_s: float) -> None:
        self._clock.lighting = True
        try:
            self._guard.emit(lease_s)
        except AbandonedError:
            raise DeviceError(
                "laser", "emit", "the laser had to stay dark", "It was ordered to stay dark."
            ) from None
        finally:
            self._clock.lighting = False

    def _switched_off(self, message: dict[str, Any]) -> None:
        """Obey the switch by which anybody on this computer can put the light out; it stays out."""
        self._off = True
        self._guard.lose("the light was switched off by rig laser off", trip=False)
        message["reply"]({"dark": self._guard.light is not Light.ALARM})

    def _mind_suspension(self) -> None:
        """Put out the light of a suspended program: its last word may hold for 15 s, to write a file."""
        now_s = time.monotonic()
        if self._guard.light is not Light.LIT or not suspended(self._program):
            self._suspended_s = inf
            return
        self._suspended_s = min(self._suspended_s, now_s)
        if now_s - self._suspended_s > SUSPENDED_S:
            self._guard.lose("the program was suspended by a signal (SIGSTOP)", trip=False)

    def _mind_sleep(self) -> None:
        """Put out a light that was on while the computer slept: nobody has looked at it."""
        before_s, self._asleep_s = self._asleep_s, asleep_s()
        slept_s = self._asleep_s - before_s
        if slept_s > ASLEEP_S and self._guard.light is Light.LIT:
            self._guard.lose(
                f"the computer slept for {slept_s:.0f} s, and nobody looked at the light meanwhile",
                trip=False,
            )

    def _watch(self) -> None:
        self._mind_sleep()
        self._mind_suspension()
        self._guard.turn()
        now_s = time.monotonic()
        if self._guard.light is Light.LIT and now_s - self._pulsed_s > PULSE_S:
            self._pulsed_s = now_s
            self._say({"alive": True})
        if self._guard.light is not Light.ALARM:
            return
        # a server that is gone never comes back, and its pseudo-terminal may be another's by now
        can_reopen = self._guard.opens_anew and not self._config.served
        if now_s - self._reopened_s > REOPEN_S and can_reopen:
            self._reopened_s = now_s
            self._reopen()
        if now_s - self._told_s > TELL_AGAIN_S:
            self._told_s = now_s
            self._shout_for_help()

    def _reopen(self) -> None:
        """Open the line anew: a plug may have been pulled and put back. Opening puts the light out."""
        self._guard.let_go()
        with suppress(DeviceError):
            self._laser_stack.close()
        for _ in range(2):  # the first may find the laser emitting, put it out, and refuse
            with suppress(DeviceError):
                self._guard.take(self._open())
                return

    def _program_is_gone(self) -> None:
        """Put the light out, and take the bias from the detector that nobody holds any more."""
        self._alone = True
        if self._guard.light is Light.LIT:
            self._guard.lose("the program ended without switching the light off", trip=False)
        elif self._guard.light is Light.ARMED:
            with suppress(DeviceError):
                self._guard.stop()
        self._take_bias()

    def _try_on(self) -> None:
        """Go on for a while with a laser that could not be made dark: its plug may be put back."""
        if self._guard.light is not Light.ALARM:
            return
        self._shout_for_help()
        if not sys.stderr.isatty():
            silent = os.open(os.devnull, os.O_WRONLY)
            # who waits for the end of what the program says gets it
            for stream in (sys.stderr, sys.stdout, self._replies):
                os.dup2(silent, stream.fileno())
        began_s = time.monotonic()
        while self._guard.light is Light.ALARM and time.monotonic() - began_s < GIVE_UP_S:
            time.sleep(PAUSE_S)
            self._watch()

    def _shout_for_help(self) -> None:
        shout(f"the laser of {self._config.name} cannot be made dark. TURN ITS KEY OFF BY HAND, NOW.")

    def _take_bias(self) -> None:
        try:
            with detector_by_address(self._config) as detector:  # opening takes the bias away, and leaving
                by_hand = "bias" in detector.by_hand
            if by_hand:
                shout("the detector keeps its BIAS: only a person can switch it off")
        except DeviceError as problem:
            shout(f"the detector may still be BIASED: {problem}")

    def _lost(self, lost: Lost) -> None:
        self._say({"lost": asdict(lost)})
        if lost.trip:
            with suppress(OSError):
                remember_trip(self._config, lost.reason)
        if self._alone or not lost.dark:
            shout(in_words(lost))

    def _answer(self, message: dict[str, Any], act: Callable[[], Any]) -> None:
        try:
            reply = {"id": message["id"], "answer": act()}
        except DeviceError as problem:
            reply = {"id": message["id"], "error": as_error(problem)}
        self._say(reply)

    def _say(self, reply: dict[str, Any]) -> None:
        with suppress(OSError, ValueError):  # the program may be gone
            self._replies.write(json.dumps(reply) + "\n")
            self._replies.flush()


def shout(sentence: str) -> None:
    """Tell whoever looks at the terminal; one that takes no text, as after Ctrl-S, is not waited for."""

    def write() -> None:
        with suppress(OSError):
            os.write(2, f"\nrig: LASER GUARD: {printable(sentence)}\n".encode(errors="backslashreplace"))

    writing = threading.Thread(target=write, daemon=True)
    try:
        writing.start()
    except RuntimeError:  # the system has no more threads
        with suppress(OSError, ValueError):
            if select.select([], [2], [], 0)[1]:
                write()
        return
    writing.join(SHOUT_S)


def cannot_begin(problem: OSError | RuntimeError) -> DeviceError:
    """Return in words why a guard could not begin: what the system refused, a file or a thread."""
    told = f"says: {problem.strerror}" if isinstance(problem, OSError) else f"says: {problem}"
    return LinkError(
        "guard of the laser",
        "begin",
        f"{getattr(problem, 'filename', None) or 'the system'} {told}",
        "The laser was not switched on. Free space or memory, or end other programs, and scan again.",
    )


def heed_sigterm(off: Callable[[dict[str, Any]], None]) -> None:
    """Take SIGTERM as a wish for darkness; not on Windows, where a process is ended without a word.

    A handler runs in the middle of anything, where what it needs may be locked; so it wakes a thread.
    """
    if sys.platform == "win32":
        return
    heard, wake = os.pipe()
    os.set_blocking(wake, False)

    def handle(number: int, frame: FrameType | None) -> None:
        with suppress(BlockingIOError):
            os.write(wake, b"\0")

    def wait() -> None:
        while os.read(heard, 1):
            off({"do": "off", "reply": lambda said: None})

    threading.Thread(target=wait, daemon=True).start()
    signal.signal(signal.SIGTERM, handle)


def main() -> None:
    """Serve the program at the other end of standard input and output."""
    for name in (
        "SIGHUP",
        "SIGINT",
        "SIGBREAK",
        "SIGQUIT",
        "SIGTSTP",
        "SIGTTIN",
        "SIGTTOU",
        "SIGPIPE",
        "SIGUSR1",
        "SIGUSR2",
    ):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nothing but replies goes to the program
    try:
        inbox = Inbox(sys.stdin)
        heed_sigterm(inbox.put)
    except RuntimeError as problem:
        shout(str(cannot_begin(problem)))
        return
    first = inbox.get(60.0)
    if not first:
        return
    try:
        guard = GuardProcess(recorded(first["config"]), inbox, replies)
    except DeviceError as problem:
        replies.write(json.dumps({"id": first["id"], "error": as_error(problem)}) + "\n")
        replies.flush()
        return
    guard.serve(first["id"])


if __name__ == "__main__":
    main()
