"""Afterpulses, seen in time after the laser's pulses.

Every detection, whatever it came from, leaves a carrier behind with a probability p, which is released after
a time s with the density exp(-s/tau)/tau and detected if the detector is ready again: after the hold-off h.
With H(v) the counts recorded at a time v after the pulse,

    E[H(u)] = L(u) [ b + sum over v of H(v) (p/tau) exp(-(u - v)/tau), u - v >= h ] ,

at times u at which the laser sends no light; b is the steady light. L(u) = 1 - sum of H(v) over u - h < v <
u, divided by the pulses, is the part of the pulses after which the detector is ready at u: exactly so, since
within a hold-off there is at most one detection. H on the right is the record itself, so afterpulses of
afterpulses and of background are in it, and times repeat with the sync period.

The same numbers could be had from the rates of a steady lamp at several hold-offs. But there the afterpulses
are 0.3 % of the counts at best, so that a lamp that drifts by a few parts in ten thousand would be taken for
them, and a decay time has to come from differences of such numbers; here they stand alone between the pulses.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.calibrate import Floats, require
from rig.calibrate.fits import reweighted

#: Guess of the decay time, with which it is decided whether there are afterpulses at all [s].
USUAL_DECAY_S = 40e-9
#: What pulse, detector and electronics blur: no nearer to the edges of what is fitted [s].
BLUR_S = 1e-9
#: The excess that counts as detected, and the misfit that is no chance [standard errors].
DETECTED, NO_CHANCE = 5.0, 6.0


@dataclass(frozen=True)
class Record:
    """Counts after the laser's pulses at one hold-off.

    Attributes
    ----------
    name
        For errors.
    counts, pulses
        (bins,) counts over one sync period from the pulse on, and the number of pulses.
    bin_width_s, period_s, hold_off_s
        The last bin may reach over the period's end.
    """

    name: str
    counts: Floats
    bin_width_s: float
    period_s: float
    pulses: float
    hold_off_s: float

    @property
    def quiet(self) -> NDArray[np.int64]:
        """Bins with steady light and afterpulses only: a hold-off after the first light until the next."""
        whole = int(self.period_s / self.bin_width_s * (1 + 1e-9))
        first = self._first_light()
        margin = int(np.ceil(BLUR_S / self.bin_width_s))
        begin = first + int(np.ceil(self.hold_off_s / self.bin_width_s)) + margin
        return np.arange(begin, first + whole - margin) % whole

    def ready(self) -> Floats:
        """(bins,) part of the pulses after which the detector is ready at each bin."""
        return 1 - self._past(self._within_hold_off) / self.pulses

    def released(self, decay_s: float) -> Floats:
        """(bins,) carriers released in each bin after the hold-off, were p = 1."""
        period, width = self.period_s, self.bin_width_s
        again = 1 / -np.expm1(-period / decay_s)  # from the periods before

        def kernel(lag_s: Floats) -> Floats:
            density = np.exp(-lag_s / decay_s) * width / decay_s
            return density * (1 - self._within_hold_off(lag_s)) + density * (again - 1)

        return self._past(kernel)

    def _within_hold_off(self, lag_s: Floats) -> Floats:
        """Part of a bin that lies less than the hold-off behind."""
        return np.clip((self.hold_off_s - lag_s) / self.bin_width_s + 0.5, 0, 1)

    def _past(self, kernel: Callable[[Floats], Floats]) -> Floats:
        """Sum of the counts before each bin, times the kernel of the lag; times repeat."""
        bins = len(self.counts)
        weights = kernel(np.arange(bins, dtype=np.float64) * np.float64(self.bin_width_s))
        return np.asarray(np.fft.irfft(np.fft.rfft(self.counts) * np.fft.rfft(weights), bins), dtype=float)

    def _first_light(self) -> int:
        """Return the bin in which the laser's first light arrives."""
        counts, usual = self.counts, float(np.median(self.counts))
        highest = int(counts.argmax())
        require(
            counts[highest] >= max(usual + 20 * np.sqrt(usual + 1), 100),
            f"{self.name}: no light of the laser is seen, but afterpulses are measured after its pulses. "
            "Remove the beam stop, attenuate less, or measure longer",
        )
        bright = np.flatnonzero(counts > usual + 10 * np.sqrt(usual + 1))
        # the longest pause between bright bins, round the period, ends at the first light
        pauses = np.diff(np.append(bright, bright[0] + len(counts)))
        return int(bright[(int(pauses.argmax()) + 1) % len(bright)])


@dataclass(frozen=True)
class Afterpulses:
    """What the records say; where there are none, ``decay_s`` is a usual one."""

    probability: float
    probability_error: float
    decay_s: float
    decay_error_s: float
    detected: bool
    chi2_per_bin: float

    def outlasting(self, hold_off_s: float) -> float:
        """Return the probability that a carrier outlasts a hold-off."""
        return self.probability * float(np.exp(-hold_off_s / self.decay_s))


def fitted(records: Sequence[Record]) -> Afterpulses:
    """Fit probability and decay time to all records together, by greatest likelihood.

    Raises CalibrationError if the records have no quiet time, or do not follow the model.
    """
    for record in records:
        quiet_s = len(record.quiet) * record.bin_width_s
        require(
            quiet_s >= 3 * USUAL_DECAY_S,
            f"{record.name}: only {1e9 * quiet_s:.0f} ns between the hold-off and the next pulse are left to "
            "see afterpulses in; use a lower --repetition or shorter hold-offs",
        )
    p, decay_s, covariance = _solve(records, USUAL_DECAY_S, free_decay=False)
    detected = p > DETECTED * np.sqrt(covariance[0, 0])
    if detected:
        p, decay_s, covariance = _solve(records, USUAL_DECAY_S, free_decay=True)
    chi2, bins = _misfit(records, p, decay_s)
    require(
        chi2 <= bins + NO_CHANCE * np.sqrt(2 * bins),
        f"{records[0].name}: between the pulses there is more than steady light and afterpulses (chi2 "
        f"{chi2:.0f} in {bins} bins). Hold-offs must be longer than the dead time of the timing "
        "instrument, and no light may return so late; check for reflections from far away",
    )
    p_error, decay_error_s = np.sqrt(np.diag(covariance)).tolist()
    return Afterpulses(
        probability=p if detected else 0.0,
        probability_error=p_error,
        decay_s=decay_s,
        decay_error_s=decay_error_s if detected else float("nan"),
        detected=detected,
        chi2_per_bin=chi2 / bins,
    )


def fitted_alone(record: Record, decay_s: float) -> tuple[float, float]:
    """Return the probability to outlast one record's hold-off, and its error, the decay time known."""
    p, _, covariance = _solve([record], decay_s, free_decay=False)
    outlasting = np.exp(-record.hold_off_s / decay_s)
    return float(p * outlasting), float(np.sqrt(covariance[0, 0]) * outlasting)


def expected(record: Record, p: float, decay_s: float) -> Floats:
    """Return (quiet bins,) counts due in the quiet bins, the steady light taken from the record."""
    counts, ready = record.counts[record.quiet], record.ready()[record.quiet]
    after = p * record.released(decay_s)[record.quiet] * ready

    def due(steady: Floats) -> Floats:
        return np.maximum(steady * ready + after, 1e-9)

    start = max(counts.sum() - after.sum(), 1.0) / ready.sum()
    return due(reweighted(due, counts, np.sqrt, [start], scale=start)[0])


def _solve(records: Sequence[Record], decay_s: float, *, free_decay: bool) -> tuple[float, float, Floats]:
    """Return p, tau and their (2, 2) covariance, with one steady light a record.

    Inside, p is replaced by the probability to be released in the time in which most is seen, of which the
    decay time is nearly independent; p itself is an extrapolation back to no hold-off at all. The decay time
    is a factor exp(x) to the given one.
    """
    pivot_s = min(record.hold_off_s for record in records) + decay_s
    ready = [record.ready()[record.quiet] for record in records]
    counts = [record.counts[record.quiet] for record in records]
    lines = 1 + free_decay

    def due(at: Floats) -> Floats:
        tau_s = decay_s * np.exp(at[1]) if free_decay else decay_s
        factor = at[0] * _per_level(tau_s, pivot_s, decay_s)
        counts = [
            (steady + factor * record.released(tau_s)[record.quiet]) * live
            for record, live, steady in zip(records, ready, at[lines:], strict=True)
        ]
        return np.maximum(np.concatenate(counts), 1e-9)

    steady = [float(np.median(one)) + 0.1 for one in counts]
    at, covariance, _ = reweighted(
        due,
        np.concatenate(counts),
        np.sqrt,
        [0.005, *[0.0] * free_decay, *steady],
        scale=[0.005, *[1.0] * free_decay, *steady],
    )
    tau_s = decay_s * float(np.exp(at[1])) if free_decay else decay_s
    factor = _per_level(tau_s, pivot_s, decay_s)
    by = np.array([[factor, at[0] * factor * (1 - pivot_s / tau_s)], [0.0, tau_s]])[:, :lines]
    return float(at[0] * factor), tau_s, by @ covariance[:lines, :lines] @ by.T


def _per_level(tau_s: float, pivot_s: float, decay_s: float) -> float:
    """Return p for a level of 1: exp(pivot / tau) tau / decay."""
    return float(np.exp(pivot_s / tau_s)) * tau_s / decay_s


def _misfit(records: Sequence[Record], p: float, decay_s: float) -> tuple[float, int]:
    """Return chi2 and its degrees of freedom, bins taken together until each has enough counts."""
    chi2, bins = 0.0, 0
    for record in records:
        due, counts = expected(record, p, decay_s), record.counts[record.quiet]
        size = max(int(np.ceil(25 / max(due.mean(), 1e-9))), 1)
        whole = len(due) // size * size
        if not whole:
            continue
        due, counts = (values[:whole].reshape(-1, size).sum(axis=1) for values in (due, counts))
        chi2 += float(((counts - due) ** 2 / due).sum())
        bins += len(due)
    return chi2, bins - len(records) - 2
