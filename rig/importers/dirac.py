"""NLOS-DIRAC, HDF5 with ``data_t``, as y-tal reads it.

``data_t`` (t, x, y) confocal transients; ``xg``, ``yg`` (x, y) spots and ``da`` (t,) distances along the
path, all in metres. ``offset_laser`` is the way from laser to wall that was subtracted from them; where it is
zero, nothing says whether the time includes it. All that is known of this layout is how y-tal converts it.
"""

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.errors import DataFileError, UsageError
from rig.importers.content import Content, stored_dtype
from rig.importers.flight import given_flights
from rig.importers.options import Options
from rig.importers.source import Source

NAME = "NLOS-DIRAC"
SIGN = "HDF5 with data_t (t, x, y), xg, yg (x, y) and da (t)"
PARTS = ("data_t", "xg", "yg", "da")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return not source.matlab5 and source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    UsageError
        If the file does not say whether its time includes the legs, and it was not given.
    DataFileError
        If arrays do not fit together.
    """
    da_m = source.numbers("da", -1)
    grid = source.shapes["xg"] or ()
    x_m, y_m = (source.numbers(name, *grid) for name in ("xg", "yg"))
    shape = source.shapes["data_t"]
    if len(grid) != 2 or shape != (len(da_m), *grid):
        raise DataFileError(
            f"{source.path}: data_t has shape {shape}, xg {grid} and da {da_m.shape}; (t, x, y), (x, y) and "
            "(t,) are needed"
        )
    step_m = (da_m[-1] - da_m[0]) / max(1, len(da_m) - 1)
    if not step_m > 0 or np.abs(np.diff(da_m) - step_m).max() > 1e-3 * step_m:
        raise DataFileError(f"{source.path}: da is not evenly spaced, rising")
    delay_s = _delays(source, options, x_m.size)
    spots_m = np.column_stack([x_m.ravel(), y_m.ravel(), np.zeros(x_m.size)])
    dataset = source.dataset("data_t")
    return Content(
        laser_m=spots_m,
        detector_m=spots_m,
        bins=len(da_m),
        bin_width_s=step_m / C_M_PER_S,
        first_bin_s=da_m[0] / C_M_PER_S,
        dtype=stored_dtype(dataset),
        blocks=[np.asarray(source.read("data_t")).reshape(len(da_m), -1).T],
        delay_s=delay_s,
        assumed=(
            "confocal; xg and yg are x and y of this program's frame; da holds the left edges of the bins: "
            "the file does not contain any of this",
        ),
    )


def _delays(source: Source, options: Options, positions: int) -> NDArray[np.float64] | None:
    """Return the flight to each position, None where time is rectified."""
    if source.has("offset_laser") and source.numbers("offset_laser", -1).any():
        return None
    told = options.optional("time_origin")
    if told is None:
        raise UsageError(
            f"{source.path} does not contain whether its time includes the paths from laser to wall and "
            "from wall "
            "to detector (offset_laser is zero or missing); use --time-origin wall if not, or --time-origin "
            "laser with --tof"
        )
    if told == "wall":
        return None
    delay_s = given_flights(options, positions)
    if delay_s is None:
        raise UsageError(
            f"{source.path} does not contain the time of flight to each position; give the file that holds "
            "tofgrid with --tof"
        )
    return delay_s
