"""How far an image lies beside its truth."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate


def displacement_m(
    seen: NDArray[np.bool_], occupied: NDArray[np.bool_], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> tuple[float, float]:
    """Return by how much (x, y) the pixels seen lie beside those occupied [m].

    It is where the cross-correlation of the two masks is greatest, with a parabola through its neighbours:
    blur that is even to all sides does not move it.

    Parameters
    ----------
    seen, occupied
        (y, x) masks. NaN where either is empty, or an axis has fewer than two pixels.
    x_m, y_m
        Evenly spaced pixel centres.
    """
    if not (seen.any() and occupied.any() and min(seen.shape) > 1):
        return float("nan"), float("nan")
    likeness = correlate(seen.astype(float), occupied.astype(float), mode="full")
    row, column = np.unravel_index(int(likeness.argmax()), likeness.shape)
    shift_y = row - (seen.shape[0] - 1) + _beyond(likeness[:, column], int(row))
    shift_x = column - (seen.shape[1] - 1) + _beyond(likeness[row], int(column))
    return float(shift_x * (x_m[1] - x_m[0])), float(shift_y * (y_m[1] - y_m[0]))


def _beyond(profile: NDArray[np.float64], peak: int) -> float:
    """Return how far beyond its greatest sample a profile's parabola has its top, in samples."""
    if not 0 < peak < len(profile) - 1:
        return 0.0
    before, top, after = profile[peak - 1 : peak + 2]
    curve = before - 2 * top + after
    return float((before - after) / (2 * curve)) if curve < 0 else 0.0
