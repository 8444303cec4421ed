"""A sweep of the gate's delay, read and reduced: when light arrives, and how much each delay lets pass."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.calibrate import Floats, require
from rig.calibrate.gate.edge import Edge, fit_edge
from rig.calibrate.raw import Raw
from rig.calibrate.timing.first_bounce import first_bounces
from rig.calibrate.timing.peaks import Peaks
from rig.errors import CalibrationError
from rig.model.delays import PathDelays
from rig.model.quantities import show

#: Counts this near to the first bounce's arrival are its own: the response is 65 ps wide, and its tail has
#: died.
ABOUT_S = 250e-12
#: What passes a closed gate where it fails; and how sure that has to be [standard errors].
FAILS_ABOVE, SURE = 0.02, 4.0
#: Fewest delays of a sweep.
MIN_DELAYS = 5
#: Degrees of the polynomial that corrects arrivals, and the positions that each needs: twice its terms.
DEGREES = ((3, 20), (2, 12), (1, 6))


@dataclass(frozen=True)
class Sweep:
    """First bounces at P positions and D delays.

    Attributes
    ----------
    spots_m, arrival_s, arrival_error_s
        (P, 3) where the laser was sent, and (P,) recorded arrivals of the first bounce.
    delays_s
        (D,) of the gate, as the detector said itself.
    part, whole
        (D, P) first-bounce counts by (P,) those through the open gate.
    failed, edge
        (P,) where the closed gate lets the first bounce pass; and the edge, fitted to all others.
    """

    spots_m: Floats
    arrival_s: Floats
    arrival_error_s: Floats
    delays_s: Floats
    part: Floats
    whole: Floats
    failed: NDArray[np.bool_]
    edge: Edge

    @property
    def late_s(self) -> Floats:
        """(D, P) delay less arrival."""
        return self.delays_s[:, None] - self.arrival_s


def open_gate_bounces(wide: Raw) -> Peaks:
    """Return the first bounce of each of P positions through the wide open gate, all of them or none."""
    found = first_bounces(wide, gated=True)
    position = min(found.left_out, default=0)
    require(
        not found.left_out,
        f"{wide.label}: no first bounce at position {position}: {found.left_out.get(position)}",
    )
    return found


def read_sweep(passes: Sequence[Raw], sigma_s: float) -> Sweep:
    """Read a sweep, whatever the order of its passes, and fit its edge, met by a pulse of this sigma.

    The pass with the widest gate is the open one. Raises CalibrationError if it is no sweep over one grid, or
    does not show the edge.
    """
    for one in passes:
        require(
            one.config.detector.gated,
            f"{one.label} was measured without the gate: give files of a sweep of its delay",
        )
    wide, *others = sorted(passes, key=lambda one: -one.gate_width_s)
    others.sort(key=lambda one: one.gate_delay_s)
    require(
        len(others) >= MIN_DELAYS,
        f"{wide.label} and {len(others)} others: a sweep is one pass with the gate wide open and five or "
        "more at other delays",
    )
    bounces = open_gate_bounces(wide)
    for one in others:
        same = one.laser_m.shape == wide.laser_m.shape and np.allclose(one.laser_m, wide.laser_m)
        require(same, f"{one.label} has other positions than {wide.label}: give files of one sweep")
        axes = [(raw.bins, raw.bin_width_s, raw.first_bin_s) for raw in (one, wide)]
        require(axes[0] == axes[1], f"{one.label} has other bins than {wide.label}: give files of one sweep")
    about = np.abs(wide.centres_s - bounces.centre_s[:, None]) < ABOUT_S
    whole = (wide.counts * about).sum(axis=1)
    counts = np.array([(one.counts * about).sum(axis=1) / one.live_s for one in others])
    part = counts / (whole / wide.live_s)
    delays_s = np.array([one.gate_delay_s for one in others])
    failed, edge = _edge(wide.label, delays_s, part, bounces.centre_s, whole, sigma_s)
    return Sweep(wide.laser_m, bounces.centre_s, bounces.centre_error_s, delays_s, part, whole, failed, edge)


def smooth_arrivals(sweep: Sweep, spots_m: Floats, legs: PathDelays) -> tuple[Floats, Floats]:
    """Return arrivals anywhere on the wall, and their standard errors.

    Straight ways mirror, spot, lens, as far as their places are known; the residuals are smooth, and are
    taken as a polynomial in x and y.

    Raises CalibrationError if there are too few positions.
    """
    positions = len(sweep.spots_m)
    require(positions >= DEGREES[-1][1], f"{positions} positions are too few: use a finer grid (--columns)")
    degree = next(degree for degree, fewest in DEGREES if positions >= fewest)
    measured, wanted = (_powers(spots, degree) for spots in (sweep.spots_m, spots_m))
    error = np.maximum(sweep.arrival_error_s, 1e-13)
    weighted = measured / error[:, None]
    residual = (sweep.arrival_s - legs.delay_s(sweep.spots_m, sweep.spots_m)) / error
    coefficients, *_ = np.linalg.lstsq(weighted, residual, rcond=None)
    chi2 = float(((residual - weighted @ coefficients) ** 2).sum() / (positions - measured.shape[1]))
    covariance = np.linalg.pinv(weighted.T @ weighted) * max(chi2, 1.0)
    error_s = np.sqrt(np.einsum("pi,ij,pj->p", wanted, covariance, wanted))
    return legs.delay_s(spots_m, spots_m) + wanted @ coefficients, error_s


def nearest_after_s(
    spots_m: Floats, legs: PathDelays, detector_spot_m: Sequence[float], nearest_m: float
) -> Floats:
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


def _powers(spots_m: Floats, degree: int) -> Floats:
    x, y = spots_m[:, 0], spots_m[:, 1]
    return np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


def _edge(
    name: str, delays_s: Floats, part: Floats, arrival_s: Floats, whole: Floats, sigma_s: float
) -> tuple[NDArray[np.bool_], Edge]:
    """Return where the gate fails, and the edge at all other positions."""
    late_s = delays_s[:, None] - arrival_s
    last = part[-1]  # at the latest delay the gate is closed everywhere, or nowhere
    failed = last > FAILS_ABOVE + SURE * np.sqrt(last / whole + 1 / whole**2)
    require(
        failed.sum() <= len(failed) / 2,
        f"{name}: {100 * np.median(last):.0f} % of the first bounce still pass at the latest delay of "
        f"{show(delays_s[-1], 's', 4)}: the sweep does not reach the gate's edge. Give a larger --after; if "
        "that does not help, the gate does not follow the laser: check its sync input",
    )
    good = ~failed
    wholes = np.broadcast_to(whole, part.shape)
    try:
        late_s, counts, whole = (each[:, good].ravel() for each in (late_s, part * whole, wholes))
        return failed, fit_edge(late_s, counts, whole, sigma_s)
    except ValueError as error:
        raise CalibrationError(
            f"{name}: the sweep from {show(delays_s[0], 's', 4)} to {show(delays_s[-1], 's', 4)} does not "
            f"show the gate's edge ({error}). Sweep further with --before and --after, or in finer steps"
        ) from None
