"""Records without their high frequencies."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.capture import Capture, Histograms
from recon.wave import VirtualPulse

#: Full width at half maximum of a Gaussian, in standard deviations.
FWHM = 2 * sqrt(2 * log(2))
#: Half-length of the Gaussian, in standard deviations.
REACH = 4.0


def low_pass_sigma_s(pulse: VirtualPulse) -> float:
    """Return the Gaussian that leaves half where half of the virtual pulse's spectrum is left.

    The spectrum exp(-(omega - omega_0)^2 sigma_t^2 / 2) is 1/2 at omega_h = omega_0 + sqrt(2 ln 2) / sigma_t,
    and so is exp(-omega_h^2 sigma^2 / 2) for sigma = sqrt(2 ln 2) / omega_h.
    """
    half = sqrt(2 * log(2))
    return half / (pulse.carrier_rad_per_s + half / pulse.sigma_s)


def low_passed(capture: Capture, sigma_s: float) -> Capture:
    """Return a capture whose histograms are convolved with a Gaussian in time.

    Parameters
    ----------
    capture
        As recorded.
    sigma_s
        Standard deviation of the Gaussian; a frequency omega keeps the part exp(-omega^2 sigma^2 / 2).

    Returns
    -------
    Capture
        float32, read in the same blocks. Light from before and after the record is missing near its ends.
    """
    return replace(capture, histograms=_Smoothed(capture.histograms, sigma_s / capture.bin_width_s))


@dataclass(frozen=True)
class _Smoothed:
    histograms: Histograms
    sigma_bins: float

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return self.histograms.shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order."""
        first, stop, _ = bins.indices(self.shape[1])
        reach = int(np.ceil(REACH * self.sigma_bins)) + 1
        begin, end = max(0, first - reach), min(self.shape[1], stop + reach)
        for positions, counts in self.histograms.blocks(slice(begin, end)):
            smooth = gaussian_filter1d(
                counts.astype(np.float32), self.sigma_bins, axis=1, mode="constant", truncate=REACH
            )
            yield positions, smooth[:, first - begin : stop - begin]
