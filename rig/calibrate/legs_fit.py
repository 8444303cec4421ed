"""From arrivals of first bounces to delay, laser head and detector head."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from recon.capture import C_M_PER_S
from rig.model.delays import PathDelays
from rig.model.pointing import Pointing

#: How well the configuration knows where galvo and detector stand: a tape measure.
TAPE_ERROR_M = 0.02
#: How well the wall is square to the rig; if it is not, galvo and detector are turned about its centre.
TILT_ERROR_RAD = np.radians(5.0)
#: How squarely the mirror is mounted, how well it knows its zero, and how far it turns when it is told to.
TURN_ERROR_RAD, OFFSET_ERROR_RAD, GAIN_ERROR = np.radians(2.0), np.radians(1.0), 0.01
#: How far a delay may be from the configured one: metres of forgotten cable.
DELAY_ERROR_S = 10e-9
#: No spots are known better, whatever a calibration says.
LEAST_SPOT_ERROR_M = 1e-5
#: Beyond so many standard errors a residual counts by its size, not its square (Huber).
ROBUST_FROM = 3.0

#: The unknowns: c times the delay [m], detector head; of the mirror pivot, rotation, offset, gain.
_DELAY, _DETECTOR, _MIRROR = 0, slice(1, 4), slice(4, 14)
_PIVOT, _TURN, _REST = slice(4, 7), slice(7, 10), slice(10, 14)

Unknowns = NDArray[np.float64]


@dataclass(frozen=True)
class Belief:
    """What is known before arrivals are looked at.

    Attributes
    ----------
    legs
        As configured.
    nominal
        The mirror as configured.
    calibrated, spot_error_m
        The mirror as calibrated, and the standard error of its spots, root mean square; None without.
    """

    legs: PathDelays
    nominal: Pointing
    calibrated: Pointing | None = None
    spot_error_m: float | None = None

    @property
    def pointing(self) -> Pointing:
        """The best model of the mirror."""
        return self.calibrated or self.nominal


@dataclass(frozen=True)
class LegsFit:
    """What arrivals say.

    Attributes
    ----------
    legs
        Delay and heads.
    delay_error_s
        Standard error of the delay alone, which trades with the heads.
    rectified_error_s
        (N,) standard error of what is subtracted from recorded time at each spot.
    spots_m
        (N, 2) where the model of the mirror puts the beam.
    residual_s
        (N,) what the fit leaves.
    chi2
        Mean square of residuals by their errors, corrected for what was fitted; about 1.
    moved_m
        (N, 2) by how much the arrivals move the spots from where the model of the mirror puts them.
    """

    legs: PathDelays
    delay_error_s: float
    rectified_error_s: NDArray[np.float64]
    spots_m: NDArray[np.float64]
    residual_s: NDArray[np.float64]
    chi2: float
    moved_m: NDArray[np.float64]


def fit_legs(
    arrival_s: NDArray[np.float64],
    error_s: NDArray[np.float64],
    mirror_rad: NDArray[np.float64],
    detector_spot_m: NDArray[np.float64],
    belief: Belief,
) -> LegsFit:
    """Fit t_p = T0 + |g - x_p| / c + |x_p - h| / c for T0, the pivot g and the detector's head h.

    g and h are nearly exchangeable, and T0 trades with both, so that they are not well known one by one: what
    was known before, with its errors, keeps them in place. What imaging needs, the delay T0 + |g - x_p| / c +
    |x_c - h| / c, hardly depends on it. The spots x_p are those of the model of the mirror, whose parameters
    are fitted too, within the errors that it has: the same g is its pivot. If residuals are larger than their
    errors, all errors are raised by as much.

    Parameters
    ----------
    arrival_s, error_s
        (N,) arrivals and standard errors.
    mirror_rad
        (N, 2) commanded angles.
    detector_spot_m
        (3,) x_c.
    belief
        What is known before.
    """
    spots_m = belief.pointing.spots_m(mirror_rad)
    start = _unknowns(belief.legs, belief.pointing)
    prior = _prior(belief, mirror_rad)

    def arrivals_s(unknowns: Unknowns) -> NDArray[np.float64]:
        real_m = _mirror(unknowns, belief).spots_m(mirror_rad)
        path_m = _distance_m(real_m, unknowns[_PIVOT]) + _distance_m(real_m, unknowns[_DETECTOR])
        return (unknowns[_DELAY] + path_m) / C_M_PER_S

    def residuals(unknowns: Unknowns) -> NDArray[np.float64]:
        return np.concatenate([(arrival_s - arrivals_s(unknowns)) / error_s, prior(unknowns)])

    def rectified_s(unknowns: Unknowns) -> NDArray[np.float64]:
        real_m = _mirror(unknowns, belief).spots_m(mirror_rad)
        back_m = _distance_m(detector_spot_m[None], unknowns[_DETECTOR])
        return (unknowns[_DELAY] + _distance_m(real_m, unknowns[_PIVOT]) + back_m) / C_M_PER_S

    start[_DELAY] += C_M_PER_S * float(np.median(arrival_s - arrivals_s(start)))
    near = least_squares(residuals, start, x_scale="jac").x  # a robust search from far away may get stuck
    found = least_squares(residuals, near, loss="huber", f_scale=ROBUST_FROM, x_scale="jac")
    left, slopes = residuals(found.x)[: len(arrival_s)], found.jac[: len(arrival_s)]
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    freedom = len(left) - float(np.einsum("ni,ij,nj->", slopes, covariance, slopes))
    chi2 = float((left**2).sum() / max(freedom, 1.0))
    covariance = covariance * max(chi2, 1.0)
    legs = PathDelays(found.x[_PIVOT], found.x[_DETECTOR], float(found.x[_DELAY]) / C_M_PER_S)
    by_unknown = _slopes(rectified_s, found.x)
    # a scan puts the spots where the model has them: what the arrivals move them by stays an error of its own
    remains_s = rectified_s(found.x) - legs.delay_s(spots_m, detector_spot_m[None])
    variance = np.einsum("ni,ij,nj->n", by_unknown, covariance, by_unknown) + remains_s**2
    return LegsFit(
        legs=legs,
        delay_error_s=float(np.sqrt(covariance[_DELAY, _DELAY])) / C_M_PER_S,
        rectified_error_s=np.asarray(np.sqrt(variance)),
        spots_m=spots_m[:, :2],
        residual_s=left * error_s,
        chi2=chi2,
        moved_m=(_mirror(found.x, belief).spots_m(mirror_rad) - spots_m)[:, :2],
    )


def _distance_m(spots_m: NDArray[np.float64], head_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(spots_m - head_m, axis=1))


def _unknowns(legs: PathDelays, pointing: Pointing) -> Unknowns:
    mirror = (pointing.mirror_m, pointing.rotation_rad, pointing.offset_rad, pointing.gain)
    return np.concatenate([[legs.electronics_delay_s * C_M_PER_S], legs.detector_head_m, *mirror])


def _mirror(unknowns: Unknowns, belief: Belief) -> Pointing:
    pivot, turn, offset, gain = (
        tuple(unknowns[part].tolist()) for part in (_PIVOT, _TURN, slice(10, 12), slice(12, 14))
    )
    return replace(belief.pointing, mirror_m=pivot, rotation_rad=turn, offset_rad=offset, gain=gain)


def _prior(belief: Belief, mirror_rad: NDArray[np.float64]) -> Callable[[Unknowns], NDArray[np.float64]]:
    """Return a function that gives the residuals, in standard errors, of unknowns from what is known of them.

    Detector, pivot and rotation of the mount are turned together where the wall is tilted. A calibrated model
    tells of its parameters what its spots, with equal errors, told it.
    """
    configured = _unknowns(belief.legs, belief.nominal)
    placed = np.r_[1:4, _PIVOT, _TURN]
    turns = np.concatenate(
        [np.cross(np.eye(3), configured[_DETECTOR]), np.cross(np.eye(3), configured[_PIVOT]), np.eye(3)],
        axis=1,
    )
    alone = np.repeat([TAPE_ERROR_M, TAPE_ERROR_M, TURN_ERROR_RAD], 3) ** 2
    root = np.linalg.cholesky(np.linalg.inv(np.diag(alone) + TILT_ERROR_RAD**2 * turns.T @ turns)).T
    rest = np.repeat([OFFSET_ERROR_RAD, GAIN_ERROR], 2)
    measured: NDArray[np.float64] = np.zeros((0, 10))
    if belief.calibrated is not None and belief.spot_error_m is not None:
        at = _unknowns(belief.legs, belief.calibrated)

        def spots(unknowns: Unknowns) -> NDArray[np.float64]:
            return _mirror(unknowns, belief).spots_m(mirror_rad)[:, :2].ravel()

        each_m = max(belief.spot_error_m, LEAST_SPOT_ERROR_M) * np.sqrt(len(mirror_rad) / 10)
        measured = np.asarray(np.linalg.qr(_slopes(spots, at)[:, _MIRROR] / each_m, mode="r"))
    calibrated = _unknowns(belief.legs, belief.pointing)[_MIRROR]

    def residuals(unknowns: Unknowns) -> NDArray[np.float64]:
        away = unknowns - configured
        return np.concatenate(
            [
                [away[_DELAY] / (DELAY_ERROR_S * C_M_PER_S)],
                root @ away[placed],
                away[_REST] / rest,
                measured @ (unknowns[_MIRROR] - calibrated),
            ]
        )

    return residuals


def _slopes(
    function: Callable[[Unknowns], NDArray[np.float64]], unknowns: Unknowns, step: float = 1e-6
) -> NDArray[np.float64]:
    """(N, unknowns) by central differences."""
    nudges = step * np.eye(len(unknowns))
    return np.stack([function(unknowns + by) - function(unknowns - by) for by in nudges], axis=1) / (2 * step)
