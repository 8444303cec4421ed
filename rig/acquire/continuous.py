"""One sweep: the mirror follows its trajectory, the point clock ticks, the timing instrument records."""

from collections.abc import Callable, Generator
from dataclasses import dataclass

from drivers.leaving import leave
from rig.acquire.assembly import Assembler, LineFailed, LineRead, Timing
from rig.acquire.events import Recorded
from rig.model.devices import Clock, PointClock, SweepingGalvo, TimeTagger
from rig.model.sweep import Sweep

#: How much later than planned the last marker may come [s].
LATE_S = 1.0


@dataclass(frozen=True)
class SweepDevices:
    """The devices that a sweep needs, and their clock."""

    galvo: SweepingGalvo
    point_clock: PointClock
    tagger: TimeTagger
    clock: Clock


def follow(
    sweep: Sweep,
    devices: SweepDevices,
    timing: Timing,
    settle_timeout_s: float,
    meanwhile: Callable[[], None],
) -> Generator[Recorded | LineRead | LineFailed, None, None]:
    """Run a sweep, and yield what it gives as it comes; at least ten times a second something.

    After a line that failed there is no more. The sweep ends, and all devices rest, when the generator is
    closed. ``meanwhile`` is called many times a second until it begins; it may raise.

    Raises
    ------
    drivers.errors.DeviceError
        If a device fails.
    """
    devices.galvo.trajectory(sweep.angles_rad, sweep.tick_s, meanwhile)
    meanwhile()
    devices.galvo.wait_settled(settle_timeout_s)
    devices.point_clock.load(sweep.marks, sweep.tick_s)
    assembler = Assembler(sweep, timing)
    problem: BaseException | None = None
    try:
        devices.tagger.start()
        devices.point_clock.start()
        overdue_s = devices.clock.now_s() + sweep.duration_s + LATE_S
        first: int | None = sweep.lines[0].steps.start
        for records in devices.tagger.records():
            yield Recorded(records.words, first)
            first = None
            yield from assembler.add(records)
            if assembler.done:
                return
            if records.complete_to > (sweep.duration_s + LATE_S) * timing.sync_hz or (
                not len(records.words) and devices.clock.now_s() > overdue_s
            ):
                yield LineFailed(assembler.line, "its markers did not come: check their cables.")
                return
    except GeneratorExit:  # the caller wants no more: that is no failure which could bear notes of others
        raise
    except BaseException as error:
        problem = error
        raise
    finally:
        leave([devices.point_clock.stop, devices.tagger.stop], problem)
