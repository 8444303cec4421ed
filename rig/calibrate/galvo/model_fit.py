"""The mirror's model: its numbers with what is believed of them beforehand, and their fit to spots.

On one wall a mirror's spots are nearly a homography of the commands' tangents, which has eight numbers. The
model has more: place, turn, offset and gain can in part stand for each other. So the configuration's values
take part in the fit, with honest widths. What they leave open moves no spot, and the covariance says so.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rig.calibrate.galvo.lens import Floats
from rig.errors import CalibrationError
from rig.model.config import RigConfig
from rig.model.pointing import Pointing
from rig.model.state import RigState

#: Standard deviations, before anything is measured, of: the rig's turn against the wall about the wall's
#: vertical and horizontal [rad], which moves mirror and detector together; the mirror's place in the rig [m],
#: its own turn [rad]; offset [rad] and gain.
WIDTHS = np.array(
    [*np.radians([10.0] * 2), *[0.05] * 3, *np.radians([5.0] * 3), *np.radians([2.0] * 2), *[0.01] * 2]
)
#: How many of a `Pointing`'s numbers are fitted: place, rotation, offset, gain.
POINTING_NUMBERS = 10
#: What a fit counts, in standard errors, for a beam that misses the wall.
MISSED = 1e6
#: Largest root mean square distance of spots from the fitted model [m].
WORST_SPOTS_M = 3e-3


@dataclass(frozen=True)
class FittedMirror:
    """A mirror's model and how well it is known.

    Attributes
    ----------
    pointing
        The model, with the hull of its spots as the calibrated area.
    covariance
        (10, 10) of place, rotation, offset and gain.
    residual_m
        Root mean square distance of measured from modelled spots [m].
    """

    pointing: Pointing
    covariance: Floats
    residual_m: float


def rig_turn(numbers: Floats) -> Rotation:
    """Return how the rig is turned against the wall, from the first two of a fit's numbers."""
    return Rotation.from_rotvec([numbers[1], numbers[0], 0.0])


def mirror(numbers: Floats, config: RigConfig) -> Pointing:
    """Return the mirror for the (12,) numbers that `WIDTHS` explains, all 0 as configured."""
    turn = rig_turn(numbers)
    place_m = turn.apply(np.add(config.galvo.position_m, numbers[2:5]))
    rotation = (turn * Rotation.from_rotvec(numbers[5:8])).as_rotvec()
    return replace(
        RigState(config).pointing,
        mirror_m=tuple(place_m.tolist()),
        rotation_rad=tuple(rotation.tolist()),
        offset_rad=(float(numbers[8]), float(numbers[9])),
        gain=(1 + float(numbers[10]), 1 + float(numbers[11])),
    )


def pointing_numbers(pointing: Pointing) -> Floats:
    """Return the (10,) numbers of a model that a calibration fits."""
    return np.array([*pointing.mirror_m, *pointing.rotation_rad, *pointing.offset_rad, *pointing.gain])


def with_numbers(pointing: Pointing, numbers: Floats) -> Pointing:
    """Return a model with other numbers, see `pointing_numbers`."""
    place_m, rotation, offset, gain = (tuple(part.tolist()) for part in np.split(numbers, [3, 6, 8]))
    return replace(pointing, mirror_m=place_m, rotation_rad=rotation, offset_rad=offset, gain=gain)


def fit_mirror(angles_rad: Floats, spots_m: Floats, covariance: Floats, config: RigConfig) -> FittedMirror:
    """Fit the model to (K, 2) spots measured at (K, 2) commanded angles, with their (2K, 2K) covariance.

    Raises
    ------
    CalibrationError
        If the spots are not where any such mirror would send the beam.
    """
    white = np.linalg.inv(np.linalg.cholesky(covariance))

    def residuals(numbers: Floats) -> Floats:
        apart_m = mirror(numbers, config).spots_m(angles_rad)[:, :2] - spots_m
        return np.concatenate([np.nan_to_num(white @ apart_m.ravel(), nan=MISSED), numbers / WIDTHS])

    fit = least_squares(residuals, np.zeros(len(WIDTHS)), x_scale=WIDTHS, xtol=1e-9, ftol=1e-9, gtol=1e-9)
    pointing = mirror(fit.x, config)
    apart_m = pointing.spots_m(angles_rad)[:, :2] - spots_m
    residual_m = float(np.sqrt((apart_m**2).sum(axis=1).mean()))
    if not residual_m < WORST_SPOTS_M:
        worst = int((apart_m**2).sum(axis=1).argmax())
        raise CalibrationError(
            f"the spots are {residual_m * 1e3:.1f} mm (root mean square) from where any mirror as configured "
            f"could send them, the worst at x = {spots_m[worst, 0]:.3f} m, y = {spots_m[worst, 1]:.3f} m. "
            "Was something moved meanwhile? Is galvo.mirrors right? Are galvo.position and the marks in "
            "metres right?"
        )
    # a homography's eight numbers are what the spots themselves determine
    excess = max(1.0, float((fit.fun[: 2 * len(spots_m)] ** 2).sum()) / (2 * len(spots_m) - 8))
    covariance = covariance_of_pointing(fit.x, np.linalg.inv(fit.jac.T @ fit.jac), config) * excess
    return FittedMirror(replace(pointing, area_m=hull(pointing, angles_rad)), covariance, residual_m)


def covariance_of_pointing(numbers: Floats, covariance: Floats, config: RigConfig) -> Floats:
    """Carry the covariance of a fit's first 12 numbers over to the model's 10."""
    count = len(WIDTHS)
    steps = np.diag(1e-4 * WIDTHS)
    slopes = np.stack(
        [
            (pointing_numbers(mirror(numbers[:count] + by, config))
             - pointing_numbers(mirror(numbers[:count] - by, config))) / (2 * by.sum())
            for by in steps
        ],
        axis=1,
    )  # fmt: skip
    return slopes @ covariance[:count, :count] @ slopes.T


def hull(pointing: Pointing, angles_rad: Floats) -> tuple[tuple[float, float], ...]:
    """Return the corners of the convex hull of the model's spots, counter-clockwise."""
    spots_m = pointing.spots_m(angles_rad)[:, :2]
    corners_m = spots_m[ConvexHull(spots_m).vertices]
    return tuple((float(x), float(y)) for x, y in corners_m)


def spot_covariances_m2(pointing: Pointing, covariance: Floats, angles_rad: Floats) -> NDArray[np.float64]:
    """Return the (K, 2, 2) covariances of the spots that a model predicts for (K, 2) angles."""
    numbers = pointing_numbers(pointing)
    slopes = np.stack(
        [
            (with_numbers(pointing, numbers + by).spots_m(angles_rad)
             - with_numbers(pointing, numbers - by).spots_m(angles_rad))[:, :2] / 2e-6
            for by in 1e-6 * np.eye(POINTING_NUMBERS)
        ],
        axis=-1,
    )  # fmt: skip
    return np.asarray(slopes @ covariance @ slopes.swapaxes(1, 2))
