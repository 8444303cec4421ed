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

from rig.errors import CalibrationError

#: Guess of the decay time, with which it is decided whether there are afterpulses at all [s].
USUAL_DECAY_S = 40e-9
#: What pulse, detector and electronics blur: no nearer to the edges of what is fitted [s].
BLUR_S = 1e-9
#: Most steps of a fit, and when it has arrived [standard errors].
STEPS, ARRIVED = 40, 1e-4
#: The excess that counts as seen, and the misfit that is no chance [standard errors].
SEEN, NO_CHANCE = 5.0, 6.0


@dataclass(frozen=True)
class Record:
    """Counts after the laser's pulses at one hold-off.

    Attributes
    ----------
    name
        For errors.
    counts
        (bins,) over one sync period, from the pulse on.
    bin_width_s, period_s
        Of the bins, and between pulses; the last bin may reach over the period's end.
    pulses
        How many there were.
    hold_off_s
        Of the detector.
    """

    name: str
    counts: NDArray[np.float64]
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

    def ready(self) -> NDArray[np.float64]:
        """(bins,) part of the pulses after which the detector is ready at each bin."""
        return 1 - self._past(lambda lag_s: self._within_hold_off(lag_s)) / self.pulses

    def released(self, decay_s: float) -> NDArray[np.float64]:
        """(bins,) carriers released in each bin after the hold-off, were p = 1."""
        period, width = self.period_s, self.bin_width_s
        again = 1 / -np.expm1(-period / decay_s)  # from the periods before

        def kernel(lag_s: NDArray[np.float64]) -> NDArray[np.float64]:
            density = np.exp(-lag_s / decay_s) * width / decay_s
            return density * (1 - self._within_hold_off(lag_s)) + density * (again - 1)

        return self._past(kernel)

    def _within_hold_off(self, lag_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Part of a bin that lies less than the hold-off behind."""
        return np.clip((self.hold_off_s - lag_s) / self.bin_width_s + 0.5, 0, 1)

    def _past(self, kernel: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Sum of the counts before each bin, times the kernel of the lag; times repeat."""
        bins = len(self.counts)
        weights = kernel(np.arange(bins, dtype=np.float64) * np.float64(self.bin_width_s))
        return np.asarray(np.fft.irfft(np.fft.rfft(self.counts) * np.fft.rfft(weights), bins), dtype=float)

    def _first_light(self) -> int:
        """Return the bin in which the laser's first light arrives."""
        counts, usual = self.counts, float(np.median(self.counts))
        highest = int(counts.argmax())
        if counts[highest] < usual + 20 * np.sqrt(usual + 1) or counts[highest] < 100:
            raise CalibrationError(
                f"{self.name}: no light of the laser stands out; afterpulses are seen after its pulses. Take "
                "the beam stop away, attenuate less, or measure longer"
            )
        bright = np.flatnonzero(counts > usual + 10 * np.sqrt(usual + 1))
        # the longest pause between bright bins, round the period, ends at the first light
        pauses = np.diff(np.append(bright, bright[0] + len(counts)))
        return int(bright[(int(pauses.argmax()) + 1) % len(bright)])


@dataclass(frozen=True)
class Afterpulses:
    """What the records say; ``seen`` is False where there are none, and then ``decay_s`` is a usual one."""

    probability: float
    probability_error: float
    decay_s: float
    decay_error_s: float
    seen: bool
    chi2_per_bin: float

    def outlasting(self, hold_off_s: float) -> float:
        """Return the probability that a carrier outlasts a hold-off."""
        return self.probability * float(np.exp(-hold_off_s / self.decay_s))


def fitted(records: Sequence[Record]) -> Afterpulses:
    """Fit probability and decay time to all records together, by greatest likelihood.

    Raises
    ------
    CalibrationError
        If the records have no quiet time, or do not follow the model.
    """
    for record in records:
        if len(record.quiet) * record.bin_width_s < 3 * USUAL_DECAY_S:
            raise CalibrationError(
                f"{record.name}: only {1e9 * len(record.quiet) * record.bin_width_s:.0f} ns between the "
                "hold-off and the next pulse are left to see afterpulses in; use a lower --repetition or "
                "shorter hold-offs"
            )
    start = _solve(records, USUAL_DECAY_S, free_decay=False)
    seen = start[0] > SEEN * np.sqrt(start[2][0, 0])
    p, decay_s, covariance = _solve(records, USUAL_DECAY_S, free_decay=True) if seen else start
    chi2, bins = _misfit(records, p, decay_s)
    if chi2 > bins + NO_CHANCE * np.sqrt(2 * bins):
        raise CalibrationError(
            f"{records[0].name}: between the pulses there is more than steady light and afterpulses "
            f"(chi2 {chi2:.0f} in {bins} bins). Hold-offs have to be longer than the dead time of the timing "
            "instrument, and no light may come back so late; check for reflections from far away"
        )
    error_s = float(np.sqrt(covariance[1, 1])) if seen else float("nan")
    return Afterpulses(
        float(p) if seen else 0.0,
        float(np.sqrt(covariance[0, 0])),
        float(decay_s),
        error_s,
        bool(seen),
        float(chi2 / bins),
    )


def fitted_alone(record: Record, decay_s: float) -> tuple[float, float]:
    """Return the probability to outlast one record's hold-off, and its error, the decay time known."""
    p, _, covariance = _solve([record], decay_s, free_decay=False)
    outlasting = np.exp(-record.hold_off_s / decay_s)
    return float(p * outlasting), float(np.sqrt(covariance[0, 0]) * outlasting)


def expected(record: Record, p: float, decay_s: float) -> NDArray[np.float64]:
    """Return (quiet bins,) counts due in the quiet bins, the steady light taken from the record."""
    quiet, ready = record.quiet, record.ready()[record.quiet]
    after = p * record.released(decay_s)[quiet] * ready
    counts = record.counts[quiet]
    steady = max(counts.sum() - after.sum(), 1.0) / ready.sum()
    for _ in range(STEPS):  # greatest likelihood: sum of ready * (counts / expected - 1) = 0
        due = steady * ready + after
        steady = max(steady + (ready * (counts / due - 1)).sum() / (ready**2 / due).sum(), 1e-9)
    return steady * ready + after


def _solve(
    records: Sequence[Record], decay_s: float, *, free_decay: bool
) -> tuple[float, float, NDArray[np.float64]]:
    """Return p, tau and their covariance: Fisher's scoring for Poisson counts, one steady light a record.

    Inside, p is replaced by the probability to be released in the time in which most is seen, of which the
    decay time is nearly independent; p itself is an extrapolation back to no hold-off at all.
    """
    pivot_s = min(record.hold_off_s for record in records) + decay_s
    ready = [record.ready()[record.quiet] for record in records]
    level, k = 0.005, 1 / decay_s
    steady = [float(np.median(record.counts[record.quiet])) + 0.1 for record in records]
    size = 2 + len(records)
    for _ in range(STEPS):
        information, slope = np.zeros((size, size)), np.zeros(size)
        for i, record in enumerate(records):
            shape = _shape(record, k, pivot_s, decay_s) * ready[i]
            tiny = 1e-4 * k
            steeper = (
                _shape(record, k + tiny, pivot_s, decay_s) - _shape(record, k - tiny, pivot_s, decay_s)
            ) / (2 * tiny)
            due = np.maximum(steady[i] * ready[i] + level * shape, 1e-9)
            moves = np.zeros((size, len(due)))
            moves[0], moves[1], moves[2 + i] = shape, level * steeper * ready[i], ready[i]
            information += (moves / due) @ moves.T
            slope += moves @ (record.counts[record.quiet] / due - 1)
        free = [index for index in range(size) if free_decay or index != 1]
        inverse = np.linalg.inv(information[np.ix_(free, free)])
        step = np.zeros(size)
        step[free] = inverse @ slope[free]
        level += step[0]
        k = float(np.clip(k + step[1], k / 1.5, k * 1.5))
        steady = [max(b + more, 1e-9) for b, more in zip(steady, step[2:], strict=True)]
        if (np.abs(step[free]) < ARRIVED * np.sqrt(np.diag(inverse))).all():
            break
    covariance = np.zeros((2, 2))
    kept = free[:2] if free_decay else [0]
    covariance[np.ix_(kept, kept)] = inverse[: len(kept), : len(kept)]
    factor = float(np.exp(k * pivot_s)) / (k * decay_s)  # p = level exp(k pivot) / (k decay_s)
    by = np.array([[factor, level * factor * (pivot_s - 1 / k)], [0.0, -1 / k**2]])
    return level * factor, 1 / k, by @ covariance @ by.T


def _shape(record: Record, k: float, pivot_s: float, decay_s: float) -> NDArray[np.float64]:
    """Return the afterpulses in the quiet bins for a level of 1."""
    reference = np.exp(k * pivot_s) / (k * decay_s)
    return record.released(1 / k)[record.quiet] * reference


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
