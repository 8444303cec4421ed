"""The guard's own process: ``python -m rig.light.process``, in a session of its own.

The program writes lines of JSON to its standard input: questions with a number, which are answered, and
beats. When the input ends without an ``end``, the program is gone: the light is put out, and then the bias of
the detector is taken away, which nobody else can do any more. Signals do not end a guard while there may be
light.
"""

import json
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any, TextIO

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from rig.devices.wires import detector_by_address, laser_by_address
from rig.light.guard import Guard, Light, Lost
from rig.light.guarded import in_words
from rig.light.switch import Switch
from rig.light.words import as_error
from rig.model.config import RigConfig, recorded
from rig.model.devices import Laser

#: Longest pause between two looks at what has come and at the light.
PAUSE_S = 0.05

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
        with suppress(OSError, ValueError):  # a line that is no JSON is the end, too
            for line in source:
                message = json.loads(line)
                if message.get("do") == "stop":
                    self.urgent.set()
                self._queue.put(message)
        self.urgent.set()
        self._queue.put(None)


class AbandonedError(Exception):
    """Raised into the wait for light that nobody wants any more."""


class GuardClock(SystemClock):
    """The time a guarded laser waits by; a wait for light ends when darkness is wanted.

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
            raise AbandonedError("darkness is wanted")


class GuardProcess:
    """Serves one program, until that ends."""

    def __init__(self, config: RigConfig, inbox: Inbox, replies: TextIO) -> None:
        self._config = config
        self._inbox = inbox
        self._replies = replies
        self._clock = GuardClock(inbox.urgent)
        self._laser_stack = ExitStack()
        self._guard = Guard(self._open(), self._clock, self._lost)
        self._told_s = self._reopened_s = time.monotonic()
        self._alone = False

    def serve(self, number: int) -> None:
        """Answer the question that began all, and then all others, until the end."""
        switch = Switch(self._config, self._inbox.put)
        try:
            self._say({"id": number, "answer": self._laser.identity})
            while (message := self._inbox.get(PAUSE_S)) is not None:
                if message.get("do") == "end":
                    self._alone = True
                    self._answer(message, self._guard.stop)
                    break
                self._obey(message)
                self._watch()
            else:
                self._program_is_gone()
            self._try_on()
        finally:
            switch.close()
            self._laser_stack.close()

    def _open(self) -> Laser:
        self._laser = self._laser_stack.enter_context(laser_by_address(self._config, self._clock))
        return self._laser

    def _obey(self, message: dict[str, Any]) -> None:
        match message.get("do"):
            case "beat":
                self._guard.hold(message["until_s"])
            case "arm":
                self._inbox.urgent.clear()
                self._answer(message, self._guard.arm)
            case "emit":
                self._answer(message, lambda: self._emit(message["until_s"]))
            case "stop":
                self._answer(message, self._guard.stop)
            case "emitting":
                self._answer(message, self._guard.emitting)
            case "settings":
                self._answer(message, lambda: dict(self._guard.settings()))
            case "off":
                self._switched_off(message)

    def _emit(self, until_s: float) -> None:
        self._clock.lighting = True
        try:
            self._guard.emit(until_s)
        except AbandonedError:
            raise DeviceError(
                "laser", "emit", "darkness was wanted", "It has been told to stay dark."
            ) from None
        finally:
            self._clock.lighting = False

    def _switched_off(self, message: dict[str, Any]) -> None:
        """Obey the switch by which anybody on this computer can put the light out."""
        if self._guard.light in (Light.LIT, Light.ALARM):
            self._guard.lose("the light was switched off by rig laser off", trip=False)
        else:
            with suppress(DeviceError):
                self._guard.stop()
        message["reply"]({"dark": self._guard.light is not Light.ALARM})

    def _watch(self) -> None:
        self._guard.turn()
        if self._guard.light is not Light.ALARM:
            return
        now_s = time.monotonic()
        # a server that is gone never comes back, and its pseudo-terminal may be another's by now
        if now_s - self._reopened_s > REOPEN_S and not self._config.served:
            self._reopened_s = now_s
            self._reopen()
        if now_s - self._told_s > TELL_AGAIN_S:
            self._told_s = now_s
            shout(f"the laser of {self._config.name} cannot be made dark. TURN ITS KEY OFF BY HAND, NOW.")

    def _reopen(self) -> None:
        """Open the line anew: a plug may have been pulled and put back. Opening puts the light out."""
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
            self._guard.lose("the program ended without putting the light out", trip=False)
        elif self._guard.light is Light.ARMED:
            with suppress(DeviceError):
                self._guard.stop()
        self._take_bias()

    def _try_on(self) -> None:
        """Go on for a while with a laser that could not be made dark: its plug may be put back."""
        if self._guard.light is not Light.ALARM:
            return
        shout(f"the laser of {self._config.name} cannot be made dark. TURN ITS KEY OFF BY HAND, NOW.")
        if not sys.stderr.isatty():
            silent = os.open(os.devnull, os.O_WRONLY)
            # who waits for the end of what the program says gets it
            for stream in (sys.stderr, sys.stdout, self._replies):
                os.dup2(silent, stream.fileno())
        began_s = time.monotonic()
        while self._guard.light is Light.ALARM and time.monotonic() - began_s < GIVE_UP_S:
            time.sleep(PAUSE_S)
            self._watch()

    def _take_bias(self) -> None:
        try:
            with detector_by_address(self._config):
                pass  # opening takes the bias away, and leaving does so again
        except DeviceError as problem:
            shout(f"the detector may still be BIASED: {problem}")

    def _lost(self, lost: Lost) -> None:
        from rig.light.state import remember_trip

        self._say({"lost": {"reason": lost.reason, "dark": lost.dark, "trip": lost.trip}})
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
    """Tell whoever still looks at the terminal."""
    with suppress(OSError, ValueError):
        sys.stderr.write(f"\nrig: LASER GUARD: {sentence}\n")
        sys.stderr.flush()


def main() -> None:
    """Serve the program at the other end of standard input and output."""
    for name in (
        "SIGHUP",
        "SIGINT",
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
    inbox = Inbox(sys.stdin)
    if hasattr(signal, "SIGTERM"):
        signal.signal(
            signal.SIGTERM, lambda number, frame: inbox.put({"do": "off", "reply": lambda said: None})
        )
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
