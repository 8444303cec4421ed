"""From a volume to what one looks at: front view and depth map."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Values = TypeVar("Values", NDArray[np.float32], NDArray[np.complex64])


def compensate_falloff(amplitude: Values, z_m: NDArray[np.float64], power: float = 2.0) -> Values:
    """Multiply an amplitude by z^power, so that far objects are not lost beside near ones.

    Counts from a small object fall as depth^-4 (both paths spread), and the intensity of its image with them
    and the wall's apparent size. The square of depth on the amplitude, the fourth power on the intensity,
    undoes the first of these; it also lifts the noise of far planes.

    Parameters
    ----------
    amplitude
        (z, y, x) field or its magnitude; give the intensity with twice the power.
    z_m
        (z,) depths.
    power
        Power of depth.

    Returns
    -------
    ndarray
        (z, y, x), same type; relative to a depth of 1 m.
    """
    return amplitude * (z_m**power).astype(np.float32)[:, None, None]


def front_view(intensity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the greatest intensity over depth, (y, x)."""
    return intensity.max(axis=0)


def depth_map(
    intensity: NDArray[np.float32], z_m: NDArray[np.float64], threshold: float = 0.1, lifted: float = 0.0
) -> NDArray[np.float32]:
    """Find the depth of greatest intensity, finer than the planes are spaced.

    The pulse is Gaussian, so along depth the logarithm of a single surface's intensity is a parabola, and the
    vertex through the greatest plane and its neighbours is its place.

    Parameters
    ----------
    intensity
        (z, y, x) intensity.
    z_m
        (z,) depths, evenly spaced.
    threshold
        Pixels whose front view is below this part of its maximum have no depth.
    lifted
        Power of depth by which the intensity was multiplied too much to be peaked at the surface. A power q
        of depth moves the peak of a Gaussian of variance s^2 by q s^2 / z: millimetres at lambda = 4 cm,
        10 cm at 20 cm. The solvers' 1/r takes z^-2 from the intensity; so after `compensate_falloff` with
        the fourth power, which shows near and far surfaces alike, two are too much. Which surface is seen,
        and whether, is told by the intensity as given; its place by the nearest peak without that power.

    Returns
    -------
    ndarray
        (y, x) float32 depth [m], NaN where there is none.
    """
    front = front_view(intensity)
    plain = intensity * (z_m**-lifted).astype(np.float32)[:, None, None] if lifted else intensity
    nearest = _uphill(plain, intensity.argmax(axis=0))
    depth = z_m[nearest]
    if len(z_m) >= 3:
        inner = np.clip(nearest, 1, len(z_m) - 2)[None]
        tiny = np.finfo(np.float32).tiny
        before, here, after = (
            np.log(np.maximum(np.take_along_axis(plain, inner + shift, axis=0)[0], tiny)).astype(np.float64)
            for shift in (-1, 0, 1)
        )
        bend = before - 2 * here + after
        peaked = (nearest == inner[0]) & (bend < 0)
        shift = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=peaked)
        depth = depth + shift * (z_m[1] - z_m[0])
    return np.where((front > 0) & (front >= threshold * front.max()), depth, np.nan).astype(np.float32)


def _uphill(intensity: NDArray[np.float32], plane: NDArray[np.intp]) -> NDArray[np.intp]:
    """Climb from each pixel's plane (y, x) to the nearest plane that is brighter than its neighbours."""
    last = len(intensity) - 1
    while True:
        here, before, after = (
            np.take_along_axis(intensity, np.clip(plane + shift, 0, last)[None], axis=0)[0]
            for shift in (0, -1, 1)
        )
        # each step ends brighter than it began, so the climb ends
        step = np.where((after > here) & (after >= before), 1, np.where(before > here, -1, 0))
        if not step.any():
            return plane
        plane = plane + step
