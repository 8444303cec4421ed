"""The steering mirror's equation of motion, compiled: moves are rows of target, error and its rate (x, y)."""

import numpy as np
from numba import njit

#: Error below which the servo holds its target exactly [rad] (about 1 um on a wall 2.5 m away).
HOLD = 3.6e-7


@njit(cache=True, error_model="numpy", nogil=True)
def _axis(error, rate, t, w):  # type: ignore[no-untyped-def]
    """Error of an axis and its rate a time after they were these."""
    decay = np.exp(-w * t)
    slope = rate + w * error
    return (error + slope * t) * decay, (slope - w * (error + slope * t)) * decay


@njit(cache=True, error_model="numpy", nogil=True)
def _state(move, t, w):  # type: ignore[no-untyped-def]
    """Position and its rate (x, y, v_x, v_y) a time after a move began."""
    ex, vx = _axis(move[2], move[4], t, w)
    ey, vy = _axis(move[3], move[5], t, w)
    if np.hypot(ex, ey) < HOLD and np.hypot(vx, vy) < HOLD * w:
        return move[0], move[1], 0.0, 0.0
    return move[0] + ex, move[1] + ey, vx, vy


@njit(cache=True, error_model="numpy", nogil=True)
def append(start_s, moves, end, times, angles, w):  # type: ignore[no-untyped-def]
    """Append moves, each from where the one before has come to; return the new end."""
    for i in range(len(times)):
        x, y, vx, vy = _state(moves[end - 1], max(times[i] - start_s[end - 1], 0.0), w)
        move = moves[end]
        start_s[end] = times[i]
        move[0], move[1] = angles[i, 0], angles[i, 1]
        move[2], move[3] = x - angles[i, 0], y - angles[i, 1]
        move[4], move[5] = vx, vy
        end += 1
    return end


@njit(cache=True, error_model="numpy", nogil=True)
def positions(start_s, moves, times, w):  # type: ignore[no-untyped-def]
    """Positions (n, 2) at times (n,), each by the last move that has begun."""
    places = np.empty((len(times), 2))
    for i in range(len(times)):
        k = max(np.searchsorted(start_s, times[i], "right") - 1, 0)
        places[i, 0], places[i, 1], _, _ = _state(moves[k], max(times[i] - start_s[k], 0.0), w)
    return places
