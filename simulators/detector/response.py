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
    return np.asarray(_delays(number, sigma_s, tail_s, tail_fraction, rng))


def spread(times_s: NDArray[np.float64], fwhm_s: float, rng: np.random.Generator) -> None:
    """Add a Gaussian error of this full width at half maximum to each of (n,) times [s], in place."""
    if len(times_s):  # handing the generator over takes as long as two thousand draws
        _spread(times_s, fwhm_s / FWHM_PER_SIGMA, rng)


@njit(cache=True, error_model="numpy", nogil=True)
def _spread(times, sigma, rng):  # type: ignore[no-untyped-def]
    """Draw here: joined with the loop a normal draw takes a third of the time that numpy takes."""
    for i in range(len(times)):
        times[i] += sigma * rng.standard_normal()


@njit(cache=True, error_model="numpy", nogil=True)
def _delays(number, sigma, tail, fraction, rng):  # type: ignore[no-untyped-def]
    delays = np.empty(number)
    for i in range(number):
        delays[i] = sigma * rng.standard_normal()
    for i in range(number):
        if rng.random() < fraction:
            delays[i] += tail * rng.standard_exponential()
    return delays
