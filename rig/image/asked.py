"""What is asked of imaging, as a person writes it: quantities as text, or as numbers in SI units."""

from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import UsageError
from rig.image.request import Request
from rig.model.quantities import depths, parse, si, si_range

if TYPE_CHECKING:
    from recon.filming import Over
    from recon.solvers.problem import Solver

#: A quantity: text with its unit, e.g. ``"4cm"``, or a number in the SI unit.
Quantity = str | float
#: From, to and step: text, e.g. ``"0.5m:3m:2cm"``, or three numbers in the SI unit.
Range = str | tuple[float, float, float]


def asked(
    *,
    camera: str = "confocal",
    solver: "str | Solver" = "rsd",
    wavelength: Quantity | None = None,
    cycles: float | None = None,
    depth: Range | None = None,
    width: Quantity | None = None,
    height: Quantity | None = None,
    voxel: Quantity | None = None,
    fade_from: Quantity | None = None,
    frames: Range | None = None,
    over: "Over | None" = None,
    all_depths: bool = False,
    snr: float | None = None,
    memory: Quantity | None = None,
    device: str = "cpu",
    calibrations: str | Path | None = None,
    even_bins: bool = False,
    each_frame: bool = False,
    fresh_to: Quantity | None = None,
    relight: str | tuple[float, float, float] | None = None,
    however_long: bool = False,
) -> Request:
    """Read what is asked of imaging; the names are those of the options of `rig recon`.

    Raises
    ------
    rig.errors.UsageError
        If a quantity or a range cannot be understood.
    """
    memory_bytes = si(memory, "memory")
    return Request(
        camera=camera,
        solver=solver,
        wavelength_m=si(wavelength, "length"),
        cycles=cycles,
        depth_m=depths(depth),
        width_m=si(width, "length"),
        height_m=si(height, "length"),
        voxel_m=si(voxel, "length"),
        fade_from_s=si(fade_from, "time"),
        frames_s=si_range(frames, "time", "--frames 2ns:20ns:0.2ns"),
        over=over,
        all_depths=all_depths,
        snr=snr,
        memory_bytes=None if memory_bytes is None else int(memory_bytes),
        device=device,
        calibrations=None if calibrations is None else Path(calibrations),
        even_bins=even_bins,
        each_frame=each_frame,
        fresh_to_m=si(fresh_to, "length"),
        relight_m=_place_m(relight),
        however_long=however_long,
    )


def _place_m(place: str | tuple[float, float, float] | None) -> tuple[float, float, float] | None:
    """Read a place: text, three lengths with commas between them, or three numbers in metres."""
    if place is None or not isinstance(place, str):
        return place
    parts = place.split(",")
    if len(parts) != 3:
        raise UsageError(f"'{place}' is not a place; write x, y and z, e.g. --relight 10cm,0cm,1m")
    x_m, y_m, z_m = (parse(part, "length") for part in parts)
    return x_m, y_m, z_m
