"""From a scan file to a volume file and pictures: choose what was not asked for, focus, find depths."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, cast

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon import defaults
from recon.camera import Camera, ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import Capture
from recon.depth import compensate_falloff, depth_map
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.solvers import fresnel
from recon.solvers.classic.solve import BASELINES, Baseline, baseline_image
from recon.video import Over, Sink, frame_times_s, video
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


class _Asked(TypedDict):
    """What image and video are both told."""

    capture: Capture
    pulse: VirtualPulse
    grid: VoxelGrid
    solver: str
    fades: Fades
    progress: Callable[[float], None] | None
    memory_bytes: int | None


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
    _check(request)
    if video_path:
        check_video(video_path)
        if request.camera != "transient":
            raise UsageError(f"the {request.camera} camera makes no video; add --camera transient")
    with ScanFile(scan_path) as scan:
        seen = _seen_with(scan, request)
        capture = seen.capture
        choice = _wavelength(request, capture, seen.instrument_response_s)
        pulse = VirtualPulse(choice.value, request.cycles)
        grid = defaults.voxels(
            capture,
            pulse,
            width_m=request.width_m,
            height_m=request.height_m,
            voxel_m=request.voxel_m,
            depth_m=request.depth_m,
        )
        fade_from_s = seen.fade_from_s if request.fade_from_s is None else request.fade_from_s
        if request.solver in BASELINES:
            volume, notes = _baseline(request, capture, grid, Fades(start_s=fade_from_s), progress)
            volume = dataclasses.replace(volume, scan=scan_path.name, scan_digest=scan.digest)
            volume = _with(volume, **_calibrated(seen))
            write_volume(volume_path, volume)
            save(_picture(volume), picture_path)
            return Result(volume, "", notes, capture.positions, time.monotonic() - began_s)
        camera = _camera(request, capture, pulse, grid)
        warnings = defaults.warnings(capture, pulse, grid, seen.instrument_response_s, camera.light(pulse))
        if request.solver == "fresnel":
            warnings += fresnel.warnings(capture, pulse.wavelength_m, grid)
        volume = Volume(
            intensity=np.empty((0,) * 3, np.float32),
            x_m=grid.x_m,
            y_m=grid.y_m,
            z_m=grid.z_m,
            parameters={
                "camera": camera.name,
                "solver": request.solver,
                "wavelength_m": pulse.wavelength_m,
                "cycles": pulse.cycles,
                "fade_from_s": fade_from_s,
                **_calibrated(seen),
            },
            scan=scan_path.name,
            scan_digest=scan.digest,
        )
        asked = _Asked(
            capture=capture,
            pulse=pulse,
            grid=grid,
            solver=request.solver,
            fades=Fades(start_s=fade_from_s),
            progress=progress,
            memory_bytes=request.memory_bytes,
        )
        if isinstance(camera, TransientCamera):
            volume = _film(asked, camera, request, volume, volume_path)
        else:
            volume = _still(asked, camera, request, volume)
            write_volume(volume_path, volume)
    save(_picture(volume), picture_path)
    if video_path:
        save_video(_seen(volume), video_path, compensation="t⁴")
    took_s = time.monotonic() - began_s
    return Result(volume, choice.reason, tuple(warnings), capture.positions, took_s)


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


def _calibrated(seen: Seen) -> dict[str, list[str]]:
    return {"calibrated": list(seen.notes)} if seen.notes else {}


def _check(request: Request) -> None:
    """Refuse options that do not go together."""
    if request.snr is not None and request.solver != "lct":
        raise UsageError(f"solver {request.solver} has no Wiener filter; --snr is for --solver lct")
    if request.solver in BASELINES and request.camera != "confocal":
        raise UsageError(
            f"solver {request.solver} forms no virtual wave, so it has no {request.camera} camera; "
            "use rsd, or leave --camera out"
        )
    for option, given in (
        ("--memory", request.memory_bytes is not None),
        ("--device", request.device != "cpu"),
    ):
        if given and request.solver in BASELINES:
            raise UsageError(f"solver {request.solver} has no {option}; use rsd, or leave {option} out")

    if request.device != "cpu" and request.camera == "transient":
        raise UsageError(
            "the transient camera has no --device: a graphics processor adds the frequencies up at one "
            "moment, and a video reads them at every frame's; leave --device out"
        )


def _baseline(
    request: Request,
    capture: Capture,
    grid: VoxelGrid,
    fades: Fades,
    progress: Callable[[float], None] | None,
) -> tuple[Volume, tuple[str, ...]]:
    """Image with one of the methods that come before virtual waves; return what to say about it, too."""
    found = baseline_image(
        capture, grid, solver=cast(Baseline, request.solver), fades=fades, snr=request.snr, progress=progress
    )
    volume = Volume(
        intensity=found.intensity,
        x_m=grid.x_m,
        y_m=grid.y_m,
        z_m=grid.z_m,
        parameters={
            "solver": found.solver,
            "falloff_power": found.falloff_power,
            "fade_from_s": fades.start_s,
            "depth_threshold": DEPTH_THRESHOLD,
            **({} if found.snr is None else {"snr": found.snr}),
        },
    )
    depth_m = _depths(volume.intensity, volume.z_m, found.falloff_power, lifted=0.0)
    return dataclasses.replace(volume, depth_m=depth_m), tuple(found.notes)


def _wavelength(request: Request, capture: Capture, response_s: float | None) -> defaults.Choice:
    if request.wavelength_m is not None:
        return defaults.Choice(request.wavelength_m, "as asked")
    return defaults.wavelength(capture, response_s)


def _camera(request: Request, capture: Capture, pulse: VirtualPulse, grid: VoxelGrid) -> Camera:
    if request.camera == "transient":
        return TransientCamera(frame_times_s(capture, pulse, grid, request.frames_s))
    return PhotoCamera() if request.camera == "photo" else ConfocalCamera()


def _still(asked: _Asked, camera: Camera, request: Request, volume: Volume) -> Volume:
    found = image(camera=camera, device=request.device, **asked)
    volume = dataclasses.replace(volume, intensity=found.intensity)
    if not isinstance(camera, ConfocalCamera):
        return volume  # depth is told by the pulse alone
    return dataclasses.replace(
        _with(volume, depth_threshold=DEPTH_THRESHOLD), depth_m=_depths(volume.intensity, volume.z_m)
    )


def _film(
    asked: _Asked, camera: TransientCamera, request: Request, volume: Volume, volume_path: Path
) -> Volume:
    """Make the video and write its volume file."""
    frames = np.zeros((len(camera.times_s), *asked["grid"].shape[1:]), np.float32)
    volume = _with(volume, over_depth=request.over)
    volume = dataclasses.replace(volume, intensity=frames, t_s=camera.times_s)
    if request.over == "surface":
        found = image(**(asked | {"progress": None}))
        volume = dataclasses.replace(volume, depth_m=_depths(found.intensity, volume.z_m))
    with _sink(volume_path, volume, request.all_depths) as sink:
        film = video(camera=camera, over=request.over, surface_m=volume.depth_m, sink=sink, **asked)
    volume = dataclasses.replace(volume, intensity=film.intensity)
    if not request.all_depths:
        write_volume(volume_path, volume)
    return volume


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


def _depths(
    intensity: NDArray[np.float32], z_m: NDArray[np.float64], falloff: float = FALLOFF, lifted: float = LIFTED
) -> NDArray[np.float32]:
    return depth_map(compensate_falloff(intensity, z_m, falloff), z_m, DEPTH_THRESHOLD, lifted=lifted)


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
