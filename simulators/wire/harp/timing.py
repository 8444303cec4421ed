"""What the timing electronics do to times: dead time, unequal bins, slow drift. Plain physics, no C."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.bench import Detections
from simulators.wire.harp.discriminators import Pulses

#: So many bins are unequal; those of longer histograms are ideal beyond.
UNEQUAL_BINS = 65536


@dataclass(frozen=True)
class Nonlinearity:
    """Differential non-linearity: bins that are wider or narrower than they say, always the same ones.

    A bin's width is 1 + d with d from a Laplace distribution, cut at ``peak``; over 65 536 bins that has
    about the 0.2 % rms and 2 % peak together that are said of such instruments (unconfirmed).

    Attributes
    ----------
    rms
        Of d (0.002). 0 is off.
    peak
        Largest d.
    seed
        Which instrument.
    """

    rms: float = 0.0
    peak: float = 0.02
    seed: int = 0

    def widths(self) -> NDArray[np.float64]:
        """(65536,) real widths, in bins; their sum is that of as many ideal bins."""
        pattern = np.random.default_rng(self.seed).laplace(0, self.rms / np.sqrt(2), UNEQUAL_BINS)
        widths = 1 + np.clip(pattern, -self.peak, self.peak)
        return widths * (UNEQUAL_BINS / widths.sum())

    def counted(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times in real bins for times in ideal ones, both from 1 where the first bin begins."""
        if not self.rms or not len(times):
            return times
        return _counted(times, _edges(self))


@cache
def _edges(clock: Nonlinearity) -> NDArray[np.float64]:
    return np.append(0.0, np.cumsum(clock.widths()))


@njit(cache=True, error_model="numpy", nogil=True)
def _counted(times, edges):  # type: ignore[no-untyped-def]
    """Find each time's bin from where it would be were all bins equal: that is a few bins off at most."""
    counted, last = times.copy(), len(edges) - 2
    for i in range(len(times)):
        time = times[i] - 1.0
        if time < 0.0 or time >= last + 1.0:
            continue
        k = int(time)
        while k > 0 and edges[k] > time:
            k -= 1
        while k < last and edges[k + 1] <= time:
            k += 1
        counted[i] = 1.0 + k + (time - edges[k]) / (edges[k + 1] - edges[k])
    return counted


@dataclass(frozen=True)
class Timing:
    """The faults of one instrument, of which it has none by default, and the pulses that it gets.

    Attributes
    ----------
    dead_time_s
        Time after a count in which the input counts no other; not extended by what falls into it (80 ns;
        below that is said of the instrument, unconfirmed). 0 is off.
    nonlinearity
        Of the bins.
    pulses
        Heights of the pulses at its inputs.
    drift_s_per_s
        How fast the times of all counts grow, from the moment the bench was built (warming cables; some ps a
        minute, unconfirmed). 0 is off.
    """

    dead_time_s: float = 0.0
    nonlinearity: Nonlinearity = field(default_factory=Nonlinearity)
    drift_s_per_s: float = 0.0
    pulses: Pulses = field(default_factory=Pulses)

    def registered(self, arrived: Detections, period_s: float, start_s: float) -> Detections:
        """Return which detections the input counts, and when, in a measurement begun at ``start_s``."""
        pulse, time_s = arrived.pulse, arrived.time_s
        if self.dead_time_s and len(arrived):
            pulse, time_s = _live(pulse, time_s, period_s, self.dead_time_s)
        if self.drift_s_per_s:
            time_s = time_s + self.drift_s_per_s * (start_s + pulse * period_s)
        return Detections(pulse, time_s)


@njit(cache=True, nogil=True)
def _live(pulse, time, period, dead_time):  # type: ignore[no-untyped-def]
    """Return events that come at least ``dead_time`` after the last that was counted: pulses and times."""
    kept_pulse, kept_time, kept = np.empty_like(pulse), np.empty_like(time), 0
    for i in range(len(pulse)):
        if kept:
            since = (pulse[i] - kept_pulse[kept - 1]) * period + time[i] - kept_time[kept - 1]
            if not since >= dead_time:
                continue
        kept_pulse[kept], kept_time[kept] = pulse[i], time[i]
        kept += 1
    return kept_pulse[:kept], kept_time[:kept]
