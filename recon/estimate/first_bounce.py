"""Time zero from the first bounce, the wall's own light, in confocal records that hold it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.capture import Capture
from recon.estimate.value import Estimate

#: Part of the positions at which the wall's light must be the largest of the record.
MOST_POSITIONS = 0.9
#: How much brighter than all that comes later it must be. A matt object of 10 cm, 30 cm away, sends back a
#: thousandth of what the wall does, a retroreflecting one some hundredths.
BRIGHTER = 5.0
#: Its longest full width at half maximum [s]. A plane parallel to the wall is seen at one time from all
#: positions too, but its light lasts: matt and 0.3 m away, 0.3 ns.
LONGEST_S = 0.25e-9
#: What comes later begins this long after it [s]; an instrument's tail belongs to the wall's light.
TAIL_S = 1e-9


def from_first_bounce(capture: Capture) -> Estimate | None:
    """Find when the first bounce arrives, if the record holds it.

    It is short, at the same time from all positions, and far brighter than what comes later. Only where
    laser and detector share their spots does it take no time, so that its arrival is time zero.

    Parameters
    ----------
    capture
        In the file's time, with the path delays of positions taken off.

    Returns
    -------
    Estimate
        Time zero in the file's time, to a bin or half of the light's width, whichever is more; None where the
        record is not confocal or does not hold such light.
    """
    width_s = capture.bin_width_s
    seen = _seen(capture, LONGEST_S / 2, TAIL_S)
    if seen is None:
        return None
    lasts_s = _full_width(seen.total - np.median(seen.total), seen.peak) * width_s
    if lasts_s > max(LONGEST_S, width_s):
        return None
    error_s = max(width_s, lasts_s / 2)
    return Estimate("time-origin", seen.at_s, seen.at_s - error_s, seen.at_s + error_s, "the first bounce")


def first_bounce_until_s(capture: Capture) -> float | None:
    """Return when the first bounce has died away, whatever the bins' width; None where there is none.

    That is where the sum of all records is least before it rises most: the first bounce falls all the time,
    until light of hidden things comes.

    Parameters
    ----------
    capture
        Its bins may have any width.
    """
    short_s = capture.bins * capture.bin_width_s / 100
    seen = _seen(capture, short_s, 5 * short_s)
    if seen is None:
        return None
    falling = gaussian_filter1d(seen.total, max(1.0, len(seen.total) / 500))[seen.peak :]
    falling = np.maximum(falling, 1e-9 * falling.max())  # a record without any background falls to nothing
    rise = int((falling / np.minimum.accumulate(falling)).argmax())
    least = int(falling[: rise + 1].argmin())
    return float(capture.first_bin_s.min()) + (seen.peak + least) * capture.bin_width_s


@dataclass(frozen=True)
class _Seen:
    """The sum of all records, its largest bin, and when the records have theirs, in the median [s]."""

    total: NDArray[np.float64]
    peak: int
    at_s: float


def _seen(capture: Capture, together_s: float, tail_s: float) -> _Seen | None:
    """Return a peak that almost all records have at one time, far above all that comes after its tail."""
    if not capture.confocal:
        return None
    width_s = capture.bin_width_s
    peaks_s, total = _peaks_and_total(capture)
    above = total - np.median(total)
    peak = int(above.argmax())
    typical_s = float(np.median(peaks_s))
    together = np.abs(peaks_s - typical_s) <= max(width_s, together_s)
    later = above[peak + max(1, round(tail_s / width_s)) :]
    bright = len(later) > 0 and above[peak] > BRIGHTER * max(0.0, float(later.max()))
    return _Seen(total, peak, typical_s) if bright and together.mean() >= MOST_POSITIONS else None


def _peaks_and_total(capture: Capture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (P,) centre of each record's largest bin, and the sum of all records on one time axis."""
    first_s = np.broadcast_to(capture.first_bin_s, capture.positions)
    moves = np.rint((first_s - first_s.min()) / capture.bin_width_s).astype(int)
    total = np.zeros(capture.bins + moves.max())
    peaks_s = np.empty(capture.positions)
    for block, counts in capture.histograms.blocks():
        peaks_s[block] = first_s[block] + (counts.argmax(axis=1) + 0.5) * capture.bin_width_s
        for move in np.unique(moves[block]):
            total[move : move + capture.bins] += counts[moves[block] == move].sum(axis=0, dtype=float)
    return peaks_s, total


def _full_width(profile: NDArray[np.float64], peak: int) -> float:
    """Return the full width at half maximum around a peak, in bins; a peak cut by the record is symmetric."""
    below = np.flatnonzero(profile < profile[peak] / 2)
    after, before = below[below > peak], below[below < peak]
    right = float(after[0] - peak) if len(after) else np.inf
    left = float(peak - before[-1]) if len(before) else right
    return left + right - 1
