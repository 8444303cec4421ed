"""What all lasers share: light takes two steps, ends at any time, and is out only if two answers say so.

The interlock and the key are what protects people; this is an extra layer only.
"""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from drivers.clock import Clock, wait_until
from drivers.errors import DeviceError, FoundEmittingError, LinkError, RefusedError
from drivers.leaving import insist, leave

BEWARE = "Treat the laser as EMITTING: turn its key off by hand."

#: So often emission is ended before the laser is said to be emitting.
STOP_TRIES = 5


class TwoStepLaser(ABC):
    """A laser whose light takes two steps, `arm` and `emit`; a context manager that leaves it dark.

    Connecting never emits. A laser that is found emitting on connect is switched off, and the connection is
    refused so that a person learns of it. A subclass says how one product is asked and told.

    Parameters
    ----------
    name
        The device and where it is, for messages.
    clock
        The time to wait by.
    emission_timeout_s
        Longest wait for the laser to confirm that it emits; its warning lamp must go first.

    Attributes
    ----------
    identity
        What the laser was recognised as; empty before.
    """

    def __init__(self, name: str, *, clock: Clock, emission_timeout_s: float) -> None:
        self.name = name
        self.identity = ""
        self._clock = clock
        self._emission_timeout_s = emission_timeout_s
        self._armed = False
        self._lit = False
        self._connected = False

    @abstractmethod
    def settings(self) -> dict[str, str | int | float | bool]:
        """Return the identity, what is set, and whether it emits, as read back."""

    @abstractmethod
    def _open(self) -> None:
        """Open the line; nothing is sent."""

    @abstractmethod
    def _close(self) -> None:
        """Close the line; safe to call at any time."""

    @abstractmethod
    def _recognise(self) -> None:
        """Find out what is there, without setting anything; raise if it is not this laser."""

    @abstractmethod
    def _prepare(self) -> None:
        """Set all that was configured, and read it back; the laser is dark."""

    @abstractmethod
    def _give_back(self) -> None:
        """Leave a laser that is dark to its front panel."""

    @abstractmethod
    def _switch(self, on: bool) -> None:
        """Tell the laser to emit, or to be dark."""

    @abstractmethod
    def _says_emitting(self) -> bool:
        """Ask whether there is light; False only by two fresh answers that agree."""

    @abstractmethod
    def _says_lit(self) -> bool:
        """Ask whether there is light; True only by two fresh answers that agree."""

    @abstractmethod
    def _lower_power(self) -> None:
        """Set the lowest power: the next best where light cannot be ended."""

    def __enter__(self) -> Self:
        self._open()
        try:
            self._recognise()
            self._connected = True
            if self._emits_when_found():
                self.stop()
                raise FoundEmittingError(
                    self.name,
                    "be dark when connected",
                    "it was emitting; it has been switched off",
                    "Find out who switched it on, and connect again.",
                )
        except BaseException as problem:
            leave([self._hang_up], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self._end, self._hang_up], problem)

    def arm(self) -> None:
        """Prepare the laser as configured, and read it back; still dark.

        Raises
        ------
        RefusedError
            The laser kept another value, is not ready, or is not dark.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        self._require_connection()
        self._armed = False
        self._require_darkness()
        self._prepare()
        self._require_darkness()
        self._armed = True

    def emit(self) -> None:
        """Begin emission and wait until the laser confirms it.

        Raises
        ------
        RefusedError
            Not armed; the key is off; or emission did not come. The laser has been told to stay dark.
        LinkError, ProtocolError
            No answer, or none that makes sense; the laser has been told to stay dark.
        """
        if not self._armed:
            raise RefusedError(self.name, "emit", "it is not armed", "Nothing was sent. Call arm first.")
        try:
            self._switch(True)
            if not wait_until(self._clock, self._says_lit, timeout_s=self._emission_timeout_s, every_s=0.1):
                raise RefusedError(
                    self.name,
                    "emit",
                    f"it stayed dark for {self._emission_timeout_s:g} s",
                    "Check the interlock and the key, reset the laser, and start again.",
                )
        except BaseException as problem:
            leave([self.stop], problem)
            raise
        self._lit = True

    def stop(self) -> None:
        """End emission, verify that the laser is dark, and disarm; safe to call at any time.

        Raises
        ------
        RefusedError
            The laser reports that it still emits; its power was set to the lowest.
        LinkError, ProtocolError
            It was told to stop, and whether it did cannot be known; its power was set to the lowest.
        """
        self._armed = self._lit = False
        if not self._connected:
            return
        insist(
            self._make_dark,
            name=self.name,
            asked="be dark",
            beware=BEWARE,
            tries=STOP_TRIES,
            otherwise=[self._lower_power],
        )

    def emitting(self) -> bool:
        """Return what the laser itself says about its emission.

        A laser that went dark by itself (interlock, key) is disarmed: light returns only through `arm`.

        Raises
        ------
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        self._require_connection()
        emitting = self._says_emitting()
        if self._lit and not emitting:
            self._armed = self._lit = False
        return emitting

    def _make_dark(self) -> None:
        """Tell it to be dark, and raise unless it says that it is."""
        self._switch(False)
        if self._says_emitting():
            raise RefusedError(self.name, "be dark", "it reports that it still emits", BEWARE)

    def _emits_when_found(self) -> bool:
        try:
            return self._says_emitting()
        except DeviceError as problem:  # it may emit
            leave([self.stop], problem)
            raise

    def _require_connection(self) -> None:
        if not self._connected:
            raise LinkError(
                self.name, "answer", "it is not connected", "Use the laser inside its with block."
            )

    def _require_darkness(self) -> None:
        if self.emitting():
            self.stop()
            raise RefusedError(
                self.name, "be dark while arming", "it was emitting; it has been switched off", BEWARE
            )

    def _end(self) -> None:
        """Make the laser dark; only one that is dark is given back to its front panel.

        A knob there may stand at full power, so that light that cannot be ended keeps the lowest power.
        """
        self.stop()
        if self._connected:
            self._give_back()

    def _hang_up(self) -> None:
        self._connected = False
        self._close()
