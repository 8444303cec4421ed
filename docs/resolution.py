"""Make the table and the picture of resolution.md: the image of one point, measured beside theory.

Run from the repository's root: ``python docs/resolution.py``.
"""

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.measures import predicted, pulse_depth_m, widths
from recon.result import Image
from recon.wave import CYCLES, VirtualPulse

#: The paper's wall: 180 x 130 positions, 1 cm apart; and its wavelength.
COLUMNS, ROWS, PITCH_M = 180, 130, 0.01
WAVELENGTH_M = 0.04
DEPTHS_M = (0.6, 1.0, 1.5, 2.5)
BIN_WIDTH_S = 16e-12


def point(depth_m: float, confocal: bool) -> Image:
    """Image a point before the wall's middle; its counts fall as 1/(r_p r_c)^2, without noise."""
    x_m, y_m = np.meshgrid(
        (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * PITCH_M, (np.arange(ROWS) - (ROWS - 1) / 2) * PITCH_M
    )
    laser_m = np.column_stack([x_m.ravel(), y_m.ravel(), np.zeros(x_m.size)])
    detector_m = laser_m if confocal else np.zeros((1, 3))
    place_m = np.array([0.0, 0.0, depth_m])
    legs_m = [np.linalg.norm(spots_m - place_m, axis=1) for spots_m in (laser_m, detector_m)]
    path_s = (legs_m[0] + legs_m[1]) / C_M_PER_S
    first_bin_s = path_s.min() - 1e-9
    counts = _records(path_s - first_bin_s, 1 / (legs_m[0] * legs_m[1]) ** 2)
    capture = Capture(ArrayHistograms(counts), BIN_WIDTH_S, np.array([first_bin_s]), laser_m, detector_m)
    across_m = np.arange(-60, 61) * 0.0025
    along_m = depth_m + np.arange(-30, 31) * 0.01
    return image(capture, VirtualPulse(WAVELENGTH_M), VoxelGrid(across_m, across_m, along_m))


def _records(delay_s: NDArray[np.float64], strength: NDArray[np.float64]) -> NDArray[np.float32]:
    """Give each record one arrival, shared between the two bins whose centres are around it."""
    at = delay_s / BIN_WIDTH_S - 0.5
    before = np.floor(at).astype(int)
    # a nanosecond beyond the last arrival, so that the record's soft end touches none
    counts = np.zeros((len(at), before.max() + round(1e-9 / BIN_WIDTH_S)), np.float32)
    rows = np.arange(len(at))
    counts[rows, before] = strength * (1 - (at - before))
    counts[rows, before + 1] = strength * (at - before)
    return counts


@cache
def rows(confocal: bool, depths_m: tuple[float, ...] = DEPTHS_M) -> list[list[float]]:
    """Return a row of the table for each depth and direction: L and d [m], then lengths [cm]."""
    found = []
    for depth_m in depths_m:
        focused = point(depth_m, confocal)
        grid = focused.grid
        measured = widths(focused.intensity, grid.x_m, grid.y_m, grid.z_m)
        for width, count in ((measured.x, COLUMNS), (measured.y, ROWS)):
            bound = predicted(WAVELENGTH_M, depth_m, count * PITCH_M)
            sides = 2 if confocal else 1
            paraxial_m = bound.both_m if confocal else bound.one_m
            lengths_m = (
                width.fwhm_m,
                bound.slit_fwhm_m / sides,
                width.first_minimum_m,
                bound.slit_zero_m / sides,
                paraxial_m,
                bound.near_m / sides,
                measured.z.fwhm_m,
            )
            found.append([depth_m, count * PITCH_M, *(100 * length_m for length_m in lengths_m)])
    return found


def table(confocal: bool) -> str:
    """Return the rows as the page shows them."""
    factor = "0.61" if confocal else "1.22"
    sine = "4 sin θ" if confocal else "2 sin θ"
    head = (
        f"| L | d | FWHM | 0.886 λ/({sine}) | first minimum | λ/({sine}) | {factor} λL/d | 1.22 λ/({sine}) "
        "| FWHM over depth |"
    )
    lines = [head, "|" + " ---: |" * 9]
    for depth_m, width_m, *lengths_cm in rows(confocal):
        cells = [f"{depth_m:g} m", f"{width_m:g} m", *(f"{length_cm:.2f}" for length_cm in lengths_cm)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw(path: Path) -> None:
    """Draw profiles through the point, and widths over depth beside the formulas."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for number, depth_m in enumerate(DEPTHS_M):
        focused = point(depth_m, False)
        k, j, _ = np.unravel_index(focused.intensity.argmax(), focused.intensity.shape)
        profile = focused.intensity[k, j] / focused.intensity.max()
        left.plot(100 * focused.grid.x_m, profile, color=f"C{number}", label=f"{depth_m:g} m")
    left.axhline(0.5, color="0.8", linewidth=0.8, zorder=0)
    left.set(xlabel="x [cm]", ylabel="intensity", xlim=(-12, 12), title="A point along x, one detector spot")
    left.legend(title="depth", frameon=False)
    depths_m = np.linspace(0.4, 2.6, 100)
    for width_m, name, colour in ((COLUMNS * PITCH_M, "x", "C0"), (ROWS * PITCH_M, "y", "C1")):
        bounds = [predicted(WAVELENGTH_M, float(depth_m), width_m) for depth_m in depths_m]
        right.plot(depths_m, [100 * bound.slit_fwhm_m for bound in bounds], colour)
        right.plot(depths_m, [50 * bound.slit_fwhm_m for bound in bounds], colour, linestyle=":")
        paraxial = [88.6 * WAVELENGTH_M * depth_m / width_m for depth_m in depths_m]
        right.plot(depths_m, paraxial, colour, linewidth=0.7, linestyle="--")
        for confocal, marker in ((False, "o"), (True, "s")):
            measured = [row[2] for row in rows(confocal) if row[1] == width_m]
            label = f"{name}, {'confocal' if confocal else 'one detector spot'}"
            right.plot(DEPTHS_M, measured, colour + marker, markersize=4, label=label)
    right.set(
        xlabel="depth L [m]", ylabel="FWHM [cm]", ylim=(0, 8.5), title="0.886 λ/(2 sin θ); dashed: paraxial"
    )
    right.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    for both in (False, True):
        print(table(both), end="\n\n")
    print(f"the pulse alone over depth: {100 * pulse_depth_m(WAVELENGTH_M, CYCLES):.2f} cm")
    draw(Path(__file__).parent / "images" / "psf.png")
