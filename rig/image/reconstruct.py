"""From a scan file to a volume file and pictures: choose what was not asked for, focus, find depths."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon import defaults
from recon.by_lasers import Elsewhere as ByLasers
from recon.by_lasers import image as by_lasers_image
from recon.by_lasers import image_and_noise
from recon.camera import Camera, ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import Capture
from recon.depth import compensate_falloff
from recon.filming import FRAMES_PER_PULSE, Over, Sink, video
from recon.filming import frame_times_s as moments_s
from recon.frames import FrameImager
from recon.grid import VoxelGrid
from recon.imaging import Planes, image, plan
from recon.noise import photon_noise, quiet_level, tallied
from recon.registry import CAMERAS, SOLVERS, entry_of, load, name_of, taking
from recon.result import Image
from recon.sampling import CONFOCAL
from recon.solvers.classic.solve import baseline_image
from recon.solvers.problem import Solver, ignore
from recon.spectrum import Spectra, spectra
from recon.surface import Surface, find
from recon.virtual_aperture import remapped
from recon.wave import CYCLES, VirtualPulse
from recon.window import Window
from rig.errors import UsageError, command_line, printable
from rig.exporters import page
from rig.files.scan import ScanFile
from rig.files.volume import Volume, volume_by_planes, write_volume
from rig.image.forecast import Forecast, forecast, require_possible
from rig.image.frames import check_frames, film_frames, frame_times_s
from rig.image.origin import origin
from rig.image.recalibrate import (
    Seen,
    as_recorded,
    by_lasers,
    from_store,
    recalibrated,
    relit,
    with_even_bins,
)
from rig.image.result import Result
from rig.model.calibrations.store import CalibrationStore
from rig.model.quantities import show, show_length
from rig.show.sheet import frames_figure, lit, refocus_figure
from rig.show.video import check_video, save_video
from rig.show.volume import check_picture, save, volume_figure

#: Power of depth, or of time since the flash, with which pictures undo the fall-off of the intensity.
FALLOFF = 4.0
#: A surface is imaged well where it is, in the median, this many times brighter than noise. If the wavelength
#: is the program's to choose, it is made longer by `LONGER` until that is so, `ATTEMPTS` times at most.
WELL, LONGER, ATTEMPTS = 20.0, 1.25, 6


@dataclass(frozen=True)
class Request:
    """What was asked for; None leaves the choice to the program."""

    camera: str = "confocal"
    solver: str | Solver = "rsd"
    wavelength_m: float | None = None
    cycles: float | None = None
    depth_m: tuple[float, float, float] | None = None
    width_m: float | None = None
    height_m: float | None = None
    voxel_m: float | None = None
    fade_from_s: float | None = None
    frames_s: tuple[float, float, float] | None = None
    over: Over | None = None
    all_depths: bool = False
    snr: float | None = None
    memory_bytes: int | None = None
    device: str = "cpu"
    calibrations: Path | None = None
    even_bins: bool = False
    each_frame: bool = False
    fresh_to_m: float | None = None
    relight_m: tuple[float, float, float] | None = None
    however_long: bool = False


class Elsewhere(Protocol):
    """Other processes that compute fields."""

    @property
    def threads(self) -> int:
        """How many parts are computed at the same time."""
        ...

    @property
    def memory_bytes(self) -> int:
        """What a part may take."""
        ...

    def imaging(self, scan: ScanFile | None) -> Planes:
        """Return what computes the planes of a scan; None, where its counts are changed here."""
        ...

    def adding(self, scan: ScanFile) -> ByLasers:
        """Return what images runs of lasers of an exhaustive capture."""
        ...


@dataclass(frozen=True)
class Work:
    """What is imaged, with all choices made; `by` and `by_lasers` compute in place of this process."""

    request: Request
    seen: Seen
    pulse: VirtualPulse
    grid: VoxelGrid
    window: Window
    scan: str
    scan_digest: str
    estimated: tuple[str, ...] = ()
    origin: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    by: Planes | None = None
    by_lasers: ByLasers | None = None

    @property
    def capture(self) -> Capture:
        """What is imaged."""
        return self.seen.capture

    def volume(self, found: Image, surface: Surface | None = None, **more: Any) -> Volume:
        """Return the volume file's value: an image, how it was made, and where it comes from."""
        grid = self.grid
        parameters: dict[str, Any] = {"solver": found.solver}
        calibrated = {"calibrated": list(self.seen.notes)} if self.seen.notes else {}
        if found.pulse:
            wave = {"wavelength_m": found.pulse.wavelength_m, "cycles": found.pulse.cycles}
            parameters = {"camera": found.camera.name, **parameters, **wave}
        else:
            parameters["falloff_power"] = found.falloff_power
        if surface:
            more["signal"] = not surface.empty
        if self.request.relight_m is not None:
            more["relight_m"] = list(self.request.relight_m)
        estimated = {"estimated": list(self.estimated)} if self.estimated else {}
        parameters |= {"fade_from_s": found.window.start_s, **more, **calibrated, **estimated}
        parameters["origin"] = dict(self.origin)
        axes = grid.x_m, grid.y_m, grid.z_m
        times_s = found.times_s
        return Volume(
            found.intensity,
            *axes,
            depth_m=surface.depth_m if surface else None,
            confidence=surface.confidence if surface else None,
            t_s=times_s,
            parameters=parameters,
            scan=self.scan,
            scan_digest=self.scan_digest,
            command=command_line(),
        )


def reconstruct(
    scan_path: Path,
    request: Request,
    volume_path: Path,
    picture_path: Path,
    progress: Callable[[float], None] | None = None,
    video_path: Path | None = None,
    page_path: Path | None = None,
    elsewhere: Elsewhere | None = None,
) -> Result:
    """Image a scan with a virtual camera; write the volume file, the picture and, if asked, video and page.

    Fields are computed by this process, or ``elsewhere``.

    Raises
    ------
    rig.errors.UsageError
        If a video or a page cannot be written as asked.
    rig.errors.DataFileError
        If the scan cannot be read.
    recon.errors.ReconError
        If it cannot be imaged as asked.
    """
    began_s = time.monotonic()
    _check(request, video_path)
    check_picture(picture_path)
    _check_page(request, page_path)
    with ScanFile(scan_path) as scan:
        result = imaged(scan, request, progress, volume_path, elsewhere)
    if not (request.each_frame or request.all_depths):  # which were written meanwhile
        write_volume(volume_path, result.volume)
    save(picture(result.volume), picture_path)
    if page_path:
        page.save(result.volume, page_path)
    if video_path:
        _save_video(result.volume, request, video_path)
    return dataclasses.replace(result, took_s=time.monotonic() - began_s)


def imaged(
    scan: ScanFile,
    request: Request,
    progress: Callable[[float], None] | None = None,
    volume_path: Path | None = None,
    elsewhere: Elsewhere | None = None,
) -> Result:
    """Image an open scan with a virtual camera, by this process or ``elsewhere``.

    Nothing is written, but for ``all_depths`` and ``each_frame``: what these make need not fit in memory, and
    goes to the volume file at once.

    Raises
    ------
    As `reconstruct`.
    """
    began_s = time.monotonic()
    _check(request, None)
    if volume_path is None and (request.all_depths or request.each_frame):
        raise UsageError(
            "films of all depths, and of each frame, are written to a file while they are made: use "
            "rig recon with --all-depths or --each-frame, and open its volume"
        )
    if request.each_frame:
        check_frames(scan)
    work, reason = chosen(scan, request, by_runs=True)
    camera = _camera(work)
    _require_possible(work, camera, elsewhere)
    work = _sent(work, scan, elsewhere)
    if request.each_frame and volume_path:
        volume, warnings = _frame_by_frame(scan, work, volume_path, progress), warnings_of(work, camera)
    elif not entry_of(request.solver).virtual_wave:
        volume, warnings, reason = *_classic(work, progress), ""
    elif isinstance(camera, TransientCamera):
        volume, warnings = _film(work, camera, volume_path, progress), warnings_of(work, camera)
    elif isinstance(camera, PhotoCamera):
        # Depth is told by the pulse alone.
        volume, warnings = work.volume(_focused(work, camera, progress)), warnings_of(work, camera)
    else:
        work, reason, volume = still(work, reason, progress)
        warnings = warnings_of(work, camera)
    warnings = (*scan.doubts, *_signal(volume), *warnings)
    return Result(volume, reason, warnings, work.seen.positions, time.monotonic() - began_s)


def forecasted(scan_path: Path, request: Request, workers: int | None = None) -> Forecast:
    """Say what imaging a scan will take; nothing of it is computed.

    Raises
    ------
    As of `reconstruct`.
    """
    _check(request, None)
    if workers:
        check_elsewhere(request)
    with ScanFile(scan_path) as scan:
        work, _ = chosen(scan, request)
        return _forecast(work, _camera(work), workers, request.memory_bytes, measured=True)


def _forecast(
    work: Work, camera: Camera, workers: int | None, worker_bytes: int | None, *, measured: bool
) -> Forecast:
    request, searched = work.request, isinstance(camera, ConfocalCamera) and work.request.wavelength_m is None
    problem = dataclasses.replace(
        plan(work.capture, work.pulse, work.grid, camera, work.window),
        device=request.device,
        slopes=isinstance(camera, ConfocalCamera),
    )
    return forecast(
        problem,
        request.solver,
        images=1 + ATTEMPTS if searched else 1,
        workers=workers,
        worker_bytes=worker_bytes,
        measured=measured,
    )


def _require_possible(work: Work, camera: Camera, elsewhere: Elsewhere | None) -> None:
    request = work.request
    by_runs = work.seen.exhaustive or work.seen.relit  # whose capture is an outline
    if request.each_frame or by_runs or not entry_of(request.solver).virtual_wave:
        return
    workers, each = (elsewhere.threads, elsewhere.memory_bytes) if elsewhere else (None, None)
    found = _forecast(work, camera, workers, each, measured=False)
    require_possible(found, bounded=request.memory_bytes is not None, however_long=request.however_long)


def _sent(work: Work, scan: ScanFile, elsewhere: Elsewhere | None) -> Work:
    """Let other processes compute, if there are any."""
    if elsewhere is None:
        return work
    check_elsewhere(work.request)
    if work.seen.exhaustive:
        return dataclasses.replace(work, by_lasers=elsewhere.adding(scan))
    return dataclasses.replace(work, by=elsewhere.imaging(None if work.request.even_bins else scan))


def _save_video(volume: Volume, request: Request, path: Path) -> None:
    """Write a film; one of light that was not told its moments begins and ends where the light does."""
    shown = _seen(volume)
    if not request.each_frame and request.frames_s is None:
        shown = lit(shown, margin=FRAMES_PER_PULSE)
    save_video(shown, path, compensation=_compensation(volume))


def settled(scan: ScanFile, request: Request) -> tuple[Work, str]:
    """Choose what was not asked for, a longer wavelength where photons are too few; say why this one."""
    work, reason = chosen(scan, request)
    return still(work, reason, None)[:2]


def chosen(scan: ScanFile, request: Request, *, by_runs: bool = False) -> tuple[Work, str]:
    """Choose what was not asked for; say why this wavelength.

    Parameters
    ----------
    scan, request
        What, and how.
    by_runs
        Whether an exhaustive capture may be seen as such, its capture being an outline without histograms.
    """
    seen = _seen_with(scan, request, by_runs and _both_sides_focus(request))
    name = printable(scan.path.name)
    # Light takes the same paths both ways: the side with more spots focuses.
    capture = remapped(seen.capture) if request.each_frame else seen.capture.by_its_finer_aperture()
    seen = dataclasses.replace(seen, capture=capture)
    _check_fade(request, capture)
    choice = _wavelength(request, seen)
    work = planned(
        dataclasses.replace(request, wavelength_m=choice.value), seen, name, scan.digest, origin(scan)
    )
    return dataclasses.replace(work, request=request, estimated=tuple(scan.estimated)), choice.reason


def planned(request: Request, seen: Seen, scan: str, digest: str, came: Mapping[str, Any]) -> Work:
    """Choose pulse, voxels and window for a wavelength that was chosen.

    Parameters
    ----------
    request
        What was asked; it names a wavelength.
    seen
        What is imaged, the side that focuses as its laser spots.
    scan, digest, came
        Name and digest of the scan, and where it comes from (`rig.image.origin`).
    """
    assert request.wavelength_m is not None
    window = Window(start_s=seen.fade_from_s if request.fade_from_s is None else request.fade_from_s)
    pulse = VirtualPulse(request.wavelength_m, CYCLES if request.cycles is None else request.cycles)
    grid = _voxels(request, seen.capture, pulse)
    return Work(request, seen, pulse, grid, window, scan, digest, origin=came)


def _check_fade(request: Request, capture: Capture) -> None:
    """Refuse a fade after which the record has nothing."""
    end_s = float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s
    if request.fade_from_s is not None and request.fade_from_s >= end_s:
        raise UsageError(
            f"--fade-from {show(request.fade_from_s, 's')} ignores all light: the record ends at "
            f"{show(end_s, 's')}; give an earlier time"
        )


def _voxels(request: Request, capture: Capture, pulse: VirtualPulse) -> VoxelGrid:
    return defaults.voxels(
        capture,
        pulse,
        width_m=request.width_m,
        height_m=request.height_m,
        voxel_m=request.voxel_m,
        depth_m=request.depth_m,
    )


def _both_sides_focus(request: Request) -> bool:
    """Return whether an exhaustive capture is imaged as such: by runs of lasers."""
    on_cpu = request.device == "cpu"  # which others take one spot, or confocal data
    return request.solver == "rsd" and on_cpu and not (request.each_frame or CAMERAS[request.camera].film)


def _seen_with(scan: ScanFile, request: Request, by_runs: bool) -> Seen:
    """Return the scan as the calibrations asked for show it; by default as it was recorded."""
    if request.relight_m is not None:
        return relit(scan, request.relight_m)
    if request.calibrations is None and not request.even_bins:
        return (by_lasers(scan) if by_runs else None) or as_recorded(scan)
    if request.calibrations is None:
        calibrations = scan.calibrations
        seen = as_recorded(scan)
    else:
        calibrations = from_store(scan, CalibrationStore(request.calibrations))
        seen = recalibrated(scan, calibrations)
    return with_even_bins(seen, scan, calibrations) if request.even_bins else seen


def _check(request: Request, video_path: Path | None) -> None:
    """Refuse options that do not go together."""
    if request.camera not in CAMERAS:
        raise UsageError(f"there is no camera {request.camera!r}; choose among {', '.join(CAMERAS)}")
    solver, entry = name_of(request.solver), entry_of(request.solver)
    if request.snr is not None and "snr" not in entry.options:
        raise UsageError(
            f"solver {solver} has no Wiener filter; --snr is for --solver {' or '.join(taking('snr'))}"
        )
    if not entry.virtual_wave and request.camera in entry.refuses:
        raise UsageError(
            f"solver {solver} forms no virtual wave, so it has no {request.camera} camera; "
            "use rsd, or leave --camera out"
        )
    without_wave = {
        "--memory": request.memory_bytes is not None,
        "--device": request.device != "cpu",
        "--cycles": request.cycles is not None,
        "--wavelength": request.wavelength_m is not None and request.depth_m is not None,
    }
    if not entry.virtual_wave:
        _refuse(f"solver {solver} forms no virtual wave, so that", without_wave, "use rsd, or leave it out")
    without_film = {
        "--frames": request.frames_s is not None,
        "--over": request.over is not None,
        "--all-depths": request.all_depths,
    }
    if not CAMERAS[request.camera].film:
        _refuse(
            f"the {request.camera} camera makes no video, so that", without_film, "add --camera transient"
        )
    if request.camera == "photo":
        _refuse(
            "the photo camera has one frequency, so that",
            {"--cycles": request.cycles is not None},
            "leave it out",
        )
    _check_each_frame(request)
    _check_relight(request)
    if video_path:
        check_video(video_path)
        if not (CAMERAS[request.camera].film or request.each_frame):
            raise UsageError(
                f"the {request.camera} camera makes no video; add --camera transient, or --each-frame"
            )


def _check_relight(request: Request) -> None:
    """Refuse what does not go with relighting a point."""
    if request.relight_m is None:
        return
    if request.solver != "rsd" or request.camera == "photo":
        raise UsageError(
            "--relight goes with the solver rsd and the confocal or the transient camera, not with "
            f"{request.camera} and {request.solver}; leave these out"
        )
    others = {
        "--each-frame": request.each_frame,
        "--calibrations": request.calibrations is not None,
        "--even-bins": request.even_bins,
        "--device": request.device != "cpu",
    }
    _refuse("a point is relit as the scan was recorded, so that", others, "leave it out")


def check_elsewhere(request: Request) -> None:
    """Refuse what is not computed in parts.

    Raises
    ------
    UsageError
        If so.
    """
    if entry_of(request.solver).way is None:
        able = " or ".join(name for name, entry in SOLVERS.items() if entry.way)
        raise UsageError(
            f"solver {name_of(request.solver)} images as a whole, on one computer; use {able}, or leave "
            "--cluster out"
        )
    if request.relight_m is not None:
        raise UsageError("a point is relit on one computer; leave --cluster out")
    if CAMERAS[request.camera].film or request.each_frame:
        raise UsageError(
            "a film is computed on one computer; leave --cluster out, or image without a time axis"
        )


def _check_each_frame(request: Request) -> None:
    """Refuse what does not go with imaging frame by frame."""
    if not request.each_frame:
        _refuse(
            "without --each-frame, so that",
            {"--fresh-to": request.fresh_to_m is not None},
            "add it, or leave this out",
        )
        return
    if (request.camera, request.solver) != ("confocal", "rsd"):
        raise UsageError(
            f"--each-frame images with the confocal camera and the solver rsd, not with {request.camera} and "
            f"{request.solver}; leave these out"
        )
    _refuse(
        "frames are imaged one by one, so that",
        {
            "--memory": request.memory_bytes is not None,
            "--device": request.device != "cpu",
            "--even-bins": request.even_bins,
        },
        "leave it out",
    )


def _check_page(request: Request, page_path: Path | None) -> None:
    """Refuse a page of what is no volume, or a name that is not that of a page."""
    if page_path is None:
        return
    if CAMERAS[request.camera].film or request.each_frame:
        raise UsageError("a film has no page; leave out --page, or image without a time axis")
    if page_path.suffix.lower() not in page.ENDINGS:
        raise UsageError(f"cannot write the page {page_path}: its ending must be {' or '.join(page.ENDINGS)}")


def _refuse(why: str, options: Mapping[str, bool], remedy: str) -> None:
    """Refuse options that were given and have no effect."""
    if given := [option for option, is_given in options.items() if is_given]:
        raise UsageError(f"{why} {' and '.join(given)} would have no effect; {remedy}")


def warnings_of(work: Work, camera: Camera = CONFOCAL) -> tuple[str, ...]:
    """List what may spoil the image."""
    response_s = work.seen.instrument_response_s
    found = defaults.warnings(work.capture, work.pulse, work.grid, response_s, camera.light(work.pulse))
    if own := entry_of(work.request.solver).warnings:
        found += load(own)(work.capture, work.pulse.wavelength_m, work.grid)
    return tuple(found)


def _classic(work: Work, progress: Callable[[float], None] | None) -> tuple[Volume, tuple[str, ...]]:
    """Image with one of the methods that come before virtual waves; return what to say about it, too."""
    request = work.request
    found = baseline_image(
        work.capture,
        work.grid,
        solver=name_of(request.solver),
        window=work.window,
        snr=request.snr,
        progress=progress,
    )
    snr = {} if found.snr is None else {"snr": found.snr}
    doubts = (*defaults.on_one_line(work.capture), *defaults.dark_parts(work.capture, work.grid))
    return work.volume(found, find(found, quiet_level(found.intensity)), **snr), (*found.notes, *doubts)


def _wavelength(request: Request, seen: Seen) -> defaults.Choice:
    if request.wavelength_m is not None:
        return defaults.Choice(request.wavelength_m, "as asked")
    return defaults.wavelength(seen.capture, seen.instrument_response_s, rendered=seen.rendered)


def _camera(work: Work) -> Camera:
    name = work.request.camera
    if CAMERAS[name].film:
        return TransientCamera(moments_s(work.capture, work.pulse, work.grid, work.request.frames_s))
    return PhotoCamera() if name == "photo" else ConfocalCamera()


def _focused(work: Work, camera: Camera, progress: Callable[[float], None] | None) -> Image:
    request = work.request
    if work.seen.exhaustive and not work.seen.relit:
        return by_lasers_image(
            work.seen.exhaustive,
            work.pulse,
            work.grid,
            camera=camera,
            window=work.window,
            progress=progress,
            memory_bytes=request.memory_bytes,
            by=work.by_lasers,
        )
    return image(
        work.capture,
        work.pulse,
        work.grid,
        solver=request.solver,
        camera=camera,
        window=work.window,
        progress=progress,
        memory_bytes=None if work.by else _memory_bytes(work),
        device=request.device,
        taking=_spectra(work),
        by=work.by,
    )


def _spectra(work: Work) -> Spectra:
    """Return what takes the spectra; of a bound on memory, those of lasers have a quarter."""
    relit_point, bound = work.seen.relit, work.request.memory_bytes
    if relit_point is None:
        return spectra
    if bound is not None:
        relit_point = dataclasses.replace(relit_point, run_bytes=min(relit_point.run_bytes, bound // 4))
    return relit_point.spectra


def _memory_bytes(work: Work) -> int | None:
    """Return the bound on the memory of imaging itself."""
    bound = work.request.memory_bytes
    return bound if bound is None or work.seen.relit is None else bound - bound // 4


def _imaged(work: Work, progress: Callable[[float], None] | None) -> tuple[Image, Surface]:
    """Image, and find the surface; its noise is that of the photons, where they were counted."""
    if work.seen.relit or (work.seen.exhaustive and work.seen.rendered):
        found = _focused(work, ConfocalCamera(), progress)
        return found, find(found, quiet_level(found.intensity))
    if work.seen.exhaustive:
        found, counted = image_and_noise(
            work.seen.exhaustive,
            work.pulse,
            work.grid,
            window=work.window,
            progress=progress,
            memory_bytes=work.request.memory_bytes,
            by=work.by_lasers,
        )
        return found, find(found, counted or quiet_level(found.intensity))
    capture, tally = tallied(work.capture, work.pulse, work.window)
    reading = dataclasses.replace(work, seen=dataclasses.replace(work.seen, capture=capture))
    found = _focused(reading, ConfocalCamera(), progress)
    noise = photon_noise(tally, work.pulse, work.grid) if tally.whole else quiet_level(found.intensity)
    return found, find(found, noise)


def still(work: Work, reason: str, progress: Callable[[float], None] | None) -> tuple[Work, str, Volume]:
    """Image with the wavelength asked for, or else with a longer one where photons are too few."""
    best, (found, surface) = work, _imaged(work, progress)
    chosen_here = work.request.wavelength_m is None and not work.seen.exhaustive  # of which one takes minutes
    attempts = ATTEMPTS if chosen_here else 0
    for attempt in range(1, attempts + 1):
        if surface.contrast_seen() >= WELL:
            break
        pulse = VirtualPulse(work.pulse.wavelength_m * LONGER**attempt, work.pulse.cycles)
        longer = dataclasses.replace(work, pulse=pulse, grid=_voxels(work.request, work.capture, pulse))
        image_longer, surface_longer = _imaged(longer, progress)
        if surface_longer.contrast_seen() > surface.contrast_seen():
            best, found, surface = longer, image_longer, surface_longer
            reason = f"there are too few photons for {show_length(work.pulse.wavelength_m)}"
    return best, reason, best.volume(found, surface)


def _signal(volume: Volume) -> tuple[str, ...]:
    """Say if nothing was seen."""
    if volume.parameters.get("signal", True):
        return ()
    return (
        "no signal above noise: what the image shows, photons that know nothing of a hidden object give as "
        "well; measure longer, or check that the laser reaches the wall and the record holds the scene",
    )


def _frame_by_frame(
    scan: ScanFile, work: Work, volume_path: Path, progress: Callable[[float], None] | None
) -> Volume:
    """Image frame by frame into the volume file; return what pictures show of it, front views."""
    grid, times_s = work.grid, frame_times_s(scan)
    dark = np.zeros((len(times_s), *grid.shape[1:]), np.float32)
    camera = ConfocalCamera()
    begun = Image(grid, None, "rsd", work.window, camera, work.pulse, times_s=times_s, frames=dark)
    fresh_to_m = work.request.fresh_to_m
    volume = work.volume(begun, each_frame=True, fresh_to_m=fresh_to_m)
    imager = FrameImager(work.capture, work.pulse, grid, work.window, fresh_to_m=fresh_to_m)
    frames = scan.histograms_of_frames()
    fronts = film_frames(frames, imager, volume, volume_path, progress or ignore)
    return dataclasses.replace(volume, intensity=fronts)


def _film(
    work: Work, camera: TransientCamera, volume_path: Path | None, progress: Callable[[float], None] | None
) -> Volume:
    """Make the video; its planes go to the volume file at once, if all depths are to be kept."""
    request, grid, over = work.request, work.grid, work.request.over or "surface"
    surface = _imaged(_lit_by_all(work), None)[1] if over == "surface" else None
    depth_m = surface.depth_m if surface else None
    dark = np.zeros((len(camera.times_s), *grid.shape[1:]), np.float32)
    begun = Image(
        grid,
        None,
        name_of(request.solver),
        work.window,
        camera,
        work.pulse,
        times_s=camera.times_s,
        frames=dark,
    )
    kept = volume_path if request.all_depths else None
    with _sink(kept, work.volume(begun, surface, over_depth=over)) as sink:
        found = video(
            work.capture,
            work.pulse,
            grid,
            camera,
            solver=request.solver,
            over=over,
            surface_m=depth_m,
            sink=sink,
            window=work.window,
            progress=progress,
            memory_bytes=_memory_bytes(work),
            device=request.device,
            taking=_spectra(work),
        )
    return work.volume(found, surface, over_depth=over)


def _lit_by_all(work: Work) -> Work:
    """Return the same work without relighting: what shows the scene's surface."""
    if not (work.seen.relit and work.seen.exhaustive):
        return work
    seen = dataclasses.replace(work.seen, capture=work.seen.exhaustive.outline(), relit=None)
    return dataclasses.replace(work, seen=seen)


@contextmanager
def _sink(path: Path | None, volume: Volume) -> Iterator[Sink | None]:
    """Open the volume file for planes, if all depths are to be kept."""
    if path is None:
        yield None
        return
    with volume_by_planes(path, volume) as dataset:

        def write(plane: int, frames: NDArray[np.float32]) -> None:
            dataset[:, plane] = frames

        yield write


def _compensation(volume: Volume) -> str:
    """Say what the intensity of pictures is multiplied with."""
    if volume.t_s is not None and not volume.parameters.get("each_frame"):
        return "t⁴"
    return "z⁴" if _falloff(volume) else ""


def _seen(volume: Volume) -> Volume:
    """Compensate the fall-off, so that far objects are seen beside near ones: with depth, or with time."""
    if volume.parameters.get("each_frame"):
        return volume  # front views, of which it was done plane by plane
    if volume.t_s is None:
        return dataclasses.replace(
            volume, intensity=compensate_falloff(volume.intensity, volume.z_m, _falloff(volume))
        )
    rise = (np.maximum(volume.t_s, 0) / volume.t_s[-1]) ** FALLOFF
    return dataclasses.replace(volume, intensity=volume.intensity * rise.astype(np.float32)[:, None, None])


def _falloff(volume: Volume) -> float:
    return float(volume.parameters.get("falloff_power", FALLOFF))


def picture(volume: Volume) -> Figure:
    """Draw a volume as `rig recon` does; of a video of all depths, the brightest depth of each pixel."""
    if volume.t_s is not None and volume.intensity.ndim == 4:
        volume = dataclasses.replace(volume, intensity=volume.intensity.max(axis=1))
    if volume.t_s is not None:
        return frames_figure(_seen(volume), compensation=_compensation(volume))
    if volume.parameters.get("camera") == "photo":
        return refocus_figure(volume)
    return volume_figure(_seen(volume), compensation=_compensation(volume))
