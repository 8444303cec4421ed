"""Ctrl-C in two steps: the first asks to stop at the next position, the second stops at once."""

import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Self


class StopRequest:
    """While entered, SIGINT and SIGTERM set a flag; a second one raises KeyboardInterrupt.

    Parameters
    ----------
    announce
        Called with a sentence for the person at the keyboard when the first signal comes.
    """

    def __init__(self, announce: Callable[[str], None]) -> None:
        self._announce = announce
        self._requested = False
        self._previous: dict[int, object] = {}

    def __call__(self) -> bool:
        """Return whether a stop was asked for."""
        return self._requested

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True
        self._announce("Stopping after this position; press Ctrl-C again to stop at once.")
