"""The steering mirror: a critically damped second-order servo that trails its command."""

from bisect import bisect_right
from dataclasses import dataclass
from math import exp, hypot

#: Error below which the servo holds its target exactly [rad] (about 1 um on a wall 2.5 m away).
HOLD = 3.6e-7


@dataclass(frozen=True)
class _Move:
    """One commanded move: the error and its rate at ``start_s``, decaying to zero at ``target``."""

    start_s: float
    target: tuple[float, float]
    error: tuple[float, float]
    rate: tuple[float, float]


class SteeringMirror:
    """Two axes, as optical angles [rad].

    The error follows e(t) = (e0 + (v0 + w e0) t) exp(-w t), the critically damped response with natural
    frequency ``w``; below `HOLD` the mirror stands exactly on its target, so that where it points does not
    depend on where it came from.

    Parameters
    ----------
    natural_frequency_hz
        Natural frequency of the servo.
    """

    def __init__(self, *, natural_frequency_hz: float = 400.0) -> None:
        self._w = 2 * 3.141592653589793 * natural_frequency_hz
        self._moves = [_Move(0.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))]

    @property
    def target(self) -> tuple[float, float]:
        """The last commanded angles [rad]."""
        return self._moves[-1].target

    @property
    def known_from_s(self) -> float:
        """The earliest time at which the position is known."""
        return self._moves[0].start_s

    def command(self, x: float, y: float, now_s: float) -> None:
        """Start moving to the angles (x, y) [rad] at time ``now_s``, from wherever the mirror is by then."""
        (px, py), (vx, vy) = self._state(self._moves[-1], now_s)
        self._moves.append(_Move(now_s, (x, y), (px - x, py - y), (vx, vy)))

    def position(self, at_s: float) -> tuple[float, float]:
        """Return the angles [rad] at time ``at_s``."""
        return self._state(self._move_at(at_s), at_s)[0]

    def settled(self, at_s: float) -> bool:
        """Whether the mirror stands on its last target."""
        return self.position(at_s) == self.target

    def commands_between(self, start_s: float, stop_s: float) -> list[float]:
        """Return the times of the commands given inside the open interval."""
        return [m.start_s for m in self._moves if start_s < m.start_s < stop_s]

    def forget_before(self, at_s: float) -> None:
        """Drop moves that ended before ``at_s``; the one in force then is kept."""
        keep = max(bisect_right([m.start_s for m in self._moves], at_s) - 1, 0)
        del self._moves[:keep]

    def _move_at(self, at_s: float) -> _Move:
        if at_s >= self._moves[-1].start_s:
            return self._moves[-1]
        index = bisect_right([m.start_s for m in self._moves], at_s) - 1
        return self._moves[max(index, 0)]

    def _state(self, move: _Move, at_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        t = max(at_s - move.start_s, 0.0)
        decay = exp(-self._w * t)
        axes = []
        for e0, v0 in zip(move.error, move.rate, strict=True):
            slope = v0 + self._w * e0
            e = (e0 + slope * t) * decay
            axes.append((e, (slope - self._w * (e0 + slope * t)) * decay))
        (ex, vx), (ey, vy) = axes
        if hypot(ex, ey) < HOLD and hypot(vx, vy) < HOLD * self._w:
            return move.target, (0.0, 0.0)
        return (move.target[0] + ex, move.target[1] + ey), (vx, vy)
