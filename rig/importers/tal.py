"""TAL (the y-tal library), HDF5 with ``H`` and ``H_format``.

``delta_t`` and ``t_start`` are metres of optical path; ``t_start`` is the left edge of bin 0, since TAL takes
bin floor((path - t_start) / delta_t). Time is the first axis of ``H``, and a polarised render has four Stokes
components on a last axis more. Enums are datasets of shape (1,), and None is an empty dataset. TAL scans the
sensor and may keep the laser still; light runs both ways alike (Helmholtz reciprocity), so that is the same
as scanning the laser before a detector that is still.
"""

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError, UsageError
from rig.files.blocks import read as read_part
from rig.files.blocks import spans
from rig.files.check import plain, reading
from rig.importers.content import Content, stored_dtype
from rig.importers.options import Options
from rig.importers.pairs import each_with_each
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source
from rig.importers.wall import WallFrame, named

NAME = "TAL"
SIGN = "HDF5 with H and H_format"
PARTS = ("H_format", "H")
#: Axes of H by TAL's HFormat code: T_Sx_Sy and T_Si, one histogram for each sensor point; T_Lx_Ly_Sx_Sy and
#: T_Li_Si, each laser point with each sensor point.
_AXES = {1: 3, 2: 5, 3: 2, 4: 3}
_EXHAUSTIVE = {2, 4}
_LX_LY_SX_SY = 2
#: Stokes components of each bin in a polarised render, on an axis after all others; the first is intensity.
_STOKES = 4
_INTENSITY = "polarised: of the Stokes components on the last axis of H, the first, intensity, is used"
#: Codes from here on are in the frequency domain.
_FREQUENCIES = 10
#: Bytes of H read at once.
_BLOCK_BYTES = 2**26


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return not source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file, block by block.

    Raises
    ------
    UsageError
        If the file does not say whether its time includes the legs, and it was not given.
    DataFileError
        If ``H`` is in the frequency domain, or arrays do not fit together.
    """
    code = int(source.numbers("H_format", 1)[0])
    if code not in _AXES:
        what = f"{code}, frequency domain" if code >= _FREQUENCIES else str(code)
        raise DataFileError(
            f"{source.path}: H_format is {what}; transients over time are needed: T_Sx_Sy, T_Si, "
            "T_Lx_Ly_Sx_Sy or T_Li_Si"
        )
    (sensor_m,), unmeasured = zeros_as_missing(source.places("sensor_grid_xyz"))
    (laser_m,), unlit = zeros_as_missing(source.places("laser_grid_xyz"))
    stokes = _check_shape(source, code, len(sensor_m), len(laser_m))
    if code not in _EXHAUSTIVE and len(laser_m) not in {1, len(sensor_m)}:
        raise DataFileError(
            f"{source.path}: {len(laser_m)} laser points for {len(sensor_m)} sensor points; "
            "one, or as many, are needed"
        )
    delta_m, start_m = source.numbers("delta_t", 1)[0], _optional(source, "t_start", 1)
    if not delta_m > 0:
        raise DataFileError(f"{source.path}: delta_t is {delta_m} m; it must be positive")
    legs_inside = _legs_inside(source, options)
    sensor_head_m, laser_head_m = _optional(source, "sensor_xyz", 3), _optional(source, "laser_xyz", 3)
    if legs_inside and (sensor_head_m is None or laser_head_m is None):
        raise DataFileError(
            f"{source.path}: its time includes the paths to and from the wall, "
            "but sensor_xyz or laser_xyz is missing"
        )
    normals = None
    if source.shapes.get("sensor_grid_normals") is not None:
        normals = source.places("sensor_grid_normals")
    with named(source.path):
        frame = WallFrame.of(sensor_m, normals, laser_head_m if sensor_head_m is None else sensor_head_m)
    heads_m = (sensor_head_m, laser_head_m) if legs_inside else (None, None)
    spots = each_with_each(
        frame.bring(sensor_m),
        frame.bring(laser_m),
        *(None if head_m is None else frame.bring(head_m) for head_m in heads_m),
        confocal=code not in _EXHAUSTIVE and len(laser_m) == len(sensor_m),
        laser_outer=True,
    )
    dataset = source.dataset("H")
    return Content(
        laser_m=spots.laser_m,
        detector_m=spots.detector_m,
        bins=dataset.shape[0],
        bin_width_s=delta_m / C_M_PER_S,
        first_bin_s=0.0 if start_m is None else start_m[0] / C_M_PER_S,
        dtype=stored_dtype(dataset),
        blocks=_blocks(source, dataset, stokes, code == _LX_LY_SX_SY),
        delays=spots.delays,
        pixels=len(sensor_m) if code in _EXHAUSTIVE and 1 < len(laser_m) <= len(sensor_m) else 0,
        assumed=(
            *spots.assumed,
            *([] if start_m is not None else ["t_start is missing: bin 0 begins at t = 0"]),
            *unmeasured,
            *unlit,
            *([_INTENSITY] if stokes else []),
        ),
        frame=frame,
    )


def _check_shape(source: Source, code: int, sensors: int, lasers: int) -> bool:
    """Return whether H has Stokes components on a last axis more.

    Raises
    ------
    DataFileError
        If its shape does not fit the points, or their order on the grids.
    """
    shape = source.shapes["H"] or ()
    axes, more = shape[: _AXES[code]], shape[_AXES[code] :]
    histograms = sensors * (lasers if code in _EXHAUSTIVE else 1)
    points = f"{sensors} sensor points" + (f" and {lasers} laser points" if code in _EXHAUSTIVE else "")
    if len(axes) != _AXES[code] or np.prod(axes[1:]) != histograms:
        raise DataFileError(f"{source.path}: H has shape {shape}, but there are {points}")
    polarised = len(more) == 1 and (more == (_STOKES,) or _says_polarised(source))
    if more not in {(), (1,)} and not polarised:
        raise DataFileError(
            f"{source.path}: H has shape {shape} with {points}; of a last axis more, only {_STOKES} Stokes "
            "components of a polarised render are known: write only the intensity"
        )
    for name, on in (("sensor_grid_xyz", axes[-2:]), ("laser_grid_xyz", axes[1:3])):
        grid = source.shapes[name] or ()
        of_grid = code == 2 or (code == 1 and name == "sensor_grid_xyz")
        if of_grid and len(grid) == 3 and grid[:2] != on:
            raise DataFileError(
                f"{source.path}: {name} is a grid of {grid[:2]} points, but H has {on} in its place; "
                "H and the grids need the same order of x and y"
            )
    return polarised


def _says_polarised(source: Source) -> bool:
    """Return whether the scene's description names a polarised render."""
    if source.shapes.get("scene_info") != ():
        return False
    return "polarized" in str(plain(source.read("scene_info")))


def _legs_inside(source: Source, options: Options) -> bool:
    flag = _optional(source, "t_accounts_first_and_last_bounces", 1)
    if flag is not None:
        return bool(flag[0])
    told = options.optional("time_origin")
    if told is None:
        raise UsageError(
            f"{source.path} does not contain whether its time includes the paths from laser to wall and "
            "from wall "
            "to sensor (t_accounts_first_and_last_bounces); use --time-origin laser if it does, wall if not"
        )
    return bool(told == "laser")


def _optional(source: Source, name: str, *shape: int) -> NDArray[np.float64] | None:
    """Return a variable, None where it is missing or TAL's None."""
    if source.shapes.get(name) is None:
        return None
    return source.numbers(name, *shape)


def _blocks(source: Source, dataset: h5py.Dataset, stokes: bool, by_rows: bool) -> Iterator[NDArray]:
    """Yield parts of H as histograms; `by_rows`, of H with two axes of lasers, also cuts along the second."""
    for some in spans(dataset, 1, _BLOCK_BYTES):
        for row in _rows_of(dataset, some) if by_rows else [slice(None)]:
            with reading(source.path):
                parts = (slice(None), some, row) if by_rows else (slice(None), some)
                block = read_part(dataset, *parts)
            yield (block[..., 0] if stokes else block).reshape(len(block), -1).T


def _rows_of(dataset: h5py.Dataset, some: slice) -> list[slice]:
    """Cut the second axis of lasers where one of the first has more bytes than are read at once."""
    one_bytes = dataset.dtype.itemsize * dataset.size // dataset.shape[1]
    if some.stop - some.start > 1 or one_bytes <= _BLOCK_BYTES:
        return [slice(0, dataset.shape[2])]
    step = max(1, _BLOCK_BYTES * dataset.shape[2] // one_bytes)
    return [slice(first, first + step) for first in range(0, dataset.shape[2], step)]
