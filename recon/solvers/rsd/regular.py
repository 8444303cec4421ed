"""The Rayleigh-Sommerfeld diffraction solver: the exact sum over the wall, by FFT.

For one frequency and one plane of voxels, sum_p H^(p, omega) exp(i k r_p)/r_p is a convolution over the
wall's plane with the spherical wave exp(i k r)/r, k = omega/c (2 omega/c for confocal data, whose light goes
both paths). The wave is evaluated at the very offsets that the lattice has, and the FFT is long enough that
nothing wraps around: the result is the discrete sum itself, to single precision, with no approximation of
the wave.

How it is made quick, per plane and frequency, for an FFT of N points and V voxels:

- the wave is even along both axes, so only a quarter is evaluated, and transformed by two real DCT-I of N/4
  points (half an FFT of N) in place of an FFT;
- from one frequency to the next the wave is multiplied by exp(i dk r): no sine or cosine (N/4 complex
  multiplications; single precision loses 1e-7 a step);
- one pass multiplies by the wall's spectrum, kept for all frequencies (N multiplications, 8 N bytes read),
  and folds the product where voxels are several lattice steps apart;
- the inverse FFT along y takes all columns, the one along x only the rows that are read (3/4 of an FFT of N,
  or of as many points as the folded spectrum has);
- the phase of the moment t(v) at which a voxel is read and the sum over frequencies are one pass of Horner's
  rule, total <- total * exp(i d_omega t) + field (V multiplications).

That is 1.25 FFTs of N points for each plane and frequency, against the 2 of kernel and inverse. Where all
voxels of a plane are read at one moment, as in confocal data, the sum is taken before the inverse FFT, and
0.5 FFTs remain. Planes are shared out to threads; each thread's working set stays within its cache.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock, local

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, LatticeAxis, recognise
from recon.capture import C_M_PER_S, Capture
from recon.computer import usual_threads
from recon.errors import GeometryError
from recon.fft import c2c, dct
from recon.grid import VoxelGrid
from recon.sampling import DepthBlock
from recon.solvers.problem import ImagingProblem, Need
from recon.solvers.rsd import kernels
from recon.solvers.rsd.lattice import AxisPlan, plan_axis
from recon.solvers.spectral import Field, Propagator
from recon.wave import Band


class Workspace:
    """Arrays of one thread."""

    def __init__(self, y: AxisPlan, x: AxisPlan) -> None:
        quarter = (2, y.half + 1, x.half + 1)
        self.wave = np.empty(quarter, np.float32)
        self.step = np.empty(quarter, np.float32)
        self.kernel = self.own_kernel = np.empty(quarter, np.float32)
        self.spectrum = np.empty((y.folded, x.folded), np.complex64)
        self.rows = np.empty((len(y.first), x.folded), np.complex64)


class Kernels:
    """Transforms of the spherical wave that are kept for the next image on the same lattice and planes.

    Parameters
    ----------
    most_bytes
        Planes whose kernels do not fit into these have theirs computed anew each time.
    """

    def __init__(self, most_bytes: int) -> None:
        self._left_bytes, self._kept = most_bytes, dict[float, NDArray[np.float32]]()
        self._lock = Lock()

    def of_plane(self, z_m: float) -> NDArray[np.float32] | None:
        """Return what was kept for a plane, (F, 2, y, x); None where nothing was."""
        return self._kept.get(z_m)

    def keep(self, z_m: float, kernels: list[NDArray[np.float32]]) -> None:
        """Keep a plane's kernels, in order of frequency, if there is room."""
        size = sum(one.nbytes for one in kernels)
        with self._lock:
            if size > self._left_bytes or z_m in self._kept:
                return
            self._left_bytes -= size
        self._kept[z_m] = np.stack(kernels)

    @property
    def room(self) -> bool:
        """Whether more may fit."""
        return self._left_bytes > 0


class LatticePropagator(Propagator):
    """Convolves with the spherical wave on a lattice.

    Parameters
    ----------
    aperture
        The wall's lattice.
    emitted
        (F, P) complex64: what each position emits at each frequency.
    band
        The frequencies.
    grid
        Voxels; depths that will be asked for, the nearest first: the lattice is planned for that.
    round_trip_factor
        How often the path from a laser spot to a voxel counts: once, or twice for confocal data.
    wall_bytes
        As of `ImagingProblem`.
    kernels
        Where the wave's transforms are kept for later images; None keeps none.
    threads
        How many transform the wall; None takes one for each core.
    """

    def __init__(
        self,
        aperture: Aperture,
        emitted: NDArray[np.complex64],
        band: Band,
        grid: VoxelGrid,
        round_trip_factor: int,
        wall_bytes: int = ImagingProblem.wall_bytes,
        kernels: Kernels | None = None,
        threads: int | None = None,
    ) -> None:
        self.band = band
        self._kernels = kernels
        self._emitted = emitted
        self._shape = grid.shape[1:]
        self._round_trip_factor = round_trip_factor
        self._y, self._x = self._plans(aperture, grid)
        self._aperture = aperture
        kept = max(1, wall_bytes // (8 * self._y.length * self._x.length))
        self._threads = local()
        with ThreadPoolExecutor(threads or usual_threads()) as pool:
            walls = list(pool.map(self._transform, range(min(kept, len(band)))))
        self._walls: Sequence[NDArray[np.complex64]] | NDArray[np.complex64] = walls

    def transformed(self, sums: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Return the wall's transforms of what lattice points emit, for `show`.

        Parameters
        ----------
        sums
            (aperture rows, aperture columns, F) complex64.

        Returns
        -------
        ndarray
            (F, lattice y, lattice x) complex64; those of several moments may be added up.
        """
        sums = sums * np.float32(1 / (self._y.length * self._x.length))
        _, columns, many = sums.shape
        # Column by column, and row by row: what is spread stays within the cache.
        up = np.stack([_spread(self._y, sums[:, column]) for column in range(columns)], axis=1)
        across = np.stack([_spread(self._x, row) for row in up])
        walls = np.zeros((many, self._y.length, self._x.length), np.complex64)
        walls[np.ix_(np.arange(many), self._y.wall, self._x.wall)] = np.moveaxis(across, 2, 0)
        return c2c(walls, axes=(1, 2), out=walls, nthreads=1)

    @property
    def kernel_bytes(self) -> int:
        """Size of a plane's kernels."""
        return 8 * len(self.band) * (self._y.half + 1) * (self._x.half + 1)

    def show(self, walls: NDArray[np.complex64]) -> None:
        """Take other transforms of the wall, as of `transformed`, in place of what was emitted before."""
        self._walls = walls

    def fields(self, z_m: float) -> Field:
        """Return the fields on the plane at depth `z_m`: (F, y, x) complex64."""
        work = self._workspace()
        fields = np.zeros((len(self.band), *self._shape), np.complex64)
        for index in self._walk(z_m, work):
            kernels.multiply(self._wall(index), work.kernel, work.spectrum, False)
            kernels.add_field(fields[index], fields[index], self._rows(work), self._x.first, self._x.weights)
        return fields

    def adjoint(self, z_m: float, fields: Field) -> NDArray[np.complex64]:
        """Take fields on the plane at depth `z_m` back to the positions: (F, y, x) to (F, P).

        It is the adjoint of what `fields` does to `emitted`: <fields(e), f> = <e, adjoint(f)>.
        """
        work = self._workspace()
        emitted = np.empty_like(self._emitted)
        for index in self._walk(z_m, work):
            across = np.zeros((self._x.folded, self._shape[0]), np.complex64)
            kernels.spread_rows(
                np.ascontiguousarray(fields[index].T, np.complex64), self._x.first, self._x.weights, across
            )
            read = np.zeros((self._y.folded, self._x.folded), np.complex64)
            kernels.spread_rows(np.ascontiguousarray(across.T), self._y.first, self._y.weights, read)
            lattice = np.tile(c2c(read, nthreads=1).conj(), (self._y.fold, self._x.fold))
            product = np.empty_like(lattice)
            kernels.multiply(lattice, work.kernel, product, False)
            # conj(K^) L is conj(K^ conj(L)), and a transform back of a conjugate is a conjugated transform.
            c2c(product, out=product, nthreads=1)
            emitted[index] = _take(self._aperture, product.conj(), self._y, self._x) / product.size
        return emitted

    def focus(
        self, z_m: float, times_s: NDArray[np.float64], reference_rad_per_s: float | None = None
    ) -> Field:
        """Sum the fields over all frequencies at moments t, and their slope: (T, y, x) complex64."""
        if len(times_s) > 1:
            return super().focus(z_m, times_s)
        fields = self.slow(z_m, times_s, reference_rad_per_s)
        turn(fields, self.band.last_rad_per_s, times_s)
        return fields

    def slow(
        self, z_m: float, times_s: NDArray[np.float64], reference_rad_per_s: float | None = None
    ) -> Field:
        """Return what `focus` does at one moment, times exp(-i omega t) with the band's highest omega.

        Where the moments change in space by no more than light does, this oscillates in space no faster than
        the field of that frequency, whichever frequencies are summed.
        """
        slopes = reference_rad_per_s is not None
        sums = self._at_once(z_m, times_s, slopes) if times_s.size == 1 else self._read(z_m, times_s, slopes)
        if reference_rad_per_s is not None:
            # What was summed is n times the field of the n-th frequency from the last.
            sums[1] *= -1j * self.band.step_rad_per_s
            sums[1] += 1j * (self.band.last_rad_per_s - reference_rad_per_s) * sums[0]
        return sums

    def _at_once(self, z_m: float, times_s: NDArray[np.float64], slopes: bool) -> Field:
        """Sum at one moment for all voxels; with slopes, the sum of n times the n-th from the last, too."""
        work = self._workspace()
        fields = np.zeros((1 + slopes, *self._shape), np.complex64)
        since = self.band.frequencies_rad_per_s - self.band.last_rad_per_s
        turns = np.exp(1j * since * times_s.item()).astype(np.complex64)
        work.spectrum[:] = 0
        sums = np.zeros_like(work.spectrum) if slopes else None
        for index in self._walk(z_m, work):
            if sums is not None:
                sums += work.spectrum  # so that the n-th from the last is added n times by the end
            wall = self._wall(index)
            wall = wall * turns[index] if turns[index] != 1 else wall
            kernels.multiply(wall, work.kernel, work.spectrum, True)
        for field in fields:
            kernels.add_field(field, field, self._rows(work), self._x.first, self._x.weights)
            if sums is not None:
                work.spectrum[:] = sums
        return fields

    def _read(self, z_m: float, times_s: NDArray[np.float64], slopes: bool) -> Field:
        """Sum at a moment for each voxel, by Horner's rule; with slopes, of n times the n-th from last."""
        work = self._workspace()
        fields = np.zeros((1 + slopes, *self._shape), np.complex64)
        step = phases(times_s, -self.band.step_rad_per_s, self._shape)
        for index in self._walk(z_m, work):
            kernels.multiply(self._wall(index), work.kernel, work.spectrum, False)
            rows = self._rows(work)
            if slopes:
                kernels.add_field_and_slope(fields[0], fields[1], step, rows, self._x.first, self._x.weights)
            else:
                kernels.add_field(fields[0], step, rows, self._x.first, self._x.weights)
        return fields

    def walls_of(self, emitted: Sequence[NDArray[np.complex64]]) -> NDArray[np.complex64]:
        """Return the transforms of what several groups of the positions emit, for `focus_together`.

        Parameters
        ----------
        emitted
            (F, P) complex64 of each group: what each position emits at each frequency.

        Returns
        -------
        ndarray
            (F, groups, lattice y, lattice x) complex64.
        """
        shape = len(self.band), len(emitted), self._y.length, self._x.length
        walls = np.empty(shape, np.complex64)
        places = list(np.ndindex(shape[:2]))

        def fill(place: tuple[int, int]) -> None:
            frequency, group = place
            walls[place] = self._transformed(emitted[group][frequency])

        with ThreadPoolExecutor(usual_threads()) as threads:
            deque(threads.map(fill, places), maxlen=0)
        return walls

    def focus_together(
        self,
        z_m: float,
        walls: NDArray[np.complex64],
        times_s: NDArray[np.float64],
        reference_rad_per_s: float | None = None,
    ) -> Field:
        """Sum all frequencies of groups on the same lattice, each read at moments of its own.

        The spherical wave is transformed once for all groups, and each takes 0.75 FFTs.

        Parameters
        ----------
        z_m
            Depth of the plane.
        walls
            As of `walls_of`.
        times_s
            (groups, y, x) moment at which each group is read at each voxel.
        reference_rad_per_s
            As of `Propagator.focus`.

        Returns
        -------
        ndarray
            (1, y, x) complex64, with a reference (2, y, x).
        """
        work = self._workspace()
        fields = np.zeros((2, *self._shape), np.complex64)
        turns, steps = (np.empty(times_s.shape, np.complex64) for _ in range(2))
        for moments_s, turn, step in zip(times_s, turns, steps, strict=True):
            turn[:] = phases(moments_s, self.band.first_rad_per_s, moments_s.shape)
            step[:] = phases(moments_s, self.band.step_rad_per_s, moments_s.shape)
        part = np.empty_like(fields[0])
        # written out once for all groups, the wave is multiplied in half of the time
        wave = np.empty(walls.shape[2:], np.complex64) if work.spectrum.shape == walls.shape[2:] else None
        for index in self._walk(z_m, work):
            part[:] = 0
            if wave is not None:
                kernels.unfold(work.kernel, wave)
            for wall, turn, step in zip(walls[index], turns, steps, strict=True):
                if wave is not None:
                    np.multiply(wall, wave, out=work.spectrum)
                else:
                    kernels.multiply(wall, work.kernel, work.spectrum, False)
                kernels.add_turned(part, turn, step, self._rows(work), self._x.first, self._x.weights)
            fields[0] += part
            if reference_rad_per_s is not None:
                fields[1] += 1j * (self.band.frequencies_rad_per_s[index] - reference_rad_per_s) * part
        return fields if reference_rad_per_s is not None else fields[:1]

    @property
    def _wavenumber(self) -> float:
        """The wave's k at the highest frequency [rad/m]."""
        return self._round_trip_factor * self.band.finest_rad_per_s / C_M_PER_S

    def _plans(self, aperture: Aperture, grid: VoxelGrid) -> tuple[AxisPlan, AxisPlan]:
        """Plan the axes y and x."""
        near_m = float(grid.z_m[0])
        return (
            self._planned(aperture.y, grid.y_m, near_m),
            self._planned(aperture.x, grid.x_m, near_m),
        )

    def _planned(self, wall: LatticeAxis, voxels_m: NDArray[np.float64], near_m: float) -> AxisPlan:
        """Plan an axis for the wave."""
        return plan_axis(wall, voxels_m, self._wavenumber, near_m)

    def _walk(self, z_m: float, work: Workspace) -> Iterator[int]:
        """From the lowest frequency up, leave the kernel's transform in `work` and yield the index."""
        kept = self._kernels.of_plane(z_m) if self._kernels else None
        if kept is not None:
            for index, work.kernel in enumerate(kept):
                yield index
            return
        work.kernel, made = work.own_kernel, []
        kernels.spherical_wave(
            np.arange(self._y.half + 1, dtype=np.float64) * self._y.step_m,
            np.arange(self._x.half + 1, dtype=np.float64) * self._x.step_m,
            z_m,
            self._round_trip_factor * self.band.first_rad_per_s / (2 * np.pi * C_M_PER_S),
            self._round_trip_factor * self.band.step_rad_per_s / (2 * np.pi * C_M_PER_S),
            work.wave,
            work.step,
        )
        for index in range(len(self.band)):
            if index:
                kernels.next_frequency(work.wave, work.step)
            dct(work.wave, axes=(1, 2), type=1, out=work.kernel, nthreads=1)
            if self._kernels and self._kernels.room:
                made.append(work.kernel.copy())
            yield index
        if self._kernels and len(made) == len(self.band):
            self._kernels.keep(z_m, made)

    def _wall(self, index: int) -> NDArray[np.complex64]:
        """Return the transform of what the wall emits at a frequency, (lattice y, lattice x)."""
        if index < len(self._walls):
            return self._walls[index]
        return self._transform(index)

    def _transform(self, index: int) -> NDArray[np.complex64]:
        """Return the transform of what the positions emit at a frequency."""
        return self._transformed(self._emitted[index])

    def _transformed(self, emitted: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Put positions on the lattice, and transform: along x only the rows that emit."""
        scale = np.float32(1 / (self._y.length * self._x.length))  # the inverse FFT's
        rows = _put(self._aperture, emitted * scale, self._y, self._x)
        wall = np.zeros((self._y.length, self._x.length), np.complex64)
        wall[self._y.wall] = c2c(rows, axes=(1,), out=rows, nthreads=1)
        return c2c(wall, axes=(0,), out=wall, nthreads=1)

    def _rows(self, work: Workspace) -> NDArray[np.complex64]:
        """Transform the spectrum back and read it along y: (voxel rows, lattice columns)."""
        c2c(work.spectrum, axes=(0,), forward=False, out=work.spectrum, nthreads=1)
        rows = work.rows
        if self._y.in_turn:
            rows = work.spectrum[: len(rows)]
        else:
            kernels.read_rows(work.spectrum, self._y.first, self._y.weights, rows)
        return c2c(rows, axes=(1,), forward=False, out=rows, nthreads=1)

    def _workspace(self) -> Workspace:
        """Return the calling thread's arrays."""
        if not hasattr(self._threads, "work"):
            self._threads.work = Workspace(self._y, self._x)
        return self._threads.work


def phases(
    times_s: NDArray[np.float64], omega_rad_per_s: float, shape: tuple[int, ...]
) -> NDArray[np.complex64]:
    """Return exp(i omega t) for moments, (..., y or 1, x or 1), at all (y, x) voxels."""
    turned = np.empty(shape, np.complex64)
    moments_s = np.ascontiguousarray(np.broadcast_to(times_s.reshape(times_s.shape[-2:]), shape))
    kernels.phase(moments_s, omega_rad_per_s / (2 * np.pi), turned)
    return turned


def turn(fields: Field, omega_rad_per_s: float, times_s: NDArray[np.float64]) -> None:
    """Multiply (..., y, x) fields by exp(i omega t), with t the (1, y or 1, x or 1) moment of each voxel."""
    fields *= phases(times_s, omega_rad_per_s, fields.shape[-2:])


def needs(
    problem: ImagingProblem,
    part: DepthBlock,
    x: LatticeAxis,
    y: LatticeAxis,
    round_trip_factor: int,
    near_m: float | None = None,
) -> Need:
    """Return the memory that imaging a depth block from a lattice, planned for `near_m`, takes."""
    grid, many = VoxelGrid(problem.grid.x_m, problem.grid.y_m, problem.grid.z_m[part.planes]), len(part.band)
    wavenumber = round_trip_factor * part.band.finest_rad_per_s / C_M_PER_S
    along_x, along_y = (
        plan_axis(axis, at_m, wavenumber, near_m) for axis, at_m in ((x, grid.x_m), (y, grid.y_m))
    )
    points = along_y.length * along_x.length
    quarter = (along_y.half + 1) * (along_x.half + 1)
    thread = 24 * quarter + 8 * along_y.folded * along_x.folded + 8 * len(grid.y_m) * along_x.folded
    thread += 8 * along_y.folded * along_x.folded + 64 * len(grid.y_m) * len(grid.x_m)
    # One wall field is put on its lattice at a time, in two steps where it is spread.
    fixed, wall = problem.threads * thread + 16 * points, 8 * points
    if problem.frames == 1:
        levels = 2 * problem.threads * thread  # two coarser lattices, at most
        return Need(24 * grid.size + fixed + levels, wall, 1)
    return Need(fixed, min(many * wall, problem.wall_bytes), many)


def aperture(capture: Capture) -> Aperture:
    """Find the lattice of a capture's positions.

    Raises
    ------
    GeometryError
        If the positions are on no even grid on z = 0, or each has a detector spot of its own elsewhere.
    """
    if capture.round_trip and not capture.confocal:
        raise GeometryError(
            "solver by FFT",
            "one detector spot, or each position lit and seen at the same spot",
            f"there are {len(capture.detector_m)} detector spots apart from the laser's",
            "Use the rsd solver, which takes any pairs.",
        )
    return recognise(capture.laser_m)


def _put(
    aperture: Aperture, emitted: NDArray[np.complex64], y: AxisPlan, x: AxisPlan
) -> NDArray[np.complex64]:
    """Put what each position emits, (P,), on the lattice's rows that emit: (rows, x.length)."""
    grid = np.zeros((aperture.y.count, aperture.x.count), np.complex64)
    np.add.at(grid.reshape(-1), aperture.row * aperture.x.count + aperture.column, emitted)
    grid = _spread(y, _spread(x, grid.T).T)
    rows = np.zeros((len(y.wall), x.length), np.complex64)
    rows[:, x.wall] = grid
    return rows


def _take(
    aperture: Aperture, lattice: NDArray[np.complex64], y: AxisPlan, x: AxisPlan
) -> NDArray[np.complex64]:
    """Take what positions receive, (P,), off the lattice: the adjoint of `_put`."""
    grid = lattice[np.ix_(y.wall, x.wall)]
    grid = _gather(y, _gather(x, grid.T).T)
    return grid[aperture.row, aperture.column]


def _spread(axis: AxisPlan, grid: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Spread a grid along its first axis."""
    if axis.spread is None:
        return grid
    spread = np.zeros((len(axis.wall), grid.shape[1]), np.complex64)
    kernels.spread_rows(np.ascontiguousarray(grid), *axis.spread, spread)
    return spread


def _gather(axis: AxisPlan, grid: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Take the adjoint of `_spread`."""
    if axis.spread is None:
        return grid
    gathered = np.empty((len(axis.spread[0]), grid.shape[1]), np.complex64)
    kernels.read_rows(np.ascontiguousarray(grid), *axis.spread, gathered)
    return gathered
