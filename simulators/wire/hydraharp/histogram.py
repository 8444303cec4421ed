"""The histogram memory: detection times in, clipped counts out. Plain physics and numpy, no C."""

import numpy as np
from numpy.typing import NDArray

from simulators.wire.hydraharp.codes import LONGEST_HISTOGRAM


def bins_of(
    times_s: NDArray[np.float64],
    *,
    period_s: float,
    divider: int,
    shift_s: float,
    offset_s: float,
    bin_width_s: float,
    length: int,
) -> NDArray[np.int64]:
    """Return the bin of each detection that falls into the histogram.

    A start-stop clock knows only the latest sync edge before a detection. So a time beyond the period (a
    photon from far away, or a late dark count) is measured from a later pulse than the one that made it, and a
    time that a channel offset made negative from an earlier one: times fold into [0, period). A divider hides
    all but every n-th pulse, so the period of the start edges is n pulses, and the photons of the n pulses
    between two edges, equally likely, appear side by side. Only then is the offset subtracted; what is then
    left of the first bin or right of the last is lost, since the instrument has nowhere to count it.

    Parameters
    ----------
    times_s
        (photons,) times after the sync pulse at the timing input [s].
    period_s
        Time between sync pulses [s].
    divider
        Sync divider.
    shift_s
        Offset of the input less that of the sync input [s].
    offset_s, bin_width_s, length
        Left edge of the first bin, width of all, and their number.

    Returns
    -------
    ndarray
        (kept photons,) bin indices, in the order of arrival.
    """
    times_s = times_s + shift_s
    if divider > 1:
        times_s += period_s * (np.arange(len(times_s)) % divider)
        period_s *= divider
    times_s -= np.floor(times_s / period_s) * period_s
    times_s -= offset_s
    times_s /= bin_width_s
    inside = (times_s >= 0) & (times_s < length)
    if not inside.all():
        times_s = times_s[inside]
    return times_s.astype(np.int64)


class HistogramMemory:
    """Counters that stop at ``count_depth``.

    Parameters
    ----------
    count_depth
        Largest count of a bin: 2**32 - 1 in the instrument.

    Attributes
    ----------
    counts
        (65536,) uint32, always the same memory.
    full
        Whether a bin reached ``count_depth``, or the count that stops a measurement.
    """

    def __init__(self, count_depth: int) -> None:
        self.counts = np.zeros(LONGEST_HISTOGRAM, np.uint32)
        self.full = False
        self._depth = count_depth
        self._used = 0

    def clear(self) -> None:
        """Set all counts to zero."""
        self.counts[: self._used] = 0
        self._used = 0
        self.full = False

    def add(self, bins: NDArray[np.int64], length: int) -> None:
        """Count photons into their bins, all below ``length``."""
        if not len(bins):
            return
        fresh = np.bincount(bins, minlength=length)
        old = self.counts[:length]
        self._used = max(self._used, length)
        if self._depth - int(old.max()) < fresh.max():
            total = old + fresh
            np.minimum(total, self._depth, out=total)
            old[:] = total
        else:
            old += fresh.astype(np.uint32)
        self.full = self.full or int(old.max()) >= self._depth

    def photons_until(self, bins: NDArray[np.int64], length: int, stop_count: int) -> int | None:
        """Return how many of the photons, in this order, arrive until a bin reaches ``stop_count``.

        None if no bin does.
        """
        missing = stop_count - self.counts[:length].astype(np.int64)
        if missing.min() <= 0:
            return 0
        if not len(bins) or (np.bincount(bins, minlength=length) < missing).all():
            return None
        order = np.argsort(bins, kind="stable")
        ordered = bins[order]
        rank = np.arange(len(bins)) - np.searchsorted(ordered, ordered)  # photons before it in the same bin
        return int(order[rank + 1 == missing[ordered]].min()) + 1
