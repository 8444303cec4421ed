"""The steering mirror: a critically damped second-order servo that trails its command."""

from itertools import pairwise
from math import exp, hypot, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Error below which the servo holds its target exactly [rad] (about 1 um on a wall 2.5 m away).
HOLD = 3.6e-7

#: It stands after so many times 1/w, whatever the step: (1 + 25) exp(-25) is 4e-10 of it, less than `HOLD`.
STILL_TURNS = 25.0


class SteeringMirror:
    """Two axes, as optical angles [rad].

    The error follows e(t) = (e0 + (v0 + w e0) t) exp(-w t), the critically damped response with natural
    frequency ``w``; below `HOLD` the mirror stands exactly on its target, so that where it points does not
    depend on where it came from. Commands may be given for times to come, tens of thousands at once.

    Parameters
    ----------
    natural_frequency_hz
        Natural frequency of the servo.
    """

    def __init__(self, *, natural_frequency_hz: float = 400.0) -> None:
        self._w = 2 * pi * natural_frequency_hz
        # one move a row: from when on; target (x, y), error and its rate at that time. Those from
        # `_first` to `_end` hold; the others are room
        self._start_s = np.zeros(64)
        self._moves = np.zeros((64, 6))
        self._first, self._end = 0, 1

    @classmethod
    def trailing(cls, lag_s: float) -> "SteeringMirror":
        """Return one that trails by ``lag_s`` a command that moves evenly: by 2 / w."""
        return cls(natural_frequency_hz=1 / (pi * lag_s))

    @property
    def known_from_s(self) -> float:
        """The earliest time at which the position is known."""
        return float(self._start_s[self._first])

    def command(self, x: float, y: float, now_s: float) -> None:
        """Start moving to the angles (x, y) [rad] at time ``now_s``, from wherever the mirror is by then.

        What was commanded for later is dropped.
        """
        self.drop_after(now_s)
        self._make_room(1)
        last = self._end - 1
        start_s = float(self._start_s[last])
        at_s = max(now_s, self.known_from_s)
        self._start_s[self._end] = at_s
        self._moves[self._end] = self._move(self._moves[last].tolist(), at_s - start_s, x, y)
        self._end += 1

    def follow(self, times_s: ArrayLike, angles_rad: ArrayLike) -> None:
        """Start moving to each pair of angles (n, 2) [rad] at each of (n,) ascending times.

        What was commanded for after the first of these is dropped.
        """
        times = np.atleast_1d(np.asarray(times_s, np.float64))
        if not len(times):
            return
        self.drop_after(float(times[0]))
        self._make_room(len(times))
        added = slice(self._end, self._end + len(times))
        self._start_s[added] = np.maximum(times, self.known_from_s)
        start_s, move = float(self._start_s[self._end - 1]), self._moves[self._end - 1].tolist()
        moves = []
        for at_s, (x, y) in zip(
            self._start_s[added].tolist(), np.asarray(angles_rad, np.float64).tolist(), strict=True
        ):
            start_s, move = at_s, self._move(move, at_s - start_s, x, y)
            moves.append(move)
        self._moves[added] = moves
        self._end = added.stop

    def drop_after(self, at_s: float) -> None:
        """Drop what is commanded for after a time."""
        self._end = max(self._after(at_s), self._first + 1)

    def target(self, at_s: float) -> tuple[float, float]:
        """Return the angles [rad] that are commanded by then."""
        (x, y, *_), _ = self._move_at(at_s)
        return x, y

    def position(self, at_s: float) -> tuple[float, float]:
        """Return the angles [rad] at time ``at_s``."""
        x, y, _, _ = self._state(*self._move_at(at_s))
        return x, y

    def positions(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles (n, 2) [rad] at each of (n,) times."""
        known = slice(self._first, self._end)
        number = np.maximum(np.searchsorted(self._start_s[known], times_s, "right") - 1, 0) + self._first
        t = np.maximum(times_s - self._start_s[number], 0.0)
        x, y, ex0, ey0, vx0, vy0 = self._moves[number].T
        decay = np.exp(-self._w * t)
        (ex, vx), (ey, vy) = (_axis(e, v, t, self._w, decay) for e, v in ((ex0, vx0), (ey0, vy0)))
        still = (np.hypot(ex, ey) < HOLD) & (np.hypot(vx, vy) < HOLD * self._w)
        return np.column_stack([x + np.where(still, 0.0, ex), y + np.where(still, 0.0, ey)])

    def settled(self, at_s: float) -> bool:
        """Whether the mirror stands on what is commanded by then."""
        move, since_s = self._move_at(at_s)
        return self._state(move, since_s)[:2] == (move[0], move[1])

    def moving_between(self, start_s: float, stop_s: float) -> list[tuple[float, float, bool]]:
        """Cut a time where the mirror is commanded while it stands, and where it stands for certain.

        Returns
        -------
        list of (begin_s, end_s, moving)
            All of the time in order. Where it is not said to move, it stands still; the last moments of a
            movement it may, too.
        """
        parts: list[tuple[float, float, bool]] = []
        for begin_s, end_s in pairwise([start_s, *self.commands_between(start_s, stop_s), stop_s]):
            if self.settled(begin_s):
                parts.append((begin_s, end_s, False))
                continue
            still_s = min(begin_s + STILL_TURNS / self._w, end_s)
            if parts and parts[-1][2]:
                parts[-1] = (parts[-1][0], still_s, True)
            else:
                parts.append((begin_s, still_s, True))
            if still_s < end_s:
                parts.append((still_s, end_s, False))
        return [part for part in parts if part[0] < part[1]]

    def commands_between(self, start_s: float, stop_s: float) -> list[float]:
        """Return the times of the commands given inside the open interval."""
        after = self._after(start_s)
        if after == self._end:
            return []
        before = self._first + self._start_s[self._first : self._end].searchsorted(stop_s, "left")
        times: list[float] = self._start_s[after:before].tolist()
        return times

    def forget_before(self, at_s: float) -> None:
        """Drop moves that ended before ``at_s``; the one in force then is kept."""
        self._first = max(self._after(at_s) - 1, self._first)

    def _move(self, last: list[float], t: float, x: float, y: float) -> list[float]:
        """Return the move to (x, y) that begins a time after the last one did."""
        px, py, vx, vy = self._state(last, t)
        return [x, y, px - x, py - y, vx, vy]

    def _move_at(self, at_s: float) -> tuple[list[float], float]:
        """Return the move in force at a time, and since when [s]."""
        number = max(self._after(at_s) - 1, self._first)
        move: list[float] = self._moves[number].tolist()
        return move, max(at_s - float(self._start_s[number]), 0.0)

    def _state(self, move: list[float], t: float) -> tuple[float, float, float, float]:
        """Return position and rate (x, y, v_x, v_y) a time after a move began."""
        x, y, ex0, ey0, vx0, vy0 = move
        decay = exp(-self._w * t)
        (ex, vx), (ey, vy) = _axis(ex0, vx0, t, self._w, decay), _axis(ey0, vy0, t, self._w, decay)
        if hypot(ex, ey) < HOLD and hypot(vx, vy) < HOLD * self._w:
            return x, y, 0.0, 0.0
        return x + ex, y + ey, vx, vy

    def _after(self, at_s: float) -> int:
        """Return the first move that begins after a time, or the end of all."""
        if at_s >= self._start_s[self._end - 1]:  # as nearly always
            return self._end
        return self._first + int(self._start_s[self._first : self._end].searchsorted(at_s, "right"))

    def _make_room(self, number: int) -> None:
        if self._end + number <= len(self._start_s):
            return
        held = slice(self._first, self._end)
        start_s, moves = self._start_s[held], self._moves[held]
        size = 2 * (len(start_s) + number)
        self._start_s, self._moves = np.zeros(size), np.zeros((size, 6))
        self._start_s[: len(start_s)], self._moves[: len(start_s)] = start_s, moves
        self._first, self._end = 0, len(start_s)


def _axis(error: Any, rate: Any, t: Any, w: float, decay: Any) -> tuple[Any, Any]:
    """Return error and rate of an axis a time after they were these, of numbers or arrays."""
    slope = rate + w * error
    now = error + slope * t
    return now * decay, (slope - w * now) * decay
