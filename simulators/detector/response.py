"""How detector and electronics blur time."""

from math import log, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Full width at half maximum of a Gaussian of unit standard deviation.
FWHM_PER_SIGMA = 2 * sqrt(2 * log(2))


def delays(
    number: int, fwhms_s: tuple[float, ...], tail_s: float, tail_fraction: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw delays from arrival to timing input [s]: a Gaussian core about zero, and a tail after it.

    Parameters
    ----------
    number
        How many.
    fwhms_s
        Full widths at half maximum of the Gaussian parts of the core [s].
    tail_s, tail_fraction
        Time constant of the exponential tail [s], and the fraction of detections delayed by it.
    """
    sigma_s = sqrt(sum(width_s**2 for width_s in fwhms_s)) / FWHM_PER_SIGMA
    delays_s = rng.standard_normal(number)
    _delay(delays_s, sigma_s, tail_s, tail_fraction, rng)
    return delays_s


@njit(cache=True, error_model="numpy", nogil=True)
def _delay(delays, sigma, tail, fraction, rng):  # type: ignore[no-untyped-def]
    for i in range(len(delays)):
        delays[i] *= sigma
        if rng.random() < fraction:
            delays[i] += tail * rng.standard_exponential()
