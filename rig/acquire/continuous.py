"""Sweeps: the mirror follows its trajectory, the point clock ticks, the timing instrument records."""

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass

from drivers.leaving import leave
from rig.acquire.assembly import Assembler, LineFailed, LineRead, Timing
from rig.acquire.events import Noticed, Recorded
from rig.errors import DoubtError
from rig.model.devices import Clock, PointClock, SweepingGalvo, TimeTagger
from rig.model.sweep import Sweep, Trajectories, loading_in_words

#: How much later than planned the last marker may come [s].
LATE_S = 1.0

#: A line whose markers or photons cannot be trusted is measured so many times before the scan ends.
TRIES = 3

#: Loading a sweep into the mirror is told if it takes longer than this [s].
NOTEWORTHY_S = 1.0


@dataclass(frozen=True)
class SweepDevices:
    """The devices that a sweep needs, their clock, and how long the mirror may take to settle."""

    galvo: SweepingGalvo
    point_clock: PointClock
    tagger: TimeTagger
    clock: Clock
    settle_timeout_s: float


def sweep_over(
    steps: range,
    paths: Trajectories,
    devices: SweepDevices,
    timing: Timing,
    meanwhile: Callable[[], None],
) -> Generator[Recorded | LineRead | Noticed, None, None]:
    """Measure steps of one pass, sweep after sweep, and yield what it gives as it comes.

    A line that failed is noticed, and measured again in a new sweep that begins with it. All devices rest
    then, and when the generator is closed. ``meanwhile`` is called many times a second while the mirror is
    told its way; it may raise.

    Raises
    ------
    rig.errors.DoubtError
        If a line failed so often that there is no use in another try.
    drivers.errors.DeviceError
        If a device fails.
    """
    next_step, tries = steps.start, 0
    sweeps = paths.sweeps(steps, devices.galvo.longest_trajectory)
    while next_step < steps.stop:
        meanwhile()
        sweep = next(sweeps)
        if (loading_s := devices.galvo.loading_s(len(sweep.marks))) > NOTEWORTHY_S:
            told = loading_in_words(len(sweep.marks), loading_s)
            yield Noticed(told, sweep.lines[0].steps.start, sweep.lines[-1].steps.stop - 1, kind="loading")
        with closing(follow(sweep, devices, timing, meanwhile)) as found:
            for one in found:
                if isinstance(one, LineFailed):
                    break
                if isinstance(one, LineRead):
                    next_step, tries = one.line.steps.stop, 0
                yield one
            else:
                continue
        told = f"{one.reason} The line is measured again"
        yield Noticed(told, one.line.steps.start, one.line.steps.stop - 1)
        tries += 1
        if tries == TRIES:
            raise DoubtError(f"a line failed {TRIES} times. {one.reason}")
        sweeps = paths.sweeps(range(next_step, steps.stop), devices.galvo.longest_trajectory)


def follow(
    sweep: Sweep,
    devices: SweepDevices,
    timing: Timing,
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
    devices.galvo.wait_settled(devices.settle_timeout_s)
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
