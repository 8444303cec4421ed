"""What part of a light pulse passes a gate whose opening edge meets it.

The sensitivity rises linearly from 0 to 1 in a time W, and is one half at the gate's delay; the pulse is a
Gaussian of standard deviation sigma. Of a pulse that arrives x before the gate is half open there passes

    E(x) = [F(W/2 - x) - F(-W/2 - x)] / W,   F(z) = z Phi(z / sigma) + sigma phi(z / sigma) ,

with the normal distribution Phi and its density phi: the linear edge averaged over the pulse.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import ndtr

from rig.calibrate import Floats
from rig.calibrate.fits import reweighted

#: A linear edge takes this much of its whole time from 20 to 80 %.
MIDDLE = 0.6
#: Only between these parts is the edge fitted: the sensitivity rings after the gate has opened, and where it
#: is closed there is nothing to learn of the edge.
FITTED = (0.005, 0.85)
#: Fewest points there.
MIN_POINTS = 4


@dataclass(frozen=True)
class Edge:
    """A gate's opening edge, and the pulse that it was measured with.

    Attributes
    ----------
    offset_s
        Delay of the half open gate less the recorded arrival of the light that it halves.
    rise_s, sigma_s
        W, and sigma of the pulse.
    covariance, residual
        (2, 2) of offset and rise [s^2], and root mean square of the residuals in standard errors.
    """

    offset_s: float
    rise_s: float
    sigma_s: float
    covariance: Floats
    residual: float

    def passed(self, late_s: ArrayLike) -> Floats:
        """Return what part passes a gate that opens so much after the light's recorded arrival."""
        return passed(np.asarray(late_s) - self.offset_s, self.rise_s, self.sigma_s)

    def blocks_from_s(self, part: float) -> float:
        """Return the least lateness of the gate at which no more than this part passes."""
        return self.offset_s + self._reach_s(part)

    def open_until_s(self, part: float) -> float:
        """Return the greatest lateness at which all but this part passes; the edge is symmetric."""
        return self.offset_s - self._reach_s(part)

    def blocks_error_s(self) -> float:
        """Return the standard error of `blocks_from_s`: of offset + rise / 2."""
        by = np.array([1.0, 0.5])
        return float(np.sqrt(by @ self.covariance @ by))

    def _reach_s(self, part: float) -> float:
        far_s = self.rise_s + 10 * self.sigma_s
        return float(brentq(lambda x_s: float(passed(x_s, self.rise_s, self.sigma_s)) - part, 0, far_s))


def passed(x_s: ArrayLike, rise_s: float, sigma_s: float) -> Floats:
    """Return E(x)."""

    def integral(z: Floats) -> Floats:
        u = z / sigma_s
        return z * ndtr(u) + sigma_s * np.exp(-(u**2) / 2) / np.sqrt(2 * np.pi)

    x = np.asarray(x_s, dtype=float)
    return (integral(rise_s / 2 - x) - integral(-rise_s / 2 - x)) / rise_s


def fit_edge(late_s: Floats, counts: Floats, whole: Floats, sigma_s: float) -> Edge:
    """Fit offset and rise, met by a pulse of this sigma.

    Of each of n measurements there are the gate's delay less the recorded arrival, the counts of the pulse,
    and the counts of the whole pulse, which the open gate lets pass in the same exposure. Raises ValueError
    if the counts do not go from open to closed.
    """
    part = counts / whole

    def error(due: Floats) -> Floats:
        if fitted_at(due).sum() < MIN_POINTS:
            raise ValueError("too few delays fall on the edge")
        return np.where(fitted_at(due), part_error(due, whole), np.inf)

    start = _start(late_s, part)
    (offset_s, rise_s), covariance, chi2 = reweighted(
        lambda at: passed(late_s - at[0], abs(at[1]), sigma_s), part, error, start, scale=start[1]
    )
    used = fitted_at(passed(late_s - offset_s, abs(rise_s), sigma_s))
    residual = float(np.sqrt(chi2 / max(used.sum() - 2, 1)))
    return Edge(float(offset_s), float(abs(rise_s)), sigma_s, covariance * max(residual, 1.0) ** 2, residual)


def fitted_at(due: Floats) -> NDArray[np.bool_]:
    """Return where the edge is fitted, by the parts that are due there."""
    return (due > FITTED[0]) & (due < FITTED[1])


def part_error(due: Floats, whole: Floats) -> Floats:
    """Return the standard error of a part, by counting: of its own counts and of the open gate's."""
    due = np.maximum(due, 0.0)
    return np.sqrt(due * (1 + due) / whole)


def _start(late_s: Floats, part: Floats) -> tuple[float, float]:
    """Return a first offset and rise from medians over stretches of lateness."""
    order = np.argsort(late_s)
    stretches = np.array_split(order, max(len(order) // 12, 4))
    at_s = np.array([np.median(late_s[some]) for some in stretches])
    middle = np.array([np.median(part[some]) for some in stretches])
    if middle.max() < 0.8 or middle[-1] > 0.1:
        raise ValueError(
            f"{100 * middle[0]:.0f} % pass at the first delays, {100 * middle[-1]:.0f} % at the last"
        )
    last_open = int(np.flatnonzero(middle > 0.5)[-1])
    below = at_s[min(last_open + 1, len(at_s) - 1)]
    return float((at_s[last_open] + below) / 2), max(float(below - at_s[last_open]), 200e-12)
