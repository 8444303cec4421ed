"""A sweep of the gate's delay, read and reduced: when light arrives, and how much each delay lets pass."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.calibrate.counts import counts_of, period_s, settings_of
from rig.calibrate.gate_edge import Edge, fit_edge
from rig.errors import CalibrationError
from rig.files.scan import ScanPass
from rig.model.delays import PathDelays
from rig.model.quantities import show

#: Counts this near to the first bounce's arrival are its own: the response is 65 ps wide, and its tail has
#: died.
ABOUT_S = 250e-12
#: The middle of these is an arrival: a tail outside it does not count.
CORE_S = 120e-12
#: Least counts of a first bounce through the open gate.
LEAST_COUNTS = 100
#: Detections a pulse above which the first of each gate hides the others.
CROWDED = 0.2
#: What passes a closed gate where it fails; and how sure that has to be [standard errors].
FAILS_ABOVE, SURE = 0.02, 4.0
#: Degrees of the polynomial that corrects arrivals, and the positions that each needs: twice its terms.
DEGREES = ((3, 20), (2, 12), (1, 6))


@dataclass(frozen=True)
class Sweep:
    """First bounces at P positions and D delays.

    Attributes
    ----------
    spots_m
        (P, 3) where the laser was sent.
    arrival_s, arrival_error_s
        (P,) recorded arrivals of the first bounce.
    delays_s
        (D,) of the gate, as the detector said itself.
    part
        (D, P) first-bounce counts by those through the open gate.
    whole
        (P,) these, for the sweep's exposure.
    failed
        (P,) where the closed gate lets the first bounce pass.
    edge
        Fitted to all but these.
    """

    spots_m: NDArray[np.float64]
    arrival_s: NDArray[np.float64]
    arrival_error_s: NDArray[np.float64]
    delays_s: NDArray[np.float64]
    part: NDArray[np.float64]
    whole: NDArray[np.float64]
    failed: NDArray[np.bool_]
    edge: Edge

    @property
    def late_s(self) -> NDArray[np.float64]:
        """(D, P) delay less arrival."""
        return self.delays_s[:, None] - self.arrival_s


def arrivals(wide: ScanPass) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (P,) arrivals of first bounces in the file's time, their errors, and their counts.

    Raises
    ------
    CalibrationError
        If some position has too few counts, or the detector sees too much light.
    """
    histograms = counts_of(wide)
    pulses = wide.live_time_s / period_s(settings_of(wide))
    crowd = float(np.median(histograms.sum(axis=1) / pulses))
    if crowd > CROWDED:
        raise CalibrationError(
            f"{wide.label}: {crowd:.2f} detections a pulse through the open gate, so the first hide the "
            f"others (saturated; {CROWDED:g} are the most). Attenuate the beam more and measure again"
        )
    centres_s = _centres_s(wide)
    size = max(round(100e-12 / wide.time_axis[1]), 1)
    smooth = np.apply_along_axis(np.convolve, 1, histograms, np.ones(size), "same")
    peak_s = centres_s[smooth.argmax(axis=1)]
    for _ in range(5):
        core = np.abs(centres_s - peak_s[:, None]) < CORE_S
        number = np.maximum((histograms * core).sum(axis=1), 1)
        peak_s = (histograms * core * centres_s).sum(axis=1) / number
    spread = ((centres_s - peak_s[:, None]) ** 2 * histograms * core).sum(axis=1) / number
    whole = first_bounce_counts(histograms, centres_s, peak_s)
    if whole.min() < LEAST_COUNTS:
        position = int(whole.argmin())
        raise CalibrationError(
            f"{wide.label}: only {whole[position]:.0f} counts of the first bounce through the open gate at "
            f"position {position}, {LEAST_COUNTS} are the least: expose longer, attenuate less, or check "
            "that the beam is not blocked"
        )
    return peak_s, np.sqrt(spread / number), whole


def first_bounce_counts(
    histograms: NDArray[np.float64], centres_s: NDArray[np.float64], arrival_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (P,) counts about the arrivals."""
    return (histograms * (np.abs(centres_s - arrival_s[:, None]) < ABOUT_S)).sum(axis=1)


def read_sweep(scans: Sequence[ScanPass], sigma_s: float) -> Sweep:
    """Read a sweep, whatever the order of its passes, and fit its edge.

    Parameters
    ----------
    scans
        The one with the widest gate is the open one.
    sigma_s
        Standard deviation of the laser's pulse.

    Raises
    ------
    CalibrationError
        If it is no sweep over one grid, or does not show the edge.
    """
    gates = [_gate(scan) for scan in scans]
    widest = int(np.argmax([width_s for _, width_s in gates]))
    wide, others = scans[widest], [scan for i, scan in enumerate(scans) if i != widest]
    if len(others) < 5:
        raise CalibrationError(
            f"{wide.label} and {len(others)} others: a sweep is one pass with the gate wide open and five or "
            "more at other delays"
        )
    delays_s = np.array([delay_s for i, (delay_s, _) in enumerate(gates) if i != widest])
    arrival_s, error_s, open_counts = arrivals(wide)
    centres_s = _centres_s(wide)
    part = []
    for scan in others:
        if scan.laser_m.shape != wide.laser_m.shape or not np.allclose(scan.laser_m, wide.laser_m):
            raise CalibrationError(
                f"{scan.label} has other positions than {wide.label}: give files of one sweep"
            )
        if scan.time_axis != wide.time_axis:
            raise CalibrationError(f"{scan.label} has other bins than {wide.label}: give files of one sweep")
        counts = first_bounce_counts(counts_of(scan), centres_s, arrival_s)
        part.append(counts / scan.live_time_s / (open_counts / wide.live_time_s))
    order = np.argsort(delays_s)
    parts, delays_s = np.array(part)[order], delays_s[order]
    failed, edge = _edge(wide.label, delays_s, parts, arrival_s, open_counts, sigma_s)
    return Sweep(wide.laser_m, arrival_s, error_s, delays_s, parts, open_counts, failed, edge)


def smooth_arrivals(
    sweep: Sweep, spots_m: NDArray[np.float64], legs: PathDelays
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return arrivals anywhere on the wall, and their standard errors.

    Straight ways mirror, spot, lens, as far as their places are known; what these leave is smooth, and is
    taken as a polynomial in x and y.

    Raises
    ------
    CalibrationError
        If there are too few positions.
    """
    if len(sweep.spots_m) < DEGREES[-1][1]:
        raise CalibrationError(f"{len(sweep.spots_m)} positions are too few: use a finer grid (--columns)")
    degree = next(degree for degree, least in DEGREES if len(sweep.spots_m) >= least)
    there_s = [_straight_s(spots, legs) for spots in (sweep.spots_m, spots_m)]
    measured, wanted = (_powers(spots, degree) for spots in (sweep.spots_m, spots_m))
    error = np.maximum(sweep.arrival_error_s, 1e-13)
    weighted = measured / error[:, None]
    left = (sweep.arrival_s - there_s[0]) / error
    coefficients, *_ = np.linalg.lstsq(weighted, left, rcond=None)
    chi2 = float(((left - weighted @ coefficients) ** 2).sum() / (len(left) - measured.shape[1]))
    covariance = np.linalg.pinv(weighted.T @ weighted) * max(chi2, 1.0)
    error_s = np.sqrt(np.einsum("pi,ij,pj->p", wanted, covariance, wanted))
    return there_s[1] + wanted @ coefficients, error_s


def nearest_after_s(
    spots_m: NDArray[np.float64], legs: PathDelays, detector_spot_m: Sequence[float], nearest_m: float
) -> NDArray[np.float64]:
    """Return how long after the first bounce light of an object so far from the wall comes, at the earliest.

    The shortest way from spot to spot over a plane at the distance z is that of a mirror there, sqrt(d^2 + 4
    z^2). The way to the mirror is common; back, the first bounce goes straight from the laser spot to the
    lens, hidden light by way of the detector's spot.
    """
    detector_m = np.asarray(detector_spot_m, dtype=float)
    apart_m = np.linalg.norm(spots_m - detector_m, axis=1)
    hidden_m = np.sqrt(apart_m**2 + 4 * nearest_m**2) + np.linalg.norm(detector_m - legs.detector_head_m)
    straight_m = np.linalg.norm(spots_m - legs.detector_head_m, axis=1)
    return (hidden_m - straight_m) / C_M_PER_S


def _straight_s(spots_m: NDArray[np.float64], legs: PathDelays) -> NDArray[np.float64]:
    there_m = np.linalg.norm(spots_m - legs.laser_head_m, axis=1)
    back_m = np.linalg.norm(spots_m - legs.detector_head_m, axis=1)
    return legs.electronics_delay_s + (there_m + back_m) / C_M_PER_S


def _powers(spots_m: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    x, y = spots_m[:, 0], spots_m[:, 1]
    return np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


def _centres_s(scan: ScanPass) -> NDArray[np.float64]:
    """Return (bins,) times in the file's time."""
    bins, width_s, first_s = scan.time_axis
    return np.asarray(first_s + (np.arange(bins) + 0.5) * width_s, dtype=float)


def _gate(scan: ScanPass) -> tuple[float, float]:
    """Return delay and width of the gate, as the detector said itself."""
    settings = settings_of(scan).detector
    if not settings.gated:
        raise CalibrationError(
            f"{scan.label} was measured without the gate: give files of a sweep of its delay"
        )
    said = scan.devices.get("spad", {})
    delay_s, width_s = (
        float(said.get(name, getattr(settings, name))) for name in ("gate_delay_s", "gate_width_s")
    )
    return delay_s, width_s


def _edge(
    name: str,
    delays_s: NDArray[np.float64],
    part: NDArray[np.float64],
    arrival_s: NDArray[np.float64],
    whole: NDArray[np.float64],
    sigma_s: float,
) -> tuple[NDArray[np.bool_], Edge]:
    """Return where the gate fails, and the edge at all other positions."""
    late_s = delays_s[:, None] - arrival_s
    # at the latest delay the gate is closed everywhere, or nowhere
    left = part[-1]
    failed = left > FAILS_ABOVE + SURE * np.sqrt(left / whole + 1 / whole**2)
    if failed.sum() > len(failed) / 2:
        raise CalibrationError(
            f"{name}: {100 * np.median(left):.0f} % of the first bounce still pass at the latest delay of "
            f"{show(delays_s[-1], 's', 4)}: the sweep does not reach the gate's edge. Give a larger "
            "--after; if that does not help, the gate does not follow the laser: check its sync input"
        )
    good = ~failed
    wholes = np.broadcast_to(whole, part.shape)
    try:
        edge = fit_edge(
            late_s[:, good].ravel(), (part * whole)[:, good].ravel(), wholes[:, good].ravel(), sigma_s
        )
    except ValueError as error:
        raise CalibrationError(
            f"{name}: the sweep from {show(delays_s[0], 's', 4)} to {show(delays_s[-1], 's', 4)} does not "
            f"show the gate's edge ({error}). Sweep further with --before and --after, or in finer steps"
        ) from None
    return failed, edge
