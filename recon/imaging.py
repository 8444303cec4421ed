"""From a capture to an image or a video: a choice of camera, and a choice of solver.

The camera says what (`recon.camera`), the solver how (`recon.solvers.problem`); `recon.registry` holds all.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon import memory
from recon.camera import Camera, ConfocalCamera
from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.registry import BOUNDED, SOLVERS, WAVE_SOLVERS, entry_of, load, name_of
from recon.registry import taking as solvers_taking
from recon.result import Image
from recon.sampling import CONFOCAL, depth_blocks, path_limits_m
from recon.solvers.problem import ImagingProblem, Solver, ignore
from recon.spectrum import Spectra, spectra
from recon.wave import VirtualPulse
from recon.window import Window

Progress = Callable[[float], None]
#: Gives the field of each plane of a problem by a solver, as `planes`.
Planes = Callable[[ImagingProblem, "str | Solver"], Iterator[NDArray[np.complexfloating]]]


def image(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    *,
    solver: str | Solver = "rsd",
    camera: Camera = CONFOCAL,
    window: Window | None = None,
    progress: Progress | None = None,
    memory_bytes: int | None = None,
    device: str = "cpu",
    fft: bool | None = None,
    taking: Spectra = spectra,
    by: Planes | None = None,
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
        One of `recon.registry.WAVE_SOLVERS`. "rsd": any positions, by FFT or the quickest other way to the
        same numbers (`recon.solvers.rsd.dispatch`); "fresnel": by FFT with the paraxial wave, for a regular
        grid of
        positions on the plane z = 0; "direct": term by term in double precision, any positions, very slow;
        "backprojection": in time, any positions, slow. Or a function of your own: it takes an
        `ImagingProblem` and yields U of each plane, (1, y, x) complex, in order of depth
        (`recon.solvers.problem`); depths are then read off the brightest planes.
    camera
        What to see; one that shows one frame.
    window
        Soft edges of the record; by default only its end is softened.
    progress
        Called with the fraction that is done.
    memory_bytes
        Bound on the memory that imaging takes beyond the record (solvers rsd and fresnel); None takes what is
        quickest.
    device
        "cpu", or "cuda" for the solver rsd on a graphics processor, with positions on a plane.
    fft
        Whether the solver rsd goes by FFT, where positions lie on a plane; None takes what is quicker.
    taking
        What takes the spectra of the capture, where they are not those of its histograms.
    by
        What computes the planes, as `planes`, in place of this process.

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

    Examples
    --------
    A point 1 m in front of the middle of a wall of 1 m x 1 m, lit at 11 x 11 spots and seen at one:

    >>> import numpy as np, recon
    >>> x_m, y_m = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-0.5, 0.5, 11)] * 2))
    >>> laser_m, point_m = np.stack([x_m, y_m, 0 * x_m], axis=1), np.array([0.0, 0.0, 1.0])
    >>> path_m = np.linalg.norm(laser_m - point_m, axis=1) + np.linalg.norm([0.5, 0.0, -1.0])
    >>> counts = np.zeros((121, 600))
    >>> counts[np.arange(121), (path_m / 299792458.0 / 20e-12).astype(int)] = 100
    >>> capture = recon.Capture(
    ...     recon.ArrayHistograms(counts), bin_width_s=20e-12, first_bin_s=np.zeros(1),
    ...     laser_m=laser_m, detector_m=np.array([[0.5, 0.0, 0.0]]),
    ... )
    >>> grid = recon.VoxelGrid.from_spec(1.0, 1.0, 0.1, (0.8, 1.2, 0.05))
    >>> found = recon.image(capture, recon.VirtualPulse(wavelength_m=0.2), grid)
    >>> z, y, x = np.unravel_index(found.intensity.argmax(), grid.shape)
    >>> bool(abs(grid.x_m[x]) < 0.1 and abs(grid.y_m[y]) < 0.1 and abs(grid.z_m[z] - 1) < 0.06)
    True
    """
    window = window or Window()
    _known(solver)
    check_device(solver, device)
    problem = replace(
        plan(capture, pulse, grid, camera, window, progress),
        device=device,
        fft=fft,
        spectra=taking,
        slopes=isinstance(camera, ConfocalCamera) and not callable(solver),
    )
    if problem.frames != 1:
        raise ParameterError(
            f"{camera.name} camera", "an image", f"it shows {problem.frames} frames", "Ask for a video."
        )
    return focused(bounded(problem, solver, memory_bytes), solver, pulse, by)


def focused(
    problem: ImagingProblem, solver: str | Solver, pulse: VirtualPulse, by: Planes | None = None
) -> Image:
    """Image a problem of one moment; `by` and what is raised are as of `image`."""
    return pictured(problem, (by or planes)(problem, solver), solver, pulse)


def pictured(
    problem: ImagingProblem,
    focused_planes: Iterable[NDArray[np.complexfloating]],
    solver: str | Solver,
    pulse: VirtualPulse,
) -> Image:
    """Put the planes of a problem of one moment, in order of depth, together to an image."""
    shape = problem.grid.shape
    field = np.empty(shape, np.complex64)
    late_s = np.empty(shape, np.float32) if problem.slopes else None
    for index, plane in enumerate(focused_planes):
        if plane.shape[1:] != shape[1:]:
            raise ParameterError(
                f"solver {name_of(solver)}",
                f"planes of {shape[1:]} voxels",
                f"plane {index} has the shape {plane.shape}",
                "Yield (1, y, x) for each plane of the grid.",
            )
        field[index] = plane[0]
        if late_s is not None:
            late_s[index] = lateness_s(plane[0], plane[1], pulse)
    window, camera, blocks = problem.window, problem.camera, problem.depth_blocks
    return Image(problem.grid, field, name_of(solver), window, camera, pulse, blocks, late_s=late_s)


def lateness_s(
    field: NDArray[np.complexfloating], slope: NDArray[np.complexfloating], pulse: VirtualPulse
) -> NDArray[np.floating]:
    """Return by how much later than a voxel is read its pulse is at its peak.

    The envelope is exp(-(t - t_0)^2/(2 sigma_t^2)), so d ln|U| / dt = t_0 / sigma_t^2 at t = 0, which is
    Re(U* dU/dt) / |U|^2 = Re((dU/dt) / U); zero where there is no field.

    Parameters
    ----------
    field, slope
        U, and dU/dt - i omega_0 U, which has the same envelope's change.
    pulse
        The virtual illumination.
    """
    # a quotient, since a product of field and slope overflows where the intensity does not
    change = np.divide(slope, field, out=np.zeros_like(field), where=field != 0)
    return pulse.sigma_s**2 * change.real


def plan(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    camera: Camera,
    window: Window,
    progress: Progress | None = None,
) -> ImagingProblem:
    """Choose bins and frequencies for a volume; raises as `image`."""
    grid.check_in_front()
    light = camera.light(pulse)
    parts = tuple(depth_blocks(capture, light, grid, camera))
    if not any(part.reached for part in parts):
        raise _unreached(capture, grid, camera)
    return ImagingProblem(capture, grid, camera, light, parts, window, progress or ignore)


def planes(problem: ImagingProblem, solver: str | Solver) -> Iterator[NDArray[np.complexfloating]]:
    """Yield the field U(v, t) of each plane in order of depth, (T, y, x) complex; raises as `image`."""
    if callable(solver):
        return solver(problem)
    _known(solver)
    focus: Solver = load(SOLVERS[solver].place)
    return focus(problem)


def bounded(
    problem: ImagingProblem, solver: str | Solver, memory_bytes: int | None, held_bytes: int = 0
) -> ImagingProblem:
    """Cut a problem so that it keeps to a bound on memory, if there is one; raises as `image`.

    Of the bound, ``held_bytes`` are taken by others meanwhile.
    """
    _known(solver)
    if memory_bytes is None:
        return problem
    needs = entry_of(solver).needs
    if needs is None:
        raise ParameterError(
            f"solver {name_of(solver)}",
            f"at most {memory_bytes / 1e6:.0f} MB of memory",
            "it has no limit of memory",
            f"Use {' or '.join(BOUNDED)}.",
        )
    return memory.cut(problem, load(needs), memory_bytes, held_bytes)


def check_device(solver: str | Solver, device: str) -> None:
    """Raise `recon.errors.ParameterError` if a solver does not compute on a device."""
    if device != "cpu" and "device" not in entry_of(solver).options:
        raise ParameterError(
            f"solver {name_of(solver)}",
            f"device {device}",
            "it computes on the cpu only",
            f"Use {' or '.join(solvers_taking('device'))}, or the cpu.",
        )


def _known(solver: str | Solver) -> None:
    if not callable(solver) and solver not in WAVE_SOLVERS:
        raise ParameterError(
            "solver", repr(solver), "there is no such solver", f"Choose among {', '.join(WAVE_SOLVERS)}."
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
