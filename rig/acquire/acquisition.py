"""One whole scan: devices opened, the plan run, the photons on disk."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.acquire.connect import open_devices
from rig.acquire.engine import (
    Consumer,
    Devices,
    Ended,
    Event,
    LineDone,
    Outcome,
    PositionDone,
    Ready,
    ScanEngine,
)
from rig.errors import DataFileError, RefusedError, UsageError
from rig.files.description import ScanDescription
from rig.files.scan import ScanFile
from rig.files.writer import ScanWriter
from rig.model import state as use
from rig.model.config import RigConfig, recorded
from rig.model.plan import ScanPlan
from rig.model.state import Calibrations

#: What is left open where the program ended between the last position and its end.
UNSEEN_END = (
    "the scan did not see its own end: whether the laser still emitted at the last positions was not asked"
)


@dataclass(frozen=True)
class ScanResult:
    """What a scan gave."""

    ended: Ended
    photons: int
    live_time_s: float


@dataclass(frozen=True)
class Watch:
    """Who looks on while a scan runs.

    Attributes
    ----------
    consumers
        Told of every event, after the file.
    should_stop
        Asked between positions whether to stop.
    """

    consumers: Sequence[Consumer] = ()
    should_stop: Callable[[], bool] = lambda: False


class Recorder:
    """A consumer of scan events that streams histograms to a file and adds them up.

    Each line of the grid is on disk before the next begins; the closing record tells how the scan ended.

    Parameters
    ----------
    writer
        The open scan file.
    """

    def __init__(self, writer: ScanWriter) -> None:
        self._writer = writer
        self._warnings: dict[str, None] = {}  # a set that keeps its order
        self.photons = 0
        self.live_time_s = 0.0

    def __call__(self, event: Event) -> None:
        """Record what belongs in the file."""
        match event:
            case Ready(warnings=warnings, settings=settings):
                self._note(warnings)
                self._writer.record_devices(settings)
            case PositionDone(exposure=exposure):
                self._note(exposure.warnings)
                self._writer.append(exposure.counts[0], exposure.live_time_s)
                self.photons += exposure.photons
                self.live_time_s += exposure.live_time_s
            case LineDone():
                self._writer.checkpoint()
            case Ended(outcome=outcome, positions_done=trusted, reason=reason):
                self._writer.withdraw(trusted)
                self._writer.close(outcome.value, reason, list(self._warnings))

    def _note(self, warnings: tuple[str, ...]) -> None:
        self._warnings.update(dict.fromkeys(warnings))


def describe(
    plan: ScanPlan, config: RigConfig, devices: Devices, calibrations: Calibrations
) -> ScanDescription:
    """Say all that is known before the first photon."""
    legs = calibrations.legs(config)
    detector_m = np.array([plan.detector_spot_m])
    gate_start_s = gate_stop_s = fade_from_s = None
    if config.spad.gated:
        gate_start_s, width_s = calibrations.gate_s(config)
        gate_stop_s = gate_start_s + width_s
        # one time after the sync pulse; in rectified time the latest opening is where the legs are shortest
        fade_from_s = gate_start_s - float(legs.delay_s(plan.spots_m, detector_m).min())
    return ScanDescription(
        laser_m=plan.spots_m,
        detector_m=detector_m,
        bins=plan.bins,
        bin_width_s=devices.tcspc.bin_width_s,
        first_bin_s=devices.tcspc.first_bin_s,
        legs=legs,
        plan=json.dumps(plan.as_dict()),
        configuration=config.model_dump_json(),
        simulated=config.simulated,
        command=" ".join(["rig", *sys.argv[1:]]),
        fade_from_s=fade_from_s,
        gate_start_s=gate_start_s,
        gate_stop_s=gate_stop_s,
        instrument_response_s=calibrations.instrument_response_s(config),
        mirror_rad=calibrations.pointing(config).angles_rad(plan.spots_m),
        calibrations=calibrations.documents(),
    )


def acquire(plan: ScanPlan, config: RigConfig, target: Path, watch: Watch | None = None) -> ScanResult:
    """Run a plan on the rig that a configuration names, into a new scan file.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails; the file then ends with the status "failed" and keeps what was measured.
    rig.errors.UsageError
        If ``target`` exists already.
    rig.errors.RefusedError
        If the plan goes beyond what was calibrated.
    """
    with open_devices(config) as devices:
        return record(plan, config, devices, target, watch, use.choose(config, devices.identities()))


def record(
    plan: ScanPlan,
    config: RigConfig,
    devices: Devices,
    target: Path,
    watch: Watch | None = None,
    calibrations: Calibrations | None = None,
) -> ScanResult:
    """Run a plan on open devices, into a new scan file; see `acquire`."""
    calibrations = calibrations or Calibrations()
    with ScanWriter.create(target, describe(plan, config, devices, calibrations)) as writer:
        return _run(plan, config, devices, writer, calibrations, watch or Watch())


def interrupted(target: Path, mine: RigConfig | None = None) -> tuple[ScanPlan, RigConfig, Calibrations]:
    """Return plan and calibrations of a scan that was interrupted, and the configuration to go on with.

    A file is data, never an order: which library is loaded, which ports are opened and how far a mirror may
    turn is said by the configuration of this rig, not by the file. Only a simulated rig, which has none of
    these, is taken from the file.

    Parameters
    ----------
    target
        The scan file.
    mine
        The configuration of the rig that is here; None where the scan was simulated.

    Raises
    ------
    rig.errors.DataFileError
        If the file is damaged, or no scan of this program.
    rig.errors.UsageError
        If it is complete, or was measured on a real rig and ``mine`` is not given.
    rig.errors.RefusedError
        If the scan was set otherwise than ``mine``.
    """
    with ScanFile(target) as scan:
        if scan.status == "complete":
            raise UsageError(f"{target} is complete: there is nothing to resume")
        if not (scan.plan and scan.configuration):
            raise DataFileError(f"{target} does not say how it was scanned: it cannot be resumed")
        plan, began_with = ScanPlan(**scan.plan), recorded(json.dumps(scan.configuration))
        calibrations = use.recorded(scan.calibrations, target)
    if mine is None:
        if not began_with.simulated:
            raise UsageError(
                f"{target} was measured on a real rig ({began_with.name}). Which devices are opened is not "
                f"taken from a file: name the rig's configuration, rig resume {target} --config FILE"
            )
        return plan, began_with, calibrations
    if others := mine.differences(began_with):
        raise RefusedError(
            f"{target} was measured with other settings than this configuration gives: {'; '.join(others)}. "
            "Set them as they were, or begin a new scan"
        )
    return plan, mine, calibrations


def resume(plan: ScanPlan, config: RigConfig, target: Path, watch: Watch | None = None) -> ScanResult:
    """Take up an interrupted scan where it stopped: same file, devices, settings and calibrations.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails.
    rig.errors.RefusedError
        If another device is connected than the one that the scan began with.
    """
    with ScanFile(target) as scan:
        if scan.done.all():
            return _end(target)
        calibrations = use.recorded(scan.calibrations, target)
    with open_devices(config) as devices:
        with ScanFile(target) as scan:
            _same_devices(scan, devices)
        with ScanWriter.resume(target) as writer:
            return _run(plan, config, devices, writer, calibrations, watch or Watch())


def _end(target: Path) -> ScanResult:
    """Give a scan its end that measured all positions and then failed or was killed; no device is needed."""
    with ScanWriter.resume(target) as writer:
        ended = Ended(Outcome.COMPLETE, writer.positions, "all positions measured")
        writer.close(ended.outcome.value, ended.reason, [UNSEEN_END])
    with ScanFile(target) as scan:
        return ScanResult(ended, scan.photons, float(np.nansum(scan.live_time_s)))


def _run(
    plan: ScanPlan,
    config: RigConfig,
    devices: Devices,
    writer: ScanWriter,
    calibrations: Calibrations,
    watch: Watch,
) -> ScanResult:
    recorder = Recorder(writer)
    everyone: tuple[Consumer, ...] = (recorder, *watch.consumers)

    def consume(event: Event) -> None:
        if isinstance(event, Ready):
            event = replace(event, warnings=(*event.warnings, *calibrations.warnings))
        for consumer in everyone:
            consumer(event)

    if calibrations.gate and config.spad.gated:
        devices.spad.set_gate(*calibrations.gate_s(config))
    engine = ScanEngine(
        devices,
        plan,
        calibrations.pointing(config),
        settle_timeout_s=config.galvo.settle_timeout_s,
        first=writer.appended,
    )
    ended = engine.run(consume, watch.should_stop)
    return ScanResult(ended, recorder.photons, recorder.live_time_s)


def _same_devices(scan: ScanFile, devices: Devices) -> None:
    """Refuse to go on with another device: half a scan from each would be worth nothing."""
    for name, now in devices.read_back().items():
        before = scan.devices.get(name, {}).get("identity", now["identity"])
        if now["identity"] != before:
            raise RefusedError(
                f"{scan.path} began with the {name} '{before}', but '{now['identity']}' is connected. "
                "Connect the first one, or begin a new scan"
            )
