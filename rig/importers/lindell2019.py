"""Lindell, Wetzstein, O'Toole 2019 (f-k migration): MATLAB with ``meas``, and ``tofgrid`` in it or beside it.

``meas`` (x, y, t) in MATLAB's order: confocal counts, not rectified. ``tofgrid`` (x, y) time of flight to the
wall and back [ps] of each position. The authors' program shifts each record by whole bins; here the shift is
exact, since the scan file keeps a delay for each position.
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
        If arrays do not fit together, or the wall is not flat.
    """
    if source.has("pos"):
        raise DataFileError(
            f"{source.path} holds 'pos': the wall is not flat, and how its points lie in this program's "
            "frame is not known; write it as neutral HDF5, with laser_position_m and time_s"
        )
    nx, ny, bins = cube_shape(source, "meas")
    tof_s, where = _times_of_flight(source, options)
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
            f"the {nx} x {ny} spots span {size_m:g} m with both edges, x rising, y falling: that is not in "
            "the file, the picture may be mirrored or turned",
            f"confocal; tofgrid of {where} is in picoseconds, and subtracted exactly, not in whole bins",
        ),
    )


def _times_of_flight(source: Source, options: Options) -> tuple[NDArray[np.float64], str]:
    """Return tofgrid (x, y) in seconds, and the name of the file it is from."""
    given = options.optional("delays")
    if given is not None and source.has("tofgrid"):
        raise UsageError(
            f"{source.path} holds tofgrid itself; leave --tof {given} out, or take tofgrid out of the file"
        )
    if source.has("tofgrid"):
        return tofgrid(source), source.path.name
    path = source.path.with_name("tof.mat") if given is None else Path(given)
    if given is None and not path.is_file():
        raise UsageError(
            f"{source.path} does not say how long light flies to each position, and there is no tof.mat "
            "beside it; give the file that holds tofgrid with --tof"
        )
    with open_source(path) as beside:
        return tofgrid(beside), path.name
