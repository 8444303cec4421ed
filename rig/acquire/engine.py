"""The scan engine: a loop over a plan that speaks to devices and tells what happens as events."""

from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import cast

import numpy as np

from drivers.errors import DeviceError, LimitError
from drivers.leaving import leave
from rig.acquire import sync
from rig.acquire.abilities import require_point_clock
from rig.acquire.assembly import LineRead, Timing, warm_up
from rig.acquire.continuous import SweepDevices, sweep_over
from rig.acquire.events import (
    Consumer,
    Ended,
    Event,
    Grown,
    LightChanged,
    LineDone,
    Noticed,
    Outcome,
    Phase,
    PhaseChanged,
    Ready,
    StepCut,
    StepDone,
)
from rig.acquire.vigil import READ_BACK_S, Vigil
from rig.errors import DoubtError, RefusedError
from rig.files.description import MOST_PAIRS
from rig.light.guard import ASKING_LEASE_S, FILE_LEASE_S, LIBRARY_LEASE_S
from rig.model.devices import (
    Clock,
    Device,
    Galvo,
    GatedSpad,
    GuardedLaser,
    Operator,
    PointClock,
    Preparation,
    Settings,
    SweepingGalvo,
    Tcspc,
    TimeTagger,
)
from rig.model.plan import Pass, ScanPlan, Step
from rig.model.state import RigState
from rig.model.sweep import Trajectories

#: Wait after light or bias changed before count rates are read: the instrument renews them every 100 ms, and
#: the vendor's demos (HHLib 3.0) wait 400 ms after a change.
RATE_SETTLING_S = 0.4

#: In which a detector has counted how often its gate opens (unconfirmed).
GATE_SETTLING_S = 2.0

#: An exposure with more than this left is cut when a stop is asked for; a shorter one is finished.
WORTH_CUTTING_S = 0.3


#: While the mirror does not stop, everything is read back so often at the ends of lines.
VOUCH_S = 0.5

#: What is said of a detector whose bias only a person can take away, when it has been closed as ever.
STAYS_BIASED = "the detector stays BIASED, as set by a person: its bias can only be switched off by hand"

#: What is said of a detector whose bias could not be taken away, or that could not be asked.
BIASED = "the detector does not confirm that its bias is off: treat it as BIASED, switch it off by hand"


@dataclass(frozen=True)
class Devices:
    """The devices of a scan and the clock that they share, opened and identified.

    The timing instrument makes histograms, or records each photon, whichever the plan needs.
    """

    galvo: Galvo
    laser: GuardedLaser
    spad: GatedSpad
    tcspc: Tcspc | TimeTagger
    clock: Clock
    point_clock: PointClock | None = None

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
        named: dict[str, Device] = {
            "galvo": self.galvo, "laser": self.laser, "spad": self.spad, "tcspc": self.tcspc
        }  # fmt: skip
        return named if self.point_clock is None else {**named, "point_clock": self.point_clock}


class _StopAskedError(Exception):
    """Raised where a stop is asked for while something takes long that is no exposure."""


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
    adjusted
        Whether a person changes the light meanwhile, as while optics are aligned (`rig.acquire.vigil.Vigil`).
        Nothing is recorded then, and so nothing is taken back.
    """

    def __init__(
        self,
        devices: Devices,
        plan: ScanPlan,
        state: RigState,
        *,
        first: int = 0,
        operator: Operator | None = None,
        adjusted: bool = False,
    ) -> None:
        self._devices = devices
        self._plan = plan
        self._state = state
        self._angles_rad = state.pointing.angles_rad(plan.spots_m)
        self._done = self._vouched = first
        self._vouched_s = 0.0
        self._operator = operator
        detector = state.config.detector
        self._gate_s = (detector.gate_delay_s, detector.gate_width_s)
        self._hold_off_s = detector.hold_off_s
        self._adjusted = adjusted
        self._prepared: Preparation | None = None
        self._lit = False
        self._sync_tells = False
        self._vigil = Vigil(devices, state, adjusted=adjusted)
        self._consume: Consumer = lambda event: None
        self._asked: Callable[[], bool | str] = lambda: False
        self._stopped_by = "stopped by the operator"
        if plan.continuous:
            warm_up()

    def _should_stop(self) -> bool:
        """Return whether a stop is asked for, and keep the reason where there is one."""
        asked = self._asked()
        if asked and isinstance(asked, str):
            self._stopped_by = asked
        return bool(asked)

    def run(self, consume: Consumer, should_stop: Callable[[], bool | str]) -> Ended:
        """Measure all steps, or stop after the one at which ``should_stop`` becomes true, or gives a reason.

        The laser is dark and the detector unbiased when this returns or raises.

        Raises
        ------
        drivers.errors.DeviceError
            If a device fails; an `Ended` event with the outcome FAILED came before.
        RefusedError
            If no sync pulses arrive, or the laser goes dark by itself.
        """
        self._consume, self._asked = consume, should_stop
        outcome, reason = Outcome.FAILED, "a device failed"
        during: BaseException | None = None
        try:
            self._run_passes()
            if self._done == len(self._plan) and not (self._plan.endless and self._should_stop()):
                outcome, reason = Outcome.COMPLETE, "all positions measured"
            else:
                outcome, reason = Outcome.INTERRUPTED, self._stopped_by
        except KeyboardInterrupt as interrupt:
            during = interrupt
            outcome, reason = Outcome.INTERRUPTED, "interrupted"
            raise
        except BaseException as error:
            during, reason = error, str(error)
            raise
        finally:
            ended = Ended(outcome, self._done, reason)
            closing, told = partial(consume, PhaseChanged(Phase.CLOSING)), partial(consume, ended)
            leave([self._put_out, self._take_bias, self._tell_of_bias, closing, told], during)
        return ended

    def _run_passes(self) -> None:
        for number, one in enumerate(self._plan.passes):
            if self._done >= self._plan.range_of_pass(number).stop and not self._grow():
                continue  # measured earlier
            if self._should_stop():
                return
            self._set_up(one)
            if not self._lit:
                self._light_up(number)
            self._expose(self._plan.range_of_pass(number))
            while self._done == len(self._plan) and not self._should_stop() and self._grow():
                self._expose(self._plan.range_of_pass(number))
            if self._done < self._plan.range_of_pass(number).stop:
                return
        self._set_hold_off_back()

    def _grow(self) -> bool:
        """Plan more frames, if they go on until they are stopped; return whether there are more."""
        if not self._plan.endless:
            return False
        longer = self._plan.longer(MOST_PAIRS // len(self._state.channels))
        if longer is None:
            at = len(self._plan) - 1
            self._tell(Noticed("a scan file cannot hold more frames: the scan ends here", at, at))
            return False
        of_a_frame = self._angles_rad[: len(self._plan) // self._plan.frames]
        self._tell(Grown(longer))
        self._plan, self._angles_rad = longer, np.tile(of_a_frame, (longer.frames, 1))
        return True

    def _set_up(self, one: Pass) -> None:
        """Set the rig as a pass wants it; in the dark, if anything has to change."""
        gate = self._state.gate
        gate_s = one.gate_s or (self._gate_s if gate is None else (gate.delay_s, gate.width_s))
        usual_s = self._state.config.detector.hold_off_s
        hold_off_s = usual_s if one.hold_off_s is None else one.hold_off_s
        asked = one.preparation if one.preparation is not self._prepared else None
        if gate_s == self._gate_s and hold_off_s == self._hold_off_s and asked is None:
            return
        if self._lit:
            self._put_out()
            self._take_bias()
        self._consume(PhaseChanged(Phase.PREPARING))
        if asked is not None:
            if self._operator is None:
                raise RefusedError(f"a person must be at the rig for this: {asked.words}")
            self._operator.prepare(asked)
            self._prepared = asked
        if gate_s != self._gate_s:
            self._devices.spad.set_gate(*gate_s)
            self._gate_s = gate_s
        if hold_off_s != self._hold_off_s:
            self._devices.spad.set_hold_off(hold_off_s)
            self._hold_off_s = hold_off_s

    def _set_hold_off_back(self) -> None:
        """Leave the hold-off as the configuration has it: a person may have to set it, who is there still."""
        usual_s = self._state.config.detector.hold_off_s
        if self._hold_off_s == usual_s:
            return
        self._put_out()
        self._take_bias()
        self._devices.spad.set_hold_off(usual_s)
        self._hold_off_s = usual_s

    def _light_up(self, pass_index: int) -> None:
        devices = self._devices
        self._consume(PhaseChanged(Phase.AIMING))
        self._aim(self._done)  # the beam is inside the plan before there is a beam
        self._consume(PhaseChanged(Phase.BIASING))
        devices.spad.enable()  # too much light in the room shows before the laser adds to it
        devices.clock.sleep(RATE_SETTLING_S)
        dark = devices.tcspc.rates()
        self._sync_tells = dark.sync_hz <= 0  # pulses only with light: then their end tells of darkness
        self._vigil.require_bearable(dark)
        self._consume(PhaseChanged(Phase.LIGHTING))
        self._lit = True
        devices.laser.arm()
        devices.laser.emit()
        self._consume(LightChanged(True, _now()))
        self._consume(PhaseChanged(Phase.CHECKING))
        self._wait(RATE_SETTLING_S)
        rates = devices.tcspc.rates()
        if rates.sync_hz <= 0:
            raise RefusedError(sync.none_came(devices.tcspc.settings()))
        self._vigil.require_bearable(rates)
        devices.laser.beat(LIBRARY_LEASE_S)
        warnings = devices.tcspc.warnings()
        devices.laser.beat(ASKING_LEASE_S)
        settings = self._with_its_gate_seen()
        warnings += sync.doubts(rates, self._state.config.laser.repetition_hz, settings["tcspc"])
        self._vigil.begin(rates, settings)
        blind = self._sync_tells and self._state.config.detector.gated
        self._tell(Ready(pass_index, rates, warnings, settings, None if blind else dark.input_hz))
        self._tell(PhaseChanged(Phase.EXPOSING))

    def _with_its_gate_seen(self) -> dict[str, Settings]:
        """Read everything back, once more where the detector has not counted the laser's pulses yet."""
        config = self._state.config
        settings = self._devices.read_back()
        try:
            sync.require_gate(settings["spad"], config.gate_hz, config.laser.repetition_hz)
        except RefusedError:
            self._wait(GATE_SETTLING_S)
            self._devices.laser.beat(ASKING_LEASE_S)
            settings = self._devices.read_back()
            sync.require_gate(settings["spad"], config.gate_hz, config.laser.repetition_hz)
        return settings

    def _expose(self, steps: range) -> None:
        self._vouched_s, self._vouched = self._devices.clock.now_s(), self._done
        one = self._plan.passes[int(self._plan.pass_of_step[steps.start])]
        try:
            if one.motion == "continuous":
                self._sweep(steps)
            else:
                self._step(steps)
            self._vouch()
        except DoubtError as error:
            if taken_back := self._take_back(self._vouched):
                error.args = (f"{error} {taken_back}",)
            raise
        except Exception as error:  # whatever failed, the light may have failed with it
            if not self._seen_lit() and (taken_back := self._take_back(self._vouched)):
                error.add_note(f"The laser does not report that it emits. {taken_back}")
            raise

    def _step(self, steps: range) -> None:
        """Measure steps with a mirror that comes to rest at each."""
        for step in self._plan.steps(self._done):
            if step.index == steps.stop or self._should_stop():
                break
            self._aim(step.index)
            if not self._measure(step):
                break
            if step.ends_line or self._since_vouched_s() > READ_BACK_S:
                self._vouch()  # no line is finished whose light was not seen to its end
            if step.ends_line:
                self._tell(LineDone(self._done))

    def _sweep(self, steps: range) -> None:
        """Measure steps with a mirror that never stops along a line."""
        clock = require_point_clock(self._devices.point_clock)
        galvo = cast(SweepingGalvo, self._devices.galvo)
        tagger = cast(TimeTagger, self._devices.tcspc)
        config = self._state.config
        paths = Trajectories(self._plan, self._angles_rad, config.galvo.turn_time_s)
        timing = Timing(
            tuple(channel.input for channel in self._state.channels),
            tagger.bins,
            tagger.rates().sync_hz,
            self._state.mirror_lag_s,
        )
        devices = SweepDevices(galvo, clock, tagger, self._devices.clock, config.galvo.settle_timeout_s)
        first, beside = self._done, 0
        lines = sweep_over(range(first, steps.stop), paths, devices, timing, self._go_on)
        with closing(lines) as found, suppress(_StopAskedError):
            for one in found:
                self._devices.laser.beat(LIBRARY_LEASE_S)
                if isinstance(one, LineRead):
                    self._read_line(one)
                    beside += one.beside
                else:
                    self._tell(one)
                    if isinstance(one, Noticed):  # between sweeps: what was measured is made safe
                        self._vouch()
                    if self._should_stop():
                        break
        self._tell_beside(first, beside)

    def _go_on(self) -> None:
        """Keep the light on while the mirror is told its way, unless a stop is asked for."""
        self._devices.laser.beat(ASKING_LEASE_S)
        if self._should_stop():
            raise _StopAskedError

    def _read_line(self, found: LineRead) -> None:
        self._devices.laser.beat(FILE_LEASE_S)
        for step, exposure in zip(self._plan.steps(self._done), found.exposures, strict=False):
            self._consume(StepDone(step, exposure))
            self._done += 1
            self._vigil.measured(exposure)
        if self._done == len(self._plan) or self._since_vouched_s() > VOUCH_S:
            self._vouch()
            self._tell(LineDone(self._done))

    def _tell_beside(self, first: int, beside: int) -> None:
        if self._done > first:
            told = f"{beside:,} photons came while the mirror turned between lines: they are not stored"
            self._tell(Noticed(told, first, self._done - 1, kind="turns"))

    def _since_vouched_s(self) -> float:
        return self._devices.clock.now_s() - self._vouched_s

    def _take_back(self, first: int) -> str:
        """Take back the steps from ``first`` on, and return in words which; nothing if there is none."""
        measured, self._done = self._done, first
        if self._adjusted or measured == first:
            return ""
        which = f"Positions {first} to {measured - 1}"
        return f"{which} may be wrong and were discarded: correct this and resume the scan"

    def _seen_lit(self) -> bool:
        """Return whether the laser says that it emits, when something else has failed."""
        try:
            return self._devices.laser.emitting()
        except (DeviceError, RefusedError):
            return False

    def _measure(self, step: Step) -> bool:
        """Measure a step; return False if a stop was asked for before its end."""
        devices = self._devices
        until_s = devices.clock.now_s() + step.exposure_s

        def meanwhile() -> bool:
            devices.laser.beat(LIBRARY_LEASE_S)
            for sentence in self._vigil.look():
                self._tell(Noticed(sentence, step.index, step.index))
            return until_s - devices.clock.now_s() > WORTH_CUTTING_S and self._should_stop()

        devices.laser.beat(LIBRARY_LEASE_S)
        exposure = cast(Tcspc, devices.tcspc).measure(step.exposure_s, meanwhile)
        if not exposure.whole:
            self._tell(StepCut(step, exposure))
            return False
        self._tell(StepDone(step, exposure))
        self._done += 1
        self._vigil.measured(exposure)
        return True

    def _vouch(self) -> None:
        """Raise unless laser, detector and instrument are as they were when the last vouched step ended."""
        since = self._vouched
        if since == self._done:
            return
        self._devices.laser.beat(ASKING_LEASE_S)
        for sentence in self._vigil.vouch():
            self._tell(Noticed(sentence, since, self._done - 1))
        self._vouched_s, self._vouched = self._devices.clock.now_s(), self._done

    def _aim(self, index: int) -> None:
        galvo, angles = self._devices.galvo, self._angles_rad[index]
        if self._lit:
            self._devices.laser.beat(ASKING_LEASE_S)
        try:
            galvo.point(*angles)
            galvo.wait_settled(self._state.config.galvo.settle_timeout_s)
        except LimitError:
            raise
        except DeviceError as first:  # one answer that is late or garbled is no reason to end a night's scan
            galvo.point(*angles)
            galvo.wait_settled(self._state.config.galvo.settle_timeout_s)
            self._tell(Noticed(f"the mirror was steered a second time: {first}", index, index))

    def _put_out(self) -> None:
        """Make the laser dark, believe it only if nothing speaks against it, and tell."""
        self._lit = False
        try:
            self._devices.laser.stop()
            self._require_no_sync()
        except BaseException as problem:
            if beam_dump_rad := self._state.config.galvo.beam_dump_rad:
                with suppress(DeviceError):
                    self._devices.galvo.point(*beam_dump_rad)
            leave([partial(self._consume, LightChanged(None, _now()))], problem)
            raise
        self._consume(LightChanged(False, _now(), self._state.config.known_dark_by))

    def _take_bias(self) -> None:
        """Take the detector's bias away, and tell if that cannot be confirmed."""
        try:
            self._devices.spad.disable()
        except BaseException as problem:
            at = min(self._done, len(self._plan) - 1)
            leave([partial(self._consume, Noticed(BIASED, at, at))], problem)
            raise

    def _tell_of_bias(self) -> None:
        """Tell of a bias that is a person's to switch off."""
        if "bias" in self._devices.spad.by_hand:
            at = min(self._done, len(self._plan) - 1)
            self._consume(Noticed(STAYS_BIASED, at, at, kind="bias"))

    def _require_no_sync(self) -> None:
        if not self._sync_tells:
            return
        self._sync_tells = False
        self._devices.clock.sleep(RATE_SETTLING_S)
        try:
            sync_hz = self._devices.tcspc.rates().sync_hz
        except DeviceError:
            return  # the laser itself has said twice that it is dark
        if sync_hz > 0:
            raise RefusedError(
                f"the laser reports that it is dark, but the timing instrument still counts {sync_hz:.3g} of "
                "its pulses a second. Treat the laser as EMITTING: turn its key off by hand, now"
            )

    def _wait(self, duration_s: float) -> None:
        """Wait with the light on."""
        self._devices.laser.beat(duration_s + LIBRARY_LEASE_S)
        self._devices.clock.sleep(duration_s)
        self._devices.laser.beat(LIBRARY_LEASE_S)

    def _tell(self, event: Event) -> None:
        """Tell consumers with the light on; a slow disk may take its time, but not for ever."""
        if self._lit:
            self._devices.laser.beat(FILE_LEASE_S)
        self._consume(event)


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")
