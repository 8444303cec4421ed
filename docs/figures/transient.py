"""Draw docs/images/transient.png: a flash between two boards, light of three bounces beside that of more.

Two small boards half face each other and half face the wall. Light is simulated without noise, once of three
bounces and once of four and five, so that what is seen in a frame can be told apart: in a measurement both
come together.

    python docs/figures/transient.py docs/images/transient.png
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from small import shrink

from recon.camera import TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.filming import video
from recon.grid import VoxelGrid
from recon.wave import VirtualPulse
from rig.model.colours import AMPLITUDE_COLOURS
from rig.show.saving import save
from rig.show.volume import X_LABEL, draw_front
from simulators.scenes.mesh import Scene
from simulators.scenes.solids import quads_mesh
from simulators.transport.light_paths import transients
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport

SPACING_M, COLUMNS, ROWS = 0.04, 45, 33
#: Longest edge of a patch: a tenth of the wavelength.
PATCH_M = 0.01
DETECTOR_M = np.array([[0.0, 0.0, 0.0]])
BIN_S, BINS = 32e-12, 900
#: A longer pulse would not tell light that comes one board's distance later.
PULSE = VirtualPulse(0.1, cycles=3)
#: Boards: their middles, side, and distance from each other [m].
MIDDLES_M, SIDE_M = ((-0.35, 0.0, 0.9), (0.35, 0.0, 0.9)), 0.16
#: Frames that are drawn, and the moments at which light is weighed [s].
SHOWN_S = np.array([2.6e-9, 3.2e-9, 4.4e-9, 5.8e-9, 6.2e-9])
TIMES_S = np.arange(2e-9, 8.1e-9, 0.2e-9)
#: The boards' depth and a little beside it: a camera with one aperture tells depth by focus alone.
GRID = VoxelGrid.from_spec(1.0, 0.7, 0.02, (0.84, 0.97, 0.03))


def boards() -> Scene:
    """Return two upright boards, each turned by 45 degrees towards the other and the wall."""
    half_m, meshes = SIDE_M / 2, []
    for name, (x, y, z) in zip(("left", "right"), MIDDLES_M, strict=True):
        along = np.array([1.0, 0.0, np.sign(-x)]) / np.sqrt(2) * half_m
        up = np.array([0.0, half_m, 0.0])
        corners = [np.array([x, y, z]) + a * along + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        meshes.append(quads_mesh(name, np.array([corners]), albedo=0.9))
    return Scene("boards", tuple(meshes))


def wall() -> NDArray[np.float64]:
    """Return the laser spots, (P, 3)."""
    x, y = np.meshgrid(np.arange(COLUMNS) - (COLUMNS - 1) / 2, np.arange(ROWS) - (ROWS - 1) / 2)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * SPACING_M


def simulate(hidden: Scene) -> tuple[Capture, Capture]:
    """Return noise-free captures of light of three bounces, and of four and five."""
    transport = Transport(tessellate(hidden, PATCH_M), hidden.triangles_m, bounces=5)
    laser_m, edges_s = wall(), BIN_S * np.arange(BINS + 1)
    captures = []
    for paths in transport.light_paths(tuple(DETECTOR_M[0])):
        light = transients((paths,), laser_m, edges_s).astype(np.float32)
        captures.append(Capture(ArrayHistograms(light), BIN_S, np.zeros(1), laser_m, DETECTOR_M))
    return captures[0], captures[1]


def film(capture: Capture, times_s: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the greatest intensity over depth at moments, (T, y, x)."""
    return video(capture, PULSE, GRID, TransientCamera(times_s)).intensity


def main(path: str) -> None:
    """Simulate, film both parts, say how much of each moment's light each is, and draw."""
    captures = simulate(boards())
    several, weighed = [film(part, TIMES_S) for part in captures], []
    print("moment: light of three bounces, of four and five, share of the latter")
    for moment, time_s in enumerate(TIMES_S):
        three, more = weighed_now = [float(part[moment].sum()) for part in several]
        weighed.append(weighed_now)
        print(f"{time_s * 1e9:5.2f} ns: {three:.2e}, {more:.2e}, {more / (three + more):.1%}")
    draw([film(part, SHOWN_S) for part in captures], np.array(weighed), path)


def draw(frames: list[NDArray[np.float32]], weighed: NDArray[np.float64], path: str) -> None:
    """Draw both parts, each moment to one scale of its own, and the light of each over time."""
    seen = np.sqrt(frames)
    greatest = seen.max(axis=(0, 2, 3))
    figure = Figure(figsize=(13, 7.5), layout=ConstrainedLayoutEngine())
    FigureCanvasAgg(figure)
    above, below = figure.subfigures(2, 1, height_ratios=(2.2, 1))
    axes = above.subplots(2, len(SHOWN_S), sharex=True, sharey=True)
    for row, part, name in zip(axes, seen, ("3 bounces", "4 and 5 bounces"), strict=True):
        for panel, frame, top in zip(row, part, greatest, strict=True):
            draw_front(panel, frame / top, GRID.x_m, GRID.y_m, AMPLITUDE_COLOURS, Normalize(0, 1))
            panel.label_outer()
            panel.set_xlabel("")
        row[0].set_ylabel(f"{name}\ny (m)")
    for panel, time_s, top in zip(axes[0], SHOWN_S, greatest, strict=True):
        panel.set_title(f"{time_s * 1e9:.1f} ns, full scale {top / greatest.max():.2g}")
    above.supxlabel(X_LABEL, size=10)
    line = below.subplots()
    line.semilogy(TIMES_S * 1e9, weighed[:, 0] / weighed.max(), color="black", label="3 bounces")
    line.semilogy(TIMES_S * 1e9, weighed[:, 1] / weighed.max(), color="darkorange", label="4 and 5 bounces")
    for time_s in SHOWN_S:
        line.axvline(time_s * 1e9, color="0.7", linestyle=":", zorder=0)
    line.set(xlabel="time after the flash (ns)", ylabel="intensity, of the greatest", ylim=(1e-8, 2))
    line.set_xlim(TIMES_S[0] * 1e9, TIMES_S[-1] * 1e9)
    line.legend(loc="upper right")
    save(figure, path)
    shrink(Path(path))


if __name__ == "__main__":
    main(*sys.argv[1:])
