"""How detector and electronics blur time."""

from math import log, sqrt

import numpy as np
from numba import njit

#: Full width at half maximum of a Gaussian of unit standard deviation.
FWHM_PER_SIGMA = 2 * sqrt(2 * log(2))


def sigma_s(*fwhms_s: float) -> float:
    """Return the standard deviation of Gaussians of these full widths at half maximum together [s]."""
    return sqrt(sum(width_s**2 for width_s in fwhms_s)) / FWHM_PER_SIGMA


@njit(cache=True, error_model="numpy", nogil=True)
def delays(number, sigma, tail, fraction, rng):  # type: ignore[no-untyped-def]
    """Draw delays from arrival to timing input [s]: a Gaussian core about zero, and a tail after it.

    Parameters
    ----------
    number
        How many.
    sigma
        Standard deviation of the core [s].
    tail, fraction
        Time constant of the exponential tail [s], and the fraction of detections delayed by it.
    """
    delays = np.zeros(number)
    spread(delays, sigma, rng)
    for i in range(number):
        if rng.random() < fraction:
            delays[i] += tail * rng.standard_exponential()
    return delays


@njit(cache=True, error_model="numpy", nogil=True)
def spread(times, sigma, rng):  # type: ignore[no-untyped-def]
    """Add a Gaussian error of this standard deviation [s] to each of (n,) times [s], in place.

    It is drawn here: joined with the loop a normal draw takes a third of the time that numpy takes.
    """
    for i in range(len(times)):
        times[i] += sigma * rng.standard_normal()
