"""An image cut into parts that are computed by themselves, anywhere.

An image is linear in the counts, and each plane is seen by itself. So a depth block may be cut

- by **depth**: parts are planes, and stack; each needs the spectra of all positions;
- by **frequency**: parts are runs of a band, and add up; each gives all planes;
- by **positions**: parts are the positions of some detector spots, where each spot is a propagation of its
  own, or any positions, where these are summed by table; they add up, too.

Of S bytes of spectra and V bytes of field, m parts in depth and n beside one another move m S + n V. The
fewest bytes are chosen among the cuts that fit into a worker's memory and give each worker enough to do. The
parts keep what the whole was planned with (lattice, nodes of tables, way of computing), so that their fields
give the same numbers to rounding.

Nothing here knows where parts are computed: a part takes spectra and gives a field.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from recon.accumulate import subset
from recon.capture import Capture, Histograms, UnreadHistograms
from recon.errors import MemoryBoundError, ParameterError
from recon.grid import VoxelGrid
from recon.imaging import planes
from recon.memory import SLACK_BYTES, Needs
from recon.noise import Tally
from recon.registry import SOLVERS, load
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Way, ignore
from recon.spectrum import spectra
from recon.window import Window

Field = NDArray[np.complexfloating]
#: So many parts for each worker, so that none waits long for the last.
PARTS_PER_WORKER = 4
#: Shorter parts than this are not cut any more: sending them would take as long.
LEAST_WORK_S = 0.1
#: Fewest positions that are summed by themselves.
LEAST_POSITIONS = 256


@dataclass(frozen=True)
class Spectra:
    """Which spectra a part needs.

    Attributes
    ----------
    block
        Number of the depth block.
    frequencies
        Which of its band.
    group, positions
        Number of the group of positions, and which they are, rising; None where all are taken.
    """

    block: int
    frequencies: slice
    group: int = 0
    positions: NDArray[np.intp] | None = None

    @property
    def name(self) -> tuple[int, int, int]:
        """What tells these from all others of an image."""
        return self.block, self.frequencies.start, self.group


@dataclass(frozen=True)
class Part:
    """What is computed by itself: some planes, with some frequencies, of some positions.

    Attributes
    ----------
    solver
        What computes it.
    problem
        Of these planes, frequencies and positions alone; its histograms are not read.
    takes
        The spectra that it needs.
    work_s
        Time of one core of a usual machine.
    memory_bytes
        What it takes at most.
    """

    solver: str
    problem: ImagingProblem
    takes: Spectra
    work_s: float
    memory_bytes: int

    def field(self, found: Field) -> Field:
        """Compute it.

        Parameters
        ----------
        found
            (F, P) spectra; they are the solver's to change.

        Returns
        -------
        ndarray
            (planes, T, y, x) field U, with the slope behind it where the problem asks for it.
        """
        problem = replace(self.problem, spectra=lambda *_: [found])
        shape = len(problem.grid.z_m), problem.frames + problem.slopes, *problem.grid.shape[1:]
        field = np.empty(shape, np.complex64)
        for index, plane in enumerate(planes(problem, self.solver)):
            field[index] = plane
        return field


@dataclass(frozen=True)
class Slab:
    """Neighbouring planes.

    Attributes
    ----------
    shape
        (planes, T, y, x) of its field.
    parts
        What its field is the sum of; none where the record does not reach it: it is dark.
    """

    shape: tuple[int, ...]
    parts: tuple[Part, ...]

    @property
    def work_s(self) -> float:
        """Time of one core of a usual machine."""
        return sum(part.work_s for part in self.parts)


@dataclass(frozen=True)
class Cut:
    """An image as slabs, in order of depth, and the depth blocks whose spectra they need."""

    blocks: tuple[DepthBlock, ...]
    slabs: tuple[Slab, ...]

    @property
    def parts(self) -> tuple[Part, ...]:
        """All parts, in order of depth."""
        return tuple(part for slab in self.slabs for part in slab.parts)

    @property
    def traffic_bytes(self) -> int:
        """Bytes of spectra and fields that are sent."""
        total = 0
        for part in self.parts:
            problem = part.problem
            total += 8 * len(problem.band) * problem.capture.positions + _field_bytes(problem)
        return total

    @property
    def memory_bytes(self) -> int:
        """What the largest part takes."""
        return max(part.memory_bytes for part in self.parts)


def cut(problem: ImagingProblem, solver: str, *, workers: int, memory_bytes: int) -> Cut:
    """Cut an image into parts for workers of one thread.

    Parameters
    ----------
    problem
        What is imaged.
    solver
        What computes it.
    workers
        How many parts are computed at the same time.
    memory_bytes
        What each of them may take.

    Raises
    ------
    ParameterError
        If images of this solver are not cut.
    MemoryBoundError
        If the smallest part does not fit; it names the least memory that would do.
    """
    entry = SOLVERS[solver]
    if entry.way is None or entry.needs is None:
        able = " or ".join(name for name, one in SOLVERS.items() if one.way)
        raise ParameterError(
            f"solver {solver}", "an image in parts", "it can only compute whole images", f"Use {able}."
        )
    way_of, needs_of = load(entry.way), load(entry.needs)
    alone = replace(problem, progress=ignore, passes=(), threads=1)
    ways = [way_of(alone, part) if part.reached else None for part in problem.depth_blocks]
    work_s = sum(way.work_s for way in ways if way)
    least_s = max(LEAST_WORK_S, work_s / (PARTS_PER_WORKER * workers))
    cutter = _Cutter(alone, solver, needs_of, memory_bytes, least_s)
    slabs = [slab for number, way in enumerate(ways) for slab in cutter.slabs(number, way)]
    return Cut(problem.depth_blocks, tuple(slabs))


@dataclass(frozen=True)
class _Cutter:
    """Cuts the depth blocks of one image."""

    problem: ImagingProblem
    solver: str
    needs_of: Needs
    memory_bytes: int
    least_s: float

    def slabs(self, number: int, way: Way | None) -> list[Slab]:
        """Cut a depth block; `way` is None where the record does not reach it."""
        problem, block = self.problem, self.problem.depth_blocks[number]
        whole = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[block.planes])
        several, across = problem.frames + problem.slopes, whole.shape[1:]
        if way is None:
            return [Slab((len(whole.z_m), several, *across), ())]
        problem = replace(problem, grid=whole, fft=way.by_fft)
        problem = replace(problem, whole_path_m=problem.path_m, whole_near_m=problem.near_m)
        found: list[Slab] = []
        in_depth, beside = self._least_traffic(problem, number, way)
        for planes_of in _shares(len(whole.z_m), in_depth):
            z_m = whole.z_m[planes_of]
            some = replace(problem, grid=VoxelGrid(whole.x_m, whole.y_m, z_m))
            work_s = way.work_s * len(z_m) / len(whole.z_m) / len(beside)
            parts = tuple(self._part(some, takes, work_s) for takes in beside)
            found.append(Slab((len(z_m), several, *across), parts))
        return found

    def _least_traffic(self, problem: ImagingProblem, number: int, way: Way) -> tuple[int, list[Spectra]]:
        """Return how many parts there are in depth, and what those beside one another take."""
        block = self.problem.depth_blocks[number]
        spectra_bytes = 8 * len(block.band) * problem.capture.positions
        most, planes_ = _most_beside(problem.capture, block, way), len(problem.grid.z_m)
        wanted = ceil(way.work_s / self.least_s)
        every = [(m, n) for m in _doubling(planes_) for n in _doubling(most)]
        enough = [(m, n) for m, n in every if m * n >= wanted] or [(planes_, most)]
        enough.sort(key=lambda cut: (cut[0] * spectra_bytes + cut[1] * _field_bytes(problem), cut))
        enough.append((planes_, most))  # the smallest parts of all
        least = 0
        for in_depth, at_once in enough:
            beside = _beside(problem.capture, block, number, way, at_once)
            z_m = problem.grid.z_m[: ceil(planes_ / in_depth)]
            first = replace(problem, grid=VoxelGrid(problem.grid.x_m, problem.grid.y_m, z_m))
            least = self._part(first, beside[0], 0.0).memory_bytes
            if least <= self.memory_bytes:
                return in_depth, beside
        raise MemoryBoundError(
            "memory of a worker",
            f"at most {self.memory_bytes / 1e6:.0f} MB",
            f"the smallest part of the image takes {least / 1e6:.0f} MB",
            f"Give each worker {ceil(least / 1e6)} MB or more, or image fewer voxels across.",
        )

    def _part(self, problem: ImagingProblem, takes: Spectra, work_s: float) -> Part:
        """Make a part of planes: the problem's grid has these alone."""
        block = self.problem.depth_blocks[takes.block]
        band = block.band[takes.frequencies]
        capture = _geometry(problem.capture, takes.positions)
        piece = DepthBlock(slice(0, len(problem.grid.z_m)), block.bins, band)
        alone = replace(problem, capture=capture, depth_blocks=(piece,))
        need = self.needs_of(alone, piece)
        # Spectra come in pieces and are put together; a field is made, and packed to be sent.
        moved = 2 * 8 * len(band) * capture.positions + 2 * _field_bytes(alone)
        least = SLACK_BYTES + need.fixed + need.least + moved
        spare = max(0, self.memory_bytes - least)
        working = min(problem.wall_bytes, need.least + spare)
        alone = replace(alone, wall_bytes=working, working_bytes=min(problem.working_bytes, working))
        return Part(self.solver, alone, takes, work_s, least)


def _most_beside(capture: Capture, block: DepthBlock, way: Way) -> int:
    """Return into how many parts a depth block can be cut whose fields add up."""
    if way.by_fft:
        return len(way.groups) if len(way.groups) > 1 else len(block.band)
    return max(1, capture.positions // LEAST_POSITIONS)


def _beside(capture: Capture, block: DepthBlock, number: int, way: Way, at_once: int) -> list[Spectra]:
    """Cut what adds up: detector spots, frequencies, or any positions."""
    every = slice(0, len(block.band))
    if at_once == 1:
        return [Spectra(number, every)]
    if way.by_fft and len(way.groups) == 1:
        return [Spectra(number, run) for run in _shares(len(block.band), at_once)]
    if way.by_fft:
        shares = [np.sort(np.concatenate(way.groups[run])) for run in _shares(len(way.groups), at_once)]
    else:
        shares = [np.arange(run.start, run.stop) for run in _shares(capture.positions, at_once)]
    return [Spectra(number, every, group, positions) for group, positions in enumerate(shares)]


def _geometry(capture: Capture, positions: NDArray[np.intp] | slice | None) -> Capture:
    """Return where and when some positions were measured, without their histograms."""
    if isinstance(positions, slice):
        positions = np.arange(positions.start, positions.stop)
    some = capture if positions is None else subset(capture, positions)
    return replace(some, histograms=UnreadHistograms((some.positions, capture.bins)))


def _field_bytes(problem: ImagingProblem) -> int:
    return 8 * (problem.frames + problem.slopes) * problem.grid.size


def _shares(many: int, into: int) -> Iterator[slice]:
    """Divide neighbours evenly."""
    edges = np.linspace(0, many, into + 1).round().astype(int).tolist()
    return (slice(first, stop) for first, stop in pairwise(edges) if stop > first)


def _doubling(most: int) -> list[int]:
    """Return 1, 2, 4 and so on, and the most."""
    return [*(2**power for power in range(most.bit_length()) if 2**power < most), most]


@dataclass(frozen=True)
class Reading:
    """Positions whose spectra are taken at once.

    Attributes
    ----------
    positions
        Which.
    capture
        Where and when they were measured; its histograms are not read.
    blocks, window
        Depth blocks, and soft edges, as of `recon.spectrum.spectra`.
    wanted
        What is kept: depth block, frequencies, and which of these positions; None keeps all.
    tally
        What sums up their counts meanwhile, if anything does.
    """

    positions: slice
    capture: Capture
    blocks: tuple[DepthBlock, ...]
    window: Window
    wanted: tuple[tuple[int, slice, NDArray[np.intp] | None], ...]
    tally: Tally | None

    def taken(self, histograms: Histograms) -> tuple[list[Field], Tally | None]:
        """Take the spectra from histograms of these positions: one (F, P) for each that is wanted."""
        capture, tally = replace(self.capture, histograms=histograms), self.tally
        if tally:
            tally = tally.reading(capture)
            capture = replace(capture, histograms=tally)
        found = spectra(capture, self.blocks, self.window)
        kept = [
            np.ascontiguousarray(found[block][run] if some is None else found[block][run][:, some])
            for block, run, some in self.wanted
        ]
        return kept, tally.unread() if tally else None


def readings(
    problem: ImagingProblem, wanted: Sequence[Spectra], runs: Sequence[slice], tally: Tally | None = None
) -> list[Reading]:
    """Divide the taking of spectra among runs of positions.

    Parameters
    ----------
    problem
        What is imaged.
    wanted
        The spectra that are needed; each reading keeps as many pieces, in this order.
    runs
        Neighbouring positions; all together are all.
    tally
        Sums up the counts of all positions.
    """
    used = sorted({one.block for one in wanted})
    blocks = tuple(problem.depth_blocks[number] for number in used)
    return [
        Reading(
            run,
            _geometry(problem.capture, run),
            blocks,
            problem.window,
            tuple((used.index(one.block), one.frequencies, _within(one.positions, run)) for one in wanted),
            tally.of(run) if tally else None,
        )
        for run in runs
    ]


def _within(positions: NDArray[np.intp] | None, run: slice) -> NDArray[np.intp] | None:
    """Return which of a run's positions are among rising ones."""
    if positions is None:
        return None
    first, stop = np.searchsorted(positions, (run.start, run.stop))
    return positions[first:stop] - run.start
