"""Plain HDF5: ``counts`` or ``transient`` (positions, bins), with positions and bin centres beside it.

``laser_position_m`` (positions, 3), ``detector_position_m`` (1 or positions, 3), ``time_s`` (bins,) bin
centres; attributes ``bin_width_s``, ``gate_start_s``, ``simulated``; in this program's frame.

The attribute ``time_origin`` says ``wall`` (rectified: t = 0 when the pulse is on the wall) or ``laser``
(t = 0 when the pulse leaves the laser), or either in a sentence. With ``laser`` the file has ``delay_s``
(positions,), what to subtract from each position's time, or the attributes ``laser_head_m`` and
``detector_head_m`` (3,) and, where it is not zero, ``electronics_delay_s``.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.files.blocks import read as read_part
from rig.files.blocks import spans
from rig.files.check import reading
from rig.importers.content import Content, stored_dtype
from rig.importers.flight import given_flights
from rig.importers.options import Options
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source
from rig.importers.wall import WallFrame, named
from rig.model.delays import PathDelays

NAME = "neutral HDF5"
SIGN = "HDF5 with counts or transient (positions, bins), laser_position_m, detector_position_m, time_s"
PARTS = ("laser_position_m", "counts or transient", "detector_position_m", "time_s")
#: Bytes of the counts read at once.
_BLOCK_BYTES = 2**24
#: What the attribute time_origin holds where time is rectified, and where it is not.
_ORIGINS = (
    r"^\W*wall\W*$|pulse (is on|is at|on|at|hits|reaches) [^;,.]*wall",
    r"^\W*laser\W*$|pulse leaves [^;,.]*laser",
)


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return not source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file, block by block.

    Raises
    ------
    UsageError
        If its time origin is neither, and was not given.
    DataFileError
        If arrays do not fit together, or its time includes legs of which it does not tell.
    """
    if source.has("counts", "transient"):
        raise DataFileError(f"{source.path} holds both counts and transient; keep only the right one")
    name = "counts" if source.has("counts") else "transient"
    laser_m, detector_m = source.places("laser_position_m"), source.places("detector_position_m")
    time_s = source.numbers("time_s", -1)
    shape = source.shapes[name]
    if shape != (len(laser_m), len(time_s)) or len(detector_m) not in {1, len(laser_m)}:
        raise DataFileError(
            f"{source.path}: {name} has shape {shape}, but there are {len(laser_m)} laser positions, "
            f"{len(detector_m)} detector positions and {len(time_s)} bin centres"
        )
    if len(detector_m) == 1:
        (laser_m,), unmeasured = zeros_as_missing(laser_m)
    else:
        (laser_m, detector_m), unmeasured = zeros_as_missing(laser_m, detector_m)
    bin_width_s = source.attribute_number(
        "bin_width_s", float(time_s[-1] - time_s[0]) / max(1, len(time_s) - 1)
    )
    # a thousandth of a bin: far above rounding, far below what an image shows
    even = np.abs(time_s - time_s[0] - np.arange(len(time_s)) * bin_width_s) < 1e-3 * bin_width_s * len(
        time_s
    )
    if not bin_width_s > 0 or not even.all():
        raise DataFileError(f"{source.path}: time_s is not evenly spaced by bin_width_s = {bin_width_s:g} s")
    gate_start_s = source.attribute_number("gate_start_s", 0.0)
    delays, delay_s, assumed = _legs(source, options, len(laser_m))
    with named(source.path):
        frame = WallFrame.amid(laser_m, detector_m, across=False)
    laser_m, detector_m = frame.bring(laser_m), frame.bring(detector_m)
    if delays is not None and not frame.still:
        delays = replace(
            delays,
            laser_head_m=frame.bring(delays.laser_head_m),
            detector_head_m=frame.bring(delays.detector_head_m),
        )
    dataset = source.dataset(name)
    return Content(
        laser_m=laser_m,
        detector_m=detector_m,
        bins=len(time_s),
        bin_width_s=bin_width_s,
        first_bin_s=float(time_s[0] - bin_width_s / 2),
        dtype=stored_dtype(dataset),
        blocks=_blocks(source, dataset),
        fade_from_s=gate_start_s if gate_start_s > 0 else None,
        simulated=bool(source.attribute_flag("simulated")),
        delays=delays,
        delay_s=delay_s,
        frame=None if frame.still else frame,
        assumed=(*assumed, *unmeasured, *_contradictions(source, laser_m, detector_m)),
    )


def _legs(
    source: Source, options: Options, positions: int
) -> tuple[PathDelays | None, NDArray[np.float64] | None, tuple[str, ...]]:
    """Return the path delays, or each position's delay, or neither where rectified; and what was assumed."""
    origin, assumed = _time_origin(source, options)
    if origin == "wall":
        return None, None, assumed
    if source.has("delay_s"):
        return None, source.numbers("delay_s", positions), assumed
    flights_s = given_flights(options, positions)
    if flights_s is not None:
        return None, flights_s, (*assumed, "the flight to each position, given with --tof, is subtracted")
    heads_m = [source.attribute_numbers(f"{side}_head_m", 3) for side in ("laser", "detector")]
    if heads_m[0] is None or heads_m[1] is None:
        raise DataFileError(
            f"{source.path}: its time origin is laser, so the flight to the wall and back is in its time, "
            "but the file does not contain how long that is: add delay_s (positions,), "
            "or the attributes laser_head_m and "
            "detector_head_m [m], or give --tof, or subtract it from time_s and set time_origin to wall"
        )
    electronics_s = source.attribute_number("electronics_delay_s", 0.0)
    return PathDelays(heads_m[0], heads_m[1], electronics_s), None, assumed


def _contradictions(source: Source, laser_m: NDArray, detector_m: NDArray) -> list[str]:
    """Return where the attribute confocal is not what the places say, in words."""
    said = source.attribute_flag("confocal")
    confocal = detector_m.shape == laser_m.shape and np.allclose(
        detector_m, laser_m, atol=1e-4, equal_nan=True
    )
    if said is None or said == confocal:
        return []
    return [f"its attribute confocal is {said}, but its places show the opposite, and those are used"]


def _time_origin(source: Source, options: Options) -> tuple[str, tuple[str, ...]]:
    text = source.attribute("time_origin")
    if text is None:
        told = options.optional("time_origin")
        return told or "wall", () if told else ("rectified: the file does not contain what its t = 0 is",)
    at_wall, at_laser = (re.search(pattern, str(text), re.IGNORECASE) for pattern in _ORIGINS)
    if bool(at_wall) == bool(at_laser):
        told = options.optional("time_origin")
        if told is None:
            raise UsageError(
                f"{source.path} has the time origin '{text}', which is neither wall nor laser; "
                "give it with --time-origin"
            )
        return told, (f"its time origin, '{text}', was used as {told}, as requested",)
    return "wall" if at_wall else "laser", ()


def _blocks(source: Source, dataset: h5py.Dataset) -> Iterator[NDArray]:
    for some in spans(dataset, 0, _BLOCK_BYTES):
        with reading(source.path):
            block = read_part(dataset, some)
        yield block
