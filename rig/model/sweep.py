"""The way of a mirror that never stops: where it is sent at each tick of a point clock, and what is marked.

A tick lasts as long as a point is measured. The mirror goes along a line from point to point, and turns
between lines in ticks that no marker has. Marker 1 comes with each point; marker 2 with the first point of
a line, and alone at its end, one tick after the last point; marker 3 with the first point of a frame, and
alone in the first tick of all.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from rig.errors import RefusedError
from rig.model.plan import Grid, ScanPlan
from rig.model.quantities import show_duration
from rig.model.state import RigState

POINT, LINE, FRAME = 1, 2, 4

#: The end of a line is marked in the first tick of the turn, so a turn has at least so many.
FEWEST_TURN_TICKS = 3

#: Largest acceleration between two lines, in units of a line's speed over the time of a turn. To go back the
#: way it came takes 2 of them; to move on by a line meanwhile a little more.
HARDEST_TURN = 3.0
LONGEST_TURN_TICKS = 2000

#: The mirror moves at most so many of the grid's spacings in a tick. A line whose points are farther apart,
#: in the coarse rounds of a progressive order, has ticks in between in which nothing is measured.
FASTEST = 2


@dataclass(frozen=True)
class Line:
    """A line of a sweep.

    Attributes
    ----------
    steps
        Steps of the plan that it measures.
    ticks
        (n,) tick of each of its points, counted from the sweep's first.
    """

    steps: range
    ticks: NDArray[np.int64]

    @property
    def end(self) -> int:
        """The tick after its last point, where its end is marked."""
        return int(self.ticks[-1]) + 1


@dataclass(frozen=True)
class Sweep:
    """Lines that are measured without a stop.

    Attributes
    ----------
    angles_rad
        (T, 2) commanded optical angles at each tick.
    marks
        (T,) uint8, markers of each tick.
    tick_s
        Time between ticks.
    lines
        In the order of time.
    """

    angles_rad: NDArray[np.float64]
    marks: NDArray[np.uint8]
    tick_s: float
    lines: tuple[Line, ...]

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return len(self.marks) * self.tick_s


@dataclass(frozen=True)
class Way:
    """What a mirror goes through in a scan.

    Attributes
    ----------
    positions
        Of each sweep, turns included.
    duration_s
        How long all sweeps take.
    farthest_rad
        Largest optical angles along both axes, turns included.
    """

    positions: tuple[int, ...]
    duration_s: float
    farthest_rad: tuple[float, float]


class Trajectories:
    """Sweeps over a plan.

    Parameters
    ----------
    plan
        Each pass that is to be swept over visits a grid line by line.
    angles_rad
        (S, 2) commanded optical angles of each step.
    turn_s
        Time in which the mirror turns from one line to its neighbour that runs the other way, where it moves
        one spacing of the grid a tick; where it moves faster, that many times as long.

    Raises
    ------
    RefusedError
        If a pass visits its positions one here, one there.
    """

    def __init__(self, plan: ScanPlan, angles_rad: NDArray[np.float64], turn_s: float) -> None:
        for one in plan.passes:
            if one.motion == "continuous" and not (
                isinstance(one.positions, Grid) and one.positions.order != "random"
            ):
                raise RefusedError(
                    "a mirror that never stops needs lines: measure positions in random order, or from a "
                    "list, with --mode step"
                )
        self._plan = plan
        self._angles_rad = angles_rad
        self._turn_s = turn_s

    def sweeps(self, steps: range, longest: int | None = None) -> Iterator[Sweep]:
        """Yield the sweeps over some steps of one pass, each of as many lines as fit.

        Parameters
        ----------
        steps
            They end with a line; the first may lie inside one.
        longest
            How many ticks a sweep may have.

        Raises
        ------
        RefusedError
            If a single line has more.
        """
        tick_s = self._plan.passes[int(self._plan.pass_of_step[steps.start])].exposure_s
        turn = max(FEWEST_TURN_TICKS, ceil(self._turn_s / tick_s - 1e-9))
        held: list[_Laid] = []
        size = 0  # of what is held, without its end
        for line in self._lines(steps):
            laid = self._along(line, turn)
            laid = replace(laid, before=_turning(held[-1], laid) if held else _speeding_up(laid))
            if held and longest is not None and size + laid.size > longest:
                yield self._sweep(held, tick_s)
                held, size, laid = [], 0, replace(laid, before=_speeding_up(laid))
            if longest is not None and laid.size > longest:
                raise RefusedError(
                    f"the mirror holds {longest:,} positions of a trajectory, and one line of {len(line):,} "
                    "points with its turns has more. Use shorter lines, or --mode step"
                )
            held.append(laid)
            size += laid.size - laid.turn
        if held:
            yield self._sweep(held, tick_s)

    def way(self, longest: int | None = None) -> Way:
        """Lay all sweeps out, each of so many positions at most, and say how much they are.

        Raises
        ------
        RefusedError
            If a single line has more.
        """
        positions, duration_s, farthest_rad = [], 0.0, np.zeros(2)
        for number in range(len(self._plan.passes)):
            for one in self.sweeps(self._plan.range_of_pass(number), longest):
                positions.append(len(one.marks))
                duration_s += one.duration_s
                farthest_rad = np.maximum(farthest_rad, np.abs(one.angles_rad).max(axis=0))
        return Way(tuple(positions), duration_s, (float(farthest_rad[0]), float(farthest_rad[1])))

    def _lines(self, steps: range) -> Iterator[range]:
        """Yield the steps of each line."""
        first = steps.start
        for end in np.flatnonzero(self._plan.ends_line[steps.start : steps.stop]) + steps.start + 1:
            yield range(first, int(end))
            first = int(end)

    def _sweep(self, laid: Sequence["_Laid"], tick_s: float) -> Sweep:
        pieces = [piece for one in laid for piece in (one.before, one.angles_rad)]
        begins = np.cumsum([len(piece) for piece in pieces])[::2]
        lines = tuple(Line(one.steps, begin + one.ticks) for one, begin in zip(laid, begins, strict=True))
        angles_rad = np.concatenate([*pieces, _slowing_down(laid[-1])])
        marks = np.zeros(len(angles_rad), np.uint8)
        marks[0] = FRAME
        for line in lines:
            marks[line.ticks] = POINT
            marks[line.ticks[0]] |= LINE | (FRAME if self._begins_frame(line.steps.start) else 0)
            marks[line.end] = LINE
        return Sweep(angles_rad, marks, tick_s, lines)

    def _begins_frame(self, step: int) -> bool:
        number = int(self._plan.pass_of_step[step])
        size = len(self._plan.passes[number].positions.spots_m)
        return (step - self._plan.range_of_pass(number).start) % size == 0

    def _along(self, steps: range, turn: int) -> "_Laid":
        """Lay out a line, which is gone along at one speed, also where positions are left out."""
        spots_m = self._plan.spots_m[steps.start : steps.stop]
        grid = self._plan.passes[int(self._plan.pass_of_step[steps.start])].positions
        assert isinstance(grid, Grid)
        spacings = np.rint(np.linalg.norm(np.diff(spots_m, axis=0), axis=1) / grid.spacing_m).astype(int)
        speed = int(min(spacings.min(initial=FASTEST), FASTEST))
        ticks = np.concatenate([[0], np.cumsum(spacings // speed)])
        angles = self._angles_rad[steps.start : steps.stop]
        every = np.arange(ticks[-1] + 1)
        filled = np.column_stack([np.interp(every, ticks, angles[:, axis]) for axis in (0, 1)])
        return _Laid(steps, filled, ticks, turn * speed)


@dataclass(frozen=True)
class _Laid:
    """A line that is laid out, and the way to it.

    Attributes
    ----------
    steps
        Of the plan.
    angles_rad
        (n, 2) at each of its ticks.
    ticks
        (points,) ticks of its points, counted from its first.
    turn
        How many ticks a turn at its speed takes.
    before
        (m, 2) angles of the way to it.
    """

    steps: range
    angles_rad: NDArray[np.float64]
    ticks: NDArray[np.int64]
    turn: int
    before: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def size(self) -> int:
        """Number of ticks, if the sweep ends with it."""
        return len(self.before) + len(self.angles_rad) + self.turn

    @property
    def begins_with(self) -> NDArray[np.float64]:
        """(2,) how far it moves in its first tick."""
        return self._speed(0)

    @property
    def ends_with(self) -> NDArray[np.float64]:
        """(2,) how far it moves in its last tick."""
        return self._speed(-1)

    def _speed(self, which: int) -> NDArray[np.float64]:
        steps = np.diff(self.angles_rad, axis=0)
        return np.asarray(steps[which]) if len(steps) else np.zeros(2)


def _speeding_up(line: _Laid) -> NDArray[np.float64]:
    """Return angles from rest to the first point and its speed, evenly accelerated."""
    turn, speed = line.turn, line.begins_with
    tick = np.arange(turn)[:, None]
    return np.asarray(line.angles_rad[0] - speed * turn / 2 + speed * tick**2 / (2 * turn))


def _slowing_down(line: _Laid) -> NDArray[np.float64]:
    """Return angles from the last point and its speed to rest."""
    turn, speed = line.turn, line.ends_with
    tick = np.arange(1, turn + 1)[:, None]
    return np.asarray(line.angles_rad[-1] + speed * tick - speed * tick**2 / (2 * turn))


def _turning(line: _Laid, after: _Laid) -> NDArray[np.float64]:
    """Return angles from a line's last point to the next one's first, both at the speed of their lines.

    A cubic (Hermite's) in time, whose acceleration is greatest at one of its ends. It takes the fewest ticks,
    and not fewer than a turn, that keep this below `HARDEST_TURN`.
    """
    start, stop, v0, v1 = line.angles_rad[-1], after.angles_rad[0], line.ends_with, after.begins_with
    turn, speed = max(line.turn, after.turn), max(np.hypot(*v0), np.hypot(*v1))
    ticks, away = turn, stop - start
    if speed:
        n = np.arange(turn, turn + LONGEST_TURN_TICKS)[:, None]
        at_ends = (6 * away - n * (4 * v0 + 2 * v1), 6 * away - n * (2 * v0 + 4 * v1))
        hardest = np.max([np.linalg.norm(one, axis=1) for one in at_ends], axis=0) / n[:, 0] ** 2
        ticks += int(np.argmax(hardest <= HARDEST_TURN * speed / turn))
    s = (np.arange(1, ticks) / ticks)[:, None]
    hermite = (2 * s**3 - 3 * s**2 + 1) * start + (3 * s**2 - 2 * s**3) * stop
    return np.asarray(hermite + ticks * ((s**3 - 2 * s**2 + s) * v0 + (s**3 - s**2) * v1))


def planned_duration_s(plan: ScanPlan, state: RigState) -> float:
    """Estimate how long a scan takes on hardware, in either mode, without the loading of a mirror."""
    if not plan.continuous:
        return plan.duration_s(state.config)
    angles_rad = state.pointing.angles_rad(plan.spots_m)
    return Trajectories(plan, angles_rad, state.config.galvo.turn_time_s).way().duration_s


def loading_in_words(positions: int, duration_s: float) -> str:
    """Say how long a mirror is told its way."""
    return f"{positions:,} positions are loaded into the mirror; this takes about {show_duration(duration_s)}"
