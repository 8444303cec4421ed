"""The histogram memory: detection times in, clipped counts out. Plain physics and numpy, no C."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.wire.harp.timing import Nonlinearity


def after_edge(
    times_s: NDArray[np.float64],
    pulse: NDArray[np.int64],
    *,
    period_s: float,
    shift_s: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which sync edge each detection is timed against, and the time after it.

    A start-stop clock knows only the latest sync pulse before a detection. So a time beyond the period (a
    photon from far away, or a late dark count) is measured from a later pulse than the one that made it, and
    a time that a channel offset made negative from an earlier one: times fold into [0, period).

    A divider hides all but every n-th pulse from the clock. The instrument knows the period, counts in the
    pulses between, and takes their times off, so that neither a time nor a number tells of the divider. The
    vendor's documents say so between the lines: all that a divider costs is some jitter (manuals of HydraHarp
    and MultiHarp), and programs that read T3 files take a sync number times the undivided period as time.
    On a real instrument it is unconfirmed.

    Parameters
    ----------
    times_s
        (photons,) times after the sync pulse at the timing input [s].
    pulse
        (photons,) which sync pulse that is.
    period_s
        Time between sync pulses [s].
    shift_s
        Offset of the input less that of the sync input [s].

    Returns
    -------
    tuple of ndarray
        Numbers and times, both (photons,) in the order given.
    """
    edge, after_s = _after_edge(times_s, pulse, period_s, shift_s)
    return edge, after_s


@njit(cache=True, error_model="numpy", nogil=True)
def _after_edge(times, pulse, period, shift):  # type: ignore[no-untyped-def]
    edge, after = pulse.copy(), times + shift
    for i in range(len(after)):
        if not 0.0 <= after[i] < period:
            later = np.floor(after[i] / period)
            edge[i] += int(later)
            after[i] -= later * period
    return edge, after


def bins_of(
    times_s: NDArray[np.float64], *, offset_s: float, bin_width_s: float, length: int, clock: Nonlinearity
) -> NDArray[np.int64]:
    """Return the bin that each time falls into, counted from 1; 0 and ``length`` + 1 are outside.

    What is left of the first bin or right of the last is lost, since the instrument has nowhere to count it.

    Parameters
    ----------
    times_s
        (photons,) times after a sync edge [s]; overwritten.
    offset_s, bin_width_s, length
        Left edge of the first bin, width of all, and their number.
    clock
        How unequal the bins really are.
    """
    times_s -= offset_s - bin_width_s  # one bin up, so that cutting off the fraction rounds down for all
    times_s /= bin_width_s
    return np.asarray(_cut_off(clock.counted(times_s), length))


@njit(cache=True, error_model="numpy", nogil=True)
def _cut_off(places, length):  # type: ignore[no-untyped-def]
    bins = np.empty(len(places), np.int64)
    for i in range(len(places)):
        bins[i] = int(min(max(places[i], 0.0), length + 1.0))
    return bins


@njit(cache=True, error_model="numpy", nogil=True)
def _count(bins, counts, depth):  # type: ignore[no-untyped-def]
    """Count into bins, which stop at ``depth``; return whether any has reached it."""
    full = False
    for i in range(len(bins)):
        k = bins[i] - 1
        if 0 <= k < len(counts):
            counts[k] = min(counts[k] + 1, depth)
            full |= counts[k] == depth
    return full


class HistogramMemory:
    """Counters that stop at ``count_depth``.

    Parameters
    ----------
    longest
        How many there are.
    count_depth
        Largest count of a bin: 2**32 - 1 in the instrument.

    Attributes
    ----------
    counts
        (longest,) uint32, always the same memory.
    address
        Where that memory lies.
    full
        Whether a bin reached ``count_depth``, or the count that stops a measurement.
    """

    def __init__(self, longest: int, count_depth: int) -> None:
        self.counts = np.zeros(longest, np.uint32)
        self.address = self.counts.ctypes.data
        self.full = False
        self._depth = count_depth
        self._used = 0

    def clear(self) -> None:
        """Set all counts to zero."""
        self.counts[: self._used] = 0
        self._used = 0
        self.full = False

    def add(self, bins: NDArray[np.int64], length: int) -> None:
        """Count photons into their bins, as `bins_of` numbers them."""
        self._used = max(self._used, length)
        self.full |= bool(_count(bins, self.counts[:length], self._depth))

    def photons_until(self, bins: NDArray[np.int64], length: int, stop_count: int) -> int | None:
        """Return how many of the photons, in this order, arrive until a bin reaches ``stop_count``.

        None if no bin does.
        """
        missing = np.full(length + 2, len(bins) + 1)  # never reached by those outside
        missing[1:-1] = stop_count - self.counts[:length].astype(np.int64)
        if missing.min() <= 0:
            return 0
        order = np.argsort(bins, kind="stable")
        ordered = bins[order]
        rank = np.arange(len(bins)) - np.searchsorted(ordered, ordered)  # photons before it in the same bin
        stopping = order[rank + 1 == missing[ordered]]
        return int(stopping.min()) + 1 if len(stopping) else None
