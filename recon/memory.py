"""How much memory imaging takes beyond the record itself, and how the work is cut to stay below a bound.

Everything that grows with the scan or the volume is counted: here what all solvers need, and beside each
solver that keeps to a bound what it needs itself (`needs`; lattice and tables below):

==================================  ========================================================================
the field and its lateness          12 bytes a voxel; 32 more for each voxel of the thickest depth block
blocks of the record                `blocks_bytes`: 8 bytes a bin of those in work, read and mixed ahead
spectra                             8 bytes a position and frequency; 40 more while phases are applied, where
                                    each position has its own first bin
a thread's plane (lattice)          about 15 bytes a point of the padded lattice and 48 a voxel
the wall's spectra (lattice)        8 bytes a point and frequency that are taken at once, and 16 a point while
                                    one is made; 8 more a point of the lattice that scattered positions are
                                    spread over
groups of records (RSD)             72 bytes a position
tables (other geometry)             16 bytes a node of the positions that are taken at once
a video's front view                4 bytes a voxel of a plane and frame
a video's planes in work            8 bytes a voxel of a plane, frame and frequency; 5 planes for each thread
==================================  ========================================================================

An image is a sum over frequencies, so that a depth block may be made in several passes over the record (on a
lattice; tables take all of a depth block's frequencies at once, and positions in turns). A video needs all
of them at once, and fewer threads where memory is short. Spectra and solver share what the fixed part leaves.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

from recon.errors import MemoryBoundError
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Need
from recon.spectrum import blocks_bytes

#: Most that a solver takes at once for wall spectra or tables.
WORKING_BYTES = 256 * 2**20
#: Planes of a video that are held for each thread: the one in work, two that wait in turn, and the one
#: that is taken, with its squares.
PLANES_PER_THREAD = 5
#: Small arrays, a file's block of counts, and the FFT library's own buffers.
SLACK_BYTES = 32 * 2**20


#: A solver's memory for a part of the depth.
Needs = Callable[[ImagingProblem, DepthBlock], Need]


def cut(problem: ImagingProblem, needs_of: Needs, memory_bytes: int, held_bytes: int = 0) -> ImagingProblem:
    """Cut the work so that its peak stays below a bound.

    Parameters
    ----------
    problem
        What is imaged.
    needs_of
        What its solver needs.
    memory_bytes
        The bound.
    held_bytes
        What others take of it meanwhile.

    Raises
    ------
    MemoryBoundError
        If not even one frequency at a time fits, or one plane of a video; it names the least that is needed.
    """
    capture, grid, parts = problem.capture, problem.grid, problem.depth_blocks
    at_least = _at_least(problem, needs_of)
    needs, spectrum, together, solver = at_least.needs, at_least.spectrum, at_least.together, at_least.solver
    plane, least, frames = at_least.plane, at_least.together_bytes + held_bytes, problem.frames
    if memory_bytes < least:
        raise MemoryBoundError(
            "memory",
            f"at most {memory_bytes / 1e6:.0f} MB",
            f"{grid.size:,} voxels from {capture.positions:,} positions need {least / 1e6:.0f} MB or more",
            f"Allow {ceil(least / 1e6)} MB, or image fewer voxels{'' if frames == 1 else ' or frames'}.",
        )
    spare = memory_bytes - least
    threads = 1
    if frames > 1:
        threads = min(problem.threads, 1 + spare // (PLANES_PER_THREAD * plane))
        spare -= (threads - 1) * PLANES_PER_THREAD * plane
    working = min(WORKING_BYTES, solver + spare // 2)
    at_once = together + (spare - (working - solver)) // spectrum
    passes: list[list[DepthBlock]] = [[]]
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
            passes[-1].append(DepthBlock(part.planes, part.bins, part.band[start:stop]))
            room -= stop - start
            start = stop
    return replace(
        problem,
        passes=tuple(map(tuple, passes)),
        working_bytes=working,
        plane_bytes=problem.plane_bytes if frames == 1 else 2 * threads * plane,
    )


def least_bytes(problem: ImagingProblem, needs_of: Needs) -> int:
    """Return the smallest bound that `cut` keeps to."""
    return _at_least(problem, needs_of).together_bytes


@dataclass(frozen=True)
class _Least:
    """What a problem takes at the least.

    Attributes
    ----------
    needs
        Of each depth block.
    together
        How many frequencies are taken at once.
    spectrum, solver, plane
        Bytes of a frequency's spectra, of the solver's work, and of a plane of a video.
    together_bytes
        All that is there at once.
    """

    needs: list[Need]
    together: int
    spectrum: int
    solver: int
    plane: int
    together_bytes: int


def _at_least(problem: ImagingProblem, needs_of: Needs) -> _Least:
    capture, grid, parts = problem.capture, problem.grid, problem.depth_blocks
    needs = [needs_of(problem, part) if part.reached else Need(0, 0, 1) for part in parts]
    reached = [part for part in parts if part.reached]
    bins = max(part.bins.stop for part in reached) - min(part.bins.start for part in reached)
    spectrum = (8 if len(capture.first_bin_s) == 1 else 48) * capture.positions + 40 * bins
    solver, together = max(need.least for need in needs), max(need.together for need in needs)
    # The Fourier matrix of a frequency is complex128 for a moment, which is in `spectrum`.
    fixed = SLACK_BYTES + blocks_bytes(capture.positions, bins)
    frames, pixels = problem.frames, len(grid.y_m) * len(grid.x_m)
    plane = 8 * pixels * (max(len(part.band) for part in reached) + frames)
    fixed += 12 * grid.size if frames == 1 else 4 * pixels * frames + PLANES_PER_THREAD * plane
    least = fixed + max(need.fixed for need in needs) + together * spectrum + solver
    return _Least(needs, together, spectrum, solver, plane, least)
