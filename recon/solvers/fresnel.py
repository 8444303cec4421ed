"""The Fresnel solver: the RSD solver with the paraxial wave (paper, supplement D.1, equation S.17).

The distance r is replaced by z + (dx^2 + dy^2)/(2 z) in the phase, and by z in the amplitude:

    exp(i k r)/r  ->  exp(i k z)/z exp(i k dx^2/(2 z)) exp(i k dy^2/(2 z))

The next term of the root is -(dx^2 + dy^2)^2/(8 z^3). Its phase, k d^4/(8 L^3) = pi d^4/(4 L^3 lambda), is
pi times the figure of S.18: that must be small for an aperture of radius d at the distance L.

The wave is a product of its axes, so that its transform is the outer product of two short cosine transforms,
and 0.75 FFTs of N points remain for each plane and frequency.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from recon.aperture import LatticeAxis
from recon.capture import C_M_PER_S, Capture
from recon.fft import dct
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Need, Way
from recon.solvers.rsd import kernels
from recon.solvers.rsd.lattice import AxisPlan, plan_axis
from recon.solvers.rsd.regular import LatticePropagator, Workspace, aperture
from recon.solvers.rsd.regular import needs as lattice_needs
from recon.solvers.spectral import Field, by_planes, spectral

#: Figure of S.18 above which there is a warning: pi times it, 0.3 radians, is a twentieth of a wave.
MAX_FIGURE = 0.1
#: Time of one core for each FFT point, plane and frequency.
POINT_S = 7e-9


def figure(capture: Capture, wavelength_m: float, depth_m: float) -> float:
    """Return d^4/(4 L^3 lambda) of S.18 for the half diagonal d of the wall; confocal data have lambda/2."""
    extent_m = np.ptp(capture.laser_m[:, :2], axis=0)
    radius_m = float(np.hypot(*extent_m)) / 2
    return (2 if capture.confocal else 1) * radius_m**4 / (4 * depth_m**3 * wavelength_m)


def warnings(capture: Capture, wavelength_m: float, grid: VoxelGrid) -> list[str]:
    """Say if the approximation is poor somewhere in a volume, and from which depth on it is good."""
    near_m = float(grid.z_m[0])
    found = figure(capture, wavelength_m, near_m)
    if found <= MAX_FIGURE:
        return []
    good_m = near_m * (found / MAX_FIGURE) ** (1 / 3)
    return [
        f"the Fresnel approximation needs d^4/(4 L^3 lambda) << 1, and it is {found:.2g} at a depth of "
        f"{near_m:.2f} m: up to {found:.2g} half waves of error at the wall's corners; it is valid from "
        f"{good_m:.1f} m on, or use --solver rsd, which is exact"
    ]


class FresnelPropagator(LatticePropagator):
    """Convolves with the paraxial wave on a lattice."""

    def _planned(self, wall: LatticeAxis, voxels_m: NDArray[np.float64], near_m: float) -> AxisPlan:
        """Plan an axis for the chirp's highest frequency, k dx/z, as far as 45 degrees: it fails beyond."""
        ends_m = wall.coordinates_m[[0, -1]]
        farthest_m = max(abs(voxels_m[-1] - ends_m[0]), abs(ends_m[1] - voxels_m[0]))
        return plan_axis(wall, voxels_m, self._wavenumber * min(1.0, farthest_m / near_m))

    def _walk(self, z_m: float, work: Workspace) -> Iterator[int]:
        """From the lowest frequency up, leave the kernel's transform in `work` and yield the index."""
        for index in range(len(self.band)):
            k = self._round_trip_factor * self.band.frequencies_rad_per_s[index] / C_M_PER_S
            along_y, along_x = (_chirp(axis, k, z_m) for axis in (self._y, self._x))
            kernels.outer(along_y * np.complex64(np.exp(1j * k * z_m) / z_m), along_x, work.kernel)
            yield index


def _chirp(axis: AxisPlan, k: float, z_m: float) -> NDArray[np.complex64]:
    """Return the cosine transform of exp(i k d^2/(2 z)) at offsets d from 0 to half an FFT's length."""
    offsets_m = np.arange(axis.half + 1) * axis.step_m
    wave = np.exp(0.5j * k / z_m * offsets_m**2)
    return (dct(wave.real, type=1) + 1j * dct(wave.imag, type=1)).astype(np.complex64)


def _focus_block(problem: ImagingProblem, emitted: Field) -> Iterator[Field]:
    round_trip_factor = 2 if problem.capture.confocal else 1
    wall = aperture(problem.capture)
    through = FresnelPropagator(
        wall,
        emitted,
        problem.band,
        problem.grid,
        round_trip_factor,
        problem.wall_bytes,
        threads=problem.threads,
    )
    return by_planes(problem, through.focus)


def needs(problem: ImagingProblem, part: DepthBlock) -> Need:
    """Return the memory that a depth block takes; raises as `aperture`."""
    wall = aperture(problem.capture)
    return lattice_needs(problem, part, wall.x, wall.y, 2 if problem.capture.confocal else 1)


def way(problem: ImagingProblem, part: DepthBlock) -> Way:
    """Return what a depth block takes; raises as `aperture`."""
    wall = aperture(problem.capture)
    factor = 2 if problem.capture.confocal else 1
    wavenumber = factor * part.band.finest_rad_per_s / C_M_PER_S
    axes = (wall.x, problem.grid.x_m), (wall.y, problem.grid.y_m)
    lengths = [plan_axis(axis, at_m, wavenumber).length for axis, at_m in axes]
    planes = part.planes.stop - part.planes.start
    work_s = POINT_S * lengths[0] * lengths[1] * planes * len(part.band)
    return Way(work_s, True, (np.arange(problem.capture.positions),))


focus = spectral(_focus_block, check=lambda problem: aperture(problem.capture))
