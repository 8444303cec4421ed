"""How far an image lies beside its truth."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate

#: Shifts at which the overlap of two masks is at least this part of its greatest are taken together: a shape
#: that is blurred holds the sharp one at many shifts alike, evenly about the right one.
NEARLY_ALL = 0.95


def displacement_m(
    seen: NDArray[np.bool_], occupied: NDArray[np.bool_], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> tuple[float, float]:
    """Return by how much (x, y) the pixels seen lie beside those occupied [m].

    It is the centre of the shifts at which the two masks overlap most. Blur that is even to all sides does
    not move it.

    Parameters
    ----------
    seen, occupied
        (y, x) masks. NaN where either is empty, or an axis has fewer than two pixels.
    x_m, y_m
        Evenly spaced pixel centres.
    """
    if not (seen.any() and occupied.any() and min(seen.shape) > 1):
        return float("nan"), float("nan")
    overlap = correlate(seen.astype(float), occupied.astype(float), mode="full")
    weight = np.where(overlap >= NEARLY_ALL * overlap.max(), overlap, 0.0)
    rows, columns = (np.arange(length) - (length // 2) for length in weight.shape)
    shift_y = rows @ weight.sum(axis=1) / weight.sum()
    shift_x = columns @ weight.sum(axis=0) / weight.sum()
    return float(shift_x * (x_m[1] - x_m[0])), float(shift_y * (y_m[1] - y_m[0]))
