"""One call for all baselines."""

from collections.abc import Callable

from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.registry import CLASSIC_SOLVERS, SOLVERS, load, taking
from recon.result import Image
from recon.sampling import path_limits_m
from recon.solvers.classic import lct
from recon.solvers.classic.resample import ConfocalLattice
from recon.window import Window


def baseline_image(
    capture: Capture,
    grid: VoxelGrid,
    *,
    solver: str,
    window: Window | None = None,
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
    window
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
    window = window or Window()
    _check(capture, grid, solver, snr)
    entry, notes = SOLVERS[solver], []
    if "snr" in entry.options:
        snr = lct.SNR if snr is None else snr
    options = {} if snr is None else {"snr": snr}
    if entry.confocal_grid:
        lattice = ConfocalLattice.of(capture, solver)
        notes = lattice.notes()
        amplitude = load(entry.place)(capture, lattice, grid, window, progress=progress, **options)
    else:
        amplitude = load(entry.place)(capture, grid, window, progress=progress, **options)
    return Image(
        grid, amplitude, solver, window, falloff_power=entry.falloff_power, snr=snr, notes=tuple(notes)
    )


def _check(capture: Capture, grid: VoxelGrid, solver: str, snr: float | None) -> None:
    if solver not in CLASSIC_SOLVERS:
        raise ParameterError(
            "solver",
            repr(solver),
            "there is no such solver",
            f"Choose one of {', '.join(CLASSIC_SOLVERS)}.",
        )
    filtered = "snr" in SOLVERS[solver].options
    if snr is not None and not (snr > 0 and filtered):
        raise ParameterError(
            f"solver {solver}",
            f"a signal-to-noise ratio of {snr}",
            "it is not positive" if filtered else "it has no such filter",
            f"Leave it out; solver {' or '.join(taking('snr'))} takes ratios above 0, and {lct.SNR} by "
            "default.",
        )
    grid.check_in_front()
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
