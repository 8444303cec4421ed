"""The response of the whole system to a pulse, from first bounces put on top of each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import approx_fprime, brentq, minimize_scalar

from rig.calibrate import Floats, figures, require
from rig.calibrate.raw import origin, reading
from rig.calibrate.timing.first_bounce import FirstBounceRoutine, first_bounces
from rig.calibrate.timing.peaks import FWHM_PER_SIGMA, Emg, Peaks
from rig.model.calibrations.kinds import Response
from rig.model.quantities import show
from rig.model.state import RigState

#: Fewest counts in all peaks together: the width is then known to half a per cent or so.
MIN_COUNTS = 10_000
#: Where the shape fits worse, it is another one.
MAX_CHI2 = 1.5
#: The response is sampled as far from its peak.
SAMPLED_S = (-0.3e-9, 0.7e-9)


@dataclass(frozen=True)
class ResponseRoutine(FirstBounceRoutine[Response]):
    """Measures first bounces at a few places of the wall for a while."""

    columns: int = 5
    rows: int = 4
    exposure_s: float = 0.5

    makes, files = Response, ("irf.h5",)

    def fit(self, files: Sequence[Path], state: RigState) -> Response:
        """Return width and tail.

        The width is that of the fitted shape, whose integrals over the bins were compared with the counts: so
        a bin's width is in neither it nor its error.
        """
        with reading(files, whole=False) as (scans, passes):
            best = max(map(first_bounces, passes), key=lambda one: float(one.counts.sum()))
            origins = origin(Response, scans)
        counts, shape = float(best.counts.sum()), best.shape
        require(
            counts >= MIN_COUNTS,
            f"{files[0]}: {counts:.0f} counts in all peaks together are too few for a response, {MIN_COUNTS} "
            "are needed: measure longer, or at more positions",
        )
        slopes = width_slopes(shape)
        variance = max(best.chi2, 1.0) * slopes @ best.shape_covariance @ slopes
        time_s, response = stacked(best)
        return Response(
            **origins,
            valid_days=365,
            fwhm_s=width_s(shape),
            fwhm_error_s=float(np.sqrt(variance)),
            core_fwhm_s=FWHM_PER_SIGMA * shape.sigma_s,
            centroid_s=shape.tail_s * shape.tail_fraction - peak_s(shape),
            tail_s=shape.tail_s,
            tail_error_s=best.shape_error.tail_s,
            tail_fraction=shape.tail_fraction,
            tail_fraction_error=best.shape_error.tail_fraction,
            counts=round(counts),
            chi2=best.chi2,
            time_s=[round(at_s, 15) for at_s in (time_s - peak_s(shape)).tolist()],
            response=[float(f"{value:.6g}") for value in response],
            warnings=[
                f"a Gaussian core with an exponential tail does not describe the response (chi^2 "
                f"{best.chi2:.1f} a bin): check the picture before you use the width"
            ]
            * (best.chi2 > MAX_CHI2),
        )

    def figure(self, files: Sequence[Path], found: Response) -> Figure:
        """Draw the response with its fit on a logarithmic scale, and what the fit leaves."""
        shape = Emg(found.core_fwhm_s / FWHM_PER_SIGMA, found.tail_s, found.tail_fraction)
        time_s, response = np.array(found.time_s), np.array(found.response)
        fine_s = np.linspace(time_s[0], time_s[-1], 1500)
        top_s = found.tail_s * found.tail_fraction - found.centroid_s
        curve = shape.density(fine_s + top_s) * 1e-12
        figure, axes = figures.panels(
            f"response: {found.counts:,} counts, tail of {show(found.tail_s, 's', 3)} in "
            f"{100 * found.tail_fraction:.1f} %",
            [["response"], ["residual"]], (9, 6), sharex=True, height_ratios=(3, 1),
        )  # fmt: skip
        above, below = axes["response"], axes["residual"]
        above.plot(time_s * 1e12, response * 1e-12, ".", color=figures.RED, markersize=4, label="measured")
        above.plot(fine_s * 1e12, curve, color=figures.BLUE, linewidth=1.2, label="core and tail")
        half = curve.max() / 2
        inside_ps = fine_s[curve >= half] * 1e12
        above.plot(inside_ps[[0, -1]], [half, half], color="0.2", linewidth=1)
        width = f"{show(found.fwhm_s, 's', 4)} ± {show(found.fwhm_error_s, 's', 1)}"
        above.annotate(width, (inside_ps[-1], half), xytext=(8, -3), textcoords="offset points")
        above.set(ylabel="density (1/ps)", yscale="log", ylim=(curve.max() * 1e-5, curve.max() * 2))
        above.legend(frameon=False)
        residual = (response - shape.density(time_s + top_s)) * 1e-12 / curve.max() * 100
        figures.residuals(below, time_s * 1e12, residual, color=figures.RED, markersize=3)
        below.set(xlabel="time after the peak (ps)", ylabel="residual\n(% of the peak)")
        return figure


def peak_s(shape: Emg) -> float:
    """Return where a shape is highest, after its core's centre."""
    found = minimize_scalar(
        lambda at_s: -shape.density(np.array(at_s)),
        bounds=(-shape.sigma_s, shape.sigma_s),
        method="bounded",
        options={"xatol": 1e-18},
    )
    return float(found.x)


def width_s(shape: Emg) -> float:
    """Return the full width at half maximum of a shape."""
    top_s, far_s = peak_s(shape), 10 * shape.sigma_s + 10 * shape.tail_s
    half = shape.density(np.array(top_s)) / 2
    rising, falling = (
        brentq(lambda at_s: float(shape.density(np.array(at_s)) - half), top_s, end_s, xtol=1e-18)
        for end_s in (top_s - far_s, top_s + far_s)
    )
    return float(falling - rising)


def width_slopes(shape: Emg) -> Floats:
    """(3,) of the width by the shape's parameters."""
    values = np.array(list(vars(shape).values()))
    return approx_fprime(values, lambda at: width_s(Emg(*at.tolist())), 1e-4 * values)


def stacked(bounces: Peaks) -> tuple[Floats, Floats]:
    """Return times after the core's centre and the mean response there, area 1 [1/s].

    Each bin is shared by the two nearest samples, so that its time is kept; that blurs a sample by a bin's
    width. The background is taken off.
    """
    width = float(bounces.time_s[0, 1] - bounces.time_s[0, 0])
    first, last = (round(limit_s / width) for limit_s in SAMPLED_S)
    place = (bounces.time_s - bounces.centre_s[:, None]) / width - first
    net = bounces.observed / bounces.live - bounces.background[:, None]
    expected = np.broadcast_to(bounces.counts[:, None] * width, net.shape)
    found, possible = np.zeros((2, last - first + 1))
    below = np.floor(place).astype(np.int64)
    for sample, share in ((below, below + 1 - place), (below + 1, place - below)):
        inside = (sample >= 0) & (sample < len(found))
        np.add.at(found, sample[inside], (net * share)[inside])
        np.add.at(possible, sample[inside], (expected * share)[inside])
    response = np.divide(found, possible, out=np.zeros_like(found), where=possible > 0)
    return np.asarray(np.arange(first, last + 1) * width, dtype=np.float64), response
