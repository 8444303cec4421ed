"""One whole scan: devices opened, the plan run, the photons on disk."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.config import RigConfig
from rig.engine import Consumer, Ended, Event, PositionDone, ScanEngine
from rig.files.scan_writer import ScanWriter
from rig.plan import ScanPlan
from rig.pointing import Pointing
from rig.recording import Recorder
from rig.session import open_devices


@dataclass(frozen=True)
class ScanResult:
    """What a scan gave."""

    ended: Ended
    photons: int
    live_time_s: float


class _Tally:
    """A consumer that adds up photons and time."""

    def __init__(self) -> None:
        self.photons = 0
        self.live_time_s = 0.0

    def __call__(self, event: Event) -> None:
        if isinstance(event, PositionDone):
            self.photons += int(event.exposure.counts.sum())
            self.live_time_s += event.exposure.live_time_s


def acquire(
    plan: ScanPlan,
    config: RigConfig,
    target: Path,
    consumers: Sequence[Consumer] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> ScanResult:
    """Run a plan on the rig that a configuration names, into a new scan file.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails; the file then ends with the status "failed" and keeps what was measured.
    rig.errors.UsageError
        If ``target`` exists already.
    """
    tally = _Tally()
    with (
        open_devices(config) as devices,
        ScanWriter.create(target, plan=plan, config=config, devices=devices) as writer,
    ):
        everyone: list[Consumer] = [Recorder(writer), tally, *consumers]

        def consume(event: Event) -> None:
            for consumer in everyone:
                consumer(event)

        engine = ScanEngine(
            devices,
            plan,
            Pointing(config.galvo.position_m),
            settle_timeout_s=config.galvo.settle_timeout_s,
        )
        ended = engine.run(consume, should_stop)
    return ScanResult(ended, tally.photons, tally.live_time_s)
