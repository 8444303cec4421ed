"""The scan engine: a loop over a plan that speaks to devices and tells what happens as events."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum

from rig.errors import RefusedError
from rig.model.devices import (
    Clock,
    Device,
    Exposure,
    Galvo,
    GatedSpad,
    Laser,
    Operator,
    Preparation,
    Rates,
    Settings,
    Tcspc,
)
from rig.model.plan import Pass, ScanPlan, Step
from rig.model.state import RigState

#: Wait after emission begins before count rates are read: the instrument renews them every 100 ms, and the
#: vendor's demos (HHLib 3.0) wait 400 ms after a change.
RATE_SETTLING_S = 0.4

#: How often the laser is asked whether it still emits: its interlock shows in nothing else.
WATCH_INTERVAL_S = 1.0


class Phase(Enum):
    """What the engine is doing.

    ::

        PREPARING -> AIMING -> LIGHTING -> CHECKING -> EXPOSING -> CLOSING
            ^---------- a pass with other settings ------'
    """

    PREPARING = "preparing"
    AIMING = "aiming"
    LIGHTING = "lighting"
    CHECKING = "checking rates"
    EXPOSING = "exposing"
    CLOSING = "closing"


class Outcome(Enum):
    """How a scan ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class PhaseChanged:
    """The engine began another phase."""

    phase: Phase


@dataclass(frozen=True)
class Ready:
    """All is set for the first exposure of a pass.

    Attributes
    ----------
    pass_index
        Which pass of the plan.
    rates
        Sync and count rates.
    warnings
        The timing instrument's own warnings.
    settings
        What each device says of itself and its settings now, by device name.
    """

    pass_index: int
    rates: Rates
    warnings: tuple[str, ...]
    settings: dict[str, Settings]


@dataclass(frozen=True)
class StepDone:
    """One step was measured. ``exposure.counts`` is valid only while the event is handled."""

    step: Step
    exposure: Exposure


@dataclass(frozen=True)
class LineDone:
    """All steps of a line were measured: a good moment to put data on disk."""

    steps_done: int


@dataclass(frozen=True)
class Ended:
    """The scan is over and the laser is dark.

    Attributes
    ----------
    outcome, reason
        How and why.
    steps_done
        Steps that can be trusted; fewer than were measured where the laser went dark unnoticed.
    """

    outcome: Outcome
    steps_done: int
    reason: str


Event = PhaseChanged | Ready | StepDone | LineDone | Ended
Consumer = Callable[[Event], None]


@dataclass(frozen=True)
class Devices:
    """The devices of a scan and the clock that they share, opened and identified."""

    galvo: Galvo
    laser: Laser
    spad: GatedSpad
    tcspc: Tcspc
    clock: Clock

    def identities(self) -> dict[str, str]:
        """Return the identity of each device."""
        return {name: device.identity for name, device in self._named.items()}

    def read_back(self) -> dict[str, Settings]:
        """Return identity and settings of each device as they are now."""
        return {
            name: {"identity": device.identity, **device.settings()} for name, device in self._named.items()
        }

    @property
    def _named(self) -> dict[str, Device]:
        return {"galvo": self.galvo, "laser": self.laser, "spad": self.spad, "tcspc": self.tcspc}


class ScanEngine:
    """Runs a plan. Its only output is events; files and displays are consumers of these.

    Parameters
    ----------
    devices
        Opened devices, set as the configuration says.
    plan
        What to measure.
    state
        The rig: where a spot is for the mirror, and how detector and gate are set where a pass does not say.
    first
        Step to begin with; those before it were measured earlier.
    operator
        Who is asked for what passes need; None where no pass asks.
    """

    def __init__(
        self,
        devices: Devices,
        plan: ScanPlan,
        state: RigState,
        *,
        first: int = 0,
        operator: Operator | None = None,
    ) -> None:
        self._devices = devices
        self._plan = plan
        self._state = state
        self._angles_rad = state.pointing.angles_rad(plan.spots_m)
        self._done = first
        self._operator = operator
        detector = state.config.detector
        self._gate_s = (detector.gate_delay_s, detector.gate_width_s)
        self._hold_off_s = detector.hold_off_s
        self._prepared: Preparation | None = None
        self._lit = False

    def run(self, consume: Consumer, should_stop: Callable[[], bool]) -> Ended:
        """Measure all steps, or stop after the one at which ``should_stop`` becomes true.

        The laser is dark and the detector unbiased when this returns or raises.

        Raises
        ------
        drivers.errors.DeviceError
            If a device fails; an `Ended` event with the outcome FAILED came before.
        RefusedError
            If no sync pulses arrive, or the laser goes dark by itself.
        """
        outcome, reason = Outcome.FAILED, "a device failed"
        try:
            self._run_passes(consume, should_stop)
            if self._done == len(self._plan):
                outcome, reason = Outcome.COMPLETE, "all positions measured"
            else:
                outcome, reason = Outcome.INTERRUPTED, "stopped by the operator"
        except KeyboardInterrupt:
            outcome, reason = Outcome.INTERRUPTED, "stopped at once by the operator"
            raise
        except Exception as error:
            reason = str(error)
            raise
        finally:
            with ExitStack() as last:  # every step is tried, whatever fails before it
                ended = Ended(outcome, self._done, reason)
                last.callback(consume, ended)
                last.callback(self._devices.spad.disable)
                last.callback(self._devices.laser.stop)
                last.callback(consume, PhaseChanged(Phase.CLOSING))
        return ended

    def _run_passes(self, consume: Consumer, should_stop: Callable[[], bool]) -> None:
        for number, one in enumerate(self._plan.passes):
            steps = self._plan.range_of_pass(number)
            if self._done >= steps.stop:
                continue  # measured earlier
            self._set_up(one, consume)
            if not self._lit:
                self._light_up(number, consume)
            self._expose(steps, consume, should_stop)
            if self._done < steps.stop or (self._done < len(self._plan) and should_stop()):
                return

    def _set_up(self, one: Pass, consume: Consumer) -> None:
        """Set the rig as a pass wants it; in the dark, if anything has to change."""
        gate = self._state.gate
        gate_s = one.gate_s or (self._gate_s if gate is None else (gate.delay_s, gate.width_s))
        usual_s = self._state.config.detector.hold_off_s
        hold_off_s = usual_s if one.hold_off_s is None else one.hold_off_s
        asked = one.preparation if one.preparation is not self._prepared else None
        if gate_s == self._gate_s and hold_off_s == self._hold_off_s and asked is None:
            return
        if self._lit:
            self._devices.laser.stop()
            self._devices.spad.disable()
            self._lit = False
        consume(PhaseChanged(Phase.PREPARING))
        if asked is not None:
            if self._operator is None:
                raise RefusedError(f"somebody has to be at the rig for this: {asked.words}")
            self._operator.prepare(asked)
            self._prepared = asked
        if gate_s != self._gate_s:
            self._devices.spad.set_gate(*gate_s)
            self._gate_s = gate_s
        if hold_off_s != self._hold_off_s:
            self._devices.spad.set_hold_off(hold_off_s)
            self._hold_off_s = hold_off_s

    def _light_up(self, pass_index: int, consume: Consumer) -> None:
        devices = self._devices
        consume(PhaseChanged(Phase.AIMING))
        self._aim(self._done)  # the beam is inside the plan before there is a beam
        consume(PhaseChanged(Phase.LIGHTING))
        self._lit = True
        devices.laser.arm()
        devices.laser.emit()
        devices.spad.enable()
        consume(PhaseChanged(Phase.CHECKING))
        devices.clock.sleep(RATE_SETTLING_S)
        rates = devices.tcspc.rates()
        if rates.sync_hz <= 0:
            raise RefusedError(
                "the timing instrument sees no sync pulses although the laser says that it emits. "
                "Check the sync cable and tcspc.sync_level, then scan again"
            )
        consume(Ready(pass_index, rates, devices.tcspc.warnings(), devices.read_back()))
        consume(PhaseChanged(Phase.EXPOSING))

    def _expose(self, steps: range, consume: Consumer, should_stop: Callable[[], bool]) -> None:
        seen_s, seen_at = self._devices.clock.now_s(), self._done
        for step in self._plan.steps(self._done):
            if step.index == steps.stop or should_stop():
                break
            self._aim(step.index)
            if self._devices.clock.now_s() - seen_s > WATCH_INTERVAL_S:
                self._require_light(seen_at)
                seen_s, seen_at = self._devices.clock.now_s(), step.index
            consume(StepDone(step, self._devices.tcspc.measure(step.exposure_s)))
            self._done += 1
            if step.ends_line:
                consume(LineDone(self._done))
        self._require_light(seen_at)  # the steps since the last look, too

    def _require_light(self, seen_at: int) -> None:
        """Raise if the laser went dark by itself, and tell since which position the data is in doubt."""
        if not self._devices.laser.emitting():
            measured, self._done = self._done, seen_at
            raise RefusedError(
                "the laser went dark by itself: check interlock and key. It was last seen emitting at "
                f"position {seen_at}; positions {seen_at} to {measured - 1} may be dark and are taken back: "
                "mend it and resume the scan"
            )

    def _aim(self, index: int) -> None:
        self._devices.galvo.point(*self._angles_rad[index])
        self._devices.galvo.wait_settled(self._state.config.galvo.settle_timeout_s)
