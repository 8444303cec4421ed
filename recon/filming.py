"""Videos of the transient camera, plane by plane: never all depths, moments and pixels at once in memory.

For each plane the fields of all frequencies are kept, and one small matrix product turns them into its
frames; these go to a sink, and into a front view that holds one image for each moment. In memory, for F
frequencies, T frames and V voxels in a plane, are then 4 T V bytes of front view and, on each thread, about
8 (F + 3 T) V bytes; fewer threads run where the latter would be more than `ImagingProblem.plane_bytes`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from recon.camera import TransientCamera
from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError
from recon.grid import VoxelGrid
from recon.imaging import Progress, bounded, check_device, plan, planes
from recon.registry import name_of
from recon.result import MOST_FIELD, Image, require_bounded
from recon.sampling import path_limits_m
from recon.solvers.problem import Solver
from recon.spectrum import Spectra, spectra
from recon.wave import VirtualPulse
from recon.window import Window

#: How depths are put into one picture: the greatest intensity, or the sum of all, or what is on the surface.
Over = Literal["max", "sum", "surface"]
#: Takes the number of a plane and its frames, (T, y, x) float32 intensity.
Sink = Callable[[int, NDArray[np.float32]], None]
#: Frames in a pulse's full width at half maximum.
FRAMES_PER_PULSE = 4
#: More frames are no video, but a slip in typing: at 25 a second it would take more than an hour.
MOST_FRAMES = 100_000


def video(
    capture: Capture,
    pulse: VirtualPulse,
    grid: VoxelGrid,
    camera: TransientCamera,
    *,
    solver: str | Solver = "rsd",
    over: Over = "max",
    surface_m: NDArray[np.float64] | NDArray[np.float32] | None = None,
    sink: Sink | None = None,
    window: Window | None = None,
    progress: Progress | None = None,
    memory_bytes: int | None = None,
    device: str = "cpu",
    taking: Spectra = spectra,
) -> Image:
    """Film how the flash of one point source travels through the hidden scene.

    Parameters
    ----------
    capture, pulse, grid, solver, window, progress, memory_bytes, device, taking
        As of `recon.imaging.image`.
    camera
        Which moments to show.
    over
        How depths are put into one picture. A camera with one aperture tells depth by focus alone: light of
        one place is seen at all depths, out of focus, dz/c earlier or later. "max" and "sum" show all of
        that; "surface" shows each pixel at the depth where something is.
    surface_m
        (y, x) depth of the surface for "surface", NaN where there is none, e.g. `recon.depth.depth_map` of
        the confocal camera's image.
    sink
        Takes every plane of voxels as it is made, in order of depth.

    Raises
    ------
    GeometryError, MemoryBoundError, ReachError, ParameterError
        As of `recon.imaging.image`.
    ReconError
        If an intensity is not within single precision.

    Examples
    --------
    Photons that come by way of a point 1 m from the middle of the wall, which is lit there and seen from 81
    spots. The film is brightest when the flash is at the point:

    >>> import numpy as np, recon
    >>> x_m, y_m = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-0.4, 0.4, 9)] * 2))
    >>> laser_m = np.stack([x_m, y_m, 0 * x_m], axis=1)
    >>> path_m = 1 + np.linalg.norm(laser_m - [0, 0, 1], axis=1)
    >>> counts = np.zeros((81, 600))
    >>> counts[np.arange(81), (path_m / 299792458.0 / 20e-12).astype(int)] = 100
    >>> capture = recon.Capture(
    ...     recon.ArrayHistograms(counts), 20e-12, np.zeros(1), laser_m, np.zeros((1, 3))
    ... )
    >>> grid = recon.VoxelGrid.from_spec(0.8, 0.8, 0.1, (1.0, 1.0, 0.1))
    >>> camera = recon.TransientCamera(np.arange(2.0, 5.0, 0.5) * 1e-9)
    >>> film = recon.video(capture, recon.VirtualPulse(0.2), grid, camera)
    >>> moment_s = film.times_s[film.frames.max(axis=(1, 2)).argmax()]
    >>> print(f"{moment_s * 1e9:.1f} ns of {1 / 0.299792458:.1f} ns")
    3.5 ns of 3.3 ns
    """
    if (surface_m is None) == (over == "surface"):
        raise ParameterError(
            "video", f"{over} over depth", "a surface is used with 'surface' only", "Give both or neither."
        )
    window = window or Window()
    check_device(solver, device)
    problem = replace(plan(capture, pulse, grid, camera, window, progress), device=device, spectra=taking)
    problem = bounded(problem, solver, memory_bytes)
    plane_of_surface = None if surface_m is None else _nearest(grid.z_m, surface_m)
    seen = np.zeros((len(camera.times_s), *grid.shape[1:]), np.float32)
    for index, fields in enumerate(planes(problem, solver)):
        frames = _intensity(fields)
        if sink:
            sink(index, frames)
        if plane_of_surface is not None:
            seen += frames * (plane_of_surface == index)
        elif over == "max":
            np.maximum(seen, frames, out=seen)
        else:
            seen += frames
    times_s = np.asarray(camera.times_s, np.float64)
    return Image(grid, None, name_of(solver), window, camera, pulse, problem.depth_blocks, times_s, seen)


def _intensity(fields: NDArray[np.complexfloating]) -> NDArray[np.float32]:
    """Return the intensity of a plane's frames, (T, y, x), if it is within single precision."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large is refused
        frames = (fields.real**2 + fields.imag**2).astype(np.float32)
    if not frames.max() <= MOST_FIELD**2:
        require_bounded(float(np.abs(fields).max()))
    return frames


def _nearest(z_m: NDArray[np.float64], surface_m: NDArray) -> NDArray[np.intp]:
    """Return the plane nearest to the surface at each pixel, -1 where there is none."""
    nearest = np.abs(z_m[:, None, None] - np.nan_to_num(surface_m)).argmin(axis=0)
    return np.where(np.isfinite(surface_m), nearest, -1)


def frame_times_s(
    capture: Capture, pulse: VirtualPulse, grid: VoxelGrid, frames_s: tuple[float, float, float] | None = None
) -> NDArray[np.float64]:
    """Choose the moments of a video.

    Unasked, it begins half a pulse before the source's light reaches the nearest voxel, and goes on for twice
    the time that light takes to the farthest, so that light by way of other surfaces is seen too, as far as
    the record goes; a pulse's width takes `FRAMES_PER_PULSE` frames.

    Parameters
    ----------
    capture, pulse, grid
        What will be filmed.
    frames_s
        First moment, last, and step.

    Raises
    ------
    ParameterError
        If the moments run backwards, or are too many.
    """
    width_s = pulse.cycles * pulse.wavelength_m / C_M_PER_S
    if frames_s is None:
        probe = TransientCamera(np.zeros(1))
        near_m, _ = path_limits_m(capture, grid, probe)  # of the aperture's own paths alone
        shortest_m, longest_m = path_limits_m(capture, grid)
        _, far_m = path_limits_m(capture, grid, probe)
        end_s = float(capture.first_bin_s.min()) + capture.bins * capture.bin_width_s
        first_s = (shortest_m - near_m) / C_M_PER_S - width_s / 2
        last_s = min(2 * (longest_m - far_m) / C_M_PER_S, end_s - near_m / C_M_PER_S)
        frames_s = (first_s, max(first_s, last_s), width_s / FRAMES_PER_PULSE)
    first_s, last_s, step_s = frames_s
    if not (last_s >= first_s and step_s > 0 and (last_s - first_s) / MOST_FRAMES < step_s):
        raise ParameterError(
            "video",
            f"frames from {first_s} s to {last_s} s, {step_s} s apart",
            f"moments must ascend, {MOST_FRAMES:,} at most",
            "Write them as first:last:step, e.g. 2ns:20ns:0.2ns.",
        )
    return first_s + step_s * np.arange(int((last_s - first_s) / step_s + 1e-6) + 1, dtype=np.float64)
