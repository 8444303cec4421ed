"""Time zero from the first bounce, the wall's own light, in confocal records that hold it."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.estimate.record import Profile
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


def from_first_bounce(record: Profile) -> Estimate | None:
    """Find when the first bounce arrives, if the record holds it.

    It is short, at the same time from all positions, and far brighter than what comes later. Only where
    laser and detector share their spots does it take no time, so that its arrival is time zero.

    Parameters
    ----------
    record
        In the file's time, with the path delays of positions taken off.

    Returns
    -------
    Estimate
        Time zero in the file's time, to a bin or half of the light's width, whichever is more; None where the
        record is not confocal or does not hold such light.
    """
    width_s = record.bin_width_s
    peak = _peak(record, LONGEST_S / 2, TAIL_S)
    if peak is None:
        return None
    lasts_s = _full_width(record.total - np.median(record.total), peak) * width_s
    if lasts_s > max(LONGEST_S, width_s):
        return None
    at_s, error_s = float(np.median(record.peaks_s)), max(width_s, lasts_s / 2)
    return Estimate("time-origin", at_s, at_s - error_s, at_s + error_s, "the first bounce")


def first_bounce_until_s(record: Profile) -> float | None:
    """Return when the first bounce has died away, whatever the bins' width; None where there is none.

    That is where the sum of all records is least before it rises most: the first bounce falls all the time,
    until light of hidden objects comes.
    """
    short_s = len(record.total) * record.bin_width_s / 100
    peak = _peak(record, short_s, 5 * short_s)
    if peak is None:
        return None
    falling = gaussian_filter1d(record.total, max(1.0, len(record.total) / 500))[peak:]
    falling = np.maximum(falling, 1e-9 * falling.max())  # a record without any background falls to nothing
    rise = int((falling / np.minimum.accumulate(falling)).argmax())
    least = int(falling[: rise + 1].argmin())
    return record.first_bin_s + (peak + least) * record.bin_width_s


def _peak(record: Profile, together_s: float, tail_s: float) -> int | None:
    """Return the bin of a peak that almost all records share, far above all that comes after its tail."""
    if not record.confocal:
        return None
    width_s = record.bin_width_s
    above = record.total - np.median(record.total)
    peak = int(above.argmax())
    together = np.abs(record.peaks_s - np.median(record.peaks_s)) <= max(width_s, together_s)
    later = above[peak + max(1, round(tail_s / width_s)) :]
    bright = len(later) > 0 and above[peak] > BRIGHTER * max(0.0, float(later.max()))
    return peak if bright and together.mean() >= MOST_POSITIONS else None


def _full_width(profile: NDArray[np.float64], peak: int) -> float:
    """Return the full width at half maximum around a peak, in bins; a peak cut by the record is symmetric."""
    below = np.flatnonzero(profile < profile[peak] / 2)
    after, before = below[below > peak], below[below < peak]
    right = float(after[0] - peak) if len(after) else np.inf
    left = float(peak - before[-1]) if len(before) else right
    return left + right - 1
