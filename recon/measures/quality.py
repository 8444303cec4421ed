"""Contrast and signal to noise of an image, from its object and what is around it."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt


def surroundings(
    occupied: NDArray[np.bool_], x_m: NDArray[np.float64], y_m: NDArray[np.float64], margin_m: float
) -> NDArray[np.bool_]:
    """Return the pixels that are background: farther than a margin from every pixel of the object.

    Parameters
    ----------
    occupied
        (y, x) where the object is.
    x_m, y_m
        Evenly spaced pixel centres.
    margin_m
        The object's blur, e.g. a width of the point spread function.
    """
    if not occupied.any():
        return np.ones(occupied.shape, bool)
    spacing = [float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (y_m, x_m)]
    return np.asarray(distance_transform_edt(~occupied, sampling=spacing) > margin_m)


def contrast(front: NDArray, occupied: NDArray[np.bool_], background: NDArray[np.bool_]) -> float:
    """Return Michelson's contrast of means, (a - b) / (a + b): 1 is an object on black, 0 no object.

    Parameters
    ----------
    front
        (y, x) front view, the greatest intensity over depth.
    occupied, background
        (y, x) pixels whose means a and b are compared. NaN where either is empty.
    """
    if not (occupied.any() and background.any()):
        return float("nan")
    a, b = front[occupied].mean(dtype=np.float64), front[background].mean(dtype=np.float64)
    return float((a - b) / (a + b)) if a + b > 0 else float("nan")


def signal_to_noise(front: NDArray, background: NDArray[np.bool_]) -> float:
    """Return how many standard deviations of the background its mean is below the greatest value.

    Parameters
    ----------
    front
        (y, x) front view.
    background
        (y, x) pixels without an object. NaN where there are fewer than two, or they are all equal.
    """
    around = front[background].astype(np.float64)
    if len(around) < 2 or not around.std() > 0:
        return float("nan")
    return float((front.max() - around.mean()) / around.std())
