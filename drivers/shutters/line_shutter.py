"""What shutters on one line share: closed when opened as a device, closed when left."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from drivers.clock import Clock
from drivers.errors import LinkError, RefusedError
from drivers.leaving import insist, leave

BEWARE = "Treat the shutter as OPEN, and the laser as EMITTING: switch the laser off by hand."


class LineShutter(ABC):
    """A shutter on one line; a context manager that leaves it closed.

    Parameters
    ----------
    name
        Where it is, for messages.
    clock
        The time to wait by.
    opens_high
        Whether it is open at the line's high level.
    moving_time_s
        How long it takes to open or to close.

    Attributes
    ----------
    identity
        Where it is, and what tells its state; empty before.
    """

    def __init__(self, name: str, *, clock: Clock, opens_high: bool, moving_time_s: float) -> None:
        self.name = name
        self.identity = ""
        self._clock = clock
        self._opens_high = opens_high
        self._moving_time_s = moving_time_s
        self._told_open = True
        self._connected = False

    @abstractmethod
    def _open_line(self) -> str:
        """Reach the line, at the level at which the shutter is closed if that can be; return who it is."""

    @abstractmethod
    def _close_line(self) -> None:
        """Let go of the line; safe to call at any time."""

    @abstractmethod
    def _set(self, level: bool) -> None:
        """Set the line's level."""

    @abstractmethod
    def _level(self) -> bool | None:
        """Return the level that is read back; None where nothing tells it."""

    def __enter__(self) -> Self:
        try:
            self.identity = self._open_line()
            self._connected = True
            self.close()
        except BaseException as problem:
            leave([self._hang_up], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self.close, self._hang_up], problem)

    def let_through(self) -> None:
        """Open it, and return when it is open.

        Raises
        ------
        RefusedError
            It stays closed, as far as that is read back.
        LinkError
            The line cannot be set or read.
        """
        self._require_connection()
        self._move(True)
        if not self.is_open():
            raise RefusedError(self.name, "open", "it stays closed", "Check its supply and its cable.")

    def close(self) -> None:
        """Close it, and return when it is closed; safe to call at any time.

        Raises
        ------
        RefusedError
            It stays open, as far as that is read back.
        LinkError
            The line was told to close it, and whether it did cannot be known.
        """
        if not self._connected:
            return
        insist(self._make_closed, name=self.name, asked="close", beware=BEWARE)

    def is_open(self) -> bool:
        """Return whether it is open: as it is read back, else as it was told last."""
        self._require_connection()
        level = self._level()
        return self._told_open if level is None else level == self._opens_high

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return identity, and whether it is open."""
        self._require_connection()
        return {
            "identity": self.identity,
            "open": self.is_open(),
            "read_back": self._level() is not None,
        }

    def _make_closed(self) -> None:
        """Tell it to close, and raise unless it is."""
        self._move(False)
        if self.is_open():
            raise RefusedError(self.name, "close", "it reports that it is open", BEWARE)

    def _move(self, to_open: bool) -> None:
        self._told_open = True  # until the line was set
        self._set(to_open == self._opens_high)
        self._told_open = to_open
        self._clock.sleep(self._moving_time_s)

    def _require_connection(self) -> None:
        if not self._connected:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the shutter inside its with block."
            )

    def _hang_up(self) -> None:
        self._connected = False
        self._close_line()
