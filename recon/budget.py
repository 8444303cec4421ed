"""How much memory imaging takes beyond the record itself, and how the work is cut to stay below a bound.

Everything that grows with the scan or the volume is counted here and nowhere else, for images of one frame:

==================================  ========================================================================
the field, and a slab's beside it   8 bytes a voxel; 24 more for each voxel of the thickest slab
a block of the record               8 bytes a bin of `BLOCK_POSITIONS` positions
spectra                             8 bytes a position and frequency; 40 more while phases are applied, where
                                    each position has its own first bin
a thread's plane (lattice)          about 15 bytes a point of the padded lattice and 48 a voxel
the wall's spectra (lattice)        8 bytes a point and frequency that are taken at once, and 16 a point while
                                    one is made; 8 more a point of the lattice that scattered positions are
                                    spread over
tables (other geometry)             16 bytes a node of the positions that are taken at once
==================================  ========================================================================

An image is a sum over frequencies, so that a slab may be made in several passes over the record (on a
lattice; tables take all of a slab's frequencies at once, and positions in turns). Spectra and solver share
what the fixed part leaves.
"""

from dataclasses import dataclass
from math import ceil, pi
from os import cpu_count

from recon.aperture import LatticeAxis, recognise
from recon.camera import Camera
from recon.capture import C_M_PER_S, Capture
from recon.errors import MemoryBoundError
from recon.grid import VoxelGrid
from recon.reach import Slab
from recon.solvers import lookup, scattered
from recon.solvers.lattice import plan_axis, taps_half_width

#: Positions in a block of the record, as the readers of this program make them.
BLOCK_POSITIONS = 1024
#: Most that a solver takes at once for wall spectra or tables.
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
        What a solver may take at once for tables; runs are so short that wall spectra keep to it too.
    """

    passes: tuple[tuple[Slab, ...], ...]
    working_bytes: int


@dataclass(frozen=True)
class _Need:
    """Bytes that a slab needs beside its spectra: in any case, and for the least that is taken at once.

    `together` frequencies are taken at least: one, or all where each pass costs as much as all.
    """

    fixed: int
    least: int
    together: int


def plan(
    capture: Capture, camera: Camera, parts: tuple[Slab, ...], grid: VoxelGrid, memory_bytes: int
) -> Plan:
    """Cut the work so that its peak stays below a bound.

    Parameters
    ----------
    capture, camera, grid
        What is imaged, with one frame.
    parts
        Slabs that cover the volume.
    memory_bytes
        The bound.

    Raises
    ------
    MemoryBoundError
        If not even one frequency at a time fits; it names the least that is needed.
    """
    needs = [_need(capture, camera, part, grid) for part in parts]
    reached = [part for part in parts if part.reached]
    bins = max(part.bins.stop for part in reached) - min(part.bins.start for part in reached)
    spectrum = (8 if len(capture.first_bin_s) == 1 else 48) * capture.positions + 40 * bins
    solver, together = max(need.least for need in needs), max(need.together for need in needs)
    # The Fourier matrix of a frequency is complex128 for a moment, which is in `spectrum`.
    fixed = SLACK_BYTES + 8 * grid.size + 8 * min(BLOCK_POSITIONS, capture.positions) * bins
    least = fixed + max(need.fixed for need in needs) + together * spectrum + solver
    if memory_bytes < least:
        raise MemoryBoundError(
            "memory",
            f"at most {memory_bytes / 1e6:.0f} MB",
            f"{grid.size:,} voxels from {capture.positions:,} positions need {least / 1e6:.0f} MB or more",
            f"Allow {ceil(least / 1e6)} MB, or image fewer voxels.",
        )
    spare = memory_bytes - least
    working = min(WORKING_BYTES, solver + spare // 2)
    at_once = together + (spare - (working - solver)) // spectrum
    passes: list[list[Slab]] = [[]]
    room = at_once
    for part, need in zip(parts, needs, strict=True):
        many = len(part.band)
        if not part.reached:
            passes[-1].append(part)
            continue
        longest = many if need.together == many else max(1, working // need.least)
        start = 0
        while start < many:
            if room < min(need.together, many):
                passes.append([])
                room = at_once
            stop = min(many, start + room, start + longest)
            passes[-1].append(Slab(part.planes, part.bins, part.band[start:stop]))
            room -= stop - start
            start = stop
    return Plan(tuple(map(tuple, passes)), working)


def _need(capture: Capture, camera: Camera, part: Slab, grid: VoxelGrid) -> _Need:
    if not part.reached:
        return _Need(0, 0, 1)
    planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[part.planes])
    slab = 24 * planes.size
    runs = scattered.planar_runs(capture)
    legs = runs[0].legs if runs else 1
    if scattered.regular(capture, runs):
        aperture = recognise(capture.laser_m - [0, 0, runs[0].depth_m])
        threads, wall = _lattice(aperture.x, aperture.y, planes, legs, part)
        return _Need(slab + threads, wall, 1)
    if scattered.quicker_on_lattice(runs, capture.laser_m, part.band, planes):
        # The lattice over all positions is as large as that of any run.
        x, y = scattered.lattice(capture.laser_m, legs, part.band, planes)
        threads, wall = _lattice(x, y, planes, legs, part)
        taps = 2 * taps_half_width(x.pitch_m * legs * part.band.last_rad_per_s / C_M_PER_S / pi)
        spreading = (TAP_BYTES * taps + 8) * capture.positions
        return _Need(slab + threads + spreading, wall + 8 * x.count * y.count + 8 * capture.positions, 1)
    many = len(part.band)
    nodes = lookup.node_range(capture, part.band, planes, camera)[2]
    # The table's phases, with their double-precision halves, belong to the pass's frequencies.
    fixed = slab + 40 * nodes * many + 100 * capture.positions
    return _Need(fixed, 2 * lookup.NODE_BYTES * nodes * LEAST_TABLES, many)


def _lattice(x: LatticeAxis, y: LatticeAxis, grid: VoxelGrid, legs: int, part: Slab) -> tuple[int, int]:
    """Return the bytes of all threads' planes, and of one frequency's wall spectrum."""
    wavenumber = legs * part.band.last_rad_per_s / C_M_PER_S
    along_x, along_y = plan_axis(x, grid.x_m, wavenumber), plan_axis(y, grid.y_m, wavenumber)
    points = along_y.length * along_x.length
    quarter = (along_y.half + 1) * (along_x.half + 1)
    thread = 24 * quarter + 8 * along_y.folded * along_x.folded + 8 * len(grid.y_m) * along_x.folded
    thread += 48 * len(grid.y_m) * len(grid.x_m)
    # One wall field is put on its lattice at a time, in two steps where it is spread.
    return (cpu_count() or 1) * thread + 16 * points, 8 * points
