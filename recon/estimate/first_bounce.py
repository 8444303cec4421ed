"""Time zero from the first bounce, the wall's own light, in confocal records that hold it."""

import numpy as np
from numpy.typing import NDArray

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
    if not capture.confocal:
        return None
    width_s = capture.bin_width_s
    peaks_s, total = _peaks_and_total(capture)
    total = total - np.median(total)
    peak = int(total.argmax())
    lasts_s = _full_width(total, peak) * width_s
    typical_s = float(np.median(peaks_s))
    together = np.abs(peaks_s - typical_s) <= max(width_s, LONGEST_S / 2)
    later = total[peak + max(1, round(TAIL_S / width_s)) :]
    seen = len(later) > 0 and total[peak] > BRIGHTER * max(0.0, float(later.max()))
    if not seen or together.mean() < MOST_POSITIONS or lasts_s > max(LONGEST_S, width_s):
        return None
    error_s = max(width_s, lasts_s / 2)
    return Estimate("time-origin", typical_s, typical_s - error_s, typical_s + error_s, "the first bounce")


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
