"""What is asked of imaging, and what of it does not go together."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from recon.filming import Over
from recon.registry import CAMERAS, SOLVERS, entry_of, name_of, taking
from recon.solvers.problem import Solver
from rig.errors import UsageError
from rig.show.endings import check_video


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

    @property
    def filmed(self) -> bool:
        """Whether its result is a film."""
        return CAMERAS[self.camera].film or self.each_frame


def check(request: Request, video_path: Path | None = None) -> None:
    """Refuse options that do not go together.

    Raises
    ------
    UsageError
        If there are any.
    """
    if request.camera not in CAMERAS:
        raise UsageError(f"there is no camera {request.camera!r}; choose among {', '.join(CAMERAS)}")
    _check_solver(request)
    _check_camera(request)
    _check_each_frame(request)
    _check_relight(request)
    if video_path:
        check_video(video_path)
        if not request.filmed:
            raise UsageError(
                f"the {request.camera} camera makes no video; add --camera transient, or --each-frame"
            )


def _check_solver(request: Request) -> None:
    """Refuse what a solver does not do."""
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


def _check_camera(request: Request) -> None:
    """Refuse what a camera does not do."""
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


def _check_relight(request: Request) -> None:
    """Refuse what does not go with relighting a point."""
    if request.relight_m is None:
        return
    if request.solver != "rsd" or request.camera == "photo":
        raise UsageError(
            "--relight needs the solver rsd and the confocal or the transient camera, not "
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
            f"solver {name_of(request.solver)} computes only whole images, on one computer; use {able}, "
            "or leave "
            "--cluster out"
        )
    if request.relight_m is not None:
        raise UsageError("a point is relit on one computer; leave --cluster out")
    if request.filmed:
        raise UsageError(
            "a film is computed on one computer; leave --cluster out, or image without a time axis"
        )


def check_page(request: Request, page_path: Path | None) -> None:
    """Refuse a page of what is no volume, or a name that is not that of a page.

    Raises
    ------
    UsageError
        If so.
    """
    if page_path is None:
        return
    from rig.exporters import page

    if request.filmed:
        raise UsageError("a film has no page; leave out --page, or image without a time axis")
    if page_path.suffix.lower() not in page.ENDINGS:
        raise UsageError(f"cannot write the page {page_path}: its ending must be {' or '.join(page.ENDINGS)}")


def _refuse(why: str, options: Mapping[str, bool], remedy: str) -> None:
    """Refuse options that were given and have no effect."""
    if given := [option for option, is_given in options.items() if is_given]:
        raise UsageError(f"{why} {' and '.join(given)} would have no effect; {remedy}")
