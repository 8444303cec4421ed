"""What photon noise alone puts into an image.

Counts that know nothing of a hidden scene add up with random phases. With Poisson counts H, of variance H,
the intensity that they give at a voxel is on average

    E|U(v)|^2 = sum_p w_p(v)^2 sum_n H[p, n] |pulse(tau_p(v) - t_n)|^2,    w_p = 1/r_p,

the sum that makes the image, without its phases. It is smooth over the volume: it is evaluated at a few
places of each plane, from neighbouring positions together, and interpolated. Around that average such an
intensity is distributed exponentially (the field is a sum of many small terms, hence Gaussian), so that

    P(|U|^2 > rho E|U|^2) = exp(-rho).
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, Capture, Positions, UnreadHistograms, pieces
from recon.grid import VoxelGrid
from recon.wave import VirtualPulse
from recon.window import Window

#: Places on the wall that stand for all positions.
TILES = 1024
#: Cells of the tallied histograms in a pulse's sigma_t.
CELLS_PER_SIGMA = 2
#: Photons more than there are: so few add up as they like, which is not exponentially distributed.
HANDFUL = 10.0
#: Places along x and y at which the noise is evaluated.
PLACES = 5


@dataclass
class Tally:
    """Histograms that are summed up coarsely while they are read.

    Attributes
    ----------
    capture
        Whose histograms they are.
    window
        Soft edges, applied to the sums.
    group
        Bins of a cell of the sums.
    tile
        (P,) tile of each position: neighbours are summed together.
    cells
        (tiles, cells) counts.
    whole
        Whether all that was read were whole numbers: photon counts, of which the noise is known.
    """

    capture: Capture
    window: Window
    group: int
    tile: NDArray[np.intp] = field(init=False)
    cells: NDArray[np.float32] = field(init=False)
    whole: bool = True

    def __post_init__(self) -> None:
        capture = self.capture
        ends_m = np.hstack([capture.laser_m, np.broadcast_to(capture.detector_m, capture.laser_m.shape)])
        self.tile = _tiles(ends_m)
        self.cells = np.zeros((self.tile.max() + 1, -(-capture.bins // self.group)), np.float32)
        self._taken = np.zeros(capture.bins, bool)
        self._end = self.window.end_weights(capture.bins, capture.bin_width_s)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return self.capture.histograms.shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order."""
        first, stop, _ = bins.indices(self.capture.bins)
        fresh = ~self._taken[first:stop]
        for positions, counts in self.capture.histograms.blocks(bins):
            self.whole &= bool(np.issubdtype(counts.dtype, np.integer))
            if fresh.any():
                self.add(positions, slice(first, stop), counts if fresh.all() else counts * fresh)
            yield positions, counts
        self._taken[first:stop] = True

    def add(self, positions: Positions, bins: slice, counts: NDArray) -> None:
        """Add counts to their cells; the window, which is wide, is taken at the cells' centres."""
        where = np.arange(self.capture.positions)[positions]
        for some in pieces(*counts.shape):
            self._add(where[some], bins, counts[some])

    def _add(self, positions: NDArray[np.intp], bins: slice, counts: NDArray) -> None:
        capture, cell_s = self.capture, self.group * self.capture.bin_width_s
        cells = slice(bins.start // self.group, -(-bins.stop // self.group))
        summed = _summed(counts, bins.start % self.group, self.group)
        centres = np.arange(cells.start, cells.stop) * self.group + self.group // 2
        summed *= self._end[np.minimum(centres, capture.bins - 1)]
        start = self.window.start_weights(capture.begins_s(positions), cells, cell_s)
        summed[:, : start.shape[1]] *= start
        tiles, row_of = np.unique(self.tile[positions], return_inverse=True)
        members = np.equal.outer(np.arange(len(tiles)), row_of).astype(np.float32)
        self.cells[tiles, cells] += members @ summed

    def add_photons(self, positions: NDArray[np.intp], bins: slice, photon_bins: NDArray[np.integer]) -> None:
        """Add photons, each by its position and its bin; those outside `bins` are left out."""
        capture, cell_s = self.capture, self.group * self.capture.bin_width_s
        inside = (photon_bins >= bins.start) & (photon_bins < bins.stop)
        positions, number = positions[inside], photon_bins[inside].astype(np.intp) // self.group
        centre = np.maximum(number * self.group, bins.start) + self.group // 2
        weight = self._end[np.minimum(centre, capture.bins - 1)]
        begins_s = np.broadcast_to(capture.begins_s(positions), positions.shape)
        weight = weight * self.window.start_weights_at(begins_s + (number + 0.5) * cell_s)
        np.add.at(self.cells, (self.tile[positions], number), weight.astype(np.float32))

    def of(self, positions: slice) -> "Tally":
        """Return what sums up some positions elsewhere, into the same cells; to be added by `absorb`."""
        other = self.unread()
        other.tile, other.cells, other._taken = self.tile[positions], np.zeros_like(self.cells), self._taken
        return other

    def reading(self, capture: Capture) -> "Tally":
        """Return it as what reads another capture's histograms, and sums them up."""
        other = copy(self)
        other.capture, other._taken = capture, self._taken.copy()
        other.cells = self.cells.copy()
        return other

    def unread(self) -> "Tally":
        """Return it without its histograms."""
        other = copy(self)
        other.capture = replace(self.capture, histograms=UnreadHistograms(self.capture.histograms.shape))
        return other

    def absorb(self, other: "Tally") -> None:
        """Add what was summed up elsewhere."""
        self.cells += other.cells
        self.whole &= other.whole
        self._taken = self._taken | other._taken

    def weighted(self, weights: NDArray[np.floating]) -> "Tally":
        """Return the tally of positions that are multiplied by (P,) weights, their variance by squares."""
        members = np.bincount(self.tile, weights != 0)
        squares = np.bincount(self.tile, np.square(weights))
        other = copy(self)
        other.cells = self.cells * np.divide(squares, np.maximum(members, 1))[:, None].astype(np.float32)
        return other


def _summed(counts: NDArray, begin: int, group: int) -> NDArray[np.float32]:
    """Return (n, groups) sums of (n, bins) counts over groups of bins, of which the first begins before them.

    They are products with ones, which take a third of the time of sums.
    """
    groups = -(-(begin + counts.shape[1]) // group)
    room = np.zeros((len(counts), groups * group), np.float32)
    room[:, begin : begin + counts.shape[1]] = counts
    return room.reshape(len(counts), groups, group) @ np.ones(group, np.float32)


def _tiles(ends_m: NDArray[np.float64]) -> NDArray[np.intp]:
    """Give positions (P, coordinates) the numbers of tiles, halved along the longest until they are many."""
    tiles = [np.arange(len(ends_m))]
    while 2 * len(tiles) <= TILES and len(tiles) < len(ends_m):
        halves = []
        for members in tiles:
            longest = np.ptp(ends_m[members], axis=0).argmax()
            order = members[np.argsort(ends_m[members, longest], kind="stable")]
            halves += [half for half in np.array_split(order, 2) if len(half)]
        tiles = halves
    number = np.empty(len(ends_m), np.intp)
    for tile, members in enumerate(tiles):
        number[members] = tile
    return number


@dataclass(frozen=True)
class Noise:
    """The mean intensity that noise gives.

    Attributes
    ----------
    levels
        (z, a few, a few) at places evenly spread over each plane, from corner to corner.
    photons
        Whether it follows from counted photons; otherwise it is what the quietest part of each plane shows.
    """

    levels: NDArray[np.float64]
    photons: bool

    def plane(self, number: int, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return the level at all pixels (y, x) of a plane."""
        _, rows, columns = self.levels.shape
        levels = _between(rows, shape[0]) @ self.levels[number] @ _between(columns, shape[1]).T
        return levels.astype(np.float32)


def _between(places: int, pixels: int) -> NDArray[np.float64]:
    """(pixels, places) weights that interpolate from evenly spread places along an axis."""
    at = np.linspace(0, places - 1, pixels)
    return np.maximum(0, 1 - np.abs(at[:, None] - np.arange(places)))


def quiet_level(intensity: NDArray[np.float32]) -> Noise:
    """Take the noise from an image itself, where photons were not counted.

    The lower quarter of an exponential distribution ends at -ln(3/4) of its mean; an image whose planes are
    filled has its objects there, and seems noisier than it is.
    """
    quarter = np.percentile(intensity.reshape(len(intensity), -1), 25, axis=1)
    return Noise(quarter[:, None, None] / -np.log(0.75), photons=False)


def tallied(capture: Capture, pulse: VirtualPulse, window: Window) -> tuple[Capture, Tally]:
    """Return a capture that is read as the given one, and what sums it up meanwhile."""
    group = max(1, int(pulse.sigma_s / CELLS_PER_SIGMA / capture.bin_width_s))
    tally = Tally(capture, window, group)
    return replace(capture, histograms=tally), tally


def photon_noise(tally: Tally, pulse: VirtualPulse, grid: VoxelGrid) -> Noise:
    """Evaluate the noise over a volume, from what was summed up while it was imaged."""
    from scipy.ndimage import gaussian_filter1d

    capture, tiles = tally.capture, len(tally.cells)
    cell_s = tally.group * capture.bin_width_s
    # |pulse|^2 is a Gaussian of sigma_t / sqrt(2), with a peak of one.
    sigma = pulse.sigma_s / np.sqrt(2) / cell_s
    seen = gaussian_filter1d(tally.cells, sigma, mode="constant", truncate=5) * np.sqrt(2 * np.pi) * sigma
    members = np.bincount(tally.tile, minlength=tiles)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        full = np.broadcast_to(values, (capture.positions, *values.shape[1:])).reshape(capture.positions, -1)
        sums = [np.bincount(tally.tile, column, minlength=tiles) for column in full.T]
        return (np.array(sums) / members).T.reshape(tiles, *values.shape[1:])

    begin_s, laser_m, detector_m = mean(capture.first_bin_s), mean(capture.laser_m), mean(capture.detector_m)
    x_m, y_m = (np.linspace(axis[0], axis[-1], min(PLACES, len(axis))) for axis in (grid.x_m, grid.y_m))

    def beside_m2(spots_m: NDArray[np.float64]) -> NDArray[np.float64]:
        across, up = (x_m[:, None] - spots_m[:, 0]) ** 2, (y_m[:, None] - spots_m[:, 1]) ** 2
        return across + up[:, None]

    beside_laser_m2, beside_detector_m2 = beside_m2(laser_m), beside_m2(detector_m)
    levels = np.empty((len(grid.z_m), len(y_m), len(x_m)))
    for k, z_m in enumerate(grid.z_m):
        r_p2 = beside_laser_m2 + (z_m - laser_m[:, 2]) ** 2
        path_m = np.sqrt(r_p2) + np.sqrt(beside_detector_m2 + (z_m - detector_m[:, 2]) ** 2)
        cell = np.clip(((path_m / C_M_PER_S - begin_s) / cell_s).astype(np.intp), 0, seen.shape[1] - 1)
        weights = 1 / r_p2
        levels[k] = (seen[np.arange(tiles), cell] * weights).sum(axis=-1)
        levels[k] += HANDFUL * weights.mean(axis=-1)
    return Noise(levels, photons=True)
