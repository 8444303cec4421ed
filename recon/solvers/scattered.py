"""Any geometry at the speed of the RSD solver, or near it: what is not a regular grid with one detector.

The image is U(v) = sum_omega g(omega) sum_j H^(j, omega) exp(i omega (r_p + r_c)/c) / r_p, each record j
with its own laser and detector spot; the amplitude weight is 1/r_p, the laser leg's, as everywhere here.
Two ways lead there:

- **lattice**: where the positions lie on a plane of constant depth, they are spread over a lattice
  (`recon.solvers.spreading`) and the RSD solver does the rest. Records that share a detector spot are one
  such run, so that a few detectors by many lasers is a run for each detector.
- **table**: anything else is summed by look-up in time (`recon.solvers.lookup`), positions times voxels.

The quicker of the two is chosen by counting what each does; `LATTICE_NS` and `LOOKUP_NS` are measured.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from recon.aperture import TOLERANCE_M, Aperture, recognise
from recon.capture import C_M_PER_S
from recon.errors import GeometryError
from recon.grid import VoxelGrid
from recon.solvers import lookup, rsd
from recon.solvers.lattice import plan_axis
from recon.solvers.spreading import NEAREST_WAVELENGTHS, lattice_axis, spread
from recon.wave import Band

Propagation = Callable[..., NDArray[np.complex64]]
#: Time of the RSD solver for each FFT point, plane and frequency; half of it for confocal data.
LATTICE_NS = 10.0
#: Time of the table for each voxel and record.
LOOKUP_NS = 4.5


@dataclass(frozen=True)
class Run:
    """Records that the RSD solver takes in one run.

    Attributes
    ----------
    records
        Which of them.
    detector_m
        (3,) the spot they share, or None where each is seen where it is lit.
    depth_m
        Depth z of their plane.
    """

    records: NDArray[np.intp]
    detector_m: NDArray[np.float64] | None
    depth_m: float


def focus_slab(
    laser_m: NDArray[np.float64],
    detector_m: NDArray[np.float64],
    spectra: NDArray[np.complex64],
    band: Band,
    grid: VoxelGrid,
    progress: Callable[[float], None] | None = None,
    *,
    working_bytes: int = rsd.WALL_BYTES,
    propagate: Propagation = rsd.focus_slab,
) -> NDArray[np.complex64]:
    """Image all planes of a grid with one band.

    Parameters
    ----------
    laser_m
        (P, 3) laser spots.
    detector_m
        (1, 3) one detector spot, or (P, 3) one for each record.
    spectra
        (F, P) complex64 spectra of the histograms.
    band
        Their frequencies, and the weights of the virtual pulse.
    grid
        Voxels.
    progress
        Called with the fraction that is done, from the calling thread.
    working_bytes
        Memory for wall spectra or tables.
    propagate
        What takes a lattice's emission to the voxels, with the arguments of `recon.solvers.rsd.focus_slab`.

    Returns
    -------
    ndarray
        (z, y, x) complex64 field U.
    """
    runs = planar_runs(laser_m, detector_m)
    if not quicker_on_lattice(runs, laser_m, band, grid):
        return lookup.focus_slab(
            laser_m, detector_m, spectra, band, grid, progress, working_bytes=working_bytes
        )
    field = np.zeros(grid.shape, np.complex64)
    for number, run in enumerate(runs):

        def running(fraction: float, number: int = number) -> None:
            if progress:
                progress((number + fraction) / len(runs))

        planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m - run.depth_m)
        detector = None if run.detector_m is None else run.detector_m - [0, 0, run.depth_m]
        aperture, emitted = on_lattice(laser_m[run.records], spectra[:, run.records], run, band, planes)
        field += propagate(aperture, emitted, band, planes, detector, running, working_bytes=working_bytes)
    return field


def planar_runs(laser_m: NDArray[np.float64], detector_m: NDArray[np.float64]) -> Sequence[Run]:
    """Group records by detector spot; empty where the laser spots lie on no plane of constant depth."""
    depth_m = float(laser_m[:, 2].min() + laser_m[:, 2].max()) / 2
    if np.abs(laser_m[:, 2] - depth_m).max() > TOLERANCE_M:
        return []
    everything = np.arange(len(laser_m))
    if len(detector_m) == 1:
        return [Run(everything, detector_m[0], depth_m)]
    if np.allclose(detector_m, laser_m, rtol=0, atol=TOLERANCE_M / 2):
        return [Run(everything, None, depth_m)]
    spots_m, which = np.unique(np.round(detector_m, 7), axis=0, return_inverse=True)
    return [
        Run(np.flatnonzero(which.reshape(-1) == number), spot_m, depth_m)
        for number, spot_m in enumerate(spots_m)
    ]


def on_lattice(
    laser_m: NDArray[np.float64],
    spectra: NDArray[np.complex64],
    run: Run,
    band: Band,
    grid: VoxelGrid,
) -> tuple[Aperture, NDArray[np.complex64]]:
    """Return a run's positions as a lattice and what its points emit: as they are, or spread.

    Parameters
    ----------
    laser_m, spectra
        (P, 3) and (F, P), of the run's records alone.
    run
        Its legs and its depth.
    band
        Frequencies.
    grid
        Voxels, depths counted from the run's plane.
    """
    wavenumber = (2 if run.detector_m is None else 1) * band.last_rad_per_s / C_M_PER_S
    try:
        return recognise(laser_m - [0, 0, run.depth_m]), spectra
    except GeometryError:
        x, y = (lattice_axis(laser_m[:, i], axis, wavenumber) for i, axis in ((0, grid.x_m), (1, grid.y_m)))
        return spread(laser_m, spectra, x, y, wavenumber)


def quicker_on_lattice(
    runs: Sequence[Run], laser_m: NDArray[np.float64], band: Band, grid: VoxelGrid
) -> bool:
    """Return whether the RSD solver's runs take less time than the table, and are exact at these depths."""
    if not runs:
        return False
    longest_m = 2 * pi * C_M_PER_S / band.first_rad_per_s
    if grid.z_m[0] - runs[0].depth_m < NEAREST_WAVELENGTHS * longest_m:
        return False
    by_table_ns = LOOKUP_NS * len(laser_m) * grid.size
    points = 0.0
    for run in runs:
        legs = 2 if run.detector_m is None else 1
        wavenumber = legs * band.last_rad_per_s / C_M_PER_S
        here_m = laser_m[run.records]
        lengths = [
            plan_axis(lattice_axis(here_m[:, i], axis, wavenumber), axis, wavenumber).length
            for i, axis in ((0, grid.x_m), (1, grid.y_m))
        ]
        points += lengths[0] * lengths[1] / legs
    return LATTICE_NS * points * len(grid.z_m) * len(band.weights) < by_table_ns
