"""The RSD solver for any geometry: the same numbers by the quickest way that leads there.

The image is U(v, t) = sum_omega g(omega) exp(i omega t) sum_j a_j H^(j, omega) exp(i omega r_j/c) / r_p, with
r_j = r_p, or r_p + r_c where each record has a detector spot of its own. Ways lead there:

- **lattice**: a regular grid is one (`recon.solvers.rsd.regular`), and other positions on a plane of
  constant depth are spread over one (`recon.solvers.rsd.gridding`). Records that share a detector spot are
  one such run, so that a few detectors by many lasers is a run for each detector;
- **table**: anything else is summed by look-up in time (`recon.solvers.rsd.tabulated`), positions times
  voxels;
- **term by term** (`recon.solvers.rsd.direct_f32`), positions times voxels times frequencies, where many
  frames are asked for, which need the field of each frequency.

The quickest is chosen by counting what each does; the times for that are measured.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import TOLERANCE_M, Aperture, LatticeAxis, recognise
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError, ParameterError
from recon.grid import VoxelGrid
from recon.sampling import Slab
from recon.solvers.problem import ImagingProblem, Need, part_of
from recon.solvers.rsd import array as rsd_array
from recon.solvers.rsd import regular as rsd_regular
from recon.solvers.rsd import tabulated
from recon.solvers.rsd.direct_f32 import TermwisePropagator
from recon.solvers.rsd.gridding import NEAREST_WAVELENGTHS, TAP_BYTES, lattice_axis, spread
from recon.solvers.rsd.lattice import plan_axis, taps_half_width
from recon.solvers.rsd.regular import LatticePropagator
from recon.solvers.spectral import Field, by_planes, spectral
from recon.wave import Band

#: Time of the lattice for each FFT point, plane and frequency; half of it for confocal data.
LATTICE_NS = 10.0
#: Time of the table for each voxel and record.
LOOKUP_NS = 4.5
#: Time of the sum term by term for each voxel, record and frequency.
TERM_NS = 1.0


@dataclass(frozen=True)
class Run:
    """Records that are taken on one lattice.

    Attributes
    ----------
    records
        Which of them.
    legs
        Legs of the path that the kernel stands for: 1, or 2 for confocal data.
    detector_m
        (3,) the spot they share, where each record has its own and its leg is not the camera's affair.
    depth_m
        Depth z of their plane.
    """

    records: NDArray[np.intp]
    legs: int
    detector_m: NDArray[np.float64] | None
    depth_m: float

    def leg_s(self, grid: VoxelGrid, z_m: float) -> NDArray[np.float64]:
        """Return the time from a plane to the run's detector spot, (y, x), or (1, 1) zero."""
        if self.detector_m is None:
            return np.zeros((1, 1))
        across = (grid.x_m - self.detector_m[0]) ** 2 + (grid.y_m[:, None] - self.detector_m[1]) ** 2
        return np.sqrt(across + (z_m - self.detector_m[2]) ** 2) / C_M_PER_S


def focus_slab(problem: ImagingProblem, emitted: NDArray[np.complex64]) -> Iterator[Field]:
    """Image a problem of one slab; yield its planes."""
    runs = planar_runs(problem.capture)
    if problem.device != "cpu":
        return _on_device(problem, emitted, runs[0])
    if _by_fft(problem, problem.band, problem.grid, runs):
        return _on_lattices(problem, emitted, runs)
    if problem.frames == 1:
        return tabulated.focus_slab(problem, emitted)
    return by_planes(problem, TermwisePropagator(problem.capture, emitted, problem.band, problem.grid).focus)


def needs(problem: ImagingProblem, part: Slab) -> Need:
    """Return the memory that a slab takes, by the way that `focus_slab` goes."""
    capture, many = problem.capture, len(part.band)
    runs = planar_runs(capture)
    planes = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[part.planes])
    if not _by_fft(problem, part.band, planes, runs):
        if problem.frames == 1:
            return tabulated.needs(problem, part)
        # term by term, from a copy of the spectra
        return Need(100 * capture.positions, 8 * capture.positions * many, many)
    legs = runs[0].legs
    if regular(capture, runs):
        aperture = recognise(capture.laser_m - [0, 0, runs[0].depth_m])
        return rsd_regular.needs(problem, part, aperture.x, aperture.y, legs)
    # The lattice over all positions is as large as that of any run.
    x, y = lattice(capture.laser_m, legs, part.band, planes)
    need = rsd_regular.needs(problem, part, x, y, legs)
    taps = 2 * taps_half_width(x.pitch_m * legs * part.band.last_rad_per_s / C_M_PER_S / pi)
    spreading = (TAP_BYTES * taps + 8) * capture.positions
    spread_bytes = 8 * x.count * y.count + 8 * capture.positions
    return Need(need.fixed + spreading, need.least + need.together * spread_bytes, need.together)


def _by_fft(problem: ImagingProblem, band: Band, grid: VoxelGrid, runs: Sequence[Run]) -> bool:
    """Return whether a slab is imaged on lattices: as asked, else as is quicker."""
    if problem.fft is not None:
        return problem.fft
    return regular(problem.capture, runs) or quicker_on_lattice(
        runs, problem.capture.laser_m, band, grid, problem.frames
    )


def planar_runs(capture: Capture) -> Sequence[Run]:
    """Group records by detector spot; empty where the laser spots lie on no plane of constant depth."""
    laser_m, detector_m = capture.laser_m, capture.detector_m
    depth_m = float(laser_m[:, 2].min() + laser_m[:, 2].max()) / 2
    if np.abs(laser_m[:, 2] - depth_m).max() > TOLERANCE_M:
        return []
    if capture.confocal or not capture.round_trip:
        return [Run(np.arange(len(laser_m)), 2 if capture.confocal else 1, None, depth_m)]
    spots_m, which = np.unique(np.round(detector_m, 7), axis=0, return_inverse=True)
    return [
        Run(np.flatnonzero(which.reshape(-1) == number), 1, spot_m, depth_m)
        for number, spot_m in enumerate(spots_m)
    ]


def regular(capture: Capture, runs: Sequence[Run]) -> bool:
    """Return whether all records are one run on a regular grid."""
    if len(runs) != 1:
        return False
    try:
        recognise(capture.laser_m - [0, 0, runs[0].depth_m])
    except GeometryError:
        return False
    return True


def quicker_on_lattice(
    runs: Sequence[Run], laser_m: NDArray[np.float64], band: Band, grid: VoxelGrid, frames: int = 1
) -> bool:
    """Return whether lattices take less time than the other ways, and are exact at these depths."""
    if not runs or (frames > 1 and len(runs) > 1) or _too_near(runs[0], band, grid):
        return False
    points = 0.0
    for run in runs:
        x, y = lattice(laser_m[run.records], run.legs, band, grid)
        wavenumber = run.legs * band.last_rad_per_s / C_M_PER_S
        lengths = [plan_axis(axis, at, wavenumber).length for axis, at in ((x, grid.x_m), (y, grid.y_m))]
        points += lengths[0] * lengths[1] / run.legs
    other_ns = LOOKUP_NS if frames == 1 else TERM_NS * len(band)
    return LATTICE_NS * points * len(grid.z_m) * len(band) < other_ns * len(laser_m) * grid.size


def _too_near(run: Run, band: Band, grid: VoxelGrid) -> bool:
    """Return whether evanescent waves, which spreading loses, are left at the nearest plane."""
    longest_m = 2 * pi * C_M_PER_S / band.first_rad_per_s
    return float(grid.z_m[0]) - run.depth_m < NEAREST_WAVELENGTHS * longest_m


def lattice(
    laser_m: NDArray[np.float64], legs: int, band: Band, grid: VoxelGrid
) -> tuple[LatticeAxis, LatticeAxis]:
    """Choose the axes x and y of the lattice that scattered positions are spread over."""
    wavenumber = legs * band.last_rad_per_s / C_M_PER_S
    return (
        lattice_axis(laser_m[:, 0], grid.x_m, wavenumber),
        lattice_axis(laser_m[:, 1], grid.y_m, wavenumber),
    )


def _put(
    problem: ImagingProblem, emitted: NDArray[np.complex64], run: Run
) -> tuple[Aperture, NDArray[np.complex64]]:
    """Return a run's positions as a lattice and what its points emit: as they are, or spread."""
    laser_m = problem.capture.laser_m
    if len(run.records) < len(laser_m):
        laser_m, emitted = laser_m[run.records], emitted[:, run.records]
    try:
        return recognise(laser_m - [0, 0, run.depth_m]), emitted
    except GeometryError:
        x, y = lattice(laser_m, run.legs, problem.band, problem.grid)
        return spread(laser_m, emitted, x, y, run.legs * problem.band.last_rad_per_s / C_M_PER_S)


def _from(run: Run, grid: VoxelGrid) -> VoxelGrid:
    """Return voxels with depths counted from the run's plane."""
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m - run.depth_m)


def _on_lattices(
    problem: ImagingProblem, emitted: NDArray[np.complex64], runs: Sequence[Run]
) -> Iterator[Field]:
    if len(runs) == 1:
        yield from by_planes(problem, _propagation(problem, emitted, runs[0]))
        return
    total: Field = np.zeros((len(problem.grid.z_m), 1, *problem.grid.shape[1:]), np.complex64)
    for number, run in enumerate(runs):
        told = part_of(problem.progress, number / len(runs), (number + 1) / len(runs))
        part = replace(problem, progress=told)
        for sum_, plane in zip(total, by_planes(part, _propagation(problem, emitted, run)), strict=True):
            sum_ += plane
    yield from total


def _propagation(
    problem: ImagingProblem, emitted: NDArray[np.complex64], run: Run
) -> Callable[[float, NDArray[np.float64]], Field]:
    """Return what focuses a run on a plane at moments that do not hold the run's own leg."""
    aperture, emitted = _put(problem, emitted, run)
    through = LatticePropagator(
        aperture, emitted, problem.band, _from(run, problem.grid), run.legs, problem.wall_bytes
    )
    return lambda z_m, times_s: through.focus(z_m - run.depth_m, times_s + run.leg_s(problem.grid, z_m))


def _on_device(problem: ImagingProblem, emitted: NDArray[np.complex64], run: Run) -> Iterator[Field]:
    aperture, emitted = _put(problem, emitted, run)
    times_s = [
        problem.times_s(plane) + run.leg_s(problem.grid, z_m) for plane, z_m in enumerate(problem.grid.z_m)
    ]
    yield from rsd_array.focus_slab(
        aperture,
        emitted,
        problem.band,
        _from(run, problem.grid),
        run.legs,
        times_s,
        problem.progress,
        on=rsd_array.backend(problem.device),
    )[:, None]


def check(problem: ImagingProblem) -> None:
    """Refuse what a device cannot do.

    Raises
    ------
    ParameterError
        If the device is unknown or missing, or many frames are asked of it.
    GeometryError
        If the positions are not one run on a lattice.
    """
    if problem.device == "cpu":
        return
    rsd_array.backend(problem.device)
    if problem.frames > 1:
        raise ParameterError(
            f"device {problem.device}",
            f"the {problem.camera.name} camera",
            f"it shows {problem.frames} frames, and the device makes images of one",
            "Use the cpu.",
        )
    runs = planar_runs(problem.capture)
    if len(runs) != 1:
        raise GeometryError(
            f"device {problem.device}",
            "laser positions on one plane, with one detector spot or seen where they are lit",
            f"there are {len(runs)} detector spots on it" if runs else "the wall is not flat",
            "Use the cpu, which takes any geometry.",
        )
    slab = next(slab for slab in problem.slabs if slab.reached)
    near = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[slab.planes])
    if not regular(problem.capture, runs) and _too_near(runs[0], slab.band, near):
        raise GeometryError(
            f"device {problem.device}",
            f"a volume from {near.z_m[0]:.3f} m on and positions off an even grid",
            f"that is nearer than {NEAREST_WAVELENGTHS:g} wavelengths",
            "Begin farther away, or use the cpu.",
        )


focus = spectral(focus_slab, check=check)
