"""The mirror's model from times of flight and a few marks: mirror, detector and delay fitted together.

A first bounce arrives at delay + |p - x| / c + |x - h| / c: pivot p, spot x(angles) on the wall, head h of
the detector. Where it arrives late, the spot is far out; marks say where it is at some angles for certain.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from recon.capture import C_M_PER_S
from rig.calibrate.galvo.lens import Floats
from rig.calibrate.galvo.model_fit import (
    MISSED,
    WIDTHS,
    FittedMirror,
    covariance_of_pointing,
    hull,
    mirror,
    rig_turn,
)
from rig.errors import CalibrationError
from rig.model.config import RigConfig

#: Standard deviations, before anything is measured, of the detector's place in the rig [m] and of the delay
#: [s].
HEAD_WIDTH_M, DELAY_WIDTH_S = 0.05, 10e-9
ALL_WIDTHS = np.array([*WIDTHS, *[HEAD_WIDTH_M] * 3, DELAY_WIDTH_S])
#: How well a person steers the beam onto a mark, along either axis [m].
AIMED_TO_M = 0.3e-3
#: What an arrival may be off besides its counting error: unequal bins and drift of the instrument [s].
INSTRUMENT_S = 1e-12
#: Fewest marks, fewest arrivals, and the least width of the marks across their longest line [m].
LEAST_MARKS, LEAST_ARRIVALS, LEAST_WIDTH_M = 4, 12, 0.2
#: Largest root mean square that the fit may leave of arrivals [s] and of marks [m].
WORST_ARRIVALS_S, WORST_MARKS_M = 20e-12, 5e-3
#: Beyond so many standard errors an arrival counts by its size, not its square (Huber).
ROBUST_FROM = 4.0


@dataclass(frozen=True)
class Marks:
    """Points on the wall onto which the beam was steered.

    Attributes
    ----------
    mark_m
        (M, 2) their x and y [m].
    mirror_rad
        (M, 2) the angles commanded there.
    """

    mark_m: Floats
    mirror_rad: Floats


@dataclass(frozen=True)
class FittedFlight:
    """What arrivals and marks say.

    Attributes
    ----------
    mirror
        The mirror's model; its residual is that of the marks.
    head_m, delay_s
        (3,) the detector's lens, and the electronics' delay, which stand in for each other in part.
    left_s
        (N,) what the fit leaves of each arrival.
    """

    mirror: FittedMirror
    head_m: Floats
    delay_s: float
    left_s: Floats


def fit_flight(
    angles_rad: Floats, arrival_s: Floats, error_s: Floats, marks: Marks, config: RigConfig
) -> FittedFlight:
    """Fit mirror, detector and delay to (N,) arrivals at (N, 2) commanded angles, and to marks.

    Raises
    ------
    CalibrationError
        If there are too few arrivals or marks, or no such rig makes them.
    """
    _refuse_few(arrival_s, marks)
    sigma_s = np.hypot(error_s, INSTRUMENT_S)
    count = len(arrival_s)

    def left_s(numbers: Floats) -> Floats:
        pointing = mirror(numbers, config)
        spots_m = pointing.spots_m(angles_rad)
        head_m, delay_s = head_and_delay(numbers, config)
        path_m = np.linalg.norm(spots_m - pointing.mirror_m, axis=1) + np.linalg.norm(
            spots_m - head_m, axis=1
        )
        return np.asarray(arrival_s - delay_s - path_m / C_M_PER_S)

    def off_m(numbers: Floats) -> Floats:
        return mirror(numbers, config).spots_m(marks.mirror_rad)[:, :2] - marks.mark_m

    def residuals(numbers: Floats) -> Floats:
        measured = np.concatenate([left_s(numbers) / sigma_s, off_m(numbers).ravel() / AIMED_TO_M])
        return np.concatenate([np.nan_to_num(measured, nan=MISSED), numbers / ALL_WIDTHS])

    start = np.zeros(len(ALL_WIDTHS))
    for loss in ("linear", "huber"):  # strays are told from the rest once the rest nearly fits
        fit = least_squares(
            residuals,
            start,
            x_scale=ALL_WIDTHS,
            xtol=1e-9,
            ftol=1e-9,
            gtol=1e-9,
            loss=loss,
            f_scale=ROBUST_FROM,
        )
        start = fit.x
    left, off = left_s(fit.x), off_m(fit.x)
    rms_s, rms_m = float(np.sqrt((left**2).mean())), float(np.sqrt((off**2).sum(axis=1).mean()))
    if not (rms_s < WORST_ARRIVALS_S and rms_m < WORST_MARKS_M):
        worst = int(np.abs(left).argmax())
        raise CalibrationError(
            f"no rig as configured fits the data: {rms_s * 1e12:.1f} ps are left of the arrivals (root mean "
            f"square; the worst is position {worst}) and {rms_m * 1e3:.1f} mm of the marks. Are the marks "
            "right, in metres from the wall's centre? Was something moved meanwhile? Are galvo.position and "
            "spad.position right to a few centimetres?"
        )
    pointing = mirror(fit.x, config)
    # each number that is measured rather than believed costs one arrival
    excess = max(1.0, float((fit.fun[:count] ** 2).sum()) / max(count - 8, 1))
    covariance = covariance_of_pointing(fit.x, np.linalg.inv(fit.jac.T @ fit.jac), config) * excess
    everywhere = np.concatenate([angles_rad, marks.mirror_rad])
    head_m, delay_s = head_and_delay(fit.x, config)
    return FittedFlight(
        FittedMirror(replace(pointing, area_m=hull(pointing, everywhere)), covariance, rms_m),
        head_m,
        delay_s,
        left,
    )


def head_and_delay(numbers: Floats, config: RigConfig) -> tuple[Floats, float]:
    """Return the detector's place (3,) [m] and the delay [s] for the (16,) numbers of `ALL_WIDTHS`."""
    head_m = rig_turn(numbers).apply(np.add(config.detector.position_m, numbers[12:15]))
    return head_m, config.timing.electronics_delay_s + float(numbers[15])


def _refuse_few(arrival_s: Floats, marks: Marks) -> None:
    if len(arrival_s) < LEAST_ARRIVALS:
        raise CalibrationError(
            f"{len(arrival_s)} arrivals are too few, {LEAST_ARRIVALS} are needed: scan more positions"
        )
    if len(marks.mark_m) < LEAST_MARKS:
        raise CalibrationError(
            f"{len(marks.mark_m)} marks are too few, {LEAST_MARKS} are needed: without them times of flight "
            "leave the spots open by turns of the mirror"
        )
    width_m = np.linalg.svd(marks.mark_m - marks.mark_m.mean(axis=0), compute_uv=False)[1]
    if width_m < LEAST_WIDTH_M:
        raise CalibrationError(
            "the marks lie nearly on one line: spread them over the wall, best to the corners of the scan"
        )
