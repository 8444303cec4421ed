"""A detector whose gate is triggered by a delayer: the two as one gated detector."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace

from drivers.errors import LimitError
from drivers.leaving import leave
from rig.devices.kinds import DELAYERS, DETECTORS, Wires
from rig.model.config import RigConfig
from rig.model.devices import GateDelayer, GatedSpad, Settings


class DelayedGate:
    """A detector and the delayer between sync pulse and gate; each is opened, and left safe, by itself.

    The delay is set while the delayer's output is off, so that no gate opens at a delay that nobody wants.
    Without the delayer's pulses no gate opens: it is the first to be switched off.

    Parameters
    ----------
    detector, delayer
        The two, opened.
    gated
        False: the detector runs freely, and the delayer stays off.
    delay_s
        Opening edge of the gate after the sync pulse.
    insertion_delay_s
        What cables and delayer add by themselves.
    period_s
        Time between two sync pulses. A gate that cannot follow its own pulse follows the one before.
    """

    def __init__(
        self,
        detector: GatedSpad,
        delayer: GateDelayer,
        *,
        gated: bool,
        delay_s: float,
        insertion_delay_s: float,
        period_s: float,
    ) -> None:
        self._detector = detector
        self._delayer = delayer
        self._insertion_delay_s = insertion_delay_s
        self._period_s = period_s
        self._gated = gated
        self._told_s = delay_s
        self._enabled = False
        self._less_s = 0.0
        if gated:
            self._set_delay(delay_s)

    @property
    def identity(self) -> str:
        """Both."""
        return f"{self._detector.identity}, its gate delayed by {self._delayer.identity}"

    @property
    def by_hand(self) -> frozenset[str]:
        """What only a person can set: of the detector's, all but the delay."""
        return self._detector.by_hand - {"gate_delay"}

    def enable(self) -> None:
        """Let the delayer's pulses out, and open the detector's gate; both are closed if one fails."""
        try:
            if self._gated:
                self._delayer.enable()
            self._detector.enable()
        except BaseException as problem:
            leave([self.disable], problem)
            raise
        self._enabled = True

    def disable(self) -> None:
        """Let no pulse out, and then close the detector; safe to call at any time."""
        self._enabled = False
        leave([self._delayer.disable, self._detector.disable], None)

    def set_gate(self, delay_s: float, width_s: float) -> None:
        """Set the delay at the delayer, whose output is off meanwhile, and the width at the detector.

        For the detector the delay stays what it was told first: it is not the detector's business.
        """
        self._delayer.disable()
        self._set_delay(delay_s)
        self._detector.set_gate(self._told_s, width_s)
        if self._enabled and self._gated:
            self._delayer.enable()

    def set_hold_off(self, hold_off_s: float) -> None:
        """Set the detector's hold-off."""
        self._detector.set_hold_off(hold_off_s)

    def settings(self) -> Settings:
        """Return the settings of the detector, the gate's delay, and the settings of the delayer."""
        of_delayer = self._delayer.settings()
        settings = {**self._detector.settings(), "identity": self.identity}
        if self._gated:
            settings["gate_delay_s"] = float(of_delayer["delay_s"]) + self._less_s
        return settings | {
            f"delayer_{name}": value for name, value in of_delayer.items() if name != "identity"
        }

    def _set_delay(self, delay_s: float) -> None:
        periods = 0
        while delay_s + periods * self._period_s < self._insertion_delay_s:
            periods += 1
        try:
            self._delay_by(delay_s, periods)
        except LimitError as problem:
            try:
                self._delay_by(delay_s, periods + 1)
            except LimitError:
                raise problem from None

    def _delay_by(self, delay_s: float, periods: int) -> None:
        less_s = self._insertion_delay_s - periods * self._period_s
        self._delayer.set_delay(delay_s - less_s)
        self._less_s = less_s


@contextmanager
def open_detector(config: RigConfig, wires: Wires) -> Iterator[GatedSpad]:
    """Open the detector, with the delayer of its gate where there is one; leave both safe at the end.

    Raises
    ------
    drivers.errors.DeviceError
        If one is missing, is another one, cannot be set so, or fails.
    """
    section, delayer = config.detector, config.delayer
    with ExitStack() as stack:
        triggered = replace(wires, gate_delayed=delayer is not None)
        detector = stack.enter_context(DETECTORS.of(section).open(section, triggered))
        if delayer is None:
            yield detector
            return
        yield DelayedGate(
            detector,
            stack.enter_context(DELAYERS.of(delayer).open(delayer, wires)),
            gated=section.gated,
            delay_s=section.gate_delay_s,
            insertion_delay_s=delayer.insertion_delay_s,
            period_s=1 / wires.sync_hz,
        )
