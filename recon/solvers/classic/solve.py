"""One call for all baselines."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, Capture
from recon.errors import ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.sampling import path_limits_m
from recon.solvers.classic import ellipsoids, fk, lct
from recon.solvers.classic.resample import ConfocalLattice
from recon.window import Fades

Baseline = Literal["bp", "laplacian-fbp", "log-fbp", "lct", "fk"]
BASELINES: tuple[Baseline, ...] = get_args(Baseline)


@dataclass(frozen=True)
class BaselineImage:
    """A volume made by a baseline, and how.

    Attributes
    ----------
    grid
        Its voxels.
    amplitude
        (z, y, x) float32, not negative and linear in photon counts, as |U| of the virtual camera is: summed
        counts (bp), minus their second derivatives (laplacian-fbp, log-fbp), albedo (lct), |psi|^2 (fk).
    solver, fades
        What was asked.
    snr
        Ratio of signal to noise power of the Wiener filter; None where there is none.
    notes
        What a reader has to know, in sentences.
    """

    grid: VoxelGrid
    amplitude: NDArray[np.float32]
    solver: Baseline
    fades: Fades
    snr: float | None
    notes: tuple[str, ...]

    @property
    def intensity(self) -> NDArray[np.float32]:
        """(z, y, x) float32 square of the amplitude, to stand beside I = |U|^2."""
        return self.amplitude**2

    @property
    def falloff_power(self) -> float:
        """Power of 1/depth left in the intensity that `compensate_falloff` should undo for the eye."""
        return 0.0 if self.solver in ("lct", "fk") else 4.0


def baseline_image(
    capture: Capture,
    grid: VoxelGrid,
    *,
    solver: Baseline,
    fades: Fades | None = None,
    snr: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> BaselineImage:
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
    if solver == "lct" and snr is None:
        snr = lct.SNR
    _check(capture, grid, solver, snr)
    notes: list[str] = []
    if solver == "bp":
        amplitude = ellipsoids.backproject(capture, grid, fades, progress)
    elif solver == "laplacian-fbp":
        amplitude = ellipsoids.laplacian_filtered(capture, grid, fades, progress)
    elif solver == "log-fbp":
        amplitude = ellipsoids.log_filtered(capture, grid, fades, progress)
    else:
        lattice = ConfocalLattice.of(capture, solver)
        notes = lattice.notes()
        if snr is not None:
            amplitude = lct.reconstruct(capture, lattice, grid, fades, snr=snr, progress=progress)
        else:
            amplitude = fk.reconstruct(capture, lattice, grid, fades, progress=progress)
    return BaselineImage(grid, amplitude, solver, fades, snr, tuple(notes))


def _check(capture: Capture, grid: VoxelGrid, solver: str, snr: float | None) -> None:
    if solver not in BASELINES:
        raise ParameterError(
            "solver", repr(solver), "there is no such baseline", f"Choose one of {', '.join(BASELINES)}."
        )
    if snr is not None and not (snr > 0 and solver == "lct"):
        raise ParameterError(
            f"solver {solver}",
            f"a signal-to-noise ratio of {snr}",
            "it is not positive" if solver == "lct" else "it has no such filter",
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
