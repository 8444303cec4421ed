"""The Onefive/NKT Katana HP pulsed lasers on their RS-232 line.

Source: published drivers for Katana 05 and 08HP (names and formats in `drivers.katana.dialects`); not yet run
on the hardware. The laser cannot be asked about its interlock: emission that was asked for and does not come
is the only sign.

Whether a Katana 05 emits is asked as ``leg?``. No published driver asks an 08HP. Here ``le?`` is tried; where
that is not answered, the light that the laser itself measures (``lpa?``) is believed, and one that answers
neither is refused. The settings that are read back say which it was.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceNotFoundError, LinkError, ProtocolError, RefusedError
from drivers.katana.dialects import (
    DIALECTS,
    MEASURED_DARK_W,
    Dialect,
    parse_emission,
    parse_measured,
    parse_rate,
    parse_value,
)
from drivers.katana.line import KatanaLine, remedy
from drivers.katana.settings import KatanaSettings
from drivers.two_step import BEWARE, TwoStepLaser


@dataclass(frozen=True)
class _Evidence:
    """How it is known whether the laser emits: a question, and what its answer means."""

    name: str
    parse: Callable[[str, str], bool | None]
    meaning: str


class KatanaLaser(TwoStepLaser):
    """A Katana laser; a context manager that leaves it dark.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    settings
        What it is set to when it is armed, and which model is expected.
    emission_timeout_s
        Longest wait for the laser to confirm that it emits; its warning lamp must go first.
    timeout_s
        Longest wait for one answer.

    Attributes
    ----------
    identity
        The model: the laser has no command that identifies it.
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
        super().__init__(self._line.name, clock=clock, emission_timeout_s=emission_timeout_s)
        self._settings = settings
        self._dialect = settings.model
        self._evidence = _Evidence(
            self._dialect.emission, parse_emission, f"asked ({self._dialect.emission}?)"
        )

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return model, power, repetition rate, trigger, remote control and emission as read back.

        ``emission_known_by`` says whether the laser was asked for its emission, or measured its light.
        """
        self._require_connection()
        names, ask = self._dialect, partial(self._line.ask, parse=parse_value)
        trigger = ask(names.trigger)
        sources = {number: source for source, number in names.triggers.items()}
        return {
            "identity": self.identity,
            f"power_{names.power_unit}": ask(names.power),
            "repetition_hz": self._line.ask(names.repetition, parse_rate),
            "trigger": sources.get(int(trigger), f"{trigger:g}"),
            "remote_control": bool(ask(names.remote)),
            **{name: ask(name) for name, _ in names.modes},
            "emitting": self.emitting(),
            "emission_known_by": self._evidence.meaning,
        }

    def _open(self) -> None:
        self._line.open()

    def _close(self) -> None:
        self._line.close()

    def _recognise(self) -> None:
        """Ask what only this model answers; the other one is told to be dark, and refused."""
        wanted = self._dialect
        heard = self._deaf_to(wanted)
        if not heard:
            self.identity = f"Onefive {wanted.model}"
            if wanted.measured:
                self._find_evidence()
            return
        for other in DIALECTS:
            if other is not wanted and not self._deaf_to(other):
                self._line.write(f"{other.emission}=0")
                raise RefusedError(
                    self.name,
                    f"be a {wanted.model}",
                    f"a {other.model} is connected, whose power has another scale",
                    "Its emission was switched off; nothing else was sent. "
                    "Write its power in the configuration, and "
                    f'kind = "{other.kind}".',
                )
        raise DeviceNotFoundError(
            self.name,
            f"answer like a {wanted.model}",
            f"{wanted.recognised_by}?: {heard[0]}",
            f"{heard[1]} Perhaps another device is at this address.",
        )

    def _deaf_to(self, dialect: Dialect) -> tuple[str, str] | None:
        """Return what came, and what to do about it, if this is not the model; None if it is."""
        try:
            self._line.ask(dialect.recognised_by, parse_value)
        except LinkError as problem:
            return problem.answered, remedy(problem.answered)
        except DeviceError as problem:
            return problem.answered, problem.remedy
        return None

    def _find_evidence(self) -> None:
        """Find out by which question emission is known."""
        names = self._dialect
        measured = _Evidence(names.measured, parse_measured, f"measured light ({names.measured}?)")
        heard = []
        for evidence in (self._evidence, measured):
            try:
                self._line.ask(evidence.name, evidence.parse)
            except DeviceError as problem:
                heard.append(f"{evidence.name}?: {problem.answered}")
            else:
                self._evidence = evidence
                return
        self._line.write(f"{names.emission}=0")
        raise ProtocolError(
            self.name,
            "report whether it emits",
            "; ".join(heard),
            f"Its emission was switched off, which it does not confirm. {BEWARE}",
        )

    def _prepare(self) -> None:
        """Take control of the power, then set modes, trigger, repetition rate and power."""
        names, wanted, put = self._dialect, self._settings, self._line.set
        if self._evidence.name == names.measured and wanted.power <= MEASURED_DARK_W:
            raise RefusedError(
                self.name,
                f"be armed for {wanted.power:g} W",
                "its emission is known only by the power that it measures, "
                "and this power is too low for that",
                f"Nothing was set. Configure a power above {MEASURED_DARK_W:g} W.",
            )
        if names.measured:  # emission without power is not seen; with the power it would be light
            self._switch(False)
        put(names.remote, "1", expected=1, within=0)
        for name, value in names.modes:
            put(name, str(value), expected=value, within=0)
        source = names.triggers[wanted.trigger]
        put(names.trigger, str(source), expected=source, within=0)
        # The laser may round: the rate to what its divider can do, the power to its decimals.
        rate = wanted.repetition_hz
        put(names.repetition, f"{rate:.0f}", expected=rate, within=rate * 1e-3, parse=parse_rate)
        self._set_power(wanted.power)

    def _give_back(self) -> None:
        """Give the power back to the knob.

        Not where light is known by what is measured: emission that is on without power would be light then.
        """
        if self._dialect.measured:
            self._lower_power()
        else:
            self._line.set(self._dialect.remote, "0", expected=0, within=0)

    def _switch(self, on: bool) -> None:
        complaint = self._line.write(f"{self._dialect.emission}={int(on)}")
        if on and complaint:
            raise self._line.complained("emit", complaint)

    def _says_emitting(self) -> bool:
        return self._line.agreed(self._evidence.name, self._evidence.parse, enough=True)

    def _says_lit(self) -> bool:
        return all(self._line.answers(self._evidence.name, self._evidence.parse, enough=False))

    def _lower_power(self) -> None:
        self._set_power(self._dialect.power_range[0])

    def _set_power(self, power: float) -> None:
        names = self._dialect
        self._line.set(names.power, names.written_power(power), expected=power, within=names.power_rounding)
