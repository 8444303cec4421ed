"""From a scan file to a volume file and a picture: choose what was not asked for, focus, find depths."""

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recon import advice
from recon.capture import Capture
from recon.depth import compensate_falloff, depth_map
from recon.imaging import Image, Solver, image
from recon.preparation import Fades
from recon.wave import VirtualPulse
from rig.files.scan import ScanFile
from rig.files.volume import Volume, write_volume
from rig.pictures import save, volume_figure
from rig.quantities import show_length

#: A pixel has a depth where its intensity, compensated for the fall-off with depth, is at least this part of
#: the greatest.
DEPTH_THRESHOLD = 0.05


@dataclass(frozen=True)
class Request:
    """What was asked for; None leaves the choice to the program."""

    solver: Solver = "rsd"
    wavelength_m: float | None = None
    cycles: float = 6.0
    depth_m: tuple[float, float, float] | None = None
    width_m: float | None = None
    height_m: float | None = None
    voxel_m: float | None = None
    fade_from_s: float | None = None
    memory_bytes: int | None = None
    device: str = "cpu"


@dataclass(frozen=True)
class Result:
    """What was imaged, and how.

    Attributes
    ----------
    volume
        Intensity, axes and depth map.
    reason
        Why this wavelength.
    warnings
        What may spoil the image.
    positions
        Positions used.
    took_s
        Computer time from opening the scan to the picture.
    """

    volume: Volume
    reason: str
    warnings: tuple[str, ...]
    positions: int
    took_s: float

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            **self.volume.parameters,
            "scan": self.volume.scan,
            "scan_digest": self.volume.scan_digest,
            "positions": self.positions,
            "voxels": self.volume.intensity.shape[::-1],
            "wavelength_reason": self.reason,
            "warnings": list(self.warnings),
            "took_s": round(self.took_s, 2),
        }

    def summary(self) -> dict[str, str]:
        """Return the result as a person reads it."""
        volume, parameters = self.volume, self.volume.parameters
        depth, height, width = volume.intensity.shape
        return {
            "wavelength": f"{show_length(parameters['wavelength_m'])}: {self.reason}",
            "solver": f"{parameters['solver']}, {parameters['cycles']:g} cycles",
            "positions": f"{self.positions:,}",
            "voxels": f"{width} x {height} x {depth}, depths {volume.z_m[0]:.2f} to {volume.z_m[-1]:.2f} m",
            "took": f"{self.took_s:.1f} s",
        }


def reconstruct(
    scan_path: Path,
    request: Request,
    volume_path: Path,
    picture_path: Path,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Image a scan with the confocal time-gated camera; write the volume file and the picture.

    Raises
    ------
    rig.errors.DataFileError
        If the scan cannot be read.
    recon.errors.ReconError
        If it cannot be imaged as asked.
    """
    began_s = time.monotonic()
    with ScanFile(scan_path) as scan:
        capture = scan.capture()
        choice = _wavelength(request, capture, scan.instrument_response_s)
        pulse = VirtualPulse(choice.value, request.cycles)
        grid = advice.voxels(
            capture,
            pulse,
            width_m=request.width_m,
            height_m=request.height_m,
            voxel_m=request.voxel_m,
            depth_m=request.depth_m,
        )
        fade_from_s = scan.fade_from_s if request.fade_from_s is None else request.fade_from_s
        warnings = advice.warnings(capture, pulse, grid, scan.instrument_response_s)
        focused = image(
            capture,
            pulse,
            grid,
            solver=request.solver,
            fades=Fades(start_s=fade_from_s),
            progress=progress,
            memory_bytes=request.memory_bytes,
            device=request.device,
        )
        volume = _volume(focused, scan_path.name, scan.digest)
    write_volume(volume_path, volume)
    save(_picture(volume), picture_path)
    took_s = time.monotonic() - began_s
    return Result(volume, choice.reason, tuple(warnings), capture.positions, took_s)


def _wavelength(request: Request, capture: Capture, response_s: float | None) -> advice.Choice:
    if request.wavelength_m is not None:
        return advice.Choice(request.wavelength_m, "as asked")
    return advice.wavelength(capture, response_s)


def _volume(focused: Image, scan: str, digest: str) -> Volume:
    grid, intensity = focused.grid, focused.intensity
    seen = compensate_falloff(intensity, grid.z_m, power=4.0)
    return Volume(
        intensity=intensity,
        x_m=grid.x_m,
        y_m=grid.y_m,
        z_m=grid.z_m,
        depth_m=depth_map(seen, grid.z_m, DEPTH_THRESHOLD),
        parameters={
            "camera": "confocal",
            "solver": focused.solver,
            "wavelength_m": focused.pulse.wavelength_m,
            "cycles": focused.pulse.cycles,
            "fade_from_s": focused.fades.start_s,
            "depth_threshold": DEPTH_THRESHOLD,
        },
        scan=scan,
        scan_digest=digest,
    )


def _picture(volume: Volume) -> Any:
    """Draw the volume with its fall-off compensated, so that far objects are seen beside near ones."""
    seen = dataclasses.replace(volume, intensity=compensate_falloff(volume.intensity, volume.z_m, power=4.0))
    return volume_figure(seen, compensation="z⁴")
