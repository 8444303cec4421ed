"""Images of a scene that moves, frame by frame: each time that the wall was scanned once more.

What does not change from frame to frame is made once: which bins and frequencies, the wall's lattice, and the
transforms of the spherical wave (`recon.solvers.rsd.regular.Kernels`). A frame then costs the Fourier sums of
its photons, one transform of the wall for each frequency, and for each plane and frequency a product and a
transform back.

**Depth-dependent averaging.** The field is linear in the counts, so that the field of several frames together
is that of the sum of their wall transforms: averaging costs no propagation. The number of frames is

    N(z) = max(1, floor(z / z_0)) ,

the rule of Nam et al., Nature Communications 12:6526 (2021), who compare with a depth of z_0 = 1 m and
average 3 frames at 3 m. Its reason is that the side of a resolution cell, 0.61 to 1.22 lambda z / d for an
aperture of side d, grows with depth: what crosses one in N frames at z crosses one in a frame at z_0, so that
motion blurs far depths, in cells, as little as near ones, while far depths, which send fewer photons, get
more of them. Rounding down keeps it from ever being more; below 2 z_0 a frame is shown alone.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, recognise
from recon.camera import ConfocalCamera
from recon.capture import Capture, Histograms
from recon.computer import usual_threads
from recon.errors import GeometryError, ParameterError
from recon.grid import VoxelGrid
from recon.imaging import plan
from recon.result import Image
from recon.sampling import DepthBlock, depth_block
from recon.solvers.problem import ImagingProblem
from recon.solvers.rsd.regular import Kernels, LatticePropagator
from recon.solvers.spectral import Field, by_planes
from recon.sparse import Photons, SparseTransform, sparse
from recon.virtual_aperture import remapped
from recon.wave import VirtualPulse
from recon.window import Window

#: Memory for transforms of the wave; planes beyond it take theirs anew in each frame.
KERNEL_BYTES = 2**30
#: Taking the wall's spectrum at one frequency takes as long as imaging so many planes at it.
TAKING_PLANES = 6
#: Depth blocks into which planes are cut at most.
MOST_BLOCKS = 16


def frames_averaged(z_m: NDArray[np.float64], fresh_to_m: float | None) -> NDArray[np.int64]:
    """Return how many frames are averaged at each depth, (nz,); one each, if there is no z_0."""
    if fresh_to_m is None:
        return np.ones(len(z_m), np.int64)
    if not fresh_to_m > 0:
        raise ParameterError("average of frames", f"z_0 = {fresh_to_m:g} m", "it is not positive", "Use 1 m.")
    return np.maximum(1, np.floor(z_m / fresh_to_m + 1e-9).astype(np.int64))


class FrameImager:
    """Images frames one after the other, with what they share made once.

    Parameters
    ----------
    capture
        Geometry and time axis of one frame; its histograms are not read. Several detector spots are taken as
        one (`recon.virtual_aperture.remapped`).
    pulse, grid, window
        As of `recon.imaging.image`.
    fresh_to_m
        Depth z_0, see the module; None averages nothing.
    kernel_bytes
        Memory for what is kept from frame to frame.

    Attributes
    ----------
    bins
        Bins that are needed of each position.

    Raises
    ------
    GeometryError
        If the spots are on no even grid on one plane.
    ReachError
        If no path to the volume falls inside the record.
    ParameterError
        If the volume is not in front of the wall, or z_0 is not positive.
    """

    def __init__(
        self,
        capture: Capture,
        pulse: VirtualPulse,
        grid: VoxelGrid,
        window: Window | None = None,
        *,
        fresh_to_m: float | None = None,
        kernel_bytes: int = KERNEL_BYTES,
    ) -> None:
        self._positions, self._pulse = capture.positions, pulse
        virtual = remapped(capture)
        depth_m = float(virtual.laser_m[:, 2].mean())
        aperture = recognise(virtual.laser_m - [0, 0, depth_m])
        averaged = frames_averaged(grid.z_m, fresh_to_m)
        problem = plan(virtual, pulse, grid, ConfocalCamera(), window or Window())
        parts = _quickest(virtual, pulse, grid, averaged)
        self._problem = replace(problem, depth_blocks=tuple(parts))
        reached = [part for part in parts if part.reached]
        self.bins = slice(min(one.bins.start for one in reached), max(one.bins.stop for one in reached))
        left = kernel_bytes
        self._parts: list[_Part] = []
        for part in parts:
            number = int(averaged[part.planes.start])
            alone = replace(self._problem, depth_blocks=(part,))
            self._parts.append(_Part(alone, aperture, depth_m, number, left))
            left -= self._parts[-1].kernel_bytes

    def image(self, frame: Histograms | Photons) -> Image:
        """Image the next frame; as `take`, then `look`."""
        self.take(frame)
        return self.look()

    def take(self, frame: Histograms | Photons) -> None:
        """Take the next frame, which is a quarter of the work; it need not be looked at.

        Parameters
        ----------
        frame
            Its counts, of the positions in order.

        Raises
        ------
        GeometryError
            If it has another number of positions.
        """
        photons = frame if isinstance(frame, Photons) else sparse(frame, self.bins)
        if len(photons.offset) - 1 != self._positions:
            raise GeometryError(
                "frame",
                f"counts of {self._positions} positions",
                f"it has {len(photons.offset) - 1}",
                "Give all frames of one scan.",
            )
        with ThreadPoolExecutor(usual_threads()) as threads:
            for part in self._parts:
                part.take(photons, threads)

    def look(self) -> Image:
        """Image what was taken: the newest frame, and at far depths those before it."""
        field = np.empty(self._problem.grid.shape, np.complex64)
        planes = (plane for part in self._parts for plane in part.planes())
        for index, plane in enumerate(planes):
            field[index] = plane[0]
        problem = self._problem
        return Image(
            problem.grid, field, "rsd", problem.window, problem.camera, self._pulse, problem.depth_blocks
        )

    def forget(self) -> None:
        """Forget the frames that were taken: the next one does not follow them."""
        for part in self._parts:
            part.forget()


class _Part:
    """A depth block whose planes average as many frames.

    Parameters
    ----------
    problem
        Of this block alone, on the grid of all planes.
    aperture, depth_m
        The wall's lattice, and its depth.
    averaged
        How many frames are averaged.
    kernel_bytes
        Memory for what is kept.
    """

    def __init__(
        self, problem: ImagingProblem, aperture: Aperture, depth_m: float, averaged: int, kernel_bytes: int
    ) -> None:
        (part,) = problem.depth_blocks
        grid = problem.grid
        self._problem = replace(problem, grid=VoxelGrid(grid.x_m, grid.y_m, grid.z_m[part.planes]))
        self._depth_m, self._reached = depth_m, part.reached
        self.kernel_bytes = 0
        if not part.reached:
            return
        self._shape = aperture.y.count, aperture.x.count
        capture = problem.capture
        place = aperture.row * aperture.x.count + aperture.column
        # Runs of frequencies, one for each thread.
        edges = np.linspace(0, len(part.band), usual_threads() + 1).round().astype(int).tolist()
        self._transforms = [
            SparseTransform(
                capture,
                replace(part, band=part.band[first:stop]),
                problem.window,
                place,
                self._shape[0] * self._shape[1],
            )
            for first, stop in pairwise(edges)
        ]
        row, column = np.divmod(np.arange(self._shape[0] * self._shape[1]), self._shape[1])
        self._propagator = LatticePropagator(
            Aperture(aperture.x, aperture.y, column, row),
            np.broadcast_to(np.complex64(0), (len(part.band), len(row))),
            part.band,
            VoxelGrid(grid.x_m, grid.y_m, self._problem.grid.z_m - depth_m),
            2 if capture.confocal else 1,
            kernels=Kernels(kernel_bytes),
        )
        planes = len(self._problem.grid.z_m)
        self.kernel_bytes = min(kernel_bytes, self._propagator.kernel_bytes * planes)
        self._walls: deque[NDArray[np.complex64]] = deque(maxlen=averaged)

    def take(self, photons: Photons, threads: ThreadPoolExecutor) -> None:
        """Add a frame's photons to the wall, and leave out those of the oldest frame."""

        def walls(transform: SparseTransform) -> NDArray[np.complex64]:
            return self._propagator.transformed(transform.sums(photons).reshape(*self._shape, -1))

        if self._reached:
            self._walls.append(np.concatenate(list(threads.map(walls, self._transforms))))

    def forget(self) -> None:
        """Forget all frames."""
        if self._reached:
            self._walls.clear()

    def planes(self) -> Iterator[Field]:
        """Yield the field of each plane, the mean over the frames that are averaged, (1, y, x)."""
        if not self._reached:
            nothing = np.zeros((1, *self._problem.grid.shape[1:]), np.complex64)
            yield from (nothing for _ in self._problem.grid.z_m)
            return
        walls = self._walls[0] if len(self._walls) == 1 else np.mean(self._walls, axis=0)
        self._propagator.show(walls)
        yield from by_planes(
            self._problem,
            lambda z_m, times_s, reference: self._propagator.focus(z_m - self._depth_m, times_s, reference),
        )


def _quickest(
    capture: Capture, pulse: VirtualPulse, grid: VoxelGrid, averaged: NDArray[np.int64]
) -> list[DepthBlock]:
    """Cut a volume into depth blocks so that a frame takes the least time.

    More blocks need fewer frequencies for each plane, and take the wall's spectra more often. They are cut
    where the number of frames that are averaged changes in any case.
    """
    changes = (1 + np.flatnonzero(np.diff(averaged))).tolist()
    runs = list(pairwise([0, *changes, len(averaged)]))
    blocks: list[DepthBlock] = []
    for first, stop in runs:
        choices: list[list[DepthBlock]] = []
        for count in range(1, min(MOST_BLOCKS, stop - first) + 1):
            edges = np.linspace(first, stop, count + 1).round().astype(int).tolist()
            choices.append([depth_block(capture, pulse, grid, slice(a, b)) for a, b in pairwise(edges)])
        blocks += min(choices, key=_cost)
    return blocks


def _cost(blocks: Iterable[DepthBlock]) -> int:
    """Return what blocks take, in planes of one frequency."""
    return sum(
        len(one.band) * (TAKING_PLANES + one.planes.stop - one.planes.start) for one in blocks if one.reached
    )
