"""The mirror's model, fitted to spots or to times of flight, and what is stored of it."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from scipy.optimize import approx_fprime
from scipy.spatial import ConvexHull

from rig.calibrate import Floats, require
from rig.calibrate.geometry_fit import Arrivals, FittedGeometry, Spots, fit_geometry
from rig.calibrate.raw import Origin
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig
from rig.model.pointing import Pointing

#: Largest root mean square distance of spots from the fitted model [m].
MAX_SPOTS_M = 3e-3
#: What an arrival may be off besides its counting error: unequal bins and drift of the instrument [s].
INSTRUMENT_S = 1e-12
#: How well a person steers the beam onto a mark, along either axis [m].
AIMED_TO_M = 0.3e-3
#: Fewest marks, fewest arrivals, and the least width of the marks across their longest line [m].
MIN_MARKS, MIN_ARRIVALS, MIN_WIDTH_M = 4, 12, 0.2
#: Largest root mean square that the fit may leave of arrivals [s] and of marks [m].
MAX_ARRIVALS_S, MAX_MARKS_M = 20e-12, 5e-3


def fit_mirror(spots: Spots, config: RigConfig) -> FittedGeometry:
    """Fit the model to measured spots.

    Raises CalibrationError if the spots are not where any such mirror would send the beam.
    """
    fit = fit_geometry(config, [spots], robust=False)
    off_m = _off_m(fit.rig.pointing, spots)
    residual_m = _rms(off_m)
    worst_m = spots.spot_m[off_m.argmax()]
    require(
        residual_m < MAX_SPOTS_M,
        f"the spots are {residual_m * 1e3:.1f} mm (root mean square) from all places that the configured "
        f"mirror can reach, the worst at x = {worst_m[0]:.3f} m, y = {worst_m[1]:.3f} m. "
        "Was something moved during the measurement? Are galvo.mirrors and galvo.incidence right? Are "
        "galvo.position and the marks in metres "
        "right?",
    )
    return fit


def fit_flight(arrivals: Arrivals, marks: Spots, config: RigConfig) -> FittedGeometry:
    """Fit mirror, detector and delay to first bounces, and to marks onto which the beam was steered.

    Where a first bounce arrives late, the spot is far out; marks say where it is at some angles for certain.

    Raises CalibrationError if there are too few arrivals or marks, or no such rig makes them.
    """
    _refuse_few(len(arrivals.arrival_s), marks.spot_m)
    noisy = replace(arrivals, error_s=np.hypot(arrivals.error_s, INSTRUMENT_S))
    fit = fit_geometry(config, [noisy, marks], robust=True)
    residual_s = arrivals.arrival_s - fit.rig.arrivals_s(arrivals.mirror_rad)
    rms_s, rms_m = _rms(residual_s), _rms(_off_m(fit.rig.pointing, marks))
    require(
        rms_s < MAX_ARRIVALS_S and rms_m < MAX_MARKS_M,
        f"the configured rig does not fit the data: residuals are {rms_s * 1e12:.1f} ps for the arrivals "
        f"(root mean square; the worst is position {int(np.abs(residual_s).argmax())}) and "
        f"{rms_m * 1e3:.1f} mm for the marks. Are the marks right, in metres from the wall's centre? Was "
        "something moved during the measurement? Are "
        "galvo.position and spad.position right to a few centimetres, and galvo.incidence to a few degrees?",
    )
    return fit


def _refuse_few(arrivals: int, marks_m: Floats) -> None:
    require(
        arrivals >= MIN_ARRIVALS,
        f"{arrivals} arrivals are too few, {MIN_ARRIVALS} are needed: scan more positions",
    )
    require(
        len(marks_m) >= MIN_MARKS,
        f"{len(marks_m)} marks are too few, {MIN_MARKS} are needed: without them, "
        "times of flight do not determine turns of the mirror",
    )
    width_m = np.linalg.svd(marks_m - marks_m.mean(axis=0), compute_uv=False)[1]
    require(
        width_m >= MIN_WIDTH_M,
        "the marks lie nearly on one line: spread them over the wall, if possible to the corners of the scan",
    )


def _off_m(pointing: Pointing, spots: Spots) -> Floats:
    """(K,) distances of the modelled from the measured spots."""
    return np.asarray(np.linalg.norm(pointing.spots_m(spots.mirror_rad)[:, :2] - spots.spot_m, axis=1))


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))


def numbers_covariance(fit: FittedGeometry) -> Floats:
    """Return the (12, 12) covariance of the mirror's place, rotation, offset, gain and incidence."""
    return fit.covariance_of(lambda rig: _numbers(rig.pointing))


def _numbers(pointing: Pointing) -> Floats:
    """Return the (12,) numbers of a model that a calibration fits."""
    p = pointing
    return np.array([*p.mirror_m, *p.rotation_rad, *p.offset_rad, *p.gain, *p.incidence_rad])


def spot_covariances_m2(pointing: Pointing, covariance: Floats, angles_rad: Floats) -> Floats:
    """Return the (K, 2, 2) covariances of the spots that a model predicts for (K, 2) angles.

    ``covariance`` is that of the model's numbers, see `GalvoModel`; an older one is of the first 10 of them.
    """

    def spots_m(numbers: Floats) -> Floats:
        place_m, turn, offset, gain, incidence = (
            tuple(part.tolist()) for part in np.split(numbers, [3, 6, 8, 10])
        )
        moved = replace(
            pointing, mirror_m=place_m, rotation_rad=turn, offset_rad=offset, gain=gain,
            incidence_rad=incidence,
        )  # fmt: skip
        return moved.spots_m(angles_rad)[:, :2].ravel()

    slopes = approx_fprime(_numbers(pointing), spots_m, 1e-6).reshape(-1, 2, 12)[..., : len(covariance)]
    return np.asarray(slopes @ covariance @ slopes.swapaxes(1, 2))


def galvo_model(
    method: Literal["cameras", "flight"],
    fit: FittedGeometry,
    spots: Spots,
    angles_rad: Floats,
    source: Origin,
    **more: Any,
) -> GalvoModel:
    """Return the calibration of a fitted mirror.

    Parameters
    ----------
    method, fit, spots
        How it was fitted, and the spots, or marks, to which it was.
    angles_rad
        (K, 2) at which it was measured: the hull of the spots there is the calibrated area.
    source, more
        Where it comes from, and what else is known.
    """
    pointing, covariance = fit.rig.pointing, numbers_covariance(fit)
    measured_m = pointing.spots_m(angles_rad)[:, :2]
    corners_m = measured_m[ConvexHull(measured_m).vertices]  # counter-clockwise
    spread_m2 = spot_covariances_m2(pointing, covariance, spots.mirror_rad)
    return GalvoModel(
        **source,
        valid_days=30,
        method=method,
        mirror_m=pointing.mirror_m,
        rotation_rad=pointing.rotation_rad,
        offset_rad=pointing.offset_rad,
        gain=pointing.gain,
        incidence_rad=pointing.incidence_rad,
        mirrors=pointing.mirrors,
        separation_m=pointing.separation_m,
        area_m=[(float(x), float(y)) for x, y in corners_m],
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        spot_error_m=float(np.sqrt(np.trace(spread_m2, axis1=1, axis2=2).mean())),
        residual_m=_rms(_off_m(pointing, spots)),
        mirror_rad=tuple((float(x), float(y)) for x, y in spots.mirror_rad),
        spots_m=tuple((float(x), float(y)) for x, y in spots.spot_m),
        **more,
    )
