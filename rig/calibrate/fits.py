"""Least squares whose weights follow the model."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from rig.calibrate import Floats

#: Most rounds, and when a fit has arrived [standard errors].
MAX_ROUNDS, ARRIVED = 30, 1e-4


def reweighted(
    model: Callable[[Floats], Floats],
    data: Floats,
    error: Callable[[Floats], Floats],
    start: ArrayLike,
    scale: ArrayLike = 1.0,
    rounds: int = MAX_ROUNDS,
) -> tuple[Floats, Floats, float]:
    """Fit a model to data whose errors depend on what is expected.

    Where these are the roots of expected counts, it ends at the greatest Poisson likelihood: there the sum of
    (n - m) / m dm/dp is 0 (iteratively reweighted least squares, Fisher's scoring).

    Parameters
    ----------
    model
        (n,) expected data for the (p,) unknowns.
    data
        (n,) data.
    error
        (n,) standard errors for (n,) expected data; infinite where data does not count.
    start, scale
        (p,) unknowns to begin with, and their orders of magnitude.
    rounds
        Most rounds.

    Returns
    -------
    (p,) unknowns, their (p, p) covariance, and chi2.
    """
    units = np.broadcast_to(np.asarray(scale, dtype=float), np.shape(start))
    at = np.asarray(start, dtype=float) / units
    for _ in range(rounds):
        weight = 1 / error(model(at * units))
        fit = least_squares(lambda x, w=weight: (model(x * units) - data) * w, at, x_scale="jac", method="lm")
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)
        moved, at = np.abs(fit.x - at), fit.x
        if (moved < ARRIVED * np.sqrt(np.diag(covariance))).all():
            break
    return at * units, covariance * np.outer(units, units), float(2 * fit.cost)
