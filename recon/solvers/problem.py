"""What a solver is given, and the seam that all of them share.

A solver is a function of a problem that yields U(v, t) plane by plane, (T, y, x) complex, in order of depth.
It asks the camera for light, reading times and aperture weights, and never what camera it is.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import pi

import numpy as np
from numpy.typing import NDArray

from recon.camera import Camera
from recon.capture import C_M_PER_S, Capture
from recon.computer import usual_threads
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock, path_limits_m, plane_times_s
from recon.spectrum import Spectra, spectra
from recon.wave import Band, Light
from recon.window import Window


def ignore(fraction: float) -> None:
    """Take progress that nobody asked for."""


def part_of(progress: Callable[[float], None], begin: float, end: float) -> Callable[[float], None]:
    """Return what takes the progress of a part of the work, and tells that of the whole."""
    return lambda fraction: progress(begin + fraction * (end - begin))


@dataclass(frozen=True)
class Need:
    """Bytes that a solver needs for a depth block beside its spectra: in any case, and for the least at once.

    `together` frequencies are taken at least: one, or all where each pass costs as much as all.
    """

    fixed: int
    least: int
    together: int


@dataclass(frozen=True)
class Way:
    """How a solver images a depth block.

    Attributes
    ----------
    work_s
        Time of one core of a usual machine, beside the spectra.
    by_fft
        Whether by lattices and FFT, whose frequencies can be taken by themselves.
    groups
        Positions that can be taken by themselves, as lattices do; empty where any can.
    """

    work_s: float
    by_fft: bool
    groups: tuple[NDArray[np.intp], ...]


@dataclass(frozen=True)
class ImagingProblem:
    """What to image.

    Attributes
    ----------
    capture, grid
        Histograms with their geometry, and voxels.
    camera, light
        What to see, and its illumination.
    depth_blocks
        Parts of the volume with the bins and frequencies that image them, covering all planes in order.
    window
        Soft edges of the record.
    progress
        To be called with the fraction that is done.
    passes
        The work cut for a bound on memory: depth blocks, or runs of a depth block's frequencies, that share
        one pass over the record. Empty takes all depth blocks in one.
    working_bytes
        What a solver may take at once for tables.
    plane_bytes
        Memory for planes in work, their frequencies and frames; fewer threads run where it would not suffice.
    device
        Where the rsd solver computes: "cpu" or "cuda".
    fft
        Whether the rsd solver goes by FFT; None takes what is quicker.
    slopes
        Whether the change with time is asked for beside the field: the solver then yields (2, y, x) for each
        plane, U and dU/dt - i omega_0 U. For images of one moment.
    wall_bytes
        Memory for the wall's spectra; those of more frequencies than fit are taken anew for each plane.
    spectra
        What takes the spectra of the capture, as `recon.spectrum.spectra`; they are the solver's to change.
    threads
        How many threads compute; by default `usual_threads`.
    whole_path_m
        `path_limits_m` of the depth block that this is a part of; None where it is a part of none. Tables
        of parts then have the same nodes, so that their fields add up to the same numbers.
    whole_near_m
        Depth of the nearest plane of the depth block that this is a part of: their lattices are the same.
    """

    capture: Capture
    grid: VoxelGrid
    camera: Camera
    light: Light
    depth_blocks: tuple[DepthBlock, ...]
    window: Window
    progress: Callable[[float], None] = ignore
    passes: tuple[tuple[DepthBlock, ...], ...] = ()
    working_bytes: int = 64 * 2**20
    plane_bytes: int = 2**30
    device: str = "cpu"
    fft: bool | None = None
    slopes: bool = False
    wall_bytes: int = 256 * 2**20
    spectra: Spectra = spectra
    threads: int = field(default_factory=usual_threads)
    whole_path_m: tuple[float, float] | None = None
    whole_near_m: float | None = None

    def times_s(self, plane: int) -> NDArray[np.float64]:
        """(T, y or 1, x or 1) moments at which the plane is read."""
        return plane_times_s(self.capture, self.grid, self.camera, self.grid.z_m[plane])

    @property
    def band(self) -> Band:
        """The frequencies of a problem of one depth block."""
        return self.depth_blocks[0].band

    @property
    def reference_rad_per_s(self) -> float | None:
        """The frequency omega_0 from which changes with time are counted; None if they are not asked for."""
        return 2 * pi * C_M_PER_S / self.light.wavelength_m if self.slopes else None

    @property
    def frames(self) -> int:
        """Number of moments T."""
        return len(self.times_s(0))

    @property
    def path_m(self) -> tuple[float, float]:
        """Shortest and longest path at which the record is read."""
        return self.whole_path_m or path_limits_m(self.capture, self.grid, self.camera)

    @property
    def near_m(self) -> float:
        """Depth of the nearest plane, which lattices are planned for."""
        return float(self.grid.z_m[0]) if self.whole_near_m is None else self.whole_near_m

    @property
    def weights(self) -> NDArray[np.float64]:
        """(P,) weight of each position."""
        return self.camera.aperture_weights(self.capture.laser_m)


Solver = Callable[[ImagingProblem], Iterator[NDArray[np.complexfloating]]]
