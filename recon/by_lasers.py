"""Imaging an exhaustive capture by runs of lasers.

The image of pairs is a sum over pairs, so that the fields of runs of lasers add up:

    U(v) = sum_l U_l(v),   U_l(v) = sum_omega g(omega) exp(i omega r_l(v)/c) sum_d H^(l, d, omega)
                                    exp(i omega r_d(v)/c) / r_d(v)

Inside, the detectors' side of one laser is focused by FFT as that of any scan with one detector spot; the
spherical wave's transforms are shared by all lasers of a run (`recon.solvers.rsd.dispatch`). Only a run of
lasers is in memory: its histograms, its spectra, and one field of the volume.

Both sides are alike to light (Helmholtz), and the weight 1/r is that of the side that focuses by FFT: the
pixels, or the lasers where these are more.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.camera import Camera, ConfocalCamera
from recon.capture import Capture
from recon.errors import MemoryBoundError
from recon.exhaustive import Exhaustive
from recon.grid import VoxelGrid
from recon.imaging import bounded, pictured, plan, planes
from recon.noise import Noise, photon_noise, tallied
from recon.result import Image
from recon.sampling import CONFOCAL
from recon.solvers.problem import ImagingProblem, ignore, part_of
from recon.wave import VirtualPulse
from recon.window import Window

#: Lasers in a run at the most: more share so little that is not shared already.
RUN = 64
#: Memory that imaging takes beside the volume where no bound was asked for.
USUAL_BYTES = 2**30


@dataclass(frozen=True)
class Added:
    """What a run of lasers adds to an image.

    Attributes
    ----------
    field
        (Z, 1 or 2, y, x) complex64, as `partial` yields it.
    levels
        Mean intensity that counted photons give by chance, as of `recon.noise.Noise`.
    whole
        Whether counts are whole numbers.
    """

    field: NDArray[np.complexfloating]
    levels: NDArray[np.floating]
    whole: bool


#: Gives what each run of lasers of an exhaustive capture adds; all of them together are the image.
Runs = Callable[[ImagingProblem, Exhaustive], Iterator[Added]]


def image(
    capture: Exhaustive,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    *,
    camera: Camera = CONFOCAL,
    window: Window | None = None,
    progress: Callable[[float], None] | None = None,
    memory_bytes: int | None = None,
    by: Runs | None = None,
) -> Image:
    """Focus both sides on every voxel; as `recon.imaging.image` of all pairs, by the solver rsd.

    Parameters
    ----------
    capture
        All pairs.
    pulse, grid, camera, window, progress, memory_bytes
        As of `recon.imaging.image`; without a bound some `USUAL_BYTES` are taken beside the volume.
    by
        What images the runs in place of this process.

    Raises
    ------
    MemoryBoundError, ReachError, ParameterError
        As `recon.imaging.image`.
    """
    problem = planned(capture, pulse, grid, camera, window or Window())
    if by:
        return _gathered(capture, replace(problem, progress=progress or ignore), pulse, by)[0]
    return _summed(capture, problem, pulse, progress or ignore, memory_bytes, lambda block: block)


def image_and_noise(
    capture: Exhaustive,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    *,
    window: Window | None = None,
    progress: Callable[[float], None] | None = None,
    memory_bytes: int | None = None,
    by: Runs | None = None,
) -> tuple[Image, Noise | None]:
    """Return the confocal camera's image of counted photons, and what noise they alone give.

    Parameters and exceptions are those of `image`. The noise, a mean intensity, adds up over runs like the
    counts; it is None where counts are no whole numbers.
    """
    window = window or Window()
    problem = planned(capture, pulse, grid, CONFOCAL, window)
    if by:
        return _gathered(capture, replace(problem, progress=progress or ignore), pulse, by)
    tally, levels, whole = None, np.zeros(()), True

    def add() -> None:
        nonlocal levels, whole
        if tally is not None:
            whole &= tally.whole
            levels = levels + photon_noise(tally, pulse, grid).levels

    def tallying(block: Capture) -> Capture:
        nonlocal tally
        add()  # what the run before was
        block, tally = tallied(block, pulse, window)
        return block

    found = _summed(capture, problem, pulse, progress or ignore, memory_bytes, tallying)
    add()
    return found, Noise(levels, photons=True) if whole else None


def of_run(block: Capture, problem: ImagingProblem, memory_bytes: int) -> Added:
    """Return what a run of lasers adds to an image, and to the noise of a pulse; any worker may do it.

    Parameters and exceptions are those of `partial`.
    """
    light = problem.light
    if not isinstance(light, VirtualPulse):
        return Added(np.stack(list(partial(block, problem, memory_bytes))), np.zeros(()), False)
    read, tally = tallied(block, light, problem.window)
    field = np.stack(list(partial(read, problem, memory_bytes)))
    return Added(field, photon_noise(tally, light, problem.grid).levels, tally.whole)


def _gathered(
    capture: Exhaustive, problem: ImagingProblem, pulse: VirtualPulse, by: Runs
) -> tuple[Image, Noise | None]:
    """Add up what others make of runs of lasers."""
    grid = problem.grid
    total = np.zeros((len(grid.z_m), 1 + problem.slopes, *grid.shape[1:]), np.complex64)
    levels, whole = np.zeros(()), True
    for run in by(problem, capture):
        total += run.field
        levels, whole = levels + run.levels, whole and run.whole
    return pictured(problem, total, "rsd", pulse), Noise(levels, photons=True) if whole else None


def _summed(
    capture: Exhaustive,
    problem: ImagingProblem,
    pulse: VirtualPulse,
    progress: Callable[[float], None],
    memory_bytes: int | None,
    seen_as: Callable[[Capture], Capture],
) -> Image:
    """Add up the fields of all runs, each block read as `seen_as` gives it."""
    bound = memory_bytes or USUAL_BYTES + 2 * held_bytes(problem)
    grid = problem.grid
    total = np.zeros((len(grid.z_m), 1 + problem.slopes, *grid.shape[1:]), np.complex64)
    for lasers in runs(capture, problem, bound):
        told = part_of(progress, lasers.start / capture.lasers, lasers.stop / capture.lasers)
        block = seen_as(capture.block(lasers))
        for sum_, plane in zip(total, partial(block, problem, bound, told), strict=True):
            sum_ += plane
    return pictured(problem, total, "rsd", pulse)


def planned(
    capture: Exhaustive, pulse: VirtualPulse, grid: VoxelGrid, camera: Camera, window: Window
) -> ImagingProblem:
    """Choose bins and frequencies of all runs; raises as `image`."""
    problem = plan(capture.outline(), pulse, grid, camera, window)
    return replace(problem, slopes=isinstance(camera, ConfocalCamera))


def partial(
    block: Capture,
    problem: ImagingProblem,
    memory_bytes: int | None = None,
    progress: Callable[[float], None] = ignore,
) -> Iterator[NDArray[np.complexfloating]]:
    """Yield what a run of lasers adds to each plane, (1 or 2, y, x) complex64; those of all runs add up.

    Parameters
    ----------
    block
        Of `Exhaustive.block`; any worker may have it.
    problem
        Of `planned`, the same for all runs.
    memory_bytes
        Bound on the memory of all, of which `held_bytes` are the sum's and the reader's.
    progress
        Called with the fraction that is done of this run.

    Raises
    ------
    MemoryBoundError
        If the bound is below the least that imaging one run needs.
    """
    part = replace(problem, capture=block, progress=progress)
    return planes(bounded(part, "rsd", memory_bytes, held_bytes(problem)), "rsd")


def held_bytes(problem: ImagingProblem) -> int:
    """Return the size of a sum over runs, and of a laser's histograms while they are read."""
    reached = [part.bins for part in problem.depth_blocks if part.reached]
    bins = max(bins.stop for bins in reached) - min(bins.start for bins in reached)
    return 8 * (1 + problem.slopes) * problem.grid.size + 12 * problem.capture.positions * bins


def runs(
    capture: Exhaustive, problem: ImagingProblem, memory_bytes: int, longest: int = RUN
) -> Iterator[slice]:
    """Yield the runs of lasers: as long as one pass over the record suffices within the memory.

    Where not even one laser's spectra fit, it is imaged in several passes by itself.

    Parameters
    ----------
    capture, problem, memory_bytes
        As of `partial`.
    longest
        Lasers in a run at the most.

    Raises
    ------
    MemoryBoundError
        If one laser does not fit in any way.
    """
    size = min(longest, capture.lasers)
    while size > 1 and not _in_one_pass(capture.block(slice(size)), problem, memory_bytes):
        size //= 2
    for first in range(0, capture.lasers, size):
        yield slice(first, min(first + size, capture.lasers))


def _in_one_pass(block: Capture, problem: ImagingProblem, memory_bytes: int) -> bool:
    try:
        part = bounded(replace(problem, capture=block), "rsd", memory_bytes, held_bytes(problem))
    except MemoryBoundError:
        return False
    return len(part.passes) == 1
