"""Lindell, Wetzstein, O'Toole 2019 (f-k migration): MATLAB with ``meas``, and ``tofgrid`` in it or beside it.

``meas`` (x, y, t) in MATLAB's order: confocal counts, not rectified. ``tofgrid`` (x, y) time of flight to the
wall and back [ps] of each position. The authors' program shifts each record by whole bins; here the shift is
exact, since the scan file keeps a delay for each position. Where the wall is not flat, ``z_offset`` (x, y)
says how far each spot is in front of z = 0 [m]: in either file, or in ``calibration.mat`` beside them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.importers.content import Content, square_grid
from rig.importers.cube import cube_blocks, cube_shape
from rig.importers.flight import tofgrid
from rig.importers.options import Options
from rig.importers.source import Source, open_source

NAME = "Lindell 2019, f-k"
SIGN = "MATLAB with meas (x, y, t), and tofgrid (x, y) in it or in tof.mat beside it"
PARTS = ("meas", "tofgrid or tof.mat")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.has("meas")


def read(source: Source, options: Options) -> Content:
    """Read the file, and the one with the times of flight.

    Raises
    ------
    UsageError
        If the bin width or the wall's size was not given, or there are no times of flight.
    DataFileError
        If arrays do not fit together, or the wall is not flat and nothing says how deep it is.
    """
    nx, ny, bins = cube_shape(source, "meas")
    tof_path = _tof_path(source, options)
    with open_source(tof_path) as beside:
        tof_s, where = tofgrid(beside), tof_path.name
    if tof_s.shape != (nx, ny):
        raise DataFileError(
            f"{source.path}: meas has {nx} x {ny} positions, but tofgrid of {where} has shape {tof_s.shape}"
        )
    bin_width_s = options.asked(
        "bin_width_s", source.path, "how wide its bins are", "the published scans have 32ps"
    )
    size_m = options.asked(
        "wall_size_m", source.path, "how large the scanned square is", "the published scans have 2m"
    )
    spots_m = square_grid(nx, ny, size_m, y_down=True)
    depth_m, depth_told = _depths(source, tof_path, (nx, ny))
    if depth_m is not None:
        spots_m[:, 2] = depth_m.ravel()
    dtype, blocks = cube_blocks(source, "meas")
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=bins,
        bin_width_s=bin_width_s,
        first_bin_s=0.0,
        dtype=dtype,
        blocks=blocks,
        delay_s=tof_s.ravel(),
        assumed=(
            f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y falling: "
            "the file does not contain this, so the picture may be mirrored or turned",
            f"confocal; tofgrid of {where} is in picoseconds, and subtracted exactly, not in whole bins",
            *depth_told,
        ),
    )


def _tof_path(source: Source, options: Options) -> Path:
    """Return the file with tofgrid: the one given, the source itself, or tof.mat beside it."""
    given = options.optional("delays")
    if given is not None and source.has("tofgrid"):
        raise UsageError(
            f"{source.path} holds tofgrid itself; leave --tof {given} out, or remove tofgrid from the file"
        )
    if source.has("tofgrid"):
        return source.path
    path = source.path.with_name("tof.mat") if given is None else Path(given)
    if given is None and not path.is_file():
        raise UsageError(
            f"{source.path} does not contain the time of flight to each position, and there is no tof.mat "
            "beside it; give the file that holds tofgrid with --tof"
        )
    return path


def _depths(
    source: Source, tof_path: Path, shape: tuple[int, int]
) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Return z of each spot from z_offset, None where the wall is flat; and what was done, in words.

    Raises
    ------
    DataFileError
        If places in the hardware's frame (pos) say that the wall is not flat, and there is no z_offset.
    """
    not_flat = None
    calibration = source.path.with_name("calibration.mat")
    for path in dict.fromkeys([source.path, tof_path, calibration]):
        if not path.is_file():
            continue
        with open_source(path) as held:
            if held.has("z_offset"):
                depth_m = held.matlab_array("z_offset")
                if depth_m.shape != shape or depth_m.dtype.kind not in "uif":
                    raise DataFileError(
                        f"{path}: z_offset has shape {depth_m.shape}; depths of {shape} spots are needed"
                    )
                return depth_m.astype(float), [f"z of each spot is z_offset of {path.name}, into the room"]
            not_flat = path if held.has("pos") else not_flat
    if not_flat is not None:
        raise DataFileError(
            f"{not_flat} holds 'pos': the wall is not flat, and the places of its points in this "
            "program's frame are not known; put calibration.mat with z_offset beside it, "
            "or write it as neutral HDF5, with "
            "laser_position_m and time_s"
        )
    return None, []
