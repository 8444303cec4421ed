"""What is imaged, with all choices made: which light, pulse, voxels, window and camera."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from recon import defaults
from recon.by_lasers import Added
from recon.camera import Camera, ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import Capture
from recon.exhaustive import Exhaustive
from recon.filming import frame_times_s as moments_s
from recon.grid import VoxelGrid
from recon.registry import CAMERAS, entry_of, load
from recon.result import Image
from recon.sampling import CONFOCAL
from recon.solvers.problem import ImagingProblem, Solver
from recon.surface import Surface
from recon.virtual_aperture import remapped
from recon.wave import CYCLES, VirtualPulse
from recon.window import Window
from rig.errors import UsageError, command_line, printable
from rig.files.scan import ScanFile
from rig.files.volume import Volume
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
from rig.image.request import Request
from rig.model.calibrations.store import CalibrationStore
from rig.model.quantities import show


class Fields(Protocol):
    """Other processes that compute the fields of a scan, in either form of its capture."""

    def planes(self, problem: ImagingProblem, solver: str | Solver) -> Iterator[NDArray[np.complexfloating]]:
        """Yield the field of each plane; as `recon.imaging.Planes`."""
        ...

    def runs(self, problem: ImagingProblem, capture: Exhaustive) -> Iterator[Added]:
        """Yield what each run of lasers of an exhaustive capture adds; as `recon.by_lasers.Runs`."""
        ...


@dataclass(frozen=True)
class Work:
    """What is imaged, with all choices made; `by` computes fields in place of this process."""

    request: Request
    seen: Seen
    pulse: VirtualPulse
    grid: VoxelGrid
    window: Window
    scan: str
    scan_digest: str
    estimated: tuple[str, ...] = ()
    origin: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    by: Fields | None = None

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
    grid = voxels(request, seen.capture, pulse)
    return Work(request, seen, pulse, grid, window, scan, digest, origin=came)


def _check_fade(request: Request, capture: Capture) -> None:
    """Refuse a fade after which the record has nothing."""
    end_s = float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s
    if request.fade_from_s is not None and request.fade_from_s >= end_s:
        raise UsageError(
            f"--fade-from {show(request.fade_from_s, 's')} ignores all light: the record ends at "
            f"{show(end_s, 's')}; give an earlier time"
        )


def voxels(request: Request, capture: Capture, pulse: VirtualPulse) -> VoxelGrid:
    """Return the voxels asked for, or those that show what a pulse resolves."""
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
    return request.solver == "rsd" and on_cpu and not request.filmed


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


def _wavelength(request: Request, seen: Seen) -> defaults.Choice:
    if request.wavelength_m is not None:
        return defaults.Choice(request.wavelength_m, "as asked")
    return defaults.wavelength(seen.capture, seen.instrument_response_s, rendered=seen.rendered)


def camera_of(work: Work) -> Camera:
    """Return the camera asked for."""
    name = work.request.camera
    if CAMERAS[name].film:
        return TransientCamera(moments_s(work.capture, work.pulse, work.grid, work.request.frames_s))
    return PhotoCamera() if name == "photo" else ConfocalCamera()


def warnings_of(work: Work, camera: Camera = CONFOCAL) -> tuple[str, ...]:
    """List what may spoil the image."""
    response_s = work.seen.instrument_response_s
    found = defaults.warnings(work.capture, work.pulse, work.grid, response_s, camera.light(work.pulse))
    if own := entry_of(work.request.solver).warnings:
        found += load(own)(work.capture, work.pulse.wavelength_m, work.grid)
    return tuple(found)
