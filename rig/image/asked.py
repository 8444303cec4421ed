"""What is asked of imaging, as a person writes it: quantities as text, or as numbers in SI units."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack, get_args

from recon.filming import Over
from recon.registry import CAMERAS, SOLVERS
from recon.solvers.problem import Solver
from rig.errors import UsageError
from rig.image.request import Request
from rig.model.quantities import depths, parse, si, si_range

#: A quantity: text with its unit, e.g. ``"4cm"``, or a number in the SI unit.
Quantity = str | float
#: From, to and step: text, e.g. ``"0.5m:3m:2cm"``, or three numbers in the SI unit.
Range = str | tuple[float, float, float]


class ImageOptions(TypedDict, total=False):
    """What may be asked of imaging; the names are those of the options of `rig recon`."""

    camera: str
    solver: str | Solver
    wavelength: Quantity | None
    cycles: float | None
    depth: Range | None
    width: Quantity | None
    height: Quantity | None
    voxel: Quantity | None
    fade_from: Quantity | None
    frames: Range | None
    over: Over | None
    all_depths: bool
    snr: float | None
    memory: Quantity | None
    device: str
    calibrations: str | os.PathLike[str] | None
    even_bins: bool
    each_frame: bool
    fresh_to: Quantity | None
    relight: str | tuple[float, float, float] | None
    however_long: bool


@dataclass(frozen=True)
class Option:
    """How an option is written and read.

    Attributes
    ----------
    field
        Of the request.
    form
        What it is in a file: text with units, a number, true or false, or one of `words`.
    read
        Makes the request's value of what was given.
    words
        Those that a word may be.
    """

    field: str
    form: Literal["text", "number", "switch", "word"]
    read: Callable[[Any], Any] = lambda value: value
    words: tuple[str, ...] = ()


def _quantity(field: str, kind: str) -> Option:
    return Option(field, "text", lambda value: si(value, kind))


def _bytes(value: Quantity) -> int | None:
    found = si(value, "memory")
    return None if found is None else int(found)


def _times_s(value: Range) -> tuple[float, float, float] | None:
    return si_range(value, "time", "--frames 2ns:20ns:0.2ns")


def _place_m(place: str | tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a place: text, three lengths with commas between them, or three numbers in metres."""
    if not isinstance(place, str):
        return place
    parts = place.split(",")
    if len(parts) != 3:
        raise UsageError(f"'{place}' is not a place; write x, y and z, e.g. --relight 10cm,0cm,1m")
    x_m, y_m, z_m = (parse(part, "length") for part in parts)
    return x_m, y_m, z_m


#: All options of imaging.
OPTIONS: dict[str, Option] = {
    "camera": Option("camera", "word", words=tuple(CAMERAS)),
    "solver": Option("solver", "word", words=tuple(SOLVERS)),
    "wavelength": _quantity("wavelength_m", "length"),
    "cycles": Option("cycles", "number"),
    "depth": Option("depth_m", "text", depths),
    "width": _quantity("width_m", "length"),
    "height": _quantity("height_m", "length"),
    "voxel": _quantity("voxel_m", "length"),
    "fade_from": _quantity("fade_from_s", "time"),
    "frames": Option("frames_s", "text", _times_s),
    "over": Option("over", "word", words=get_args(Over)),
    "all_depths": Option("all_depths", "switch"),
    "snr": Option("snr", "number"),
    "memory": Option("memory_bytes", "text", _bytes),
    "device": Option("device", "word", words=("cpu", "cuda")),
    "calibrations": Option("calibrations", "text", lambda value: Path(os.fspath(value))),
    "even_bins": Option("even_bins", "switch"),
    "each_frame": Option("each_frame", "switch"),
    "fresh_to": _quantity("fresh_to_m", "length"),
    "relight": Option("relight_m", "text", _place_m),
    "however_long": Option("however_long", "switch"),
}


def asked(**options: Unpack[ImageOptions]) -> Request:
    """Read what is asked of imaging; what is None, or left out, is chosen by the program.

    Raises
    ------
    rig.errors.UsageError
        If a quantity or a range cannot be understood.
    TypeError
        If there is no such option.
    """
    given: dict[str, Any] = {**options}
    if unknown := sorted(given.keys() - OPTIONS):
        raise TypeError(f"imaging has no option {', '.join(unknown)}; it has {', '.join(OPTIONS)}")
    found = [(OPTIONS[name], value) for name, value in given.items() if value is not None]
    return Request(**{option.field: option.read(value) for option, value in found})
