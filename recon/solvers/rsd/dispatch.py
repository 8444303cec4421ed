"""The RSD solver for any geometry: the same numbers by the quickest way that leads there.

The image is U(v, t) = sum_omega g(omega) exp(i omega t) sum_j a_j H^(j, omega) exp(i omega r_j/c) / r_p, with
r_j = r_p, or r_p + r_c where each record has a detector spot of its own. Ways lead there:

- **lattice**: a regular grid is one (`recon.solvers.rsd.regular`), and other positions on a plane of
  constant depth are spread over one (`recon.solvers.rsd.gridding`). Records that share a detector spot are
  one such group, so that a few detectors by many lasers is a group for each detector;
- **table**: anything else is summed by look-up in time (`recon.solvers.rsd.tabulated`), positions times
  voxels;
- **term by term** (`recon.solvers.rsd.direct_f32`), positions times voxels times frequencies, where many
  frames are asked for, which need the field of each frequency.

The quickest is chosen by counting what each does; the times for that are measured.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import pi
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from recon.aperture import TOLERANCE_M, Aperture, LatticeAxis, recognise
from recon.capture import C_M_PER_S, Capture
from recon.computer import usual_threads
from recon.errors import GeometryError
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock, plane_times_s
from recon.solvers.problem import ImagingProblem, Need, Way, part_of
from recon.solvers.rsd import array as rsd_array
from recon.solvers.rsd import regular as rsd_regular
from recon.solvers.rsd import tabulated
from recon.solvers.rsd.direct_f32 import TermwisePropagator
from recon.solvers.rsd.gridding import NEAREST_WAVELENGTHS, TAP_BYTES, lattice_axis, spread
from recon.solvers.rsd.lattice import plan_axis, taps_half_width
from recon.solvers.rsd.levels import LevelPropagator, Scene, plan_levels, work_points
from recon.solvers.rsd.regular import LatticePropagator
from recon.solvers.spectral import Field, by_planes, spectral
from recon.wave import Band

#: Time of the lattice for each FFT point, plane and frequency; half of it for confocal data.
LATTICE_NS = 10.0
#: The same for each of several groups with one lattice.
SHARED_NS = 7.0
#: Time of the table for each voxel and record.
LOOKUP_NS = 4.5
#: Most groups that share a lattice's waves at once: more save less than a hundredth of the time.
GROUPS = 64
#: Time of the sum term by term for each voxel, record and frequency.
TERM_NS = 1.0
#: Memory of a record in its group: its spot (twice: once to be recognised again), number, column and row.
GROUP_BYTES = 72


@dataclass(frozen=True, eq=False)
class PlanarGroup:
    """Records that are taken on one lattice.

    Attributes
    ----------
    records
        Which of them.
    round_trip_factor
        How often the path from a laser spot to a voxel counts: once, or twice for confocal data.
    detector_m
        (3,) the spot they share, where each record has its own and its path is not the camera's affair.
    depth_m
        Depth z of their plane.
    laser_m
        (records, 3) their laser spots, z counted from that plane.
    """

    records: NDArray[np.intp]
    round_trip_factor: int
    detector_m: NDArray[np.float64] | None
    depth_m: float
    laser_m: NDArray[np.float64]

    @cached_property
    def aperture(self) -> Aperture | None:
        """The regular grid that the laser spots are; None where they are none, and must be spread."""
        with suppress(GeometryError):
            return recognise(self.laser_m)
        return None

    def detector_time_s(self, grid: VoxelGrid, z_m: float) -> NDArray[np.float64]:
        """Return the time from a plane to the group's detector spot, (y, x), or (1, 1) zero."""
        if self.detector_m is None:
            return np.zeros((1, 1))
        across = (grid.x_m - self.detector_m[0]) ** 2 + (grid.y_m[:, None] - self.detector_m[1]) ** 2
        return np.sqrt(across + (z_m - self.detector_m[2]) ** 2) / C_M_PER_S


def focus_block(problem: ImagingProblem, emitted: NDArray[np.complex64]) -> Iterator[Field]:
    """Image a problem of one depth block; yield its planes."""
    groups = planar_groups(problem.capture)
    if problem.device != "cpu":
        return _on_device(problem, emitted, groups[0])
    if _by_fft(problem, problem.band, problem.grid, groups):
        return _on_lattices(problem, emitted, groups)
    if problem.frames == 1:
        return tabulated.focus_block(problem, emitted)
    return by_planes(problem, TermwisePropagator(problem.capture, emitted, problem.band, problem.grid).focus)


def needs(problem: ImagingProblem, part: DepthBlock) -> Need:
    """Return the memory that a depth block takes, by the way that `focus_block` goes."""
    need = _needs(problem, part)
    return replace(need, fixed=need.fixed + GROUP_BYTES * problem.capture.positions)


def _needs(problem: ImagingProblem, part: DepthBlock) -> Need:
    """Return the same without the groups."""
    capture, many = problem.capture, len(part.band)
    groups = planar_groups(capture)
    planes = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[part.planes])
    if not _by_fft(problem, part.band, planes, groups):
        if problem.frames == 1:
            return tabulated.needs(problem, part)
        # term by term, from a copy of the spectra
        return Need(100 * capture.positions, 8 * capture.positions * many, many)
    round_trip_factor = groups[0].round_trip_factor
    near_m = replace(problem, grid=planes).near_m - groups[0].depth_m
    aperture = groups[0].aperture
    if aperture and together(groups):
        need = rsd_regular.needs(problem, part, aperture.x, aperture.y, round_trip_factor, near_m)
        # beside the walls, the groups' own phases at the voxels of a plane, their steps, and the wave
        pixels = planes.size // len(planes.z_m)
        shared = usual_threads() * (16 * min(len(groups), GROUPS) * pixels + need.least)
        return replace(need, fixed=need.fixed + (shared if len(groups) > 1 else 0))
    # The lattice over all positions is as large as that of any group.
    x, y = lattice(capture.laser_m, round_trip_factor, part.band, planes)
    need = rsd_regular.needs(problem, part, x, y, round_trip_factor, near_m)
    taps = 2 * taps_half_width(x.pitch_m * round_trip_factor * part.band.finest_rad_per_s / C_M_PER_S / pi)
    spreading = (TAP_BYTES * taps + 8) * capture.positions
    spread_bytes = 8 * x.count * y.count + 8 * capture.positions
    return Need(need.fixed + spreading, need.least + need.together * spread_bytes, need.together)


def _by_fft(problem: ImagingProblem, band: Band, grid: VoxelGrid, groups: Sequence[PlanarGroup]) -> bool:
    """Return whether a depth block is imaged on lattices: as asked, else as is quicker."""
    if problem.fft is not None:
        return problem.fft
    return regular(groups) or quicker_on_lattice(
        groups, problem.capture.positions, band, grid, problem.frames
    )


def planar_groups(capture: Capture) -> Sequence[PlanarGroup]:
    """Group records by detector spot; empty where the laser spots lie on no plane of constant depth.

    It is asked for with each depth block, and remembered.
    """
    if capture not in _groups:
        _groups[capture] = _grouped(capture)
    return _groups[capture]


_groups: WeakKeyDictionary[Capture, Sequence[PlanarGroup]] = WeakKeyDictionary()


def _grouped(capture: Capture) -> Sequence[PlanarGroup]:
    laser_m, detector_m = capture.laser_m, capture.detector_m
    depth_m = float(laser_m[:, 2].min() + laser_m[:, 2].max()) / 2
    if np.abs(laser_m[:, 2] - depth_m).max() > TOLERANCE_M:
        return []
    on_plane_m = laser_m - [0, 0, depth_m]
    if capture.confocal or not capture.round_trip:
        factor = 2 if capture.confocal else 1
        return [PlanarGroup(np.arange(len(laser_m)), factor, None, depth_m, on_plane_m)]
    spots_m, which = _unique(np.round(detector_m, 7))
    order = np.argsort(which, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(which))[:-1])
    return [
        PlanarGroup(records, 1, spot_m, depth_m, on_plane_m[records])
        for records, spot_m in zip(members, spots_m, strict=True)
    ]


def _unique(spots_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return different spots, and the number of each one's; quick where equal ones follow each other."""
    begins = np.flatnonzero(np.append(True, (np.diff(spots_m, axis=0) != 0).any(axis=1)))
    unique_m, which = np.unique(spots_m[begins], axis=0, return_inverse=True)
    return unique_m, np.repeat(which.reshape(-1), np.diff(begins, append=len(spots_m)))


def regular(groups: Sequence[PlanarGroup]) -> bool:
    """Return whether all records are one group on a regular grid."""
    return len(groups) == 1 and groups[0].aperture is not None


def quicker_on_lattice(
    groups: Sequence[PlanarGroup], records: int, band: Band, grid: VoxelGrid, frames: int = 1
) -> bool:
    """Return whether lattices take less time than the other ways, and are exact at these depths."""
    if not groups or (frames > 1 and len(groups) > 1):
        return False
    if _too_near(groups[0], band, grid) and not all(group.aperture for group in groups):
        return False
    return _lattice_ns(groups, band, grid) < _other_ns(records, band, grid, frames)


def _lattice_ns(groups: Sequence[PlanarGroup], band: Band, grid: VoxelGrid) -> float:
    """Return the time that lattices take [ns]; positions are spread, or a regular grid is one as it is."""
    if len(groups) > 1 and together(groups):
        each_ns = SHARED_NS * len(groups) * _points(groups[0], band, grid)
    else:
        each_ns = LATTICE_NS * sum(
            _points(group, band, grid, len(groups) > GROUPS) / group.round_trip_factor for group in groups
        )
    return each_ns * len(grid.z_m) * len(band)


def _points(group: PlanarGroup, band: Band, grid: VoxelGrid, roughly: bool = False) -> int:
    """Return the number of points of a group's FFT, on its own lattice or that which it is spread over.

    What is found `roughly`, at once, may be too large.
    """
    aperture = group.aperture
    if aperture:
        x, y = aperture.x, aperture.y
    else:
        x, y = lattice(group.laser_m, group.round_trip_factor, band, grid)
    wavenumber = group.round_trip_factor * band.finest_rad_per_s / C_M_PER_S
    near_m = None if roughly else float(grid.z_m[0]) - group.depth_m
    return (
        plan_axis(y, grid.y_m, wavenumber, near_m).length * plan_axis(x, grid.x_m, wavenumber, near_m).length
    )


def _other_ns(positions: int, band: Band, grid: VoxelGrid, frames: int) -> float:
    """Return the time that tables take, or, of many frames, the sum term by term [ns]."""
    return (LOOKUP_NS if frames == 1 else TERM_NS * len(band)) * positions * grid.size


def way(problem: ImagingProblem, part: DepthBlock) -> Way:
    """Return how a depth block is imaged, as `focus_block` goes, and what that takes."""
    groups = planar_groups(problem.capture)
    planes = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[part.planes])
    if not _by_fft(problem, part.band, planes, groups):
        count_ns = _other_ns(problem.capture.positions, part.band, planes, problem.frames)
        return Way(1e-9 * count_ns, False, ())
    if len(groups) == 1 and problem.frames == 1:
        count_ns = _levels_ns(replace(problem, grid=planes), part.band, groups[0])
    else:
        count_ns = _lattice_ns(groups, part.band, planes)
    return Way(1e-9 * count_ns, True, tuple(group.records for group in groups))


def _levels_ns(problem: ImagingProblem, band: Band, group: PlanarGroup) -> float:
    """Return the time that the planes of a problem take level by level [ns]."""
    grid, aperture = _planned_for(group, problem), group.aperture
    if aperture is None:
        axes = lattice(group.laser_m, group.round_trip_factor, band, problem.grid)
        aperture = Aperture(*axes, np.zeros(0, np.intp), np.zeros(0, np.intp))
    scene = Scene.of(aperture, grid, group.round_trip_factor, partial(_moments_s, problem, group))
    points = work_points(plan_levels(scene, band)) / group.round_trip_factor
    return LATTICE_NS * points * len(problem.grid.z_m)


def _too_near(group: PlanarGroup, band: Band, grid: VoxelGrid) -> bool:
    """Return whether evanescent waves, which spreading loses, are left at the nearest plane."""
    longest_m = 2 * pi * C_M_PER_S / band.first_rad_per_s
    return float(grid.z_m[0]) - group.depth_m < NEAREST_WAVELENGTHS * longest_m


def lattice(
    laser_m: NDArray[np.float64], round_trip_factor: int, band: Band, grid: VoxelGrid
) -> tuple[LatticeAxis, LatticeAxis]:
    """Choose the axes x and y of the lattice that scattered positions are spread over."""
    wavenumber = round_trip_factor * band.finest_rad_per_s / C_M_PER_S
    return (
        lattice_axis(laser_m[:, 0], grid.x_m, wavenumber),
        lattice_axis(laser_m[:, 1], grid.y_m, wavenumber),
    )


def _put(
    problem: ImagingProblem, emitted: NDArray[np.complex64], group: PlanarGroup
) -> tuple[Aperture, NDArray[np.complex64]]:
    """Return a group's positions as a lattice and what its points emit: as they are, or spread."""
    if len(group.records) < problem.capture.positions:
        emitted = emitted[:, group.records]
    if group.aperture:
        return group.aperture, emitted
    x, y = lattice(group.laser_m, group.round_trip_factor, problem.band, problem.grid)
    wavenumber = group.round_trip_factor * problem.band.finest_rad_per_s / C_M_PER_S
    return spread(group.laser_m, emitted, x, y, wavenumber)


def _from(group: PlanarGroup, grid: VoxelGrid) -> VoxelGrid:
    """Return voxels with depths counted from the group's plane."""
    return VoxelGrid(grid.x_m, grid.y_m, grid.z_m - group.depth_m)


def _planned_for(group: PlanarGroup, problem: ImagingProblem) -> VoxelGrid:
    """Return the voxels of a plane, at the depth that lattices are planned for."""
    return _from(group, VoxelGrid(problem.grid.x_m, problem.grid.y_m, np.array([problem.near_m])))


def _on_lattices(
    problem: ImagingProblem, emitted: NDArray[np.complex64], groups: Sequence[PlanarGroup]
) -> Iterator[Field]:
    if len(groups) == 1:
        yield from by_planes(problem, _propagation(problem, emitted, groups[0]))
        return
    total: Field = np.zeros(
        (len(problem.grid.z_m), 1 + problem.slopes, *problem.grid.shape[1:]), np.complex64
    )
    at_once = 1
    if together(groups):
        wall_bytes = 8 * len(problem.band) * _points(groups[0], problem.band, problem.grid)
        at_once = min(GROUPS, max(1, problem.working_bytes // wall_bytes))
    for start in range(0, len(groups), at_once):
        some = groups[start : start + at_once]
        told = part_of(problem.progress, start / len(groups), (start + len(some)) / len(groups))
        propagation = _propagation if len(some) == 1 else _shared_propagation
        focus = propagation(problem, emitted, *some)
        for sum_, plane in zip(total, by_planes(replace(problem, progress=told), focus), strict=True):
            sum_ += plane
    yield from total


def together(groups: Sequence[PlanarGroup]) -> bool:
    """Return whether all groups have the same positions in the same order, so that one lattice is theirs."""
    return all(np.array_equal(group.laser_m, groups[0].laser_m) for group in groups[1:])


def _shared_propagation(
    problem: ImagingProblem, emitted: NDArray[np.complex64], *groups: PlanarGroup
) -> Callable[[float, NDArray[np.float64], float | None], Field]:
    """Return what focuses groups with one lattice on a plane; the wave is transformed once for all."""
    of_groups = [_put(problem, emitted, group) for group in groups]
    aperture, first = of_groups[0]
    depth_m = groups[0].depth_m
    voxels = _planned_for(groups[0], problem)
    through = LatticePropagator(aperture, first, problem.band, voxels, groups[0].round_trip_factor, 0)
    walls = through.walls_of([emission for _, emission in of_groups])

    def focus(z_m: float, times_s: NDArray[np.float64], reference_rad_per_s: float | None) -> Field:
        own_s = [times_s[0] + group.detector_time_s(problem.grid, z_m) for group in groups]
        moments_s = np.stack([np.broadcast_to(one, problem.grid.shape[1:]) for one in own_s])
        return through.focus_together(z_m - depth_m, walls, moments_s, reference_rad_per_s)

    return focus


def _propagation(
    problem: ImagingProblem, emitted: NDArray[np.complex64], group: PlanarGroup
) -> Callable[[float, NDArray[np.float64], float | None], Field]:
    """Return what focuses a group on a plane at moments that do not hold the group's own detector path."""
    aperture, emitted = _put(problem, emitted, group)
    arguments = aperture, emitted, problem.band, _planned_for(group, problem), group.round_trip_factor
    if problem.frames > 1:
        whole = LatticePropagator(*arguments, problem.wall_bytes, threads=problem.threads)
        return lambda z_m, times_s, reference: whole.focus(
            z_m - group.depth_m, times_s + group.detector_time_s(problem.grid, z_m), reference
        )
    moments = partial(_moments_s, problem, group)
    through = LevelPropagator(*arguments, moments, problem.wall_bytes, problem.threads)
    return lambda z_m, _, reference: through.focus(z_m - group.depth_m, reference)


def _moments_s(
    problem: ImagingProblem, group: PlanarGroup, grid: VoxelGrid, z_m: float
) -> NDArray[np.float64]:
    """Return when voxels are read, those of a plane at a depth before the group's."""
    times_s = plane_times_s(problem.capture, grid, problem.camera, z_m + group.depth_m)
    return times_s + group.detector_time_s(grid, z_m + group.depth_m)


def _on_device(
    problem: ImagingProblem, emitted: NDArray[np.complex64], group: PlanarGroup
) -> Iterator[Field]:
    aperture, emitted = _put(problem, emitted, group)
    times_s = [
        problem.times_s(plane) + group.detector_time_s(problem.grid, z_m)
        for plane, z_m in enumerate(problem.grid.z_m)
    ]
    yield from rsd_array.focus_block(
        aperture,
        emitted,
        problem.band,
        _from(group, problem.grid),
        group.round_trip_factor,
        times_s,
        problem.progress,
        reference_rad_per_s=problem.reference_rad_per_s,
        near_m=problem.near_m - group.depth_m,
        on=rsd_array.backend(problem.device),
    )


def check(problem: ImagingProblem) -> None:
    """Refuse what a device cannot do.

    Raises
    ------
    ParameterError
        If the device is unknown or missing.
    GeometryError
        If the positions are not one group on a lattice.
    """
    if problem.device == "cpu":
        return
    rsd_array.backend(problem.device)
    groups = planar_groups(problem.capture)
    if len(groups) != 1:
        raise GeometryError(
            f"device {problem.device}",
            "laser positions on one plane, with one detector spot or seen where they are lit",
            f"there are {len(groups)} detector spots on it" if groups else "the wall is not flat",
            "Use the cpu, which takes any geometry.",
        )
    depth_block = next(depth_block for depth_block in problem.depth_blocks if depth_block.reached)
    near = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[depth_block.planes])
    if not regular(groups) and _too_near(groups[0], depth_block.band, near):
        raise GeometryError(
            f"device {problem.device}",
            f"a volume from {near.z_m[0]:.3f} m on and positions off an even grid",
            f"that is nearer than {NEAREST_WAVELENGTHS:g} wavelengths",
            "Begin farther away, or use the cpu.",
        )


focus = spectral(focus_block, check=check)
