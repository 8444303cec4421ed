"""Two hidden squares by all lasers and all pixels, and with one of them lit: docs/exhaustive.md.

    python docs/figures/exhaustive.py

It prints the numbers of the page (about a minute of CPU time).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon.by_lasers import image
from recon.capture import C_M_PER_S
from recon.exhaustive import ArrayLaserHistograms, Exhaustive
from recon.grid import VoxelGrid
from recon.imaging import plan, planes
from recon.relight import Relit, SeparatingCamera
from recon.wave import VirtualPulse
from recon.window import Window
from rig.bench.render import even_grid
from rig.model.colours import AMPLITUDE_COLOURS
from rig.show.saving import save
from simulators.scenes import Mesh, Scene
from simulators.transport.each_with_each import EachWithEach
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport

PICTURE = Path(__file__).parents[1] / "images" / "exhaustive.png"
LASER_M, PIXEL_M = even_grid(12, 12, 1.2, 1.2), even_grid(24, 24, 1.2, 1.2)
BIN_S, BINS = 32e-12, 560
PULSE = VirtualPulse(0.10)
#: Middle of each square, and where its front looks in x and z.
SQUARES = {
    "A": ((-0.35, 0.0, 0.85), (1.0, -1.0)),
    "B": ((0.35, 0.0, 0.85), (-1.0, -1.0)),
}
SIDE_M = 0.2
GRID = VoxelGrid(-0.575 + 0.05 * np.arange(24), -0.125 + 0.05 * np.arange(6), 0.6 + 0.025 * np.arange(21))


def scene() -> Scene:
    """Return the squares."""
    meshes = []
    for name, (centre_m, front) in SQUARES.items():
        along = np.array([-front[1], 0.0, front[0]]) / np.hypot(*front) * SIDE_M / 2
        up = np.array([0.0, SIDE_M / 2, 0.0])
        corners_m = np.array(
            [np.add(centre_m, a * along + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        )
        meshes.append(Mesh(name, corners_m, np.array([[0, 1, 2], [0, 2, 3]]), 0.9))
    return Scene("squares", tuple(meshes))


def rendered(bounces: int) -> Exhaustive:
    """Render all pairs."""
    built = scene()
    each = EachWithEach(Transport(tessellate(built, 0.05), built.triangles_m, bounces=bounces), PIXEL_M)
    counts = np.stack([each.transients(tuple(spot), BINS, BIN_S) for spot in LASER_M])
    return Exhaustive(ArrayLaserHistograms(counts), BIN_S, np.zeros((1, 1)), LASER_M, PIXEL_M)


def parts(lit: Relit, grid: VoxelGrid, later_s: NDArray[np.float64]) -> NDArray[np.floating]:
    """Return |U| of direct, first-order and later light, (2 + later, z, y, x)."""
    problem = plan(lit.outline(), PULSE, grid, SeparatingCamera(later_s), Window())
    fields = np.stack(list(planes(replace(problem, spectra=lit.spectra), "rsd")), axis=1)
    return np.abs(fields)


def top(axes: Axes, amplitude: NDArray[np.floating], title: str, most: float) -> None:
    """Draw the greatest amplitude over y, seen from above."""
    x_m, z_m = GRID.x_m, GRID.z_m
    step = 0.025
    extent = (x_m[-1] + step, x_m[0] - step, z_m[0] - step / 2, z_m[-1] + step / 2)
    axes.imshow(
        amplitude.max(axis=1)[:, ::-1],
        origin="lower",
        extent=extent,
        cmap=AMPLITUDE_COLOURS,
        vmin=0,
        vmax=most,
    )
    for name, ((x, _, z), front) in SQUARES.items():
        along = np.array([-front[1], front[0]]) / np.hypot(*front) * SIDE_M / 2
        axes.plot([x - along[0], x + along[0]], [z - along[1], z + along[1]], color="white", lw=0.8, ls=":")
        axes.text(x, z + 0.07, name, color="white", ha="center")
    axes.set(title=title, xlabel="← x (m)", ylabel="depth z (m)", aspect="equal")
    axes.title.set_fontsize(9)


def main() -> None:
    """Draw the figure and print its numbers."""
    a_m, b_m = (np.array(SQUARES[name][0]) for name in "AB")
    captures = {bounces: rendered(bounces) for bounces in (3, 4)}
    lit = {bounces: Relit(capture, a_m) for bounces, capture in captures.items()}
    both = image(captures[4], PULSE, GRID)
    direct, first = parts(lit[4], GRID, np.empty(0))
    _, alone = parts(lit[3], GRID, np.empty(0))
    # on B's side of the middle the light of A itself, out of focus, has passed
    beyond = np.broadcast_to(GRID.x_m > 0.2, first.shape)
    figure = Figure(figsize=(11.5, 6.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    amplitude = both.amplitude * (GRID.z_m / GRID.z_m[-1])[:, None, None] ** 2
    voxels_m = np.stack(np.meshgrid(GRID.z_m, GRID.y_m, GRID.x_m, indexing="ij"), axis=-1)[..., ::-1]
    most = first[np.linalg.norm(voxels_m - b_m, axis=-1) < SIDE_M / 2].max()
    share = most / direct.max()
    top(axes[0, 0], amplitude, "all lit, both sides focused", amplitude.max())
    top(axes[0, 1], direct, "A lit, t = 0: direct light", direct.max())
    top(axes[0, 2], first * beyond, f"A lit, t = |v - A|/c, x > 20 cm; {1 / share:.0f} times as bright", most)
    top(axes[1, 0], alone * beyond, "the same without light from A to B", most)
    over_time(axes[1, 1], lit, b_m, float(direct.max()))
    axes[1, 2].plot(*LASER_M[:, :2].T, "r.", ms=5, label="laser spots")
    axes[1, 2].plot(*PIXEL_M[:, :2].T, "b.", ms=1.5, label="pixels")
    axes[1, 2].set(xlabel="← x (m)", ylabel="y (m)", aspect="equal")
    axes[1, 2].set_title("on the wall: 144 laser spots, 576 pixels", fontsize=9)
    axes[1, 2].invert_xaxis()
    axes[1, 2].legend(fontsize=8, loc="upper right")
    save(figure, PICTURE)
    for what, one in {"direct": direct, "first order": first * beyond, "without": alone * beyond}.items():
        z, _, x = np.unravel_index(one.argmax(), one.shape)
        print(f"{what}: {one.max() / direct.max():.4f} at x {GRID.x_m[x]:.3f} m, z {GRID.z_m[z]:.3f} m")


def over_time(axes: Axes, lit: dict[int, Relit], place_m: NDArray[np.float64], unit: float) -> None:
    """Draw what is seen at a place over time, with and without light between the squares."""
    times_s = 25e-12 * np.arange(-20, 200)
    straight_s = float(np.linalg.norm(place_m - lit[4].point_m)) / C_M_PER_S
    voxel = VoxelGrid(*(np.array([one]) for one in place_m))
    around = np.abs(times_s - straight_s) < 0.3e-9
    for bounces, relit in lit.items():
        seen = parts(relit, voxel, times_s - straight_s)[2:, 0, 0, 0] / unit
        axes.semilogy(times_s * 1e9, seen, label=f"up to {bounces} bounces")
        peak_s = times_s[around][seen[around].argmax()]
        print(f"{bounces} bounces: {seen[around].max():.4f} of the direct light at {peak_s * 1e9:.3f} ns")
    print(f"|B - A|/c is {straight_s * 1e9:.3f} ns")
    axes.axvline(straight_s * 1e9, color="0.4", ls=":", label="|B - A|/c")
    axes.set(xlabel="t after A is lit (ns)", ylabel="|U| / direct", ylim=(1e-4, 1))
    axes.set_title("A lit: amplitude at B", fontsize=9)
    axes.legend(fontsize=8)


if __name__ == "__main__":
    main()
