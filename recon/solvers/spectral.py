"""What the solvers in the frequency domain share: spectra in, planes out, and the reading of a plane in time.

Such a solver is a propagator: it takes the weighted wall field of each frequency to planes of voxels. All
else, which bins, which frequencies, which moments, is here.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from os import cpu_count
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from recon.capture import Capture
from recon.grid import VoxelGrid
from recon.solvers.task import Solver, Task
from recon.spectrum import spectra
from recon.wave import Band

Field = NDArray[np.complexfloating]
#: Part of the progress that reading the record makes up.
READING = 0.3
#: Memory for planes in work, their frequencies and frames; fewer threads run where it would not suffice.
PLANE_BYTES = 2**30


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

    def focus(self, z_m: float, times_s: NDArray[np.float64]) -> Field:
        """Sum the fields over all frequencies at moments t, (T, y or 1, x or 1): (T, y, x) complex."""
        return read(self.fields(z_m), self.band, times_s)


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
    propagator: Callable[[Capture, Any, Band, VoxelGrid], Propagator],
    dtype: DTypeLike = np.complex64,
    check: Callable[[Capture], object] | None = None,
) -> Solver:
    """Make a solver of a kind of propagator.

    Parameters
    ----------
    propagator
        Called with the capture, the (F, P) weighted spectra g(omega) a_p H^(p, omega), their band and the
        voxels, for each slab.
    dtype
        Type of spectra and fields.
    check
        Called before the record is read; raises if the propagator cannot take these positions.
    """

    def focus(task: Task) -> Iterator[Field]:
        capture, grid = task.capture, task.grid
        if check:
            check(capture)
        found = spectra(capture, task.slabs, task.fades, lambda part: task.progress(READING * part), dtype)
        done = 0
        for slab in task.slabs:
            planes = range(*slab.planes.indices(len(grid.z_m)))
            emitted = found.pop(0)
            if slab.reached:
                emitted *= slab.band.weights[:, None]
                emitted *= task.weights
                voxels = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[slab.planes])
                through = propagator(capture, emitted, slab.band, voxels)
                focused = _in_order(task, through, planes)
            else:
                focused = (np.zeros((len(task.times_s(plane)), *grid.shape[1:]), dtype) for plane in planes)
            for plane in focused:
                yield plane
                done += 1
                task.progress(READING + (1 - READING) * done / len(grid.z_m))

    return focus


def _in_order(task: Task, propagator: Propagator, planes: range) -> Iterator[Field]:
    """Share planes out to threads; yield them in order, with no more in work than memory is meant for."""

    def focus(plane: int) -> Field:
        return propagator.focus(float(task.grid.z_m[plane]), task.times_s(plane))

    frames = len(task.times_s(planes[0]))
    frequencies = max(len(slab.band) for slab in task.slabs) if frames > 1 else 1
    one = 8 * (frequencies + frames) * task.grid.shape[1] * task.grid.shape[2]
    workers = max(1, min(cpu_count() or 1, PLANE_BYTES // (2 * one)))
    with ThreadPoolExecutor(workers) as threads:
        waiting: deque[Future[Field]] = deque()
        try:
            for plane in planes:
                waiting.append(threads.submit(focus, plane))
                if len(waiting) > 2 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for unwanted in waiting:
                unwanted.cancel()
