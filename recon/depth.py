"""From a volume to what one looks at: front view and depths.

**Where a surface is.** The brightest voxel along depth is not quite on it. The 1/r of the sum takes something
from far voxels, z^-2 of the intensity of a point and nothing of a plane's (there the part of the wall that
adds up grows with r), and a power q of depth moves the peak of a Gaussian of variance s^2 by q s^2/z:
millimetres at lambda = 4 cm, centimetres for long waves. Such a factor belongs to the voxel and not to the
time, though. So the pulse is read in time: at a voxel v

    U(v, t) = sum_p A_p/r_p(v) pulse(t + tau_p(v) - tau_p(v_0))

for a point at v_0 with the delays tau_p, and at v = v_0 all pulses are at their peak at t = 0, whatever the
weights, the pulse's length and the arrangement of spots. The time t_0(v) of the peak is late, positive, in
front of a surface and negative behind it; the surface is where it is zero. For an extended plane the sum over
its points is one of stationary phase: the factor that it leaves hardly depends on the frequency, and a factor
that does not depend on it has no delay.
"""

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


def peak_depth(
    intensity: NDArray[np.float32],
    z_m: NDArray[np.float64],
    late_s: NDArray[np.float32] | None = None,
    lifted: float = 0.0,
) -> NDArray[np.float32]:
    """Find the depth of what is brightest at each pixel, finer than the planes are spaced.

    With `late_s`, that is where the pulse is neither late nor early, next to the brightest plane; see above.
    Without, as for methods that have no pulse, it is the vertex of the parabola through the logarithm of the
    brightest plane and its neighbours.

    Parameters
    ----------
    intensity
        (z, y, x) intensity.
    z_m
        (z,) depths, ascending, evenly spaced.
    late_s
        (z, y, x) by how much later than read each voxel's pulse is at its peak, of a `recon.result.Image`.
    lifted
        Without `late_s`: power of depth by which the intensity was multiplied too much to be peaked at a
        surface. Which surface is seen is told by the intensity as given, its place by the nearest peak
        without that power.

    Returns
    -------
    ndarray
        (y, x) float32 depth [m].
    """
    brightest = intensity.argmax(axis=0)
    if len(z_m) < 3:
        return z_m[brightest].astype(np.float32)
    if late_s is not None:
        return _on_time(late_s, z_m, brightest)
    if lifted:
        intensity = intensity * (z_m**-lifted).astype(np.float32)[:, None, None]
        brightest = _uphill(intensity, brightest)
    inner = np.clip(brightest, 1, len(z_m) - 2)
    tiny = np.finfo(np.float32).tiny
    before, here, after = (
        np.log(np.maximum(_at(intensity, inner + shift), tiny)).astype(np.float64) for shift in (-1, 0, 1)
    )
    bend = before - 2 * here + after
    peaked = (brightest == inner) & (bend < 0)
    shift = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=peaked)
    return (z_m[brightest] + shift * (z_m[1] - z_m[0])).astype(np.float32)


def depth_map(
    intensity: NDArray[np.float32],
    z_m: NDArray[np.float64],
    threshold: float = 0.1,
    lifted: float = 0.0,
) -> NDArray[np.float32]:
    """Return the peak's depth, NaN where the front view is below a part of its maximum.

    `recon.surface.find` tells surfaces from noise and glints; this is for a volume of which nothing but the
    intensity is known. `lifted` is as in `peak_depth`.

    Examples
    --------
    A pulse that is brightest at a depth of 1.02 m, on planes 10 cm apart, beside a dark pixel:

    >>> import numpy as np, recon
    >>> z_m = np.array([0.8, 0.9, 1.0, 1.1, 1.2])
    >>> bright = np.exp(-(((z_m - 1.02) / 0.1) ** 2))
    >>> intensity = np.stack([bright, 0.01 * bright], axis=-1)[:, None]
    >>> recon.depth_map(intensity, z_m).round(3).tolist()
    [[1.0199999809265137, nan]]
    """
    front = front_view(intensity)
    seen = (front > 0) & (front >= threshold * front.max())
    return np.where(seen, peak_depth(intensity, z_m, lifted=lifted), np.nan).astype(np.float32)


def _on_time(
    late_s: NDArray[np.float32], z_m: NDArray[np.float64], plane: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Go from each pixel's plane (y, x) to where lateness falls through zero, and interpolate there."""
    last = len(z_m) - 1
    late = _at(late_s, plane)
    step = np.where(late > 0, 1, -1)
    walking = np.ones(plane.shape, bool)
    while True:
        beyond = np.clip(plane + step, 0, last)
        next_late = _at(late_s, beyond)
        # On, while the next plane is on the same side of the surface, and nearer to it.
        walking &= (next_late * step > 0) & (np.abs(next_late) < np.abs(late)) & (beyond != plane)
        if not walking.any():
            break
        plane, late = np.where(walking, beyond, plane), np.where(walking, next_late, late)
    # Where lateness does not change sign, or rises with depth, the brightest plane is what there is.
    falls = (next_late * late < 0) & (beyond != plane)
    part = np.divide(late, late - next_late, out=np.zeros_like(late), where=falls)
    return (z_m[plane] + part * (z_m[beyond] - z_m[plane])).astype(np.float32)


def _uphill(intensity: NDArray[np.float32], plane: NDArray[np.intp]) -> NDArray[np.intp]:
    """Climb from each pixel's plane (y, x) to the nearest plane that is brighter than its neighbours."""
    last = len(intensity) - 1
    while True:
        here, before, after = (_at(intensity, np.clip(plane + shift, 0, last)) for shift in (0, -1, 1))
        # each step ends brighter than it began, so the climb ends
        step = np.where((after > here) & (after >= before), 1, np.where(before > here, -1, 0))
        if not step.any():
            return plane
        plane = plane + step


def _at(volume: NDArray[np.float32], plane: NDArray[np.intp]) -> NDArray[np.float32]:
    """Take a volume (z, y, x) at a plane for each pixel, (y, x)."""
    return np.take_along_axis(volume, plane[None], axis=0)[0]
