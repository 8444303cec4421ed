"""Exhaustive captures: many laser spots, each with the same many pixels."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from recon.capture import ArrayHistograms, Capture, Histograms


class LaserHistograms(Protocol):
    """Photon counts of all pairs, readable by runs of lasers."""

    @property
    def bins(self) -> int:
        """Number of bins."""
        ...

    def of(self, lasers: slice) -> Histograms:
        """Return the histograms of a run of lasers, the pixels of each one following one another."""
        ...


@dataclass(frozen=True)
class ArrayLaserHistograms:
    """Histograms that are in memory already.

    Attributes
    ----------
    counts
        (lasers, pixels, bins), any real type.
    """

    counts: NDArray

    @property
    def bins(self) -> int:
        """Number of bins."""
        return self.counts.shape[2]

    def of(self, lasers: slice) -> Histograms:
        """Return the histograms of a run of lasers."""
        return ArrayHistograms(self.counts[lasers].reshape(-1, self.bins))


@dataclass(frozen=True)
class Exhaustive:
    """Each laser spot with each pixel, in rectified time, in the frame of `recon.capture.Capture`.

    Attributes
    ----------
    histograms
        Counts H[l, d, n] of L lasers, D pixels and B bins.
    bin_width_s
        Width of a bin.
    first_bin_s
        (1, 1) or (L, D): left edge of bin 0 in rectified time.
    laser_m, pixel_m
        (L, 3) and (D, 3) spots on the wall.
    """

    histograms: LaserHistograms
    bin_width_s: float
    first_bin_s: NDArray[np.float64]
    laser_m: NDArray[np.float64]
    pixel_m: NDArray[np.float64]

    @property
    def lasers(self) -> int:
        """Number of laser spots L."""
        return len(self.laser_m)

    @property
    def pairs(self) -> int:
        """Number of pairs of laser spot and pixel."""
        return self.lasers * len(self.pixel_m)

    def block(self, lasers: slice) -> Capture:
        """Return a run of lasers as pairs, the side that focuses as laser spots."""
        pairs = self.pairs_of(lasers)
        return self._capture(pairs.histograms, pairs.first_bin_s, pairs.laser_m, pairs.detector_m)

    def pairs_of(self, lasers: slice) -> Capture:
        """Return a run of lasers as pairs of laser and detector spot, laser by laser."""
        lit_m = self.laser_m[lasers]
        sides_m = np.repeat(lit_m, len(self.pixel_m), axis=0), np.tile(self.pixel_m, (len(lit_m), 1))
        first_bin_s = self.first_bin_s[0] if self.first_bin_s.size == 1 else self.first_bin_s[lasers].ravel()
        return Capture(self.histograms.of(lasers), self.bin_width_s, first_bin_s, *sides_m)

    def outline(self) -> Capture:
        """Return few pairs, in which each spot of either side is, with no histograms: to plan with.

        Extents, spacings, limits of paths, and so bins and frequencies, are those of all pairs.
        """
        count = max(self.lasers, len(self.pixel_m))
        numbers = np.arange(count)
        # shifted by one, so that equal grids on both sides do not look like a confocal scan
        sides_m = self.laser_m[(numbers + 1) % self.lasers], self.pixel_m[numbers % len(self.pixel_m)]
        first_bin_s = np.full(count, self.first_bin_s.min())
        first_bin_s[-1] = self.first_bin_s.max()
        if np.ptp(first_bin_s) == 0:
            first_bin_s = first_bin_s[:1]
        unread = ArrayHistograms(np.broadcast_to(np.uint8(0), (count, self.histograms.bins)))
        return self._capture(unread, first_bin_s, *sides_m)

    def _capture(
        self,
        histograms: Histograms,
        first_bin_s: NDArray[np.float64],
        laser_m: NDArray[np.float64],
        pixel_m: NDArray[np.float64],
    ) -> Capture:
        aperture_m, other_m = (laser_m, pixel_m) if self.lasers > len(self.pixel_m) else (pixel_m, laser_m)
        return Capture(histograms, self.bin_width_s, first_bin_s, aperture_m, other_m)
