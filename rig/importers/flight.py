"""Times of flight to each position, from a file of their own."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.importers.options import Options
from rig.importers.source import Source, open_source


def tofgrid(source: Source) -> NDArray[np.float64]:
    """Return ``tofgrid`` in seconds, in MATLAB's order; the file has picoseconds, NaN where a ray missed.

    Raises
    ------
    DataFileError
        If it is no grid of numbers.
    """
    grid_ps = source.matlab_array("tofgrid")
    if grid_ps.dtype.kind not in "uif" or grid_ps.ndim != 2 or not np.isfinite(grid_ps).any():
        raise DataFileError(f"{source.path}: tofgrid must be a grid of numbers [ps]")
    return grid_ps * 1e-12


def given_flights(options: Options, positions: int) -> NDArray[np.float64] | None:
    """Return (positions,) times of flight [s] from the file given with --tof; None where none was given.

    Raises
    ------
    DataFileError
        If it cannot be read, or holds another number of them.
    """
    given = options.optional("delays")
    if given is None:
        return None
    with open_source(Path(given)) as beside:
        delay_s = tofgrid(beside).ravel()
    if delay_s.size != positions:
        raise DataFileError(
            f"{given}: tofgrid holds {delay_s.size} times of flight, but there are {positions} positions"
        )
    return delay_s
