"""Peaks of one shape, a Gaussian core with an exponential tail, fitted by Poisson maximum likelihood."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from rig.errors import CalibrationError

#: Full width at half maximum of a Gaussian of unit standard deviation.
FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))
#: At most so many steps of Fisher's scoring; it stops where they do not change anything.
STEPS, SMALL = 60, 1e-3
#: Ends of the search: a shape beyond them is none of a detector.
_LEAST, _MOST = np.array([2e-12, 5e-12, 1e-4]), np.array([500e-12, 1e-9, 0.9])


@dataclass(frozen=True)
class Shape:
    """A Gaussian core, and an exponential that delays a part of the detections.

    Attributes
    ----------
    sigma_s
        Standard deviation of the core.
    tail_s, tail_fraction
        Time constant, and which part is delayed by it.
    """

    sigma_s: float
    tail_s: float
    tail_fraction: float

    def below(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what part comes before these times from the core's centre: the cumulative distribution.

        Phi(z) - f exp(s^2 / 2 tau^2 - t / tau) Phi(z - s / tau) with z = t / s.
        """
        return ndtr(time_s / self.sigma_s) - self.tail_fraction * self._late(time_s)

    def density(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probability density [1/s]."""
        z = time_s / self.sigma_s
        core = np.exp(-z * z / 2) / (np.sqrt(2 * np.pi) * self.sigma_s)
        return (1 - self.tail_fraction) * core + self.tail_fraction * self._late(time_s) / self.tail_s

    def _late(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        ratio = self.sigma_s / self.tail_s
        log = ratio**2 / 2 - time_s / self.tail_s + log_ndtr(time_s / self.sigma_s - ratio)
        return np.exp(np.minimum(log, 0.0))


@dataclass(frozen=True)
class Fit:
    """Peaks of one shape.

    Attributes
    ----------
    centre_s, centre_error_s
        (N,) centres of the cores, and standard errors.
    counts, background
        (N,) counts in each peak, and a bin beside it, had the detector always been ready.
    shape, shape_error
        Of all, and standard errors.
    shape_covariance
        (3, 3) of the shape's parameters.
    model
        (N, W) expected counts.
    """

    centre_s: NDArray[np.float64]
    centre_error_s: NDArray[np.float64]
    counts: NDArray[np.float64]
    background: NDArray[np.float64]
    shape: Shape
    shape_error: Shape
    shape_covariance: NDArray[np.float64]
    model: NDArray[np.float64]


def fit(edges_s: NDArray[np.float64], seen: NDArray[np.float64], live: NDArray[np.float64]) -> Fit:
    """Fit a centre, counts and a background to each of N histograms, and one shape to all.

    Parameters
    ----------
    edges_s
        (N, W + 1) edges of the bins.
    seen
        (N, W) counts.
    live
        (N, W) part of the light that is detected at all.

    Raises
    ------
    CalibrationError
        If the search does not end.
    """
    own, common = _start(edges_s, seen, live)
    zero = edges_s[:, :1]
    likelihood = -np.inf
    for _ in range(STEPS):
        model, slopes = _model(edges_s - zero, own, common, live)
        reached = float((seen * np.log(model) - model).sum())
        weights = 1 / model
        hessian = np.einsum("inw,nw,jnw->nij", slopes, weights, slopes)
        pull = np.einsum("inw,nw->ni", slopes, weights * (seen - model))
        step_own, step_common, covariance, errors = _solve(hessian, pull, common)
        small = np.abs(step_own[:, 0]) < SMALL * errors
        step_own[:, 0] = np.clip(step_own[:, 0], -common[0] / 2, common[0] / 2)
        own, common = own + step_own, common + step_common
        own[:, 1:] = np.maximum(own[:, 1:], 1e-3)
        if small.all() and abs(reached - likelihood) < SMALL:
            break
        likelihood = reached
    else:
        raise CalibrationError(
            "the search for one shape of all peaks does not end: look at the raw data with rig plot"
        )
    return Fit(
        centre_s=own[:, 0] + zero[:, 0],
        centre_error_s=errors,
        counts=own[:, 1],
        background=own[:, 2],
        shape=Shape(*common.tolist()),
        shape_error=Shape(*np.sqrt(np.diag(covariance)).tolist()),
        shape_covariance=covariance,
        model=model,
    )


def _start(
    edges_s: NDArray[np.float64], seen: NDArray[np.float64], live: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, 3) centre after the first edge, counts and background, and (3,) the shape, roughly."""
    width_s = edges_s[0, 1] - edges_s[0, 0]
    rate = seen / live
    background = np.quantile(rate, 0.25, axis=1) + 0.5 / rate.shape[1]
    counts = np.maximum(rate.sum(axis=1) - background * rate.shape[1], 1.0)
    smooth = max(round(40e-12 / width_s), 1)
    kernel = np.ones(smooth) / smooth
    smoothed = np.array([np.convolve(row, kernel, "same") for row in rate])
    tops = smoothed.argmax(axis=1)
    height = smoothed.max(axis=1) - background
    sigma_s = float(np.median(counts * width_s / np.maximum(height, 1e-9))) / 2.7
    own = np.stack([(tops + 0.5) * width_s, counts, background], axis=1)
    return own, np.clip(np.array([sigma_s, 2 * sigma_s, 0.1]), _LEAST, _MOST)


def _model(
    time_s: NDArray[np.float64],
    own: NDArray[np.float64],
    common: NDArray[np.float64],
    live: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, W) expected counts, and (6, N, W) their slopes by centre, counts, background and shape."""
    shape, since_s = Shape(*common.tolist()), time_s - own[:, :1]
    counts = own[:, 1:2]
    inside = np.diff(shape.below(since_s), axis=1)
    by_centre = -counts * np.diff(shape.density(since_s), axis=1)
    by_shape = []
    for name in ("sigma_s", "tail_s", "tail_fraction"):
        value = getattr(shape, name)
        more, less = (replace(shape, **{name: value * factor}) for factor in (1 + 1e-4, 1 - 1e-4))
        change = np.diff(more.below(since_s) - less.below(since_s), axis=1)
        by_shape.append(counts * change / (2e-4 * value))
    model = live * np.maximum(counts * inside + own[:, 2:], 1e-12)
    return model, live * np.stack([by_centre, inside, np.ones_like(inside), *by_shape])


def _solve(
    hessian: NDArray[np.float64], pull: NDArray[np.float64], shape: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Solve for the steps of (N, 6, 6) normal equations that share their last three unknowns.

    Returns (N, 3) own and (3,) common steps, the latter no larger than the (3,) shape itself and not beyond
    the ends of the search, the common ones' covariance, and (N,) errors of the centres.
    """
    own, mixed, common = hessian[:, :3, :3], hessian[:, :3, 3:], hessian[:, 3:, 3:]
    scale = np.sqrt(np.einsum("nii->ni", own))
    inverse = np.linalg.inv(own / (scale[:, :, None] * scale[:, None, :]))
    inverse = inverse / (scale[:, :, None] * scale[:, None, :])
    given = inverse @ mixed
    rest = (common - mixed.transpose(0, 2, 1) @ given).sum(axis=0)
    size = np.sqrt(np.diag(rest))
    covariance = np.linalg.inv(rest / np.outer(size, size)) / np.outer(size, size)
    step_common = covariance @ (pull[:, 3:] - np.einsum("nij,ni->nj", given, pull[:, :3])).sum(axis=0)
    step_common = np.clip(shape + np.clip(step_common, -shape / 2, shape), _LEAST, _MOST) - shape
    step_own = np.einsum("nij,nj->ni", inverse, pull[:, :3]) - given @ step_common
    own_covariance = inverse + given @ covariance @ given.transpose(0, 2, 1)
    return step_own, step_common, covariance, np.sqrt(own_covariance[:, 0, 0])
