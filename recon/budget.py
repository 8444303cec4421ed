"""How much memory imaging takes beyond the record itself, and how the work is cut to stay below a bound.

Everything that grows with the scan or the volume is counted here and nowhere else:

==================================  ========================================================================
the field, and a slab's beside it   8 bytes a voxel; 16 more for each voxel of the thickest slab
a block of the record               8 bytes a bin of `BLOCK_POSITIONS` positions
spectra                             8 bytes a position and frequency; 40 more while phases are applied, where
                                    each position has its own first bin
a thread's plane (RSD)              about 15 bytes a point of the padded lattice, for each thread
the wall's spectra (RSD)            8 bytes a point and frequency that are taken at once; 8 more a point of
                                    the lattice that scattered positions are spread over
tables (scattered, no plane)        16 bytes a node of the positions that are taken at once
==================================  ========================================================================

An image is a sum over frequencies, so that a slab may be made in several passes over the record (on a
lattice; tables take all of a slab's frequencies at once, and positions in turns). Spectra and solver share
what the fixed part leaves.
"""

from dataclasses import dataclass
from math import ceil, pi
from os import cpu_count

from recon.aperture import Aperture, LatticeAxis
from recon.capture import C_M_PER_S, Capture
from recon.errors import MemoryBoundError
from recon.grid import VoxelGrid
from recon.reach import Slab
from recon.solvers import lookup, scattered
from recon.solvers.lattice import plan_axis, taps_half_width
from recon.solvers.spreading import lattice_axis

#: Positions in a block of the record, as the readers of this program make them.
BLOCK_POSITIONS = 1024
#: What the solvers take at once when nothing is asked.
WORKING_BYTES = 256 * 2**20
#: What computing one weight of a position's spreading takes for a moment, in double precision.
TAP_BYTES = 64
#: Positions whose tables are made at once at the least; fewer would be slow.
LEAST_TABLES = 256
#: Small arrays, a file's block of counts, and the FFT library's own buffers.
SLACK_BYTES = 32 * 2**20


@dataclass(frozen=True)
class Plan:
    """The work, cut.

    Attributes
    ----------
    passes
        Slabs, or runs of frequencies of a slab, that share one pass over the record.
    working_bytes
        What a solver may take at once for wall spectra or tables.
    """

    passes: tuple[tuple[Slab, ...], ...]
    working_bytes: int


@dataclass(frozen=True)
class _Need:
    """Bytes: whatever is done, for each frequency of spectra, and the solver's least.

    `together` frequencies are taken at least: one, or all of a slab where each pass costs as much as all.
    """

    fixed: int
    spectrum: int
    solver: int
    together: int = 1


def plan(
    capture: Capture,
    aperture: Aperture | None,
    parts: list[Slab],
    grid: VoxelGrid,
    memory_bytes: int | None = None,
) -> Plan:
    """Cut the work so that its peak stays below a bound.

    Parameters
    ----------
    capture, aperture, grid
        What is imaged; the aperture is None for scattered positions.
    parts
        Slabs that cover the volume.
    memory_bytes
        The bound; None takes everything in one pass.

    Raises
    ------
    MemoryBoundError
        If not even one frequency at a time fits; it names the least that is needed.
    """
    reached = [part for part in parts if part.reached]
    if memory_bytes is None:
        return Plan((tuple(reached),), WORKING_BYTES)
    need = _need(capture, aperture, reached, grid)
    least = need.fixed + need.together * need.spectrum + need.solver
    if memory_bytes < least:
        raise MemoryBoundError(
            "memory",
            f"at most {memory_bytes / 1e6:.0f} MB",
            f"{grid.size:,} voxels from {capture.positions:,} positions need {least / 1e6:.0f} MB or more",
            f"Allow {ceil(least / 1e6)} MB, or image fewer voxels.",
        )
    spare = memory_bytes - least
    working = min(WORKING_BYTES, need.solver + spare // 2)
    at_once = need.together + (spare - (working - need.solver)) // need.spectrum
    passes: list[list[Slab]] = [[]]
    room = at_once
    for part in reached:
        start, many = 0, len(part.band.weights)
        while start < many:
            if room < min(need.together, many):
                passes.append([])
                room = at_once
            stop = min(many, start + room)
            passes[-1].append(Slab(part.planes, part.bins, part.band[start:stop]))
            room -= stop - start
            start = stop
    return Plan(tuple(map(tuple, passes)), working)


def _need(capture: Capture, aperture: Aperture | None, reached: list[Slab], grid: VoxelGrid) -> _Need:
    per_plane = len(grid.y_m) * len(grid.x_m)
    thickest = max(part.planes.stop - part.planes.start for part in reached)
    bins = max(part.bins.stop for part in reached) - min(part.bins.start for part in reached)
    fixed = SLACK_BYTES + 8 * grid.size + 16 * thickest * per_plane
    # The Fourier matrix of a frequency is complex128 for a moment.
    fixed += 8 * min(BLOCK_POSITIONS, capture.positions) * bins
    spectrum = (8 if len(capture.first_bin_s) == 1 else 48) * capture.positions + 40 * bins
    if aperture is not None:
        legs = 2 if capture.confocal else 1
        thread, solver = _lattice(aperture.x, aperture.y, grid, legs, reached)
        return _Need(fixed + thread, spectrum, solver)
    runs = scattered.planar_runs(capture.laser_m, capture.detector_m)
    threads, solvers, together = [0], [0], [1]
    for part in reached:
        planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[part.planes])
        if scattered.quicker_on_lattice(runs, capture.laser_m, part.band, planes):
            # The lattice over all positions is as large as that of any run.
            legs = 2 if runs[0].detector_m is None else 1
            wavenumber = legs * part.band.last_rad_per_s / C_M_PER_S
            x, y = (
                lattice_axis(capture.laser_m[:, i], axis, wavenumber)
                for i, axis in ((0, grid.x_m), (1, grid.y_m))
            )
            thread, solver = _lattice(x, y, grid, legs, [part])
            taps = 2 * taps_half_width(x.pitch_m * wavenumber / pi)
            spreading = TAP_BYTES * taps * capture.positions
            threads.append(thread + spreading + 8 * x.count * y.count * len(part.band.weights))
            solvers.append(solver)
        else:
            nodes = lookup.node_range(capture.laser_m, capture.detector_m, part.band, planes)[2]
            # The table's phases, with their double-precision halves, belong to the pass's frequencies.
            threads.append(40 * nodes * len(part.band.weights) + 100 * capture.positions)
            together.append(len(part.band.weights))
            solvers.append(2 * lookup.NODE_BYTES * nodes * LEAST_TABLES)
    return _Need(fixed + max(threads), spectrum, max(solvers), max(together))


def _lattice(
    x: LatticeAxis, y: LatticeAxis, grid: VoxelGrid, legs: int, reached: list[Slab]
) -> tuple[int, int]:
    """Return the bytes of all threads' planes, and of one frequency's wall spectrum."""
    wavenumber = legs * max(part.band.last_rad_per_s for part in reached) / C_M_PER_S
    along_x, along_y = plan_axis(x, grid.x_m, wavenumber), plan_axis(y, grid.y_m, wavenumber)
    points = along_y.length * along_x.length
    quarter = (along_y.half + 1) * (along_x.half + 1)
    thread = 24 * quarter + 8 * points + 8 * len(grid.y_m) * along_x.length
    return (cpu_count() or 1) * thread, 8 * points
