"""One whole scan: devices opened, the plan run, the photons on disk."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.acquire.connect import Own, open_devices
from rig.acquire.engine import Devices, ScanEngine
from rig.acquire.events import (
    Consumer,
    Ended,
    Event,
    Grown,
    LightChanged,
    LineDone,
    Noticed,
    Outcome,
    Ready,
    StepCut,
    StepDone,
)
from rig.acquire.log import ScanLog, log_of
from rig.acquire.raw import RawRecords
from rig.errors import DataFileError, RefusedError, UsageError, command_line, in_shell
from rig.files.description import ScanDescription
from rig.files.records import beside
from rig.files.scan import ScanFile
from rig.files.writer import ScanWriter, finish
from rig.model.config import RigConfig
from rig.model.devices import Exposure, Operator
from rig.model.photons import TaggedExposure
from rig.model.plan import ScanPlan
from rig.model.state import RigState
from rig.model.sweep import planned_duration_s

#: What is left open where the program ended between the last position and its end.
UNSEEN_END = (
    "the program ended before the scan did: it was not checked whether the laser still emitted "
    "at the last positions"
)


@dataclass(frozen=True)
class ScanResult:
    """What a scan gave.

    ``light`` is what was last known of the laser's, None where no device was opened; ``unverified`` says what
    was set by hand.
    """

    ended: Ended
    photons: int
    live_time_s: float
    light: LightChanged | None = None
    unverified: tuple[str, ...] = ()


@dataclass(frozen=True)
class Watch:
    """Who looks on while a scan runs.

    Attributes
    ----------
    consumers
        Told of every event, after the file.
    should_stop
        Asked between positions whether to stop; a text is the reason that the file will name.
    begun
        Told what a scan is, new or taken up again, before its first event.
    records
        Where the timing instrument's records of a new scan are kept, beside its file; None for nowhere.
    """

    consumers: Sequence[Consumer] = ()
    should_stop: Callable[[], bool | str] = lambda: False
    begun: Callable[[ScanDescription], None] = lambda description: None
    records: Path | None = None


class Recorder:
    """A consumer of scan events that streams photons to a file and adds them up.

    Each line of the grid is on disk before the next begins; the closing record tells how the scan ended.

    Parameters
    ----------
    writer
        The open scan file.
    """

    def __init__(self, writer: ScanWriter) -> None:
        self._writer = writer
        self.photons = 0
        self.live_time_s = 0.0
        self.light: LightChanged | None = None

    def __call__(self, event: Event) -> None:
        """Record what belongs in the file."""
        match event:
            case Ready(pass_index=pass_index, warnings=warnings, settings=settings):
                self._note(warnings)
                self._writer.record_devices(settings, pass_index)
            case StepDone(exposure=exposure):
                self._note(exposure.warnings)
                self._append(exposure)
                self.photons += exposure.photons
                self.live_time_s += exposure.live_time_s
            case StepCut(step=step, exposure=exposure):
                self._writer.keep_cut(step.index, exposure.counts, exposure.live_time_s)
            case Noticed(sentence=sentence, first=first, last=last, kind=kind):
                self._writer.note(sentence, first, last, kind)
            case LightChanged():
                self.light = event
                step_now = min(self._writer.appended, self._writer.steps - 1)
                self._writer.note(event.words, step_now, step_now, "light")
            case LineDone():
                self._writer.checkpoint()
            case Grown(plan=plan):
                self._writer.grow(plan)
            case Ended(outcome=outcome, steps_done=trusted, reason=reason):
                self._writer.withdraw(trusted)
                self._writer.close(outcome.value, reason)

    def _append(self, exposure: Exposure) -> None:
        """Give a step's photons to the file."""
        if self._writer.tagged and isinstance(exposure, TaggedExposure):
            self._writer.append_photons(exposure.photon_bins, exposure.of_channel, exposure.live_time_s)
        else:
            self._writer.append(exposure.counts, exposure.live_time_s)

    def _note(self, warnings: tuple[str, ...]) -> None:
        """Note what is said of the step at hand."""
        step = min(self._writer.appended, self._writer.steps - 1)
        for sentence in warnings:
            self._writer.note(sentence, step, step)


def describe(plan: ScanPlan, state: RigState, devices: Devices) -> ScanDescription:
    """Say all that is known before the first photon."""
    detector_m = np.array([[channel.spot_m for channel in state.channels]])
    gate_start_s = gate_stop_s = fade_from_s = None
    gates = {one.gate_s for one in plan.passes}
    if state.gate and len(gates) == 1:
        gate_start_s, width_s = gates.pop() or (state.gate.delay_s, state.gate.width_s)
        gate_stop_s = gate_start_s + width_s
        # one time after the sync pulse; in rectified time the latest opening is where the path is shortest
        fade_from_s = gate_start_s - float(state.delays.delay_s(plan.spots_m[:, None], detector_m).min())
    config = state.config
    return ScanDescription(
        laser_m=plan.spots_m,
        detector_m=detector_m,
        bins=devices.tcspc.bins,
        bin_width_s=devices.tcspc.bin_width_s,
        first_bin_s=devices.tcspc.first_bin_s,
        delays=state.delays,
        channels=state.channels,
        plan=plan,
        state=state,
        simulated=config.rehearsed,
        command=command_line(),
        fade_from_s=fade_from_s,
        gate_start_s=gate_start_s,
        gate_stop_s=gate_stop_s,
        instrument_response_s=state.response_s,
        mirror_rad=state.pointing.angles_rad(plan.spots_m),
        tagged=plan.continuous,
    )


def acquire(
    plan: ScanPlan,
    state: RigState,
    target: Path,
    watch: Watch | None = None,
    operator: Operator | None = None,
) -> ScanResult:
    """Run a plan on a rig, into a new scan file; ``operator`` sets what has no data interface.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails; the file then ends with the status "failed" and keeps what was measured.
    rig.errors.UsageError
        If ``target`` exists already.
    rig.errors.RefusedError
        If the plan goes beyond what was calibrated.
    """
    with open_devices(state.config, tagged=plan.continuous, operator=operator) as devices:
        return record(plan, state.of_devices(devices.identities()), devices, target, watch)


def record(
    plan: ScanPlan,
    state: RigState,
    devices: Devices,
    target: Path,
    watch: Watch | None = None,
    operator: Operator | None = None,
) -> ScanResult:
    """Run a plan on open devices, into a new scan file; ``operator`` is asked for what passes need."""
    watch, description = watch or Watch(), describe(plan, state, devices)
    with (
        RawRecords(watch.records, description) as raw,
        ScanWriter.create(target, description) as writer,
    ):
        watch.begun(description)
        return _run(plan, state, devices, writer, watch, raw, operator)


def interrupted(
    target: Path, mine: RigConfig | None = None, usual: Callable[[], RigConfig | None] = lambda: None
) -> tuple[ScanPlan, RigState]:
    """Return the plan of a scan that was interrupted, and the state of the rig to go on with.

    A file is data, never an order: which library is loaded, which ports are opened and how far a mirror may
    turn is said by the configuration of this rig, not by the file. Only a wholly simulated rig, which has
    none of these, is taken from the file. Calibrations are those that the scan began with.

    Parameters
    ----------
    target
        The scan file.
    mine
        The configuration of the rig that is here; None where the scan was simulated.
    usual
        Gives that configuration where ``mine`` is None and the scan was not wholly simulated.

    Raises
    ------
    rig.errors.DataFileError
        If the file is damaged, or no scan of this program.
    rig.errors.UsageError
        If it is complete, or was measured on a real rig and no configuration is given.
    rig.errors.RefusedError
        If the scan was set otherwise than ``mine``.
    """
    finish(target)
    with ScanFile(target) as scan:
        if scan.status == "complete" and not scan.altered.any():
            raise UsageError(f"{target} is complete: there is nothing to resume")
        if scan.plan is None or scan.state is None:
            raise DataFileError(f"{target} does not hold a scan plan: it cannot be resumed")
        scan.passes()  # a plan that does not fit its file is refused
        plan, began = scan.plan, scan.state
    simulated = began.config.simulated and began.config.tcspc.kind != "playback"
    if mine is None and not simulated:
        mine = usual()
    if mine is None:
        if not simulated:
            raise UsageError(
                f"{target} was not measured on the simulated rig only ({began.config.name}). "
                "The devices to open are never taken from a scan file: give the rig's configuration, "
                f"{in_shell('rig', 'resume', target)} --config FILE"
            )
        return plan, began
    if others := mine.differences(began.config):
        raise RefusedError(
            f"{target} was measured with other settings than this configuration gives: {'; '.join(others)}. "
            "Set them back to the old values, or start a new scan"
        )
    return plan, RigState(mine, began.calibrations)


def resume(
    plan: ScanPlan,
    state: RigState,
    target: Path,
    watch: Watch | None = None,
    operator: Operator | None = None,
    own: Own | None = None,
) -> ScanResult:
    """Take up an interrupted scan where it stopped: same file, devices, settings and calibrations.

    ``operator`` sets what has no data interface, ``own`` are devices as of `open_devices`. Where the
    instrument's records were kept beside it, those of what follows are kept in a file of their own.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails.
    rig.errors.RefusedError
        If another device is connected than the one that the scan began with.
    """
    with ScanFile(target) as scan:
        measured = scan.steps if scan.done.all() else int(scan.done.argmin())
    if measured == len(plan) and not plan.endless:
        return _end(target)
    begin_s = _begin_s(plan, state, measured)
    opened = open_devices(
        state.config, first=measured, tagged=plan.continuous, begin_s=begin_s, operator=operator, own=own
    )
    with opened as devices:
        with ScanFile(target) as scan:
            _same_devices(scan, devices)
        watch, description = watch or Watch(), describe(plan, state, devices)
        records = beside(target, again=True) if plan.continuous and beside(target).exists() else None
        with (
            ScanWriter.resume(target) as writer,
            RawRecords(records, description, writer.appended) as raw,
        ):
            watch.begun(description)
            return _run(plan, state, devices, writer, watch, raw)


def _begin_s(plan: ScanPlan, state: RigState, measured: int) -> float:
    """Return the time at which a simulated bench goes on that has seen some spots already, else zero.

    A new bench would not know of these visits, and give the same photons again, of a scene that moves back to
    where it began.
    """
    if len(np.unique(plan.spots_m, axis=0)) == len(plan):
        return 0.0
    return planned_duration_s(plan, state) * measured / len(plan)


def _end(target: Path) -> ScanResult:
    """Give a scan its end that measured all positions and then failed or was killed; no device is needed."""
    with ScanWriter.resume(target) as writer:
        ended = Ended(Outcome.COMPLETE, writer.steps, "all positions measured")
        writer.close(ended.outcome.value, ended.reason, [UNSEEN_END])
    with ScanFile(target) as scan:
        return ScanResult(ended, scan.photons, float(np.nansum(scan.live_time_s)))


def _run(
    plan: ScanPlan,
    state: RigState,
    devices: Devices,
    writer: ScanWriter,
    watch: Watch,
    raw: RawRecords,
    operator: Operator | None = None,
) -> ScanResult:
    recorder = Recorder(writer)
    log = ScanLog(log_of(writer.path), plan, writer.appended)
    everyone: tuple[Consumer, ...] = (log, recorder, *watch.consumers)
    doubts = list(state.doubts)

    def consume(event: Event) -> None:
        if isinstance(event, Ready):
            event = replace(event, warnings=(*event.warnings, *doubts))
            doubts.clear()  # said once
        raw(event)
        if problem := raw.problem():
            step = min(writer.appended, writer.steps - 1)
            consume(Noticed(problem, step, step))
        for consumer in everyone:
            consumer(event)

    first = min(writer.appended, writer.steps - 1)
    for sentence in state.config.unverified:
        writer.note(sentence, first, first, "by hand")
    engine = ScanEngine(devices, plan, state, first=writer.appended, operator=operator)
    with log:
        ended = engine.run(consume, watch.should_stop)
    return ScanResult(ended, recorder.photons, recorder.live_time_s, recorder.light, state.config.unverified)


def _same_devices(scan: ScanFile, devices: Devices) -> None:
    """Refuse to go on with another device: half a scan from each would be worth nothing.

    On the simulated rig the gated detector of earlier programs was the one of today under another name.
    """
    simulated = scan.config is not None and scan.config.simulated
    for name, now in devices.read_back().items():
        before = scan.devices.get(name, {}).get("identity", now["identity"])
        renamed = simulated and name == "spad" and "ID120 simulated" in str(before)
        if now["identity"] != before and not renamed:
            raise RefusedError(
                f"{scan.path} began with the {name} '{before}', but '{now['identity']}' is connected. "
                "Connect the first one, or start a new scan"
            )
