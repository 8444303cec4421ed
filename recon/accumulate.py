"""An image that grows while positions are measured.

What imaging needs of a position are its spectra, which do not depend on other positions: they are taken when
its histogram arrives, and kept. An image of what is there so far is then the usual solver's work on the
positions that have arrived, without reading anything twice. Memory is that of the spectra of all positions,
whatever is measured.
"""

from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon import defaults
from recon.camera import ConfocalCamera
from recon.capture import ArrayHistograms, Capture, Positions
from recon.depth import compensate_falloff, front_view
from recon.grid import VoxelGrid
from recon.imaging import focused, plan
from recon.noise import photon_noise, tallied
from recon.result import Image
from recon.spectrum import Transform
from recon.surface import Surface, find
from recon.wave import VirtualPulse
from recon.window import Window


class Accumulator:
    """The spectra of one virtual pulse, of the positions that have arrived.

    Parameters
    ----------
    capture
        Geometry and time axis of all positions that are to come; its histograms are not read.
    pulse, grid, window
        As of `recon.imaging.image`.

    Attributes
    ----------
    pulse
        The virtual illumination.
    bins
        Bins that are needed of each position.
    arrived
        (P,) which positions have arrived.

    Raises
    ------
    ReachError
        If no path to the volume falls inside the record.
    ParameterError
        If the volume is not in front of the wall.
    """

    def __init__(self, capture: Capture, pulse: VirtualPulse, grid: VoxelGrid, window: Window) -> None:
        self._capture, self.pulse = capture, pulse
        self._problem = replace(plan(capture, pulse, grid, ConfocalCamera(), window), slopes=True)
        self._transform = Transform(capture, self._problem.depth_blocks, window)
        _, self._tally = tallied(capture, pulse, window)
        self.bins = self._transform.bins
        self.arrived = np.zeros(capture.positions, bool)

    @property
    def spectra(self) -> list[NDArray[np.complexfloating]]:
        """(F, P) for each depth block, zero where a position has not arrived."""
        return self._transform.spectra

    def add(self, positions: Positions, counts: NDArray) -> None:
        """Add counts of some positions; a position that comes again is added up.

        Parameters
        ----------
        positions
            Which, each once.
        counts
            (block, bins) of the whole record; they may be reused afterwards.
        """
        seen = counts[:, self.bins]
        self._transform.add(positions, seen)
        self._tally.add(positions, self.bins, seen)
        self.arrived[positions] = True

    def add_photons(
        self, positions: NDArray[np.intp], offset: NDArray[np.integer], photon_bins: NDArray[np.integer]
    ) -> None:
        """Add the photons of some positions; the quicker way where most bins are empty.

        Parameters
        ----------
        positions
            (n,) which; one that comes again is added up.
        offset
            (n + 1,) where the photons of each begin, and the end.
        photon_bins
            (photons,) the bin of each, in the whole record.
        """
        self._transform.add_photons(positions, offset, photon_bins)
        self._tally.add_photons(np.repeat(positions, np.diff(offset)), self.bins, photon_bins)
        self.arrived[positions] = True

    def image(
        self,
        last: int | None = None,
        among: int | None = None,
        weights: NDArray[np.floating] | None = None,
    ) -> Image:
        """Image what has arrived.

        Parameters
        ----------
        last
            Use the first so many positions; None uses all.
        among
            Show the solver the first so many positions, those that are not used as dark ones: a finer lattice
            is faster than one that is coarser than half a wavelength. None shows it what is used alone.
        weights
            (P,) by which positions are multiplied; None is one for all.
        """
        bright = self.arrived.copy()
        bright[len(bright) if last is None else last :] = False
        # a slice where it can be: taking some of the spectra takes as long as a tenth of the image
        if among is not None or bright.all():
            shown: NDArray[np.intp] | slice = slice(among)
        else:
            shown = np.flatnonzero(bright)
        weight = bright[shown] if weights is None else (bright * weights)[shown].astype(np.float32)

        def spectra(*asked: object) -> list[NDArray[np.complexfloating]]:
            if weights is None and weight.all():
                return [one[:, shown].copy() for one in self._transform.spectra]
            return [one[:, shown] * weight for one in self._transform.spectra]

        part = replace(self._problem, capture=subset(self._capture, np.arange(len(bright))[shown]))
        part = replace(part, spectra=spectra)
        return focused(part, "rsd", self.pulse)

    def surface(self, image: Image, weights: NDArray[np.floating] | None = None) -> Surface:
        """Find the surface in an image of what has arrived, made with these weights."""
        tally = self._tally if weights is None else self._tally.weighted(np.where(self.arrived, weights, 0))
        return find(image, photon_noise(tally, self.pulse, image.grid))


@dataclass(frozen=True)
class Picture:
    """What is seen so far.

    Attributes
    ----------
    positions
        How many it is made of.
    pulse, grid
        With which virtual pulse, on which voxels; x and y are those of all pictures of a scan.
    front
        (y, x) float32 front view: greatest amplitude over depth, its fall-off with depth compensated.
    surface
        Depth map and its contrast to the photons' noise.
    """

    positions: int
    pulse: VirtualPulse
    grid: VoxelGrid
    front: NDArray[np.float32]
    surface: Surface


@dataclass(frozen=True)
class Coming:
    """A scan that is under way.

    Attributes
    ----------
    capture
        Geometry and time axis of all positions, in the order in which they come; its histograms are not read.
    rounds
        Number of positions by the end of each round: after each, they are evenly spread.
    window
        Soft edges of the record.
    response_fwhm_s
        Of the instrument, as `recon.defaults.wavelength` takes it.
    """

    capture: Capture
    rounds: tuple[int, ...]
    window: Window
    response_fwhm_s: float | None

    def after_rounds(self) -> list[Capture]:
        """Return the geometry of what has come by the end of each round."""
        return [subset(self.capture, np.arange(end)) for end in self.rounds]

    def shortest_m(self, capture: Capture) -> float:
        """Return the shortest wavelength that some of it bears."""
        return defaults.wavelength(capture, self.response_fwhm_s).value


class GrowingPicture:
    """Pictures of a scan that is under way, with the wavelength that its finest complete round bears.

    Of a round that is not complete nothing is shown: the wall would be denser on one side, and the picture
    less like the final one than that of the round before.

    Parameters
    ----------
    scan
        What is to come.
    """

    def __init__(self, scan: Coming) -> None:
        self.rounds = scan.rounds
        self.positions = 0
        capture, rounds = scan.capture, scan.rounds
        seen = scan.after_rounds()
        pulses = [VirtualPulse(scan.shortest_m(one)) for one in seen]
        spacings_m = [defaults.spacing_m(one) for one in seen]
        voxel_m = max(spacings_m[-1], pulses[-1].wavelength_m / 2)
        accumulators = {
            pulse: Accumulator(capture, pulse, defaults.voxels(capture, pulse, voxel_m=voxel_m), scan.window)
            for pulse in dict.fromkeys(pulses)
        }
        self._needed_until = dict(zip(pulses, rounds, strict=True))  # of each, its last round
        self._accumulators = [accumulators[pulse] for pulse in pulses]
        fine = [[s < pulse.wavelength_m / 2 * (1 + 1e-3) for s in spacings_m] for pulse in pulses]
        self._among = [rounds[one.index(True, k) if any(one[k:]) else -1] for k, one in enumerate(fine)]

    def add(self, first: int, counts: NDArray) -> None:
        """Add the next positions, or positions that were added before once more.

        Parameters
        ----------
        first
            The first of them.
        counts
            (block, bins) of neighbours in order.
        """
        for accumulator in dict.fromkeys(self._accumulators):
            fitting = min(len(counts), self._needed_until[accumulator.pulse] - first)
            if fitting > 0:
                accumulator.add(slice(first, first + fitting), counts[:fitting])
        self.positions = max(self.positions, first + len(counts))

    def add_photons(self, first: int, offset: NDArray[np.integer], photon_bins: NDArray[np.integer]) -> None:
        """As `add`, from photons: (n + 1,) where those of each position begin, and (photons,) their bins."""
        for accumulator in dict.fromkeys(self._accumulators):
            fitting = min(len(offset) - 1, self._needed_until[accumulator.pulse] - first)
            if fitting > 0:
                some = photon_bins[: offset[fitting]]
                accumulator.add_photons(np.arange(first, first + fitting), offset[: fitting + 1], some)
        self.positions = max(self.positions, first + len(offset) - 1)

    def picture(self) -> Picture:
        """Make the picture of the complete rounds; before the first is complete, of what is there."""
        number = max(bisect_right(self.rounds, self.positions) - 1, 0)
        used = min(self.positions, self.rounds[number])
        accumulator = self._accumulators[number]
        image = accumulator.image(used, self._among[number])
        lifted = compensate_falloff(image.intensity, image.grid.z_m, image.falloff_power)
        front = np.sqrt(front_view(lifted))
        return Picture(used, accumulator.pulse, image.grid, front, accumulator.surface(image))


def likeness(one: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the correlation coefficient of two front views: 1 if they show the same, 0 if one is flat."""
    one, other = one - one.mean(dtype=np.float64), other - other.mean(dtype=np.float64)
    power = float((one**2).sum() * (other**2).sum())
    return float((one * other).sum()) / power**0.5 if power > 0 else 0.0


def subset(capture: Capture, positions: NDArray[np.intp]) -> Capture:
    """Return the geometry of some positions; their histograms are not kept, and are zero."""
    nothing = np.broadcast_to(np.uint8(0), (len(positions), capture.bins))
    every = len(capture.detector_m) == 1
    return replace(
        capture,
        histograms=ArrayHistograms(nothing),
        first_bin_s=capture.begins_s(positions),
        laser_m=capture.laser_m[positions],
        detector_m=capture.detector_m if every else capture.detector_m[positions],
    )
