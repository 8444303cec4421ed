"""Draw a mirror that is met at an angle: its mount, and what that does to a grid of commands on the wall.

    python docs/figures/mount.py docs/images

It makes ``mount.png``; all beams and spots are those of `rig.model.pointing.Pointing`.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from small import shrink

from rig.model.pointing import Pointing
from rig.show.saving import save
from rig.show.volume import X_LABEL

DISTANCE_M = 2.5
INCIDENCE_DEG, COMMAND_DEG = 22.5, 18.0
DARK, GREEN, RED, BLUE = "0.25", "#2a9d4a", "#c0392b", "#2166ac"


def draw_mount(axes: Axes) -> None:
    """Draw mirror, normal and beams in the plane of incidence."""
    incidence, command = np.radians([INCIDENCE_DEG, COMMAND_DEG])
    pointing = Pointing((0.0, 0.0, DISTANCE_M), incidence_rad=(incidence, 0.0))
    pivot = np.array([0.0, DISTANCE_M])
    axes.axhline(0, color=DARK, linewidth=3)
    axes.text(2.2, -0.2, "wall, z = 0", color=DARK)
    source = np.array([np.sin(2 * incidence), -np.cos(2 * incidence)])
    axes.annotate("", pivot, pivot + 1.6 * source, arrowprops={"arrowstyle": "-|>", "color": GREEN})
    axes.text(
        *(pivot + 1.62 * source),
        "the beam comes\nfrom here:\nincidence_direction\n= 0deg (x)",
        va="top",
        ha="right",
    )
    for angle, color, style, name in (
        (0.0, DARK, "-", "at rest"),
        (command, RED, "--", f"command x = {COMMAND_DEG:g} deg"),
    ):
        x_m = float(pointing.spots_m((angle, 0.0))[0])
        axes.annotate(
            "", (x_m, 0.0), pivot, arrowprops={"arrowstyle": "-|>", "color": color, "linestyle": style}
        )
        axes.text(
            x_m + (0.05 if angle else -0.05),
            0.06,
            name,
            color=color,
            fontsize=9,
            ha="right" if angle else "left",
        )
        lean = incidence + angle / 2
        normal, face = np.array([np.sin(lean), -np.cos(lean)]), np.array([np.cos(lean), np.sin(lean)])
        axes.plot(*np.transpose([pivot - 0.4 * face, pivot + 0.4 * face]), color=color, linewidth=3)
        axes.plot(*np.transpose([pivot, pivot + 0.95 * normal]), ":", color=color)
    for start in (0.0, incidence):
        turned = start + np.linspace(0.0, incidence, 20)
        axes.plot(0.62 * np.sin(turned), DISTANCE_M - 0.62 * np.cos(turned), color=BLUE, linewidth=1)
        place = (0.72 * np.sin(turned[10]), DISTANCE_M - 0.72 * np.cos(turned[10]))
        axes.text(*place, "i", color=BLUE, ha="center", va="center")
    axes.set(xlim=(2.3, -1.4), ylim=(-0.35, 3.1), aspect="equal", xlabel=X_LABEL, ylabel="z (m)")
    axes.set_title(f"plane of incidence, i = incidence = {INCIDENCE_DEG:g} deg; dotted: normals")


def draw_wall(axes: Axes) -> None:
    """Draw where the commands of an even grid lead."""
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 10), np.linspace(-0.65, 0.65, 8))
    commands = np.arctan(np.stack([x, y], axis=-1) / DISTANCE_M)
    for degrees, color in ((0.0, "0.7"), (22.5, BLUE), (45.0, RED)):
        pointing = Pointing((0.0, 0.0, DISTANCE_M), incidence_rad=(np.radians(degrees), 0.0))
        spots_m = pointing.spots_m(commands)
        for lines in (spots_m, spots_m.swapaxes(0, 1)):
            for line in lines:
                axes.plot(line[:, 0], line[:, 1], color=color, linewidth=1)
        axes.plot([], color=color, label=f"incidence {degrees:g} deg")
    axes.set(aspect="equal", xlabel=X_LABEL, ylabel="y (m)", title="the same commands, on the wall")
    axes.xaxis.set_inverted(True)


if __name__ == "__main__":
    figure = Figure(figsize=(13, 5.5), layout="constrained")
    mount, wall = figure.subplots(1, 2, width_ratios=(1, 1.1))
    draw_mount(mount)
    draw_wall(wall)
    figure.legend(*wall.get_legend_handles_labels(), loc="outside lower right", ncols=3, frameon=False)
    picture = Path(sys.argv[1]) / "mount.png"
    save(figure, picture)
    shrink(picture)
