"""What imaging will take, counted before it begins: work, memory, and time at the speed of a machine.

Time is counted in operations (`effort`), each at the time that one core of a usual machine takes for it; how
much slower or faster a machine is, a small run of each kind says (`speed`).
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from recon import memory
from recon.baseband import products
from recon.camera import ConfocalCamera
from recon.capture import ArrayHistograms, Capture
from recon.grid import BYTES_PER_VOXEL, VoxelGrid
from recon.imaging import plan, planes
from recon.noise import tallied
from recon.registry import SOLVERS, entry_of, load
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Need, Solver
from recon.spectrum import spectra
from recon.wave import VirtualPulse
from recon.window import Window

#: Time of one core for each count of the record that is unpacked from a file.
READ_NS = 2.0
#: For each that is mixed down, and summed up for the noise.
COUNT_NS = 7.0
#: For each cell of what is mixed down, and frequency of a depth block.
PRODUCT_NS = 0.09
#: For each voxel: intensity, noise, surface, file and picture.
VOXEL_NS = 300.0
#: For each plane: its noise, at the places that stand for all positions.
PLANE_S = 1.5e-3
#: For each moment, frequency and pixel of a film's plane.
MOMENT_NS = 0.5
#: Program, libraries, and drawing.
START_S = 2.6


@dataclass(frozen=True)
class Speed:
    """How much longer a machine takes than a usual one, by the processor time of one core.

    Attributes
    ----------
    waves, tables, record
        For waves by FFT, for tables and terms, and for reading, its noise and its spectra.
    """

    waves: float = 1.0
    tables: float = 1.0
    record: float = 1.0


@dataclass(frozen=True)
class Effort:
    """What an image takes.

    Attributes
    ----------
    voxels, positions
        How many.
    frequencies
        Of the depth block that has most.
    pairs
        Pairs of plane and frequency.
    by_fft
        Whether waves go by FFT.
    waves_s, record_s, voxels_s
        Time of one core of a usual machine: for waves, for the record, and for what each voxel costs beside.
    spectra_bytes
        Spectra of all depth blocks.
    memory_bytes
        The most that is held at once, the program itself left out, where nothing bounds it.
    least_bytes
        What it needs if it is cut to the least; as much as `memory_bytes` where the solver does not cut.
    """

    voxels: int
    positions: int
    frequencies: int
    pairs: int
    by_fft: bool
    waves_s: float
    record_s: float
    voxels_s: float
    spectra_bytes: int
    memory_bytes: int
    least_bytes: int

    def processor_s(self, speed: Speed) -> float:
        """Return the processor time on a machine."""
        waves_s = self.waves_s * (speed.waves if self.by_fft else speed.tables)
        return START_S + waves_s + (self.record_s + self.voxels_s) * speed.record

    def clock_s(self, speed: Speed, cores: int) -> float:
        """Return the time by the clock on a machine that does nothing else.

        Waves take all cores; one reads the record and one mixes it down.
        """
        waves_s = self.waves_s * (speed.waves if self.by_fft else speed.tables)
        record_s = self.record_s * speed.record
        return self.processor_s(speed) - waves_s * (1 - 1 / cores) - record_s * (1 - 1 / min(2, cores))


def effort(problem: ImagingProblem, solver: str | Solver) -> Effort | None:
    """Count what imaging takes; None for solvers whose work is not counted.

    Raises
    ------
    GeometryError
        If the solver cannot take the positions.
    """
    entry = entry_of(solver)
    if entry.way is None or entry.needs is None:
        return None
    way, needs, capture = load(entry.way), load(entry.needs), problem.capture
    reached = [part for part in problem.depth_blocks if part.reached]
    ways = [way(problem, part) for part in reached]
    pixels = problem.grid.shape[1] * problem.grid.shape[2]
    pairs = sum(len(part.band) * _planes(part) for part in reached)
    waves_s = sum(one.work_s for one in ways)
    if problem.frames > 1:
        waves_s += 1e-9 * MOMENT_NS * problem.frames * pairs * pixels
    need = [needs(problem, part) for part in reached]
    spectra_bytes = sum(8 * capture.positions * len(part.band) for part in reached)
    least = memory.least_bytes(problem, needs)
    most = BYTES_PER_VOXEL * problem.grid.size + spectra_bytes + max(one.fixed for one in need)
    most += sum(sorted(_walls_bytes(problem, *one) for one in zip(reached, need, strict=True))[-2:])
    record_ns = READ_NS * capture.bins + _spectra_ns(reached, capture.bin_width_s)
    return Effort(
        problem.grid.size,
        capture.positions,
        max(len(part.band) for part in reached),
        pairs,
        all(one.by_fft for one in ways),
        waves_s,
        1e-9 * record_ns * capture.positions,
        1e-9 * VOXEL_NS * problem.grid.size + PLANE_S * len(problem.grid.z_m),
        spectra_bytes,
        max(most, least),
        least,
    )


def _walls_bytes(problem: ImagingProblem, part: DepthBlock, need: Need) -> int:
    """Return what the wall's transforms of a depth block take; two blocks overlap."""
    return min(problem.wall_bytes, len(part.band) * need.least // need.together)


def _spectra_ns(parts: Sequence[DepthBlock], bin_width_s: float) -> float:
    """Return the time of one core for the spectra and the noise of a position."""
    bins = max(part.bins.stop for part in parts) - min(part.bins.start for part in parts)
    lasting_s = [(part.bins.stop - part.bins.start) * bin_width_s for part in parts]
    return COUNT_NS * bins + PRODUCT_NS * products([part.band for part in parts], lasting_s)


def _planes(part: DepthBlock) -> int:
    return part.planes.stop - part.planes.start


def speed() -> Speed:
    """Measure this machine by a small run of each kind, about a second of processor time in all."""
    flat, curved = _sample(64, 0.0), _sample(24, 0.1)
    axis = np.linspace(-0.4, 0.4, 48)
    grid = VoxelGrid(axis, axis, np.linspace(0.5, 0.6, 12))
    return Speed(
        _ratio_of_waves(flat, grid), _ratio_of_waves(curved, grid), _ratio_of_record(_sample(64, 0.0, 4))
    )


_PULSE = VirtualPulse(0.05, 2)


def _sample(side: int, bend: float, fine: int = 1) -> Capture:
    """Return a wall of side x side positions, bent by so much at 1 m beside its middle, its bins so fine."""
    at = (np.arange(side) - (side - 1) / 2) / side
    x, y = (axis.ravel() for axis in np.meshgrid(at, at))
    laser_m = np.stack([x, y, bend * x**2], axis=1)
    photons = np.random.default_rng(0).integers(0, side**2 * 1024 * fine, side**2 * 50)
    counts = np.bincount(photons, minlength=side**2 * 1024 * fine).astype(np.uint32).reshape(side**2, -1)
    return Capture(ArrayHistograms(counts), 16e-12 / fine, np.zeros(1), laser_m, np.array([[0.1, 0.0, 0.0]]))


def _ratio_of_waves(capture: Capture, grid: VoxelGrid) -> float:
    problem = replace(plan(capture, _PULSE, grid, ConfocalCamera(), Window()), slopes=True, threads=1)
    found = spectra(capture, problem.depth_blocks, Window())

    def run() -> None:
        given = replace(problem, spectra=lambda *_: [one.copy() for one in found])
        for _ in planes(given, "rsd"):
            pass

    way = load(SOLVERS["rsd"].way or "")
    return _least_s(run) / sum(way(problem, part).work_s for part in problem.depth_blocks if part.reached)


def _ratio_of_record(capture: Capture) -> float:
    grid = VoxelGrid(np.zeros(1), np.zeros(1), np.linspace(0.5, 1.0, 8))
    blocks = plan(capture, _PULSE, grid, ConfocalCamera(), Window()).depth_blocks
    usual_s = 1e-9 * _spectra_ns(blocks, capture.bin_width_s) * capture.positions
    return _least_s(lambda: spectra(tallied(capture, _PULSE, Window())[0], blocks, Window())) / usual_s


def _least_s(run: Callable[[], object]) -> float:
    """Return the least processor time of two runs; the one before may compile."""
    run()
    taken = []
    for _ in range(2):
        began_s = time.process_time()
        run()
        taken.append(time.process_time() - began_s)
    return min(taken)
