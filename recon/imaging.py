"""From a capture to an image or a video: a choice of camera, and a choice of solver.

The camera says what (`recon.camera`), the solver how (`recon.solvers.problem`); `SOLVERS` is the table of
all.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon import memory
from recon.camera import Camera
from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.sampling import CONFOCAL, Slab, path_limits_m, slabs
from recon.solvers import direct, fresnel, time_domain
from recon.solvers.problem import Solver, Task, ignore
from recon.solvers.rsd import dispatch
from recon.wave import VirtualPulse
from recon.window import Fades

Progress = Callable[[float], None]
#: All solvers, by name.
SOLVERS: dict[str, Solver] = {
    "rsd": dispatch.focus,
    "fresnel": fresnel.focus,
    "direct": direct.focus,
    "backprojection": time_domain.focus,
}
#: Those that can keep to a bound on memory.
BOUNDED = ("rsd", "fresnel")


@dataclass(frozen=True)
class Image:
    """A focused volume and what it was made from.

    Attributes
    ----------
    grid
        Its voxels.
    field
        (z, y, x) complex64 field U.
    solver, pulse, fades, camera
        What was asked.
    slabs
        Which bins and frequencies image which planes; the back-projection solver uses the pulse itself.
    """

    grid: VoxelGrid
    field: NDArray[np.complex64]
    solver: str
    pulse: VirtualPulse
    fades: Fades
    slabs: tuple[Slab, ...]
    camera: Camera = CONFOCAL

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) float32 intensity I = |U|^2."""
        return self.field.real**2 + self.field.imag**2


def image(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    *,
    solver: str = "rsd",
    camera: Camera = CONFOCAL,
    fades: Fades | None = None,
    progress: Progress | None = None,
    memory_bytes: int | None = None,
    device: str = "cpu",
) -> Image:
    """Focus a virtual camera on every voxel.

    With the confocal camera U(v) = sum_omega g(omega) exp(i omega r_c(v)/c) sum_p H^(p, omega)
    exp(i omega r_p(v)/c) / r_p(v) for one detector spot, and sum_omega g(omega) sum_p H^(p, omega)
    exp(2 i omega r_p(v)/c) / r_p(v) for confocal data (paper, equations 4 and S.19 to S.22, in one sign
    convention: H^ = sum H exp(-i omega t)). Sums over omega are normalised as in `VirtualPulse.band`, so that
    all solvers give the same numbers.

    Parameters
    ----------
    capture
        Histograms and geometry.
    pulse
        The virtual illumination.
    grid
        Voxels, any pitch, offset and extent in front of the wall.
    solver
        A key of `SOLVERS`. "rsd": any positions, by FFT or the quickest other way to the same numbers
        (`recon.solvers.rsd.dispatch`); "fresnel": by FFT with the paraxial wave, for a regular grid of
        positions on the plane z = 0; "direct": term by term in double precision, any positions, very slow;
        "backprojection": in time, any positions, slow.
    camera
        What to see; one that shows one frame.
    fades
        Soft edges of the record; by default only its end is softened.
    progress
        Called with the fraction that is done.
    memory_bytes
        Bound on the memory that imaging takes beyond the record (solvers rsd and fresnel); None takes what is
        quickest.
    device
        "cpu", or "cuda" for the solver rsd on a graphics processor, with positions on a plane.

    Raises
    ------
    GeometryError
        If the solver, the camera or the device cannot take these positions.
    MemoryBoundError
        If the bound is below the least that imaging needs.
    ReachError
        If no path to the volume falls inside the record.
    ParameterError
        If the volume is not in front of the wall, the solver or the device is unknown or missing, the solver
        cannot serve the camera, the bound or the device, or the camera shows more than one frame.
    """
    fades = fades or Fades()
    if device != "cpu" and solver != "rsd":
        raise ParameterError(
            f"solver {solver}", f"device {device}", "it computes on the cpu alone", "Use rsd, or the cpu."
        )
    task = replace(plan(capture, pulse, grid, camera, fades, progress), device=device)
    if task.frames != 1:
        raise ParameterError(
            f"{camera.name} camera", "an image", f"it shows {task.frames} frames", "Ask for a video."
        )
    task = bounded(task, solver, memory_bytes)
    field = np.empty(grid.shape, np.complex64)
    for index, plane in enumerate(planes(task, solver)):
        field[index] = plane[0]
    return Image(grid, field, solver, pulse, fades, task.slabs, camera)


def plan(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    camera: Camera,
    fades: Fades,
    progress: Progress | None = None,
) -> Task:
    """Choose bins and frequencies for a volume; raises as `image`."""
    if grid.size == 0 or grid.z_m[0] <= 0:
        raise ParameterError(
            "volume",
            f"depths from {grid.z_m[:1]} m",
            "voxels must be in front of the wall",
            "Begin at z > 0.",
        )
    light = camera.light(pulse)
    parts = tuple(slabs(capture, light, grid, camera))
    if not any(part.reached for part in parts):
        raise _unreached(capture, grid, camera)
    return Task(capture, grid, camera, light, parts, fades, progress or ignore)


def planes(task: Task, solver: str) -> Iterator[NDArray[np.complexfloating]]:
    """Yield the field U(v, t) of each plane in order of depth, (T, y, x) complex; raises as `image`."""
    _known(solver)
    return SOLVERS[solver](task)


def bounded(task: Task, solver: str, memory_bytes: int | None) -> Task:
    """Cut a task so that it keeps to a bound on memory, if there is one; raises as `image`."""
    _known(solver)
    if memory_bytes is None:
        return task
    if solver not in BOUNDED:
        raise ParameterError(
            f"solver {solver}",
            f"at most {memory_bytes / 1e6:.0f} MB of memory",
            "it cannot keep to a bound",
            f"Use {' or '.join(BOUNDED)}.",
        )
    return memory.cut(task, memory_bytes)


def _known(solver: str) -> None:
    if solver not in SOLVERS:
        raise ParameterError(
            "solver", repr(solver), "there is no such solver", f"Choose among {', '.join(SOLVERS)}."
        )


def _unreached(capture: Capture, grid: VoxelGrid, camera: Camera) -> ReachError:
    shortest_m, longest_m = path_limits_m(capture, grid, camera)
    begin_s = float(capture.first_bin_s.min())
    end_s = float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s
    return ReachError(
        "volume",
        f"light that takes {shortest_m / C_M_PER_S * 1e9:.2f} to {longest_m / C_M_PER_S * 1e9:.2f} ns",
        f"the record holds {begin_s * 1e9:.2f} to {end_s * 1e9:.2f} ns",
        "Choose other depths, or check the record's time origin.",
    )
