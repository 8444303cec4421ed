"""Peaks in histograms: found, and fitted with one shape by Poisson maximum likelihood."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from rig.calibrate import Floats, require
from rig.errors import CalibrationError

#: Full width at half maximum of a Gaussian of unit standard deviation.
FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))
#: What is fitted, from the highest point on: too short for light of a hidden scene, long enough for a tail.
WINDOW_S = (-0.4e-9, 0.8e-9)
#: Counts are smoothed over this time before the highest point is looked for.
SMOOTHED_S = 60e-12
#: Detections for each pulse above which a peak is refused; far below it the losses are corrected for.
MAX_PER_PULSE = 0.1
#: Fewest counts above the background in a peak: it is then known to 3 ps or so, and surely is one.
MIN_COUNTS = 100
#: So far from the highest point nothing of its peak is left that could be taken for a second one.
PEAK_S = 0.25e-9
#: A second peak so high in parts of the first makes the first doubtful.
MAX_SECOND = 0.5
#: Largest part of the histograms without a good peak.
MAX_LEFT_OUT = 0.25
#: So many bins with the largest count of all are no chance: the counter was full.
FULL_BINS = 5
FULL_COUNTERS = (2**16 - 1, 2**32 - 1)
#: Below this expectation counts are too skew for a sum of squares.
MIN_FOR_CHI2 = 5
#: At most so many steps of Fisher's scoring; it stops where they do not change anything.
MAX_STEPS, SMALL = 60, 1e-3
#: Ends of the search: a shape beyond them is none of a detector.
_LOW, _HIGH = np.array([2e-12, 5e-12, 1e-4]), np.array([500e-12, 1e-9, 0.9])


@dataclass(frozen=True)
class Emg:
    """A Gaussian core with this sigma, of which a fraction is delayed exponentially with ``tail_s``.

    It is the sum of a Gaussian and an exponentially modified Gaussian.
    """

    sigma_s: float
    tail_s: float
    tail_fraction: float

    def cumulative(self, time_s: Floats) -> Floats:
        """Return what part comes before these times from the core's centre.

        Phi(z) - f exp(s^2 / 2 tau^2 - t / tau) Phi(z - s / tau) with z = t / s.
        """
        return ndtr(time_s / self.sigma_s) - self.tail_fraction * self._late(time_s)

    def density(self, time_s: Floats) -> Floats:
        """Return the probability density [1/s]."""
        z = time_s / self.sigma_s
        core = np.exp(-z * z / 2) / (np.sqrt(2 * np.pi) * self.sigma_s)
        return (1 - self.tail_fraction) * core + self.tail_fraction * self._late(time_s) / self.tail_s

    def _late(self, time_s: Floats) -> Floats:
        ratio = self.sigma_s / self.tail_s
        log = ratio**2 / 2 - time_s / self.tail_s + log_ndtr(time_s / self.sigma_s - ratio)
        return np.exp(np.minimum(log, 0.0))


@dataclass(frozen=True)
class Peaks:
    """N peaks of one shape, in windows of W bins.

    Attributes
    ----------
    centre_s, centre_error_s
        (N,) centres of the cores, and standard errors.
    counts, background
        (N,) counts in each peak, and a bin beside it, had the detector always been ready.
    shape, shape_covariance
        Of all, and the (3, 3) covariance of its parameters.
    time_s, observed, live, model
        (N, W) bins' centres, counts, the part of the light that is detected at all, and expected counts.
    index, left_out
        (N,) of which histograms these are the peaks; and why each of the others has none.
    """

    centre_s: Floats
    centre_error_s: Floats
    counts: Floats
    background: Floats
    shape: Emg
    shape_covariance: Floats
    time_s: Floats
    observed: Floats
    live: Floats
    model: Floats
    index: NDArray[np.int64]
    left_out: dict[int, str]

    @property
    def shape_error(self) -> Emg:
        """Standard errors of the shape."""
        return Emg(*np.sqrt(np.diag(self.shape_covariance)).tolist())

    @property
    def chi2(self) -> float:
        """Pearson's, of the bins with enough counts, by their number; about 1 where the shape is right."""
        many = self.model >= MIN_FOR_CHI2
        squares = (self.observed - self.model)[many] ** 2 / self.model[many]
        free = len(squares) - 2 * len(self.model) - 3
        return float(squares.sum() / free) if free > 0 else 1.0


def find(
    histograms: Floats,
    pulses: Floats,
    live: Floats,
    edges_s: Floats,
    *,
    name: str,
    max_per_pulse: float = MAX_PER_PULSE,
    min_counts: int = MIN_COUNTS,
    searched: slice = slice(None),
) -> Peaks:
    """Find and fit the one strong peak of each histogram.

    Raises CalibrationError if more than a few histograms have no peak, a full counter, too high a rate, or
    two equal peaks.

    Parameters
    ----------
    histograms, live
        (P, B) counts, and the part of the light that is detected at all.
    pulses
        (P,) after how many pulses they were counted.
    edges_s
        (B + 1,) of the bins, which are equally wide.
    name
        Of what is measured, for messages.
    max_per_pulse
        Most detections for each pulse.
    min_counts
        Fewest counts of a peak above the background.
    searched
        Bins in which the highest point is looked for.
    """
    width_s = float(edges_s[-1] - edges_s[0]) / (len(edges_s) - 1)
    before, size = round(-WINDOW_S[0] / width_s), round((WINDOW_S[1] - WINDOW_S[0]) / width_s)
    starts, left_out = np.zeros(len(histograms), np.int64), {}
    for number, (histogram, each_pulses) in enumerate(zip(histograms, pulses, strict=True)):
        try:
            _refuse_saturated(histogram, each_pulses, max_per_pulse)
            starts[number] = (
                (searched.start or 0) + _highest(histogram[searched], width_s, min_counts) - before
            )
            fits = 0 <= starts[number] <= histograms.shape[1] - size
            require(fits, "its peak is cut off by the end of the histogram")
        except CalibrationError as error:
            left_out[number] = str(error)
    first = min(left_out, default=0)
    several = f"{len(left_out)} of {len(histograms)} positions cannot be used. Position {first}: "
    require(
        len(left_out) <= MAX_LEFT_OUT * len(histograms),
        f"{name}: {several if len(histograms) > 1 else ''}{left_out.get(first)}",
    )
    good = np.setdiff1d(np.arange(len(histograms)), list(left_out))
    inside, edges = (starts[good, None] + np.arange(width) for width in (size, size + 1))
    found = fit(edges_s[edges], histograms[good[:, None], inside], live[good[:, None], inside])
    return replace(found, index=good, left_out=left_out)


def _refuse_saturated(histogram: Floats, pulses: float, max_per_pulse: float) -> None:
    total, largest = histogram.sum(), histogram.max(initial=0)
    full = (histogram == largest).sum() >= FULL_BINS and largest >= MIN_COUNTS
    require(
        total <= max_per_pulse * pulses,
        f"its peak is saturated, {total / pulses:.2g} detections a pulse, "
        f"but {max_per_pulse:g} is the limit: attenuate the laser more",
    )
    require(
        not full and largest not in FULL_COUNTERS,
        f"its bins are full at {largest:.0f} counts: attenuate more, or measure shorter",
    )


def _highest(histogram: Floats, width_s: float, min_counts: int) -> int:
    """Return the bin of the one strong peak, or refuse what has none, or two."""
    width = max(round(SMOOTHED_S / width_s), 1)
    smooth = np.convolve(histogram, np.ones(width), "same")
    peak = int(smooth.argmax())
    around = slice(max(peak + round(WINDOW_S[0] / width_s), 0), peak + round(WINDOW_S[1] / width_s))
    elsewhere, near = smooth.copy(), round(PEAK_S / width_s)
    elsewhere[max(peak - near, 0) : peak + near] = 0
    background = float(np.median(smooth))
    inside = float(histogram[around].sum()) - background / width * (around.stop - around.start)
    require(
        inside >= min_counts and smooth[peak] >= background + 8 * np.sqrt(background + 1),
        f"it has no peak: {inside:.0f} counts above the background at its highest point, "
        f"but {min_counts} are needed. Measure longer, attenuate less, "
        "and check that the beam is not blocked and the detector is free-running",
    )
    later_s = (int(elsewhere.argmax()) - peak) * width_s
    require(
        elsewhere.max() - background <= MAX_SECOND * (smooth[peak] - background),
        f"it has two strong peaks, {abs(later_s) * 1e9:.2f} ns apart: find and cover what reflects",
    )
    return peak


def fit(edges_s: Floats, observed: Floats, live: Floats) -> Peaks:
    """Fit a centre, counts and a background to each of N histograms, and one shape to all.

    The (N, W) observed counts of bins with (N, W + 1) edges are Poisson distributed about live (counts * a
    CDF difference + background). Raises CalibrationError if the search does not end.
    """
    own, common = _start(edges_s, observed, live)
    zero = edges_s[:, :1]
    likelihood = -np.inf
    for _ in range(MAX_STEPS):
        model, slopes = _model(edges_s - zero, own, common, live)
        reached = float((observed * np.log(model) - model).sum())
        information = np.einsum("inw,nw,jnw->nij", slopes, 1 / model, slopes)
        gradient = np.einsum("inw,nw->ni", slopes, observed / model - 1)
        step_own, step_common, covariance, errors = _solve(information, gradient, common)
        small = np.abs(step_own[:, 0]) < SMALL * errors
        step_own[:, 0] = np.clip(step_own[:, 0], -common[0] / 2, common[0] / 2)
        own, common = own + step_own, common + step_common
        own[:, 1:] = np.maximum(own[:, 1:], 1e-3)
        if small.all() and abs(reached - likelihood) < SMALL:
            break
        likelihood = reached
    else:
        raise CalibrationError(
            "the search for one shape of all peaks does not converge: check the raw data with rig plot"
        )
    centre_s, counts, background = own.T
    return Peaks(
        centre_s + zero[:, 0], errors, counts, background, Emg(*common.tolist()), covariance,
        (edges_s[:, :-1] + edges_s[:, 1:]) / 2, observed, live, model, np.arange(len(own)), {},
    )  # fmt: skip


def _start(edges_s: Floats, observed: Floats, live: Floats) -> tuple[Floats, Floats]:
    """Return (N, 3) centre after the first edge, counts and background, and (3,) the shape, roughly."""
    width_s = edges_s[0, 1] - edges_s[0, 0]
    rate = observed / live
    background = np.quantile(rate, 0.25, axis=1) + 0.5 / rate.shape[1]
    counts = np.maximum(rate.sum(axis=1) - background * rate.shape[1], 1.0)
    smooth = max(round(40e-12 / width_s), 1)
    smoothed = np.array([np.convolve(row, np.ones(smooth) / smooth, "same") for row in rate])
    height = smoothed.max(axis=1) - background
    sigma_s = float(np.median(counts * width_s / np.maximum(height, 1e-9))) / 2.7
    own = np.stack([(smoothed.argmax(axis=1) + 0.5) * width_s, counts, background], axis=1)
    return own, np.clip(np.array([sigma_s, 2 * sigma_s, 0.1]), _LOW, _HIGH)


def _model(time_s: Floats, own: Floats, common: Floats, live: Floats) -> tuple[Floats, Floats]:
    """(N, W) expected counts, and (6, N, W) their slopes by centre, counts, background and shape."""
    shape, since_s = Emg(*common.tolist()), time_s - own[:, :1]
    counts = own[:, 1:2]
    inside = np.diff(shape.cumulative(since_s), axis=1)
    by_centre = -counts * np.diff(shape.density(since_s), axis=1)
    by_shape = []
    for name, value in vars(shape).items():
        more, less = (replace(shape, **{name: value * factor}) for factor in (1 + 1e-4, 1 - 1e-4))
        change = np.diff(more.cumulative(since_s) - less.cumulative(since_s), axis=1)
        by_shape.append(counts * change / (2e-4 * value))
    model = live * np.maximum(counts * inside + own[:, 2:], 1e-12)
    return model, live * np.stack([by_centre, inside, np.ones_like(inside), *by_shape])


def _solve(information: Floats, gradient: Floats, shape: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Solve for the steps of (N, 6, 6) normal equations that share their last three unknowns.

    Returns (N, 3) own and (3,) common steps, the latter no larger than the (3,) shape itself and not beyond
    the ends of the search, the common ones' covariance, and (N,) errors of the centres.
    """
    own, mixed, common = information[:, :3, :3], information[:, :3, 3:], information[:, 3:, 3:]
    inverse = _inverse(own)
    given = inverse @ mixed
    covariance = _inverse((common - mixed.transpose(0, 2, 1) @ given).sum(axis=0))
    step_common = covariance @ (gradient[:, 3:] - np.einsum("nij,ni->nj", given, gradient[:, :3])).sum(axis=0)
    step_common = np.clip(shape + np.clip(step_common, -shape / 2, shape), _LOW, _HIGH) - shape
    step_own = np.einsum("nij,nj->ni", inverse, gradient[:, :3]) - given @ step_common
    own_covariance = inverse + given @ covariance @ given.transpose(0, 2, 1)
    return step_own, step_common, covariance, np.sqrt(own_covariance[:, 0, 0])


def _inverse(matrix: Floats) -> Floats:
    """Invert (..., n, n) matrices whose unknowns have very different units."""
    scale = np.sqrt(np.einsum("...ii->...i", matrix))
    scale = scale[..., :, None] * scale[..., None, :]
    return np.linalg.inv(matrix / scale) / scale
