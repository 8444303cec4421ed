"""Draw the pictures of ``docs/baselines.md``: one scan by every baseline and by the phasor field.

python docs/figures/baselines.py SU_SCAN.h5 FOUR_SCAN.h5      after `rig import` of the published measurements
"""

import sys
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from small import shrink

from recon.capture import Capture
from recon.defaults import voxels
from recon.depth import compensate_falloff
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.registry import CLASSIC_SOLVERS
from recon.solvers.classic.solve import baseline_image
from recon.wave import VirtualPulse
from recon.window import Window
from rig.files.scan import ScanFile
from rig.model.colours import AMPLITUDE_COLOURS
from rig.show.saving import save
from rig.show.volume import draw_front

IMAGES = Path(__file__).parents[1] / "images"


def compare(
    capture: Capture, grid: VoxelGrid, pulse: VirtualPulse, window: Window
) -> dict[str, tuple[NDArray[np.float32], float]]:
    """Image a capture by all methods.

    Returns
    -------
    dict
        For each method the (z, y, x) amplitude, linear in counts and compensated for its fall-off with depth,
        and the processor seconds that it took, once compiled.
    """

    def by(solver: str) -> NDArray[np.float32]:
        if solver == "rsd":
            field = image(capture, pulse, grid, window=window).field
            return np.abs(compensate_falloff(field, grid.z_m))
        result = baseline_image(capture, grid, solver=solver, window=window)
        return compensate_falloff(result.amplitude, grid.z_m, result.falloff_power / 2)

    results = {}
    for solver in (*CLASSIC_SOLVERS, "rsd"):
        by(solver)
        began_s = process_time()
        amplitude = by(solver)
        results[solver] = amplitude, process_time() - began_s
    return results


def draw(results: dict[str, tuple[NDArray[np.float32], float]], grid: VoxelGrid, path: Path) -> None:
    """Draw the front views side by side."""
    figure = Figure(figsize=(11, 7), layout=ConstrainedLayoutEngine(w_pad=0.08))
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for axes, (solver, (amplitude, took_s)) in zip(panels.flat, results.items(), strict=True):
        front = amplitude.max(axis=0)
        shown = draw_front(axes, front / front.max(), grid.x_m, grid.y_m, AMPLITUDE_COLOURS, Normalize(0, 1))
        axes.label_outer()
        name = "phasor field (rsd)" if solver == "rsd" else solver
        axes.set_title(f"{name}, {took_s:.1f} s of one core")
    figure.colorbar(shown, ax=panels, label="amplitude / maximum", shrink=0.6)
    save(figure, path)
    shrink(path)


def main(su: str, four: str) -> None:
    """Write both pictures."""
    for scan_path, name, wavelength_m, finer, depth_m in (
        (su, "baselines_su", 0.04, 1, (0.45, 1.2, 0.01)),
        (four, "baselines_four", 0.06, 2, (0.7, 1.2, 0.01)),
    ):
        with ScanFile(scan_path) as scan:
            capture, window = scan.capture(), Window(start_s=scan.fade_from_s)
            pulse = VirtualPulse(wavelength_m)
            side_m = float(np.diff(np.unique(capture.laser_m[:, 0])).max()) / finer
            grid = voxels(capture, pulse, voxel_m=side_m, depth_m=depth_m)
            draw(compare(capture, grid, pulse, window), grid, IMAGES / f"{name}.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
