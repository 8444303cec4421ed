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

#: A linear edge takes this much of its whole time from 20 to 80 %.
MIDDLE = 0.6
#: Only between these parts is the edge fitted: the sensitivity rings after the gate has opened, and where it
#: is closed there is nothing to learn of the edge.
FITTED = (0.005, 0.85)
#: Steps of the fit; the last ones change nothing.
STEPS = 30


@dataclass(frozen=True)
class Edge:
    """A gate's opening edge, and the pulse that it was measured with.

    Attributes
    ----------
    offset_s
        Delay of the half open gate less the recorded arrival of the light that it halves.
    rise_s
        W.
    sigma_s
        Of the pulse.
    covariance
        (2, 2) of offset and rise [s^2].
    residual
        Root mean square of what the fit leaves, in standard errors.
    """

    offset_s: float
    rise_s: float
    sigma_s: float
    covariance: NDArray[np.float64]
    residual: float

    def passed(self, late_s: ArrayLike) -> NDArray[np.float64]:
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


def passed(x_s: ArrayLike, rise_s: float, sigma_s: float) -> NDArray[np.float64]:
    """Return E(x)."""

    def integral(z: NDArray[np.float64]) -> NDArray[np.float64]:
        u = z / sigma_s
        return z * ndtr(u) + sigma_s * np.exp(-(u**2) / 2) / np.sqrt(2 * np.pi)

    x = np.asarray(x_s, dtype=float)
    return (integral(rise_s / 2 - x) - integral(-rise_s / 2 - x)) / rise_s


def fit_edge(
    late_s: NDArray[np.float64], counts: NDArray[np.float64], whole: NDArray[np.float64], sigma_s: float
) -> Edge:
    """Fit offset and rise.

    Parameters
    ----------
    late_s
        (n,) gate's delay less recorded arrival.
    counts
        (n,) counts of the pulse.
    whole
        (n,) counts that the open gate lets pass, from a measurement of the same exposure.
    sigma_s
        Of the pulse.

    Raises
    ------
    ValueError
        If the counts do not go from open to closed.
    """
    part = counts / whole
    offset_s, rise_s = _start(late_s, part)
    for _ in range(STEPS):
        due = passed(late_s - offset_s, rise_s, sigma_s)
        used = fitted_at(due)
        error = part_error(due, whole)[used]
        tiny = 1e-13
        by = np.stack(
            [
                (passed(late_s - offset_s - tiny, rise_s, sigma_s) - due) / tiny,
                (passed(late_s - offset_s, rise_s + tiny, sigma_s) - due) / tiny,
            ]
        )[:, used]
        left = (part - due)[used]
        information = (by / error**2) @ by.T
        if used.sum() < 4 or np.linalg.cond(information) > 1e12:
            raise ValueError("too few delays fall on the edge")
        step = np.linalg.solve(information, by @ (left / error**2))
        offset_s += float(np.clip(step[0], -0.3 * rise_s, 0.3 * rise_s))
        rise_s = float(np.clip(rise_s + step[1], rise_s / 1.5, rise_s * 1.5))
    residual = float(np.sqrt(((left / error) ** 2).sum() / max(used.sum() - 2, 1)))
    covariance = np.asarray(np.linalg.inv(information) * max(residual, 1.0) ** 2, dtype=float)
    return Edge(offset_s, rise_s, sigma_s, covariance, residual)


def fitted_at(due: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where the edge is fitted, by the parts that are due there."""
    return (due > FITTED[0]) & (due < FITTED[1])


def part_error(due: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard error of a part, by counting: of its own counts and of the open gate's."""
    return np.sqrt(due * (1 + due) / whole)


def _start(late_s: NDArray[np.float64], part: NDArray[np.float64]) -> tuple[float, float]:
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
