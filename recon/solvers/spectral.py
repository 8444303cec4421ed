"""What the solvers in the frequency domain share: spectra in, planes out, and the reading of a plane in time.

Such a solver takes the weighted wall field of each frequency to the planes of one depth block, most often by
a propagator, plane by plane. All else, which bins, which frequencies, which passes over the record, is here.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import chain, islice

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Solver, part_of
from recon.wave import Band

Field = NDArray[np.complexfloating]
#: Part of the progress that reading the record makes up.
READING = 0.3


class Propagator(ABC):
    """Takes the field on the wall, at the frequencies of one band, to planes of voxels.

    Attributes
    ----------
    band
        The frequencies.
    """

    band: Band

    @abstractmethod
    def fields(self, z_m: float) -> Field:
        """Return g(omega) F(v, omega) on the plane at depth `z_m`: (F, y, x) complex."""

    def focus(
        self, z_m: float, times_s: NDArray[np.float64], reference_rad_per_s: float | None = None
    ) -> Field:
        """Sum the fields over all frequencies at moments t, (T, y or 1, x or 1): (T, y, x) complex.

        With a reference omega_0, and one moment, the change dU/dt - i omega_0 U follows: (2, y, x).
        """
        fields = self.fields(z_m)
        values = read(fields, self.band, times_s)
        if reference_rad_per_s is None:
            return values
        turning = 1j * (self.band.frequencies_rad_per_s - reference_rad_per_s)
        fields *= turning[:, None, None].astype(fields.dtype)
        return np.concatenate([values, read(fields, self.band, times_s)])


class SumPropagator(Propagator):
    """Sums over all positions, wherever they are.

    Parameters
    ----------
    capture
        Where the positions are; with a detector spot for each, the phase is that of both paths.
    emitted
        (F, P) complex: what each position emits at each frequency.
    band
        The frequencies.
    grid
        Axes x and y are used.
    """

    def __init__(self, capture: Capture, emitted: Field, band: Band, grid: VoxelGrid) -> None:
        self.band = band
        self._emitted = np.ascontiguousarray(emitted.T)
        self._grid = grid
        self._laser_m = np.ascontiguousarray(capture.laser_m, np.float64)
        detector_m = capture.detector_m if capture.round_trip else np.empty((0, 3))
        self._detector_m = np.ascontiguousarray(detector_m, np.float64)


def read(fields: Field, band: Band, times_s: NDArray[np.float64]) -> Field:
    """Evaluate sum_omega exp(i omega t) fields.

    Parameters
    ----------
    fields
        (F, y, x) complex.
    band
        Their frequencies.
    times_s
        (T, y or 1, x or 1) moments.

    Returns
    -------
    ndarray
        (T, y, x) of the fields' type.
    """
    if times_s[0].size == 1:  # the same moments for all voxels: a matrix product
        phases = np.exp(1j * np.multiply.outer(times_s.reshape(-1), band.frequencies_rad_per_s))
        return np.tensordot(phases.astype(fields.dtype), fields, axes=1)
    frames = np.empty((len(times_s), *fields.shape[1:]), fields.dtype)
    for frame, moments_s in zip(frames, times_s, strict=True):
        step = np.exp(1j * band.step_rad_per_s * moments_s).astype(fields.dtype)
        frame[:] = fields[-1]
        for field in fields[-2::-1]:
            frame *= step
            frame += field
        frame *= np.exp(1j * band.first_rad_per_s * moments_s)
    return frames


def spectral(
    focus_block: Callable[[ImagingProblem, Field], Iterator[Field]],
    dtype: DTypeLike = np.complex64,
    check: Callable[[ImagingProblem], object] | None = None,
) -> Solver:
    """Make a solver of what images one depth block.

    Parameters
    ----------
    focus_block
        Called for each depth block with a problem of it alone and the (F, P) weighted spectra g(omega) a_p
        H^(p, omega); yields its planes.
    dtype
        Type of spectra and fields.
    check
        Called before the record is read; raises if the problem cannot be done.
    """

    def focus(problem: ImagingProblem) -> Iterator[Field]:
        if check:
            check(problem)
        if problem.passes:
            yield from in_passes(problem)
            return
        steps = _Steps(problem)
        found = steps.spectra(problem.depth_blocks, dtype)
        begin = (
            partial(_planes, focus_block, steps.alone(block), found, dtype) for block in problem.depth_blocks
        )
        yield from _overlapping(list(begin), problem)

    def in_passes(problem: ImagingProblem) -> Iterator[Field]:
        """Take the depth blocks in pieces that keep to a bound on memory, one after the other."""
        missing = deque(len(depth_block.band) for depth_block in problem.depth_blocks)
        held: list[Field] = []
        steps = _Steps(problem)
        for pieces in problem.passes:
            found = steps.spectra(pieces, dtype)
            for piece in pieces:
                planes = _planes(focus_block, steps.alone(piece), found, dtype)
                missing[0] -= len(piece.band)
                if held:
                    for sum_, plane in zip(held, planes, strict=True):
                        sum_ += plane
                    planes = iter(held)
                if missing[0]:
                    held = list(planes)
                else:
                    yield from planes
                    missing.popleft()
                    held = []

    return focus


class _Steps:
    """The steps of a problem, each with its part of the progress.

    Parameters
    ----------
    problem
        All of it.
    """

    def __init__(self, problem: ImagingProblem) -> None:
        self._problem = problem
        self._work = sum(_work(depth_block) for depth_block in problem.depth_blocks)
        self._done = 0.0

    def spectra(self, pieces: Sequence[DepthBlock], dtype: DTypeLike) -> list[Field]:
        """Take the spectra of depth blocks, or pieces of them, in one pass over the record."""
        problem, told = self._problem, self._next(READING / max(1, len(self._problem.passes)))
        return problem.spectra(problem.capture, pieces, problem.window, told, dtype)

    def alone(self, piece: DepthBlock) -> ImagingProblem:
        """Return a problem of a depth block, or a piece of one, alone."""
        told, grid = self._next((1 - READING) * _work(piece) / self._work), self._problem.grid
        voxels = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[piece.planes])
        return replace(self._problem, grid=voxels, depth_blocks=(piece,), progress=told)

    def _next(self, part: float) -> Callable[[float], None]:
        began, self._done = self._done, self._done + part
        return part_of(self._problem.progress, began, self._done)


def _overlapping(begin: Sequence[Callable[[], Iterator[Field]]], problem: ImagingProblem) -> Iterator[Field]:
    """Yield the planes of all depth blocks; each begins while the last planes of the one before are in work.

    Otherwise cores would wait for one another at the end of each block.
    """
    with ThreadPoolExecutor(1) as thread:
        following = thread.submit(_begun, begin[0])
        for number, block in enumerate(problem.depth_blocks):
            last = block.planes.stop - block.planes.start - 1
            for index, plane in enumerate(following.result()):
                if index == max(0, last - problem.threads) and number + 1 < len(begin):
                    following = thread.submit(_begun, begin[number + 1])
                yield plane


def _begun(begin: Callable[[], Iterator[Field]]) -> Iterator[Field]:
    """Begin to compute planes before they are asked for."""
    planes = begin()
    return chain([next(planes)], planes)


def _work(piece: DepthBlock) -> int:
    return piece.reached * (piece.planes.stop - piece.planes.start) * len(piece.band)


def _planes(
    focus_block: Callable[[ImagingProblem, Field], Iterator[Field]],
    part: ImagingProblem,
    found: list[Field],
    dtype: DTypeLike,
) -> Iterator[Field]:
    """Image a problem of one depth block: darkness, where the record does not reach it.

    Its spectra are taken out of the list, the first of them, so that their memory is free when it is done.
    """
    emitted = found.pop(0)
    if not part.depth_blocks[0].reached:
        return (np.zeros((part.frames + part.slopes, *part.grid.shape[1:]), dtype) for _ in part.grid.z_m)
    # In the spectra's own precision: weights of another are converted number by number.
    emitted *= part.band.weights[:, None].astype(emitted.real.dtype)
    emitted *= part.weights.astype(emitted.real.dtype)
    return focus_block(part, emitted)


def by_planes(
    problem: ImagingProblem, focus: Callable[[float, NDArray[np.float64], float | None], Field]
) -> Iterator[Field]:
    """Image a problem of one depth block plane by plane.

    Planes are shared out to threads, and come in order, with no more in work than memory is meant for.

    Parameters
    ----------
    problem
        Its planes.
    focus
        Called with a depth, the moments there, and the reference for slopes, as `Propagator.focus`.
    """

    def one_plane(plane: int) -> Field:
        return focus(float(problem.grid.z_m[plane]), problem.times_s(plane), problem.reference_rad_per_s)

    planes = range(len(problem.grid.z_m))
    frequencies = len(problem.band) if problem.frames > 1 else 1
    one = 8 * (frequencies + problem.frames) * problem.grid.shape[1] * problem.grid.shape[2]
    workers = max(1, min(problem.threads, problem.plane_bytes // (2 * one)))
    with ThreadPoolExecutor(workers) as threads:
        waiting: deque[Future[Field]] = deque()
        unsent = iter(planes)
        try:
            for done in planes:
                for plane in islice(unsent, 2 * workers + 1 - len(waiting)):
                    waiting.append(threads.submit(one_plane, plane))
                yield waiting.popleft().result()
                problem.progress((done + 1) / len(planes))
        finally:
            for unwanted in waiting:
                unwanted.cancel()
