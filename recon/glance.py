"""A quick, coarse image of what has arrived: for one who looks on while positions are measured.

A wave of length lambda is sampled well enough every lambda/2. Where positions are closer, neighbours are put
together in square **cells** of that side: the photons of a position count for the centre of its cell, on the
time axis of that. This costs a wave that arrives at the angle theta to the normal the factor
sinc(side sin(theta) / lambda) along each axis, which is 0.8 at 45 degrees and a side of lambda/2, and spares
a factor of (side/spacing)^2 in time and memory.

Cells are shown as the mean of what was measured in them. So one that was visited more often is no brighter,
and positions of a round that is not complete yet help, in place of tilting the aperture.
"""

from bisect import bisect_right
from dataclasses import dataclass, replace
from math import ceil, log2

import numpy as np
from numpy.typing import NDArray

from recon import defaults
from recon.accumulate import Accumulator, Coming, Picture
from recon.capture import ArrayHistograms, Capture
from recon.depth import compensate_falloff, front_view
from recon.wave import VirtualPulse
from recon.window import Window

#: Cells along the longer side of the wall at most: an image of so many takes a third of a second of one core.
MOST_CELLS = 60


@dataclass(frozen=True)
class Cells:
    """Positions put together.

    Attributes
    ----------
    capture
        Of the cells, as if they were positions; its histograms are not there.
    of_position
        (P,) the cell of each position.
    later_bins
        (P,) by how many bins a photon of a position is later on its cell's time axis.
    """

    capture: Capture
    of_position: NDArray[np.intp]
    later_bins: NDArray[np.int64]

    @classmethod
    def of(cls, capture: Capture, side_m: float) -> "Cells":
        """Put the positions of a capture together in squares, those of each detector spot apart."""
        low_m, high_m = capture.laser_m.min(axis=0), capture.laser_m.max(axis=0)
        count = np.floor((high_m - low_m) / side_m + 1 + 1e-6).astype(np.int64)
        start_m = (low_m + high_m - count * side_m) / 2  # the same rest on either side
        place = np.clip(np.floor((capture.laser_m - start_m) / side_m + 1e-6), 0, count - 1).astype(np.int64)
        spots_m, spot = np.unique(capture.detector_m, axis=0, return_inverse=True)
        spot = np.broadcast_to(spot.ravel(), capture.positions)
        key = np.ravel_multi_index((*place.T, spot), (*count, len(spots_m)))
        _, first, cell = np.unique(key, return_index=True, return_inverse=True)
        laser_m = start_m + (place[first] + 0.5) * side_m
        begins_s = np.broadcast_to(capture.first_bin_s, capture.positions)
        begin_s = np.bincount(cell, begins_s) / np.bincount(cell)
        one = len(capture.detector_m) == 1
        return cls(
            replace(
                capture,
                histograms=ArrayHistograms(np.broadcast_to(np.uint8(0), (len(first), capture.bins))),
                first_bin_s=begin_s,
                laser_m=laser_m,
                detector_m=capture.detector_m if one else capture.detector_m[first],
            ),
            cell,
            np.rint((begins_s - begin_s[cell]) / capture.bin_width_s).astype(np.int64),
        )


class Level:
    """Cells of one size, imaged with the wavelength that they bear.

    Parameters
    ----------
    capture
        Of the positions.
    side_m, wavelength_m
        Of the cells, and of the wave.
    window
        Soft edges of the record.
    """

    def __init__(self, capture: Capture, side_m: float, wavelength_m: float, window: Window) -> None:
        self._cells = Cells.of(capture, side_m)
        self._measured = np.zeros(self._cells.capture.positions, np.int64)  # positions of each cell
        self.pulse = VirtualPulse(wavelength_m)
        grid = defaults.voxels(self._cells.capture, self.pulse, voxel_m=side_m)
        self._accumulator = Accumulator(self._cells.capture, self.pulse, grid, window)

    def add_photons(
        self, positions: NDArray[np.intp], offset: NDArray[np.integer], photon_bins: NDArray[np.integer]
    ) -> None:
        """Add the photons of some positions; as `recon.accumulate.Accumulator.add_photons`."""
        later = np.repeat(self._cells.later_bins[positions], np.diff(offset))
        cells = self._cells.of_position[positions]
        self._accumulator.add_photons(cells, offset, photon_bins.astype(np.int64) + later)
        np.add.at(self._measured, cells, 1)

    def picture(self, positions: int) -> Picture:
        """Image what has arrived, which is so many positions."""
        measured = self._measured
        weights = measured[measured > 0].mean() / np.maximum(measured, 1)
        image = self._accumulator.image(among=len(measured), weights=weights)
        lifted = compensate_falloff(image.intensity, image.grid.z_m, image.falloff_power)
        front = np.sqrt(front_view(lifted))
        surface = self._accumulator.surface(image, weights)
        return Picture(positions, self.pulse, image.grid, front, surface)


class Glance:
    """Coarse pictures of a scan that is under way, each of all that has arrived.

    Until the first round is complete, and in a scan that has but one, the aperture is what has been visited
    of it; then the wavelength follows the finest complete round.

    Parameters
    ----------
    scan
        What is to come.
    """

    def __init__(self, scan: Coming) -> None:
        self.positions = 0
        self._rounds = scan.rounds
        self._arrived = np.zeros(scan.capture.positions, bool)
        sides_m = self._sides_m(scan)
        shortest_m = scan.shortest_m(scan.capture)
        levels = {
            side_m: Level(scan.capture, side_m, max(2 * side_m, shortest_m), scan.window)
            for side_m in dict.fromkeys(sides_m)
        }
        self._levels = [levels[side_m] for side_m in sides_m]
        # each is shown until the round after its last is complete, and takes what comes meanwhile
        self._needed_until = dict(zip(self._levels, [*self._rounds[1:], self._rounds[-1]], strict=True))

    @staticmethod
    def _sides_m(scan: Coming) -> list[float]:
        """Return the side of the cells for each round: each is to hold a position of a complete one.

        Every other round has positions in the centres of squares; its cells are those squares.
        """
        spacings_m = [defaults.spacing_m(one) for one in scan.after_rounds()]
        finest_m = spacings_m[-1]
        wide_m = float(np.ptp(scan.capture.laser_m, axis=0).max())
        least = max(1, ceil(wide_m / finest_m / MOST_CELLS))
        powers = [ceil(log2(spacing_m / finest_m) - 0.1) for spacing_m in spacings_m]
        return [max(least, 2**power) * finest_m for power in powers]

    def add_photons(self, first: int, offset: NDArray[np.integer], photon_bins: NDArray[np.integer]) -> None:
        """Add the photons of the next positions, or of some that were left out.

        Parameters
        ----------
        first
            The first of them.
        offset
            (n + 1,) where the photons of each begin, and the end.
        photon_bins
            (photons,) the bin of each.
        """
        positions = np.arange(first, first + len(offset) - 1)
        self._arrived[positions] = True
        self.positions = int(np.count_nonzero(self._arrived))
        for level in dict.fromkeys(self._levels):
            if first < self._needed_until[level]:
                level.add_photons(positions, offset, photon_bins)

    def picture(self) -> Picture:
        """Make the picture of what has arrived."""
        complete = bisect_right(self._rounds, self.positions) - 1
        return self._levels[max(complete, 0)].picture(self.positions)
