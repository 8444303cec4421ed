"""The Onefive/NKT Katana HP pulsed laser on its RS-232 line.

Source: published drivers for Katana 05 and 08HP (names and formats in `drivers.katana.dialects`); not yet run
on the hardware. The laser cannot be asked about its interlock: emission that was asked for and does not come
is the only sign. This is an extra layer of safety only; the interlock and the key are the real ones.
"""

from types import TracebackType
from typing import Self

from drivers.clock import Clock, wait_until
from drivers.errors import (
    DeviceError,
    DeviceNotFoundError,
    FoundEmittingError,
    LinkError,
    ProtocolError,
    RefusedError,
)
from drivers.katana.dialects import DIALECTS, Dialect
from drivers.katana.line import KatanaLine
from drivers.katana.settings import KatanaSettings
from drivers.leaving import leave

BEWARE = "Treat the laser as EMITTING: turn its key off by hand."

#: So often emission is ended before the laser is said to be emitting.
STOP_TRIES = 5

#: Between two questions that must agree: a late answer to an earlier question has come by then, and is thrown
#: away by the next one; an answer takes 5 ms at 38400 baud.
BETWEEN_ANSWERS_S = 0.05


class KatanaLaser:
    """A laser whose light takes two steps, `arm` and `emit`; a context manager that leaves it dark.

    Connecting never emits. A laser that is found emitting on connect is switched off, and the connection is
    refused so that a person learns of it.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    settings
        What it is set to when it is armed.
    emission_timeout_s
        Longest wait for the laser to confirm that it emits; its warning lamp must go first.
    timeout_s
        Longest wait for one answer.

    Attributes
    ----------
    identity
        The model, as told from its dialect: the laser has no command that identifies it.
    """

    def __init__(
        self,
        address: str,
        *,
        clock: Clock,
        settings: KatanaSettings,
        emission_timeout_s: float = 10.0,
        timeout_s: float = 0.5,
    ) -> None:
        self._line = KatanaLine(address, clock=clock, timeout_s=timeout_s)
        self._clock = clock
        self._settings = settings
        self._emission_timeout_s = emission_timeout_s
        self._found: Dialect | None = None
        self.identity = ""
        self._armed = False
        self._lit = False

    def __enter__(self) -> Self:
        self._line.open()
        try:
            emitting = self._probe()
            if emitting:
                self.stop()
                raise FoundEmittingError(
                    self._line.name,
                    "be dark when connected",
                    "it was emitting; it has been switched off",
                    "Find out who switched it on, and connect again.",
                )
        except BaseException as problem:
            leave([self._close], problem)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        leave([self._end, self._close], problem)

    def arm(self) -> None:
        """Take control of the power, set power, repetition rate and trigger, and read them back; still dark.

        Raises
        ------
        LimitError
            The model found does not take these values; nothing was sent.
        RefusedError
            The laser kept another value, or is not dark.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        names, wanted = self._dialect, self._settings
        wanted.check([names], self._line.name)
        self._armed = False
        if self.emitting():
            self.stop()
            raise RefusedError(
                self._line.name, "be dark while arming", "it was emitting; it has been switched off", BEWARE
            )
        if names.remote:
            self._line.set(names.remote, "1", expected=1, within=0)
        source = names.triggers[wanted.trigger]
        self._line.set(names.trigger, str(source), expected=source, within=0)
        # The laser may round: the rate to what its divider can do, the power to its two decimals.
        rate = wanted.repetition_hz
        self._line.set(names.repetition, f"{rate:.0f}", expected=rate, within=rate * 1e-3)
        power = names.power_format.format(wanted.power_setpoint)
        self._line.set(names.power, power, expected=wanted.power_setpoint, within=0.0051)
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
            raise RefusedError(
                self._line.name, "emit", "it is not armed", "Nothing was sent. Call arm first."
            )
        try:
            if complaint := self._line.write(f"{self._dialect.emission}=1"):
                raise self._line.complained("emit", complaint)
            if not wait_until(self._clock, self._says_lit, timeout_s=self._emission_timeout_s, every_s=0.1):
                raise RefusedError(
                    self._line.name,
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
            The laser says that it still emits; its power was set to the lowest.
        LinkError, ProtocolError
            It was told to stop, and whether it did cannot be known; its power was set to the lowest.
        """
        self._armed = self._lit = False
        if self._found is None:
            return
        doubt: BaseException | None = None
        interrupted: BaseException | None = None
        for _ in range(STOP_TRIES):  # neither a garbled line nor an interrupt must leave the light on
            try:
                self._line.write(f"{self._found.emission}=0")
                if not self._says_emitting():
                    break
                doubt = RefusedError(self._line.name, "be dark", "it says that it still emits", BEWARE)
            except DeviceError as problem:
                doubt = type(problem)(self._line.name, "be dark", problem.answered, BEWARE)
            except BaseException as problem:
                doubt = interrupted = problem
        else:
            assert doubt is not None
            leave([self._lower_power], doubt)
            raise doubt
        if interrupted is not None:
            raise interrupted

    def emitting(self) -> bool:
        """Return what the laser itself says about its emission.

        A laser that went dark by itself (interlock, key) is disarmed: light returns only through `arm`.

        Raises
        ------
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        emitting = self._says_emitting()
        if self._lit and not emitting:
            self._armed = self._lit = False
        return emitting

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return model, power, repetition rate, trigger, remote control and emission as read back."""
        names = self._dialect
        trigger = self._line.get(names.trigger)
        sources = {number: source for source, number in names.triggers.items()}
        settings: dict[str, str | int | float | bool] = {
            "identity": self.identity,
            "power_setpoint": self._line.get(names.power),
            "repetition_hz": self._line.get(names.repetition),
            "trigger": sources.get(int(trigger), f"{trigger:g}"),
            "emitting": self.emitting(),
        }
        if names.remote:
            settings["remote_control"] = bool(self._line.get(names.remote))
        return settings

    @property
    def _dialect(self) -> Dialect:
        if self._found is None:
            raise LinkError(
                self._line.name, "answer", "it is not connected", "Use the laser inside its with block."
            )
        return self._found

    def _probe(self) -> bool:
        """Find the dialect by asking for emission, which changes nothing; return the emission."""
        heard = []
        for dialect in DIALECTS:
            try:
                emitting = self._line.emission(dialect)
            except (LinkError, ProtocolError, RefusedError) as problem:
                heard.append(f"{dialect.emission}?: {problem.answered}")
                continue
            self._found = dialect
            self.identity = f"Onefive {dialect.model}"
            return emitting
        raise DeviceNotFoundError(
            self._line.name,
            "answer like a Katana laser",
            "; ".join(heard),
            "Check the address: another device, or none, is there.",
        )

    def _says_emitting(self) -> bool:
        """Ask whether the laser emits; that it does not is believed from two answers only, both fresh.

        Raises
        ------
        ProtocolError
            The answers do not agree.
        """
        if self._line.emission(self._dialect):
            return True
        self._clock.sleep(BETWEEN_ANSWERS_S)
        if self._line.emission(self._dialect):
            raise ProtocolError(
                self._line.name,
                "say twice whether it emits",
                "it said that it is dark, and then that it emits",
                "Check the cable; ask again.",
            )
        return False

    def _says_lit(self) -> bool:
        """Return whether two fresh answers say that the laser emits; one alone may be late."""
        if not self._line.emission(self._dialect):
            return False
        self._clock.sleep(BETWEEN_ANSWERS_S)
        return self._line.emission(self._dialect)

    def _end(self) -> None:
        """Make the laser dark; only one that is dark gets its power control back to the front panel.

        The knob may stand at full power, so that light that cannot be ended keeps the lowest power set here.
        """
        self.stop()
        if self._found is not None and self._found.remote:
            self._line.set(self._found.remote, "0", expected=0, within=0)

    def _lower_power(self) -> None:
        """Set the lowest power: the next best where light cannot be ended."""
        lowest = self._dialect.power_range[0]
        self._line.set(
            self._dialect.power, self._dialect.power_format.format(lowest), expected=lowest, within=0.0051
        )

    def _close(self) -> None:
        self._found = None
        self._line.close()
