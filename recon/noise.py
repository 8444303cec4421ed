"""What photon noise alone puts into an image.

Counts that know nothing of a hidden scene add up with random phases. With Poisson counts H, of variance H,
the intensity that they give at a voxel is on average

    E|U(v)|^2 = sum_p w_p(v)^2 sum_n H[p, n] |pulse(tau_p(v) - t_n)|^2,    w_p = 1/r_p,

the sum that makes the image, without its phases. It is smooth over the volume: it is evaluated at a few
places of each plane, from a sample of positions, and interpolated. Around that average such an intensity is
distributed exponentially (the field is a sum of many small terms, hence Gaussian), so that

    P(|U|^2 > rho E|U|^2) = exp(-rho).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.capture import C_M_PER_S, Capture
from recon.grid import VoxelGrid
from recon.wave import VirtualPulse
from recon.window import Window

#: Positions of the sample: the noise of a sum over them is known to a thirtieth.
SAMPLE = 1024
#: Cells of the sampled histograms in a pulse's sigma_t.
CELLS_PER_SIGMA = 2
#: Places along x and y at which the noise is evaluated.
PLACES = 5


@dataclass
class Sampled:
    """Histograms that keep a coarse copy of some positions while they are read.

    Attributes
    ----------
    capture
        Whose histograms they are.
    window
        Soft edges, applied to the copy.
    group
        Bins of a cell of the copy.
    rows
        (S,) positions that are copied.
    cells
        (S, cells) counts.
    whole
        Whether all that was read were whole numbers: photon counts, of which the noise is known.
    """

    capture: Capture
    window: Window
    group: int
    rows: NDArray[np.intp] = field(init=False)
    cells: NDArray[np.float32] = field(init=False)
    whole: bool = True

    def __post_init__(self) -> None:
        positions = self.capture.positions
        # In random order, so that a sample of a grid is no coarser grid.
        chosen = np.random.default_rng(0).permutation(positions)[:SAMPLE]
        self.rows = np.sort(chosen)
        self.cells = np.zeros((len(chosen), -(-self.capture.bins // self.group)), np.float32)
        self._taken = np.zeros(self.capture.bins, bool)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of positions and number of bins."""
        return self.capture.histograms.shape

    def blocks(self, bins: slice = slice(None)) -> Iterator[tuple[slice, NDArray]]:
        """Yield (positions, counts) in order."""
        first, stop, _ = bins.indices(self.capture.bins)
        fresh = np.flatnonzero(~self._taken[first:stop]) + first
        for positions, counts in self.capture.histograms.blocks(bins):
            if len(fresh):
                self._copy(positions, first, fresh, counts)
            yield positions, counts
        self._taken[first:stop] = True

    def _copy(self, positions: slice, first: int, fresh: NDArray[np.intp], counts: NDArray) -> None:
        low, high = np.searchsorted(self.rows, [positions.start, positions.stop])
        rows = self.rows[low:high]
        self.whole &= np.issubdtype(counts.dtype, np.integer)
        if not len(rows):
            return
        capture = self.capture
        part = np.array(counts[rows - positions.start], np.float32)
        first_bin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[rows]
        bins = slice(first, first + part.shape[1])
        start = self.window.start_weights(first_bin_s, bins, capture.bin_width_s)
        part[:, : start.shape[1]] *= start
        part *= self.window.end_weights(capture.bins, capture.bin_width_s)[bins].astype(np.float32)
        np.add.at(self.cells[low:high].T, fresh // self.group, part[:, fresh - first].T)


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


def sampled(capture: Capture, pulse: VirtualPulse, window: Window) -> tuple[Capture, Sampled]:
    """Return a capture that is read as the given one, and what keeps a sample of it meanwhile."""
    group = max(1, int(pulse.sigma_s / CELLS_PER_SIGMA / capture.bin_width_s))
    sample = Sampled(capture, window, group)
    return replace(capture, histograms=sample), sample


def photon_noise(sample: Sampled, pulse: VirtualPulse, grid: VoxelGrid) -> Noise:
    """Evaluate the noise over a volume, from what was sampled while it was imaged."""
    capture, rows = sample.capture, sample.rows
    cell_s = sample.group * capture.bin_width_s
    # |pulse|^2 is a Gaussian of sigma_t / sqrt(2), with a peak of one.
    sigma = pulse.sigma_s / np.sqrt(2) / cell_s
    seen = gaussian_filter1d(sample.cells, sigma, mode="constant", truncate=5) * np.sqrt(2 * np.pi) * sigma
    begin_s = np.broadcast_to(capture.first_bin_s, capture.positions)[rows]
    laser_m = capture.laser_m[rows]
    detector_m = np.broadcast_to(capture.detector_m, capture.laser_m.shape)[rows]
    x_m, y_m = (np.linspace(axis[0], axis[-1], min(PLACES, len(axis))) for axis in (grid.x_m, grid.y_m))
    levels = np.empty((len(grid.z_m), len(y_m), len(x_m)))
    scale = capture.positions / len(rows)
    for k, z_m in enumerate(grid.z_m):
        places_m = np.stack(np.broadcast_arrays(x_m[None, :], y_m[:, None], z_m), axis=-1)[..., None, :]
        r_p = np.linalg.norm(places_m - laser_m, axis=-1)
        delay_s = (r_p + np.linalg.norm(places_m - detector_m, axis=-1)) / C_M_PER_S
        cell = np.clip(((delay_s - begin_s) / cell_s).astype(int), 0, seen.shape[1] - 1)
        weights = 1 / r_p**2
        # One count more than there were: a handful of photons adds up as it likes, and is no evidence.
        levels[k] = (seen[np.arange(len(rows)), cell] * weights).sum(axis=-1) * scale + weights.mean(axis=-1)
    return Noise(levels, photons=True)
