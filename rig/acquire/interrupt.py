"""Being asked to stop: every signal sets a flag, which is looked at where it is safe; none raises."""

import signal
from collections.abc import Callable
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Self


class StopRequest:
    """While entered, every signal that would end or suspend the program sets a flag instead.

    A program that is gone or suspended cannot put out a laser that it has lit. So a closed terminal (SIGHUP),
    Ctrl-backslash (SIGQUIT), Ctrl-Z (SIGTSTP), a failing power supply (SIGPWR) and the others ask for a stop
    as Ctrl-C does. An exception that a signal raises may come between any two lines, in the middle of putting
    out the light too; so none is raised, however often the signal comes. What cannot be caught, or comes from
    a crash, is met by the guard of the laser.

    After a request the program ends, and Ctrl-C stays without effect: keys that are still held were obeyed.

    Parameters
    ----------
    announce
        Called with a sentence for the person at the keyboard at each signal.
    """

    def __init__(self, announce: Callable[[str], None]) -> None:
        self._announce = announce
        self._requested = False
        self._reason = ""
        self._previous: dict[int, object] = {}

    def __call__(self) -> bool | str:
        """Return whether a stop was asked for: the reason, if `ask` was called with one first."""
        return self._requested and (self._reason or True)

    def ask(self, reason: str) -> None:
        """Ask for a stop, as the first signal does; from any thread."""
        if not self._requested:
            self._reason = reason
        self._request()

    def __enter__(self) -> Self:
        for number in _stopping():
            self._previous[number] = signal.signal(number, self._handle)
        for number in _named("SIGTTIN", "SIGTTOU"):  # a program in the background may be suspended by these
            self._previous[number] = signal.signal(number, signal.SIG_IGN)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._requested:
            self._previous[signal.SIGINT] = signal.SIG_IGN
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._request()

    def _request(self) -> None:
        said = "Stopping: the laser goes dark first." if self._requested else "Stopping after this position."
        self._requested = True
        with suppress(Exception):  # a terminal that is gone cannot be told, and must not keep the light on
            self._announce(said)


def _named(*names: str) -> set[int]:
    return {int(getattr(signal, name)) for name in names if hasattr(signal, name)}


def _stopping() -> set[int]:
    """Return the signals whose default is to end or suspend a program, and that can be caught.

    Those of a crash are left out, since the program cannot go on after them; so are those that the system
    ignores by default (of a child, of the window), or Python (a closed pipe, a file that is too large).
    """
    crash = _named("SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT", "SIGSYS", "SIGTRAP")
    harmless = _named("SIGCHLD", "SIGCONT", "SIGURG", "SIGWINCH", "SIGPIPE", "SIGXFSZ", "SIGTTIN", "SIGTTOU")
    every = {int(number) for number in signal.valid_signals()}
    return every - crash - harmless - _named("SIGKILL", "SIGSTOP")
