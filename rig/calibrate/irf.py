"""The response of the whole system to a pulse, from first bounces put on top of each other."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from rig.acquire.acquisition import Watch
from rig.acquire.connect import Station
from rig.calibrate import peaks
from rig.calibrate.first_bounce import FirstBounces, first_bounces, free_running, record_first_bounces
from rig.calibrate.routine import Routine, origin
from rig.errors import CalibrationError
from rig.files.scan import ScanFile
from rig.model.calibrations.kinds import Response
from rig.model.config import RigConfig
from rig.model.state import RigState

#: Fewest counts in all peaks together: the width is then known to half a per cent or so.
FEWEST_COUNTS = 10_000
#: Where the shape fits worse, it is another one.
LARGEST_CHI2 = 1.5
#: The response is sampled as far from its peak.
SAMPLED_S = (-0.3e-9, 0.7e-9)


@dataclass(frozen=True)
class ResponseRoutine(Routine[Response]):
    """Measures first bounces at a few places of the wall for a while."""

    columns: int = 5
    rows: int = 4
    exposure_s: float = 0.5

    makes = Response

    def setup(self, config: RigConfig) -> RigConfig:
        """Return the detector free running, and a histogram of the whole period."""
        return free_running(config)

    def measure(self, station: Station, state: RigState, folder: Path, watch: Watch) -> list[Path]:
        """Record first bounces, the laser attenuated."""
        path = folder / "irf.h5"
        record_first_bounces(
            station,
            state,
            path,
            watch,
            columns=self.columns,
            rows=self.rows,
            exposure_s=self.exposure_s,
        )
        return [path]

    def fit(self, files: Sequence[Path], state: RigState) -> Response:
        """Return width and tail.

        The width is that of the fitted shape, whose integrals over the bins were compared with the counts: so
        a bin's width is in neither it nor its error.
        """
        with ExitStack() as stack:
            scans = [stack.enter_context(ScanFile(path)) for path in files]
            bounces = [first_bounces(scan) for scan in scans]
            origins = origin(Response, scans)
        best = max(bounces, key=lambda one: float(one.counts.sum()))
        counts = float(best.counts.sum())
        if counts < FEWEST_COUNTS:
            raise CalibrationError(
                f"{files[0]}: {counts:.0f} counts in all peaks together are too few for a response, "
                f"{FEWEST_COUNTS} are needed: measure longer, or at more positions"
            )
        fwhm_s, slopes = width_s(best.shape), width_slopes(best.shape)
        variance = max(best.chi2, 1.0) * slopes @ best.shape_covariance @ slopes
        time_s, response = stacked(best)
        return Response(
            **origins,
            valid_days=365,
            fwhm_s=fwhm_s,
            fwhm_error_s=float(np.sqrt(variance)),
            core_fwhm_s=peaks.FWHM_PER_SIGMA * best.shape.sigma_s,
            centroid_s=best.shape.tail_s * best.shape.tail_fraction - peak_s(best.shape),
            tail_s=best.shape.tail_s,
            tail_error_s=best.shape_error.tail_s,
            tail_fraction=best.shape.tail_fraction,
            tail_fraction_error=best.shape_error.tail_fraction,
            counts=round(counts),
            chi2=best.chi2,
            time_s=[round(at_s, 15) for at_s in (time_s - peak_s(best.shape)).tolist()],
            response=[float(f"{value:.6g}") for value in response],
            warnings=_warnings(best),
        )

    def figure(self, files: Sequence[Path], found: Response) -> Figure:
        """Draw the response, the fit and what it leaves."""
        from rig.calibrate.pictures import response_figure

        return response_figure(found)


def peak_s(shape: peaks.Shape) -> float:
    """Return where a shape is highest, after its core's centre."""
    span_s = (-shape.sigma_s, shape.sigma_s)
    found = minimize_scalar(lambda at_s: -shape.density(np.array(at_s)), bounds=span_s, method="bounded",
                            options={"xatol": 1e-18})  # fmt: skip
    return float(found.x)


def width_s(shape: peaks.Shape) -> float:
    """Return the full width at half maximum of a shape."""
    top_s = peak_s(shape)
    half = shape.density(np.array(top_s)) / 2

    def above(at_s: float) -> float:
        return float(shape.density(np.array(at_s)) - half)

    far_s = 10 * shape.sigma_s + 10 * shape.tail_s
    return float(
        brentq(above, top_s, top_s + far_s, xtol=1e-18) - brentq(above, top_s - far_s, top_s, xtol=1e-18)
    )


def width_slopes(shape: peaks.Shape) -> NDArray[np.float64]:
    """(3,) of the width by the shape's parameters."""
    values = np.array([shape.sigma_s, shape.tail_s, shape.tail_fraction])
    slopes = []
    for step in np.diag(1e-3 * values):
        more, less = (width_s(peaks.Shape(*(values + sign * step).tolist())) for sign in (1, -1))
        slopes.append((more - less) / (2 * step.sum()))
    return np.array(slopes)


def stacked(bounces: FirstBounces) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times after the core's centre and the mean response there, area 1 [1/s].

    Each bin is shared by the two nearest samples, so that its time is kept; that blurs a sample by a bin's
    width. The background is taken off.
    """
    width = bounces.bin_width_s
    first, last = (round(limit_s / width) for limit_s in SAMPLED_S)
    place = (bounces.time_s - bounces.arrival_s[:, None]) / width - first
    net = bounces.rate - bounces.background[:, None]
    expected = np.broadcast_to(bounces.counts[:, None] * width, net.shape)
    found, possible = np.zeros((2, last - first + 1))
    below = np.floor(place).astype(np.int64)
    for sample, share in ((below, below + 1 - place), (below + 1, place - below)):
        inside = (sample >= 0) & (sample < len(found))
        np.add.at(found, sample[inside], (net * share)[inside])
        np.add.at(possible, sample[inside], (expected * share)[inside])
    response = np.divide(found, possible, out=np.zeros_like(found), where=possible > 0)
    return np.asarray(np.arange(first, last + 1) * width, dtype=np.float64), response


def _warnings(bounces: FirstBounces) -> list[str]:
    if bounces.chi2 <= LARGEST_CHI2:
        return []
    return [
        f"a Gaussian core with an exponential tail does not describe the response (chi^2 "
        f"{bounces.chi2:.1f} a bin): look at the picture before you trust the width"
    ]
