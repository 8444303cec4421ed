"""One call for all baselines."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon import registry
from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.picture import Image
from recon.sampling import path_limits_m
from recon.solvers.classic import lct
from recon.window import Fades

#: The methods that form no virtual wave, by name.
BASELINES = {name: info for name, info in registry.SOLVERS.items() if not info.wave}
#: What computes one: of capture, voxels, soft edges, and what else it takes; gives amplitude and notes, or
#: amplitude alone.
Method = Callable[..., NDArray[np.float32] | tuple[NDArray[np.float32], list[str]]]


def baseline_image(
    capture: Capture,
    grid: VoxelGrid,
    *,
    solver: str,
    fades: Fades | None = None,
    snr: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Image:
    """Image a volume by an earlier method.

    Parameters
    ----------
    capture
        Histograms and geometry. "bp", "laplacian-fbp" and "log-fbp" take any positions; "lct" and "fk" need a
        regular grid on z = 0, confocal or, as an approximation that `notes` tells, with one detector spot.
    grid
        Voxels, any pitch, offset and extent in front of the wall.
    solver
        Which.
    fades
        Soft edges of the record; by default only its end is softened.
    snr
        Ratio of signal to noise power for "lct", by default `lct.SNR`. Others have no such filter.
    progress
        Called with the fraction that is done.

    Raises
    ------
    GeometryError
        If the solver cannot take these positions.
    ReachError
        If no path to the volume falls inside the record.
    ParameterError
        If the volume is not in front of the wall, the solver unknown, or a ratio not positive or given to
        another solver.
    """
    fades = fades or Fades()
    _check(capture, grid, solver, snr)
    info = BASELINES[solver]
    if info.takes("snr"):
        snr = lct.SNR if snr is None else snr
    method: Method = info.load()
    found = method(capture, grid, fades, progress=progress, **({} if snr is None else {"snr": snr}))
    amplitude, notes = found if isinstance(found, tuple) else (found, [])
    return Image(grid, solver, fades, field=amplitude, snr=snr, notes=tuple(notes))


def _check(capture: Capture, grid: VoxelGrid, solver: str, snr: float | None) -> None:
    if solver not in BASELINES:
        raise ParameterError(
            "solver", repr(solver), "there is no such baseline", f"Choose one of {', '.join(BASELINES)}."
        )
    filtered = BASELINES[solver].takes("snr")
    if snr is not None and not (snr > 0 and filtered):
        raise ParameterError(
            f"solver {solver}",
            f"a signal-to-noise ratio of {snr}",
            "it is not positive" if filtered else "it has no such filter",
            f"Leave it out; solver lct takes ratios above 0, and {lct.SNR} by default.",
        )
    if grid.size == 0 or grid.z_m[0] <= 0:
        raise ParameterError(
            "volume",
            f"depths from {grid.z_m[:1]} m",
            "voxels must be in front of the wall",
            "Begin at z > 0.",
        )
    shortest_m, longest_m = path_limits_m(capture, grid)
    begin_m = float(capture.first_bin_s.min()) * C_M_PER_S
    end_m = (float(capture.first_bin_s.max()) + capture.bins * capture.bin_width_s) * C_M_PER_S
    if longest_m < begin_m or shortest_m > end_m:
        raise ReachError(
            "volume",
            f"paths of {shortest_m:.2f} to {longest_m:.2f} m",
            f"the record holds {begin_m:.2f} to {end_m:.2f} m",
            "Choose other depths, or check the record's time origin.",
        )
