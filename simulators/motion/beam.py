"""The beam behind the mirror, compiled: for a single position array operations take ten times as long."""

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", nogil=True)
def rays(angles, linear, at_rest, two, apart, turned):  # type: ignore[no-untyped-def]
    """Return where the beam starts and its direction, (n, 3) each, in the wall's frame [m].

    Parameters
    ----------
    angles
        (n, 2) commanded optical angles [rad].
    linear
        (2, 2) gain and offset [rad] of both axes.
    at_rest
        (4, 3) of one mirror at rest: its normal, where the beam comes from, and its two axes.
    two, apart
        Whether it is a pair of mirrors, and how far apart these are [m].
    turned
        (3, 3) that a row in the mount's frame is multiplied by.
    """
    starts, directions = np.zeros((len(angles), 3)), np.zeros((len(angles), 3))
    for i in range(len(angles)):
        a_x = linear[0, 0] * angles[i, 0] + linear[1, 0]
        a_y = linear[0, 1] * angles[i, 1] + linear[1, 1]
        tan_x, tan_y = np.tan(a_x), np.tan(a_y)
        start, direction = (apart * tan_x, 0.0, 0.0), (tan_x / np.cos(a_y), tan_y, -1.0)
        if not two:
            start, direction = (0.0, 0.0, 0.0), _reflected(tan_x, tan_y, at_rest)
        for axis in range(3):
            for k in range(3):
                starts[i, axis] += start[k] * turned[k, axis]
                directions[i, axis] += direction[k] * turned[k, axis]
    return starts, directions


@njit(cache=True, error_model="numpy", nogil=True)
def _reflected(tan_x, tan_y, at_rest):  # type: ignore[no-untyped-def]
    """Return the direction of the beam off one mirror, in the mount's frame."""
    resting, source, x, y = at_rest[0], at_rest[1], at_rest[2], at_rest[3]
    # tan(half the angle) = t / (1 + sqrt(1 + t^2)), t = |(tan_x, tan_y)|
    stiff = 1.0 + np.sqrt(1.0 + tan_x**2 + tan_y**2)
    normal = stiff * resting + tan_x * x + tan_y * y
    facing = (normal * source).sum()
    twice = 2.0 * facing / (normal * normal).sum() if facing > 0.0 else np.nan
    way = twice * normal - source
    return way[0], way[1], way[2]
