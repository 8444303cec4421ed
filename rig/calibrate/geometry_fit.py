"""One fit of the rig's geometry: mirror, detector and delay, from what is known where and when.

A first bounce arrives at delay + |g - x| / c + |x - h| / c: pivot g of the mirror, spot x(commanded angles)
on the wall, head h of the detector. Arrivals, spots that cameras see and marks onto which a person steers
the beam are fitted together, by least squares.

On one wall a mirror's spots are nearly a homography of the commands' tangents, which has eight numbers. The
model has more: place, turn, offset and gain can in part stand for each other, and so can g, h and the delay.
At an angle of incidence the spots' lines bend, which no homography does: so the spots tell the incidence, and
from which side the beam comes. Gain, offset and distance trade with what is left of it open.
So the configuration's values take part in the fit, with honest standard deviations. What they leave open
moves no spot and no arrival, and the covariance says so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import approx_fprime, least_squares
from scipy.spatial.transform import Rotation

from rig.calibrate import Floats
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.pointing import Pointing
from rig.model.state import RigState

#: How well the configuration knows where mirror and detector stand: a tape measure.
TAPE_ERROR_M = 0.02
#: How well the wall is square to the rig; if it is not, mirror and detector are turned about its centre.
TILT_ERROR_RAD = np.radians(5.0)
#: How well the angle of incidence on the mirror is known, and across it its direction: read off a mount's
#: drawing, or by a set square.
INCIDENCE_ERROR_RAD = np.radians(5.0)
#: How well a mirror's electronics keep their scale. It need not make up for the incidence, which is a part of
#: the model: widths from 1 % to 10 % leave the same errors (docs/calibration/galvo.md).
GAIN_ERROR = 0.01
#: Standard deviations, before anything is measured, of the unknowns: the rig's turn against the wall about
#: the wall's axes [rad], which moves mirror and detector together; the mirror's place in the rig [m], its own
#: turn [rad], offset [rad], gain and incidence [rad]; the detector's place in the rig [m]; the delay [s]:
#: metres of forgotten cable.
WIDTHS = np.concatenate(
    [
        np.repeat([TILT_ERROR_RAD, TAPE_ERROR_M], 3),
        np.repeat([np.radians(2.0), np.radians(1.0), GAIN_ERROR, INCIDENCE_ERROR_RAD], [3, 2, 2, 2]),
        np.repeat([TAPE_ERROR_M, 10e-9], [3, 1]),
    ]
)
#: Where the incidence is among the unknowns.
INCIDENCE = [13, 14]
#: Most evaluations of a search; where the data fits it takes a tenth of them.
MAX_EVALUATIONS = 100
#: Beyond so many standard errors a residual counts by its size, not its square (Huber).
ROBUST_FROM = 3.0
#: What a fit counts, in standard errors, for a beam that misses the wall.
MISSED = 1e6


@dataclass(frozen=True)
class RigGeometry:
    """Where mirror and detector stand, how the mirror turns, and what cables delay."""

    pointing: Pointing
    delays: PathDelays

    def arrivals_s(self, mirror_rad: Floats) -> Floats:
        """Return when first bounces arrive for (N, 2) commanded angles."""
        spots_m = self.pointing.spots_m(mirror_rad)
        return self.delays.delay_s(spots_m, spots_m)


@dataclass(frozen=True)
class Arrivals:
    """(N,) times at which first bounces arrived for (N, 2) commanded angles, and their standard errors."""

    mirror_rad: Floats
    arrival_s: Floats
    error_s: Floats

    def residuals(self, rig: RigGeometry) -> Floats:
        """Return (N,) measured less modelled, in standard errors."""
        return (self.arrival_s - rig.arrivals_s(self.mirror_rad)) / self.error_s


@dataclass(frozen=True)
class Spots:
    """(K, 2) places on the wall where the beam was for (K, 2) commanded angles: spots, or marks.

    Their error is one standard deviation for each coordinate, or the (2K, 2K) covariance.
    """

    mirror_rad: Floats
    spot_m: Floats
    error: float | Floats

    def residuals(self, rig: RigGeometry) -> Floats:
        """Return (2K,) measured less modelled, in standard errors, made independent."""
        off_m = (self.spot_m - rig.pointing.spots_m(self.mirror_rad)[:, :2]).ravel()
        if np.ndim(self.error) == 0:
            return np.asarray(off_m / self.error)
        return np.linalg.solve(np.linalg.cholesky(self.error), off_m)


@dataclass(frozen=True)
class FittedGeometry:
    """What the data says.

    Attributes
    ----------
    rig, chi2
        The geometry, and the mean square of the measured data's residuals in their errors, corrected for what
        was fitted; about 1.
    unknowns, covariance
        Of the fit, in units of `WIDTHS`; where ``chi2`` is above 1 all errors are raised by as much.
    """

    rig: RigGeometry
    chi2: float
    unknowns: Floats
    covariance: Floats
    _config: RigConfig

    def covariance_of(self, quantity: Callable[[RigGeometry], Floats]) -> Floats:
        """Return the (n, n) covariance of n numbers that the geometry gives."""
        slopes = np.atleast_2d(
            approx_fprime(self.unknowns, lambda at: quantity(geometry(at, self._config)), 1e-4)
        )
        return np.asarray(slopes @ self.covariance @ slopes.T)


def geometry(unknowns: Floats, config: RigConfig) -> RigGeometry:
    """Return the rig for the unknowns in units of `WIDTHS`, all 0 as configured."""
    tilt, place_m, turn, offset, gain, incidence, head_m, delay_s = np.split(
        unknowns * WIDTHS, [3, 6, 9, 11, 13, 15, 18]
    )
    rig_turn = Rotation.from_rotvec(tilt)
    mirror_m = rig_turn.apply(np.add(config.galvo.position_m, place_m))
    configured = RigState(config).pointing
    pointing = replace(
        configured,
        mirror_m=tuple(mirror_m.tolist()),
        rotation_rad=tuple((rig_turn * Rotation.from_rotvec(turn)).as_rotvec().tolist()),
        offset_rad=tuple(offset.tolist()),
        gain=tuple((1 + gain).tolist()),
        incidence_rad=tuple(np.add(configured.incidence_rad, incidence).tolist()),
    )
    head_m = rig_turn.apply(np.add(config.detector.position_m, head_m))
    return RigGeometry(
        pointing, PathDelays(mirror_m, head_m, config.timing.electronics_delay_s + float(delay_s[0]))
    )


def fit_geometry(
    config: RigConfig,
    measured: Sequence[Arrivals | Spots],
    calibrated: Sequence[Arrivals | Spots] = (),
    *,
    robust: bool,
) -> FittedGeometry:
    """Fit the rig to what was measured, and to what was ``calibrated`` before; ``config`` is by tape measure.

    Residuals of what was ``measured`` say how good the fit is. With ``robust`` single data may be far off.
    """
    data = [*measured, *calibrated]
    number = sum(len(one.residuals(geometry(np.zeros(len(WIDTHS)), config))) for one in measured)

    def residuals(unknowns: Floats) -> Floats:
        rig = geometry(unknowns, config)
        return np.nan_to_num(np.concatenate([*(one.residuals(rig) for one in data), unknowns]), nan=MISSED)

    every, at = np.arange(len(WIDTHS)), np.zeros(len(WIDTHS))
    # a search from far away may get stuck: a robust one, and one for an incidence that no spots tell
    if not any(isinstance(one, Spots) for one in data):
        at, _ = _search(residuals, at, np.delete(every, INCIDENCE), "linear")
    at, by_unknown = _search(residuals, at, every, "linear")
    if robust:
        at, by_unknown = _search(residuals, at, every, "huber")
    remaining, slopes = residuals(at)[:number], by_unknown[:number]
    covariance = np.asarray(np.linalg.inv(by_unknown.T @ by_unknown), dtype=float)
    freedom = number - float(np.einsum("ni,ij,nj->", slopes, covariance, slopes))
    chi2 = float((remaining**2).sum() / max(freedom, 1.0))
    return FittedGeometry(geometry(at, config), chi2, at, covariance * max(chi2, 1.0), config)


def _search(
    residuals: Callable[[Floats], Floats],
    start: Floats,
    free: NDArray[np.int_],
    loss: Literal["linear", "huber"],
) -> tuple[Floats, Floats]:
    """Return the best unknowns of which some are ``free``, and the residuals' slopes by these."""

    def of_free(values: Floats) -> Floats:
        at = start.copy()
        at[free] = values
        return residuals(at)

    fit = least_squares(
        of_free, start[free], loss=loss, f_scale=ROBUST_FROM, x_scale="jac",
        xtol=1e-9, ftol=1e-9, gtol=1e-9, max_nfev=MAX_EVALUATIONS,
    )  # fmt: skip
    found = start.copy()
    found[free] = fit.x
    return found, fit.jac
