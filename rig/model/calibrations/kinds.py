"""The kinds of calibrations, and what each found. Standard errors are named after what they belong to."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rig.model.calibrations.base import Calibration
from rig.model.delays import PathDelays
from rig.model.pointing import Pointing

Point = tuple[float, float, float]


class TimeZero(Calibration):
    """When the pulse is on the wall.

    A first bounce arrives at delay + |x_p - laser head| / c + |x_p - detector head| / c.
    """

    kind: ClassVar[str] = "time-zero"
    belongs_to: ClassVar[tuple[str, ...]] = ("galvo", "laser", "spad", "tcspc")

    electronics_delay_s: float
    electronics_delay_error_s: float
    laser_head_m: Point
    detector_head_m: Point
    detector_spot_m: Point
    rectified_error_s: float
    """Standard error of the rectified time of a position, the median over those measured."""
    rectified_error_worst_s: float
    """The largest of them."""
    residual_s: float | None
    """Root mean square of the residuals of the fit; None if one target was used with all positions
    together."""
    chi2: float
    """Mean square of the residuals in units of their standard errors: about 1 if the model is right."""
    positions: int
    drift_per_minute_s: float | None
    """By how much arrivals come later with each minute; None where it was not measured."""
    drift_per_minute_error_s: float | None
    spots_m: list[tuple[float, float]]
    residuals_s: list[float]
    """Assumed places of the spots, visit after visit, and the residual of the fit at each."""

    @property
    def legs(self) -> PathDelays:
        """The ways and delays to subtract from recorded times."""
        return PathDelays(
            np.array(self.laser_head_m), np.array(self.detector_head_m), self.electronics_delay_s
        )


class MirrorLag(Calibration):
    """By how much a mirror that moves trails its command."""

    kind: ClassVar[str] = "lag"
    belongs_to: ClassVar[tuple[str, ...]] = ("galvo", "point_clock")

    lag_s: float = Field(ge=0, le=1)
    lag_error_s: float
    point_s: float
    """Time of a point,"""
    speed_m_per_s: float
    """and speed of the spot along the lines, with which it was measured."""
    chi2: float
    """Mean square of the residuals in units of their standard errors: about 1 if one lag explains all."""
    positions: int
    after_s: list[float]
    lag_after_s: list[float]
    """At these times after the first point of a line: the lag by itself, the traces of turns in it,"""
    lag_after_error_s: list[float]
    """and its standard error."""


class GalvoModel(Calibration):
    """Where the beam meets the wall for each command, see `rig.model.pointing.Pointing`."""

    kind: ClassVar[str] = "galvo"
    belongs_to: ClassVar[tuple[str, ...]] = ("galvo",)

    method: Literal["cameras", "flight"]
    mirror_m: Point
    rotation_rad: Point
    offset_rad: tuple[float, float]
    gain: tuple[float, float]
    incidence_rad: tuple[float, float] = (0.0, 0.0)
    mirrors: Literal[1, 2]
    separation_m: float
    area_m: list[tuple[float, float]]
    covariance: tuple[tuple[float, ...], ...] = ()
    """(12, 12) of mirror_m, rotation_rad, offset_rad, gain and incidence_rad, in this order; see
    `rig.calibrate.galvo.mirror.spot_covariances_m2`. Older ones are (10, 10), without incidence_rad; empty
    where not known."""
    spot_error_m: float
    """Standard error of a spot that the model predicts, root mean square over those measured."""
    residual_m: float
    """Root mean square distance between measured and modelled spots (by flight, of the marks)."""
    positions: int
    mirror_rad: tuple[tuple[float, float], ...] = ()
    """Commanded angles at which spots were measured,"""
    spots_m: tuple[tuple[float, float], ...] = ()
    """and these spots (x, y); by flight, the marks."""
    detector_head_m: Point | None = None
    """By flight, the detector that fits along with the mirror,"""
    electronics_delay_s: float | None = None
    """and the delay; scans do not use them, see `TimeZero`."""

    def pointing(self) -> Pointing:
        """Return the model; it refuses spots outside the calibrated area."""
        return Pointing(
            mirror_m=self.mirror_m,
            rotation_rad=self.rotation_rad,
            offset_rad=self.offset_rad,
            gain=self.gain,
            incidence_rad=self.incidence_rad,
            mirrors=self.mirrors,
            separation_m=self.separation_m,
            area_m=tuple(self.area_m),
        )


class Response(Calibration):
    """The response of the whole system to a pulse."""

    kind: ClassVar[str] = "irf"
    belongs_to: ClassVar[tuple[str, ...]] = ("laser", "spad", "tcspc")

    fwhm_s: float
    fwhm_error_s: float
    core_fwhm_s: float
    """Full width at half maximum of the Gaussian core alone."""
    centroid_s: float
    """Mean of the response after its peak."""
    tail_s: float
    """Time constant of its exponential tail."""
    tail_error_s: float
    tail_fraction: float
    """Part of the detections in that tail."""
    tail_fraction_error: float
    counts: int
    chi2: float
    """Mean square of the residuals in units of their standard errors: about 1 if the shape is right."""
    time_s: list[float]
    response: list[float]
    """The measured response at ``time_s`` about its peak, area 1 [1/s]."""


class DarkRates(Calibration):
    """What the detector counts without laser light, and what each avalanche leaves behind."""

    kind: ClassVar[str] = "dark"
    belongs_to: ClassVar[tuple[str, ...]] = ("spad",)

    dark_hz: float
    """Counts a second of the covered detector while it is ready, afterpulses subtracted."""
    dark_error_hz: float
    ambient_hz: float
    """Counts a second that are added when the detector is uncovered."""
    ambient_error_hz: float
    afterpulse_probability: float
    """Probability that an avalanche leaves a trapped carrier; 0 if no afterpulses were seen."""
    afterpulse_probability_error: float
    afterpulse_decay_s: float | None
    """Mean time until the carrier is released; None if no afterpulses were seen."""
    afterpulse_decay_error_s: float | None
    chi2_per_bin: float
    """Chi-square a bin of the fit to the afterpulses; 1 if the model leaves only counting noise."""
    hold_off_s: list[float]
    after_hold_off: list[float]
    """Measured probability that a carrier outlasts each of these hold-offs."""
    after_hold_off_error: list[float]


class GateOpening(Calibration):
    """When to open the gate."""

    kind: ClassVar[str] = "gate"
    belongs_to: ClassVar[tuple[str, ...]] = ("laser", "spad")

    gate_delay_s: float
    """Earliest opening that blocks the first bounce wherever it can be blocked."""
    gate_delay_error_s: float
    gate_width_s: float
    nearest_m: float
    """Distance from the wall of the nearest object whose light must be kept."""
    passed: float
    """Part of the first bounce that still passes where it is blocked latest."""
    edge_s: float
    """Time that the gate takes from 20 to 80 %."""
    edge_error_s: float
    offset_s: float
    """Delay of the half open gate less the recorded arrival of the light that it halves."""
    residual: float
    """Root mean square of the residuals of the fitted edge, in standard errors."""
    spots_m: list[tuple[float, float]]
    earliest_s: list[float | None]
    """Earliest opening at each of these spots; None where there is none that keeps the nearest object."""
    latest_s: list[float]
    """Latest opening at each of these spots that keeps the nearest object."""
    failed: list[bool]
    """Where the first bounce passes the closed gate."""


class BinWidths(Calibration):
    """Real widths of the timing instrument's bins."""

    kind: ClassVar[str] = "dnl"
    belongs_to: ClassVar[tuple[str, ...]] = ("tcspc",)
    bulky: ClassVar[tuple[str, ...]] = ("measured",)

    bin_width_s: float
    first_bin_s: float
    measured: list[float | None]
    """(bins,) width of each bin as counted, in mean bin widths; None where the sync period ends before the
    bin."""
    counts_per_bin: float
    """Number of counts with which each width was measured."""
    nonlinearity: float
    """Root mean square of the real widths' deviations from 1: as counted, counting noise subtracted."""
    nonlinearity_at_most: float
    """Its upper limit at two standard errors."""
    kept: float
    """Part of a counted deviation that is real, S / (S + N): S is the variance of the real widths,
    N that of counting them."""

    @property
    def noise(self) -> float:
        """Standard deviation of a counted width by counting alone."""
        return self.counts_per_bin**-0.5

    @property
    def widths(self) -> NDArray[np.float64]:
        """(bins,) best estimate of each width: as counted but shrunk towards 1; 1 where not measured."""
        counted = np.array([1.0 if width is None else width for width in self.measured])
        return 1 + self.kept * (counted - 1)


KINDS: dict[str, type[Calibration]] = {
    each.kind: each for each in (GalvoModel, TimeZero, MirrorLag, Response, DarkRates, GateOpening, BinWidths)
}
"""By name, in the order in which they are measured: each may build on those before it."""
