"""From a capture to an image: the confocal time-gated camera with a choice of solver."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recon.aperture import Aperture, recognise
from recon.budget import plan
from recon.capture import C_M_PER_S, Capture
from recon.errors import GeometryError, ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.preparation import Fades
from recon.reach import Slab, path_limits_m, slabs
from recon.solvers import backprojection, rsd, rsd_array, scattered
from recon.spectrum import spectra
from recon.wave import VirtualPulse

Progress = Callable[[float], None]
Solver = Literal["rsd", "backprojection"]
#: Part of the progress that reading the record makes up.
READING = 0.3


@dataclass(frozen=True)
class Image:
    """A focused volume and what it was made from.

    Attributes
    ----------
    grid
        Its voxels.
    field
        (z, y, x) complex64 field U.
    solver, pulse, fades
        What was asked.
    slabs
        Which bins and frequencies imaged which planes (RSD solver); empty for the back-projection solver,
        which uses the pulse itself.
    """

    grid: VoxelGrid
    field: NDArray[np.complex64]
    solver: Solver
    pulse: VirtualPulse
    fades: Fades
    slabs: tuple[Slab, ...]

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) float32 intensity I = |U|^2."""
        return self.field.real**2 + self.field.imag**2


def image(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    *,
    solver: Solver = "rsd",
    fades: Fades | None = None,
    progress: Progress | None = None,
    memory_bytes: int | None = None,
    device: str = "cpu",
) -> Image:
    """Focus the virtual camera on every voxel.

    U(v) = sum_omega g(omega) exp(i omega r_c(v)/c) sum_p H^(p, omega) exp(i omega r_p(v)/c) / r_p(v) for one
    detector spot, and sum_omega g(omega) sum_p H^(p, omega) exp(2 i omega r_p(v)/c) / r_p(v) for confocal
    data (paper, equations 4 and S.19 to S.22, in one sign convention: H^ = sum H exp(-i omega t)). Sums over
    omega are normalised as in `VirtualPulse.band`, so that both solvers give the same numbers.

    Parameters
    ----------
    capture
        Histograms and geometry.
    pulse
        The virtual illumination.
    grid
        Voxels, any pitch, offset and extent in front of the wall.
    solver
        "rsd": by FFT for a regular grid of positions on the plane z = 0, and for any other positions by the
        quickest way to the same numbers (`recon.solvers.scattered`); "backprojection": in time, for any
        positions, slow and independent.
    fades
        Soft edges of the record; by default only its end is softened.
    progress
        Called with the fraction that is done.
    memory_bytes
        Bound on the memory that imaging takes beyond the record (RSD solver); None takes what is quickest.
    device
        "cpu", or "cuda" for the RSD solver on a graphics processor.

    Raises
    ------
    MemoryBoundError
        If the bound is below the least that imaging needs.
    ReachError
        If no path to the volume falls inside the record.
    ParameterError
        If the volume is not in front of the wall, or the solver or the device is unknown or missing.
    """
    fades = fades or Fades()
    if grid.size == 0 or grid.z_m[0] <= 0:
        raise ParameterError(
            "volume",
            f"depths from {grid.z_m[:1]} m",
            "voxels must be in front of the wall",
            "Begin at z > 0.",
        )
    parts = slabs(capture, pulse, grid)
    if not any(part.reached for part in parts):
        raise _unreached(capture, grid)
    if solver == "rsd":
        field = _by_rsd(capture, grid, parts, fades, progress, memory_bytes, device)
        return Image(grid, field, solver, pulse, fades, tuple(parts))
    if solver == "backprojection":
        if memory_bytes is not None or device != "cpu":
            raise ParameterError(
                "solver backprojection",
                "a memory bound or a device",
                "it has neither",
                "Choose rsd, which takes any positions too.",
            )
        field = backprojection.focus(capture, pulse, grid, fades, progress)
        return Image(grid, field, solver, pulse, fades, ())
    raise ParameterError("solver", repr(solver), "there is no such solver", "Choose rsd or backprojection.")


def _by_rsd(
    capture: Capture,
    grid: VoxelGrid,
    parts: list[Slab],
    fades: Fades,
    progress: Progress | None,
    memory_bytes: int | None,
    device: str,
) -> NDArray[np.complex64]:
    aperture = _aperture(capture)
    cut = plan(capture, aperture, parts, grid, memory_bytes)
    propagate: scattered.Propagation = rsd.focus_slab
    if device != "cpu":
        propagate = partial(rsd_array.focus_slab, on=rsd_array.backend(device))
    field = np.zeros(grid.shape, np.complex64)
    work = sum(_work(piece) for pieces in cut.passes for piece in pieces)
    done = 0
    for number, pieces in enumerate(cut.passes):

        def reading(fraction: float, number: int = number, done: int = done) -> None:
            if progress:
                part = READING * (number + fraction) / len(cut.passes)
                progress(part + (1 - READING) * done / work)

        emitted = spectra(capture, pieces, fades, reading)
        for piece in pieces:

            def focusing(
                fraction: float, piece: Slab = piece, number: int = number, done: int = done
            ) -> None:
                if progress:
                    part = READING * (number + 1) / len(cut.passes)
                    progress(part + (1 - READING) * (done + fraction * _work(piece)) / work)

            planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[piece.planes])
            # Taken out of the list, so that its memory is free when its slab is done.
            arguments = emitted.pop(0), piece.band, planes
            if aperture is None:
                field[piece.planes] += scattered.focus_slab(
                    capture.laser_m,
                    capture.detector_m,
                    *arguments,
                    focusing,
                    working_bytes=cut.working_bytes,
                    propagate=propagate,
                )
            else:
                detector_m = None if capture.confocal else capture.detector_m[0]
                field[piece.planes] += propagate(
                    aperture, *arguments, detector_m, focusing, working_bytes=cut.working_bytes
                )
            done += _work(piece)
    return field


def _work(piece: Slab) -> int:
    return (piece.planes.stop - piece.planes.start) * len(piece.band.weights)


def _aperture(capture: Capture) -> Aperture | None:
    """Return the wall's regular grid, or None where it has none or detectors are many."""
    if not capture.confocal and len(capture.detector_m) != 1:
        return None
    try:
        return recognise(capture.laser_m)
    except GeometryError:
        return None


def _unreached(capture: Capture, grid: VoxelGrid) -> ReachError:
    shortest_m, longest_m = path_limits_m(capture, grid)
    begin_s = float(capture.first_bin_s.min())
    end_s = float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s
    return ReachError(
        "volume",
        f"light that takes {shortest_m / C_M_PER_S * 1e9:.2f} to {longest_m / C_M_PER_S * 1e9:.2f} ns",
        f"the record holds {begin_s * 1e9:.2f} to {end_s * 1e9:.2f} ns",
        "Choose other depths, or check the record's time origin.",
    )
