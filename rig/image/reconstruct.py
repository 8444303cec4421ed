"""From a scan file to a volume file and pictures: choose what was not asked for, focus, find depths."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon import defaults
from recon.camera import Camera, ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import Capture
from recon.depth import compensate_falloff, depth_map
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.picture import Image, Over
from recon.registry import CAMERAS, SOLVERS, SolverInfo, solvers_with
from recon.solvers import fresnel
from recon.solvers.classic.solve import baseline_image
from recon.video import Sink, frame_times_s, video
from recon.wave import VirtualPulse
from recon.window import Fades
from rig.errors import UsageError
from rig.files.scan import ScanFile
from rig.files.volume import Volume, volume_by_planes, write_volume
from rig.image.recalibrate import Seen, as_recorded, from_store, recalibrated, with_even_bins
from rig.image.result import Result
from rig.model.calibrations.store import CalibrationStore
from rig.show.sheet import frames_figure, refocus_figure
from rig.show.video import check_video, save_video
from rig.show.volume import save, volume_figure

#: A pixel has a depth where its intensity, compensated for the fall-off with depth, is at least this part of
#: the greatest.
DEPTH_THRESHOLD = 0.05
#: Power of depth, or of time since the flash, with which pictures undo the fall-off of the intensity.
FALLOFF = 4.0
#: Part of that power which the virtual wave does not need, since its 1/r took only z^-2; see `depth_map`.
LIFTED = 2.0


@dataclass(frozen=True)
class Request:
    """What was asked for; None leaves the choice to the program."""

    camera: str = "confocal"
    solver: str = "rsd"
    wavelength_m: float | None = None
    cycles: float = 6.0
    depth_m: tuple[float, float, float] | None = None
    width_m: float | None = None
    height_m: float | None = None
    voxel_m: float | None = None
    fade_from_s: float | None = None
    frames_s: tuple[float, float, float] | None = None
    over: Over = "surface"
    all_depths: bool = False
    snr: float | None = None
    memory_bytes: int | None = None
    device: str = "cpu"
    calibrations: Path | None = None
    even_bins: bool = False


def reconstruct(
    scan_path: Path,
    request: Request,
    volume_path: Path,
    picture_path: Path,
    progress: Callable[[float], None] | None = None,
    video_path: Path | None = None,
) -> Result:
    """Image a scan with a virtual camera; write the volume file, the picture and, if asked, the video.

    Raises
    ------
    rig.errors.UsageError
        If a video cannot be written as asked.
    rig.errors.DataFileError
        If the scan cannot be read.
    recon.errors.ReconError
        If it cannot be imaged as asked.
    """
    began_s = time.monotonic()
    _check(request, video_path)
    with ScanFile(scan_path) as scan:
        choices = _choose(scan, request)
        volume = _volume(scan, choices)
        if request.camera == "transient":
            found = _film(choices, volume, volume_path, progress)
        else:
            found = _still(choices, progress)
        volume = _filled(volume, found)
        if not (request.camera == "transient" and request.all_depths):
            write_volume(volume_path, volume)
    save(_picture(volume), picture_path)
    if video_path:
        save_video(_seen(volume), video_path, compensation="t⁴")
    warnings = (*choices.warnings, *found.notes)
    took_s = time.monotonic() - began_s
    return Result(volume, choices.reason, warnings, choices.capture.positions, took_s)


@dataclass(frozen=True)
class _Choices:
    """What is imaged, how, and why so.

    Attributes
    ----------
    request
        What was asked for.
    calibrated
        Which later calibrations the scan is seen with.
    reason
        Why this wavelength; empty where there is none.
    warnings
        What may spoil the image.
    """

    request: Request
    capture: Capture
    pulse: VirtualPulse
    grid: VoxelGrid
    fades: Fades
    camera: Camera
    calibrated: tuple[str, ...]
    reason: str
    warnings: tuple[str, ...]

    @property
    def solver(self) -> SolverInfo:
        """The solver's entry."""
        return SOLVERS[self.request.solver]


def _choose(scan: ScanFile, request: Request) -> _Choices:
    seen = _seen_with(scan, request)
    capture = seen.capture
    wavelength = _wavelength(request, capture, seen.instrument_response_s)
    pulse = VirtualPulse(wavelength.value, request.cycles)
    grid = defaults.voxels(
        capture,
        pulse,
        width_m=request.width_m,
        height_m=request.height_m,
        voxel_m=request.voxel_m,
        depth_m=request.depth_m,
    )
    camera = _camera(request, capture, pulse, grid)
    waves = SOLVERS[request.solver].wave
    warnings: list[str] = []
    if waves:
        warnings = defaults.warnings(capture, pulse, grid, seen.instrument_response_s, camera.light(pulse))
    if request.solver == "fresnel":
        warnings += fresnel.warnings(capture, pulse.wavelength_m, grid)
    fade_from_s = seen.fade_from_s if request.fade_from_s is None else request.fade_from_s
    return _Choices(
        request=request,
        capture=capture,
        pulse=pulse,
        grid=grid,
        fades=Fades(start_s=fade_from_s),
        camera=camera,
        calibrated=seen.notes,
        reason=wavelength.reason if waves else "",
        warnings=tuple(warnings),
    )


def _still(choices: _Choices, progress: Callable[[float], None] | None) -> Image:
    """Focus one frame."""
    request, fades = choices.request, choices.fades
    if not choices.solver.wave:
        return baseline_image(
            choices.capture,
            choices.grid,
            solver=request.solver,
            fades=fades,
            snr=request.snr,
            progress=progress,
        )
    return image(
        choices.capture,
        choices.pulse,
        choices.grid,
        camera=choices.camera,
        solver=request.solver,
        fades=fades,
        progress=progress,
        memory_bytes=request.memory_bytes,
        device=request.device,
    )


def _film(
    choices: _Choices, volume: Volume, volume_path: Path, progress: Callable[[float], None] | None
) -> Image:
    """Film a flash; where all depths are asked for, their volume file is written meanwhile."""
    request, camera = choices.request, choices.camera
    assert isinstance(camera, TransientCamera)
    surface_m = None
    if request.over == "surface":
        confocal = dataclasses.replace(choices, camera=ConfocalCamera())
        surface_m = _depths(_still(confocal, None))
    begun = dataclasses.replace(
        _with(volume, over_depth=request.over),
        intensity=np.zeros((len(camera.times_s), *choices.grid.shape[1:]), np.float32),
        t_s=camera.times_s,
        depth_m=surface_m,
    )
    with _sink(volume_path, begun, request.all_depths) as sink:
        film = video(
            choices.capture,
            choices.pulse,
            choices.grid,
            camera,
            solver=request.solver,
            over=request.over,
            surface_m=surface_m,
            sink=sink,
            fades=choices.fades,
            progress=progress,
            memory_bytes=request.memory_bytes,
        )
    return dataclasses.replace(film, surface_m=surface_m)


def _volume(scan: ScanFile, choices: _Choices) -> Volume:
    """Return the volume that is to be filled, with all that is known of it before."""
    grid, wave = choices.grid, {}
    if choices.solver.wave:
        pulse = choices.pulse
        wave = {"camera": choices.camera.name, "wavelength_m": pulse.wavelength_m, "cycles": pulse.cycles}
    return Volume(
        intensity=np.zeros((0, *grid.shape[1:]), np.float32),
        x_m=grid.x_m,
        y_m=grid.y_m,
        z_m=grid.z_m,
        parameters={
            "solver": choices.solver.name,
            **wave,
            "fade_from_s": choices.fades.start_s,
            **({"calibrated": list(choices.calibrated)} if choices.calibrated else {}),
        },
        scan=scan.path.name,
        scan_digest=scan.digest,
    )


def _filled(volume: Volume, found: Image) -> Volume:
    """Return the volume with its image, and the depths where these mean something."""
    volume = dataclasses.replace(volume, intensity=found.intensity)
    if found.times_s is not None:
        volume = _with(volume, over_depth=found.over)
        return dataclasses.replace(volume, t_s=found.times_s, depth_m=found.surface_m)
    if not SOLVERS[found.solver].wave:
        volume = _with(volume, falloff_power=found.falloff_power)
        volume = volume if found.snr is None else _with(volume, snr=found.snr)
    elif not isinstance(found.camera, ConfocalCamera):
        return volume  # depth is told by the pulse alone
    volume = _with(volume, depth_threshold=DEPTH_THRESHOLD)
    return dataclasses.replace(volume, depth_m=_depths(found))


def _seen_with(scan: ScanFile, request: Request) -> Seen:
    """Return the scan as the calibrations asked for show it; by default as it was recorded."""
    if request.calibrations is None and not request.even_bins:
        return as_recorded(scan)
    if request.calibrations is None:
        calibrations = scan.calibrations
        seen = as_recorded(scan)
    else:
        calibrations = from_store(scan, CalibrationStore(request.calibrations))
        seen = recalibrated(scan, calibrations)
    return with_even_bins(seen, scan, calibrations) if request.even_bins else seen


def _check(request: Request, video_path: Path | None) -> None:
    """Refuse options that do not go together."""
    solver, camera = SOLVERS[request.solver], CAMERAS[request.camera]
    if video_path:
        check_video(video_path)
        if request.camera != "transient":
            raise UsageError(f"the {request.camera} camera makes no video; add --camera transient")
    if request.snr is not None and not solver.takes("snr"):
        others = ", ".join(solvers_with("snr"))
        raise UsageError(f"solver {solver.name} has no Wiener filter; --snr is for --solver {others}")
    if not solver.wave and camera.name not in solver.cameras:
        raise UsageError(
            f"solver {solver.name} forms no virtual wave, so it has no {camera.name} camera; "
            "use rsd, or leave --camera out"
        )
    for option, given in (
        ("memory", request.memory_bytes is not None),
        ("device", request.device != "cpu"),
    ):
        if given and not solver.wave and not solver.takes(option):
            raise UsageError(f"solver {solver.name} has no --{option}; use rsd, or leave --{option} out")
    if request.device != "cpu" and not camera.device:
        raise UsageError(
            f"the {camera.name} camera has no --device: a graphics processor adds the frequencies up at one "
            "moment, and a video reads them at every frame's; leave --device out"
        )


def _wavelength(request: Request, capture: Capture, response_s: float | None) -> defaults.Choice:
    if request.wavelength_m is not None:
        return defaults.Choice(request.wavelength_m, "as asked")
    return defaults.wavelength(capture, response_s)


def _camera(request: Request, capture: Capture, pulse: VirtualPulse, grid: VoxelGrid) -> Camera:
    if request.camera == "transient":
        return TransientCamera(frame_times_s(capture, pulse, grid, request.frames_s))
    return PhotoCamera() if request.camera == "photo" else ConfocalCamera()


@contextmanager
def _sink(path: Path, volume: Volume, all_depths: bool) -> Iterator[Sink | None]:
    """Open the volume file for planes, if all depths are to be kept."""
    if not all_depths:
        yield None
        return
    with volume_by_planes(path, volume) as dataset:

        def write(plane: int, frames: NDArray[np.float32]) -> None:
            dataset[:, plane] = frames

        yield write


def _with(volume: Volume, **parameters: Any) -> Volume:
    return dataclasses.replace(volume, parameters={**volume.parameters, **parameters})


def _depths(found: Image) -> NDArray[np.float32]:
    z_m, wave = found.grid.z_m, SOLVERS[found.solver].wave
    intensity = compensate_falloff(found.intensity, z_m, found.falloff_power)
    return depth_map(intensity, z_m, DEPTH_THRESHOLD, lifted=LIFTED if wave else 0.0)


def _seen(volume: Volume) -> Volume:
    """Compensate the fall-off, so that far objects are seen beside near ones: with depth, or with time."""
    if volume.t_s is None:
        return dataclasses.replace(
            volume, intensity=compensate_falloff(volume.intensity, volume.z_m, _falloff(volume))
        )
    rise = (np.maximum(volume.t_s, 0) / volume.t_s[-1]) ** FALLOFF
    return dataclasses.replace(volume, intensity=volume.intensity * rise.astype(np.float32)[:, None, None])


def _falloff(volume: Volume) -> float:
    return float(volume.parameters.get("falloff_power", FALLOFF))


def _picture(volume: Volume) -> Figure:
    if volume.t_s is not None:
        return frames_figure(_seen(volume), compensation="t⁴")
    if volume.parameters.get("camera") == "photo":
        return refocus_figure(volume)
    return volume_figure(_seen(volume), compensation="z⁴" if _falloff(volume) else "")
