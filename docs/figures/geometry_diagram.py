"""Draw how light goes: laser, relay wall, hidden object, wall, detector; and what is counted of it.

    python docs/figures/geometry_diagram.py docs/images

It makes ``geometry.png``. The room is drawn from above, in the program's frame: x to the right for one who
faces the wall, y up, z out of the wall. Times follow from the lengths that are drawn.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from recon.capture import C_M_PER_S
from rig.show.saving import save

X_P, X_C = np.array([-0.55, 0.0]), np.array([0.1, 0.0])  # x and z in metres
HIDDEN = np.array([0.95, 1.2])
LASER, DETECTOR = np.array([-0.55, 2.55]), np.array([0.0, 2.55])
DARK, GREEN, BLUE, RED = "0.25", "#1b8a3c", "#2166ac", "#b2182b"


def beside(place: np.ndarray, x_m: float, z_m: float) -> tuple[float, float]:
    """Return a place next to another one."""
    return place[0] + x_m, place[1] + z_m


def draw_room(axes: Axes) -> None:
    """Draw wall, rig, screen and hidden object from above."""
    axes.fill_between([-1.35, 1.5], -0.12, 0.0, color="0.75")
    axes.text(-1.33, 0.17, "relay wall, z = 0", color=DARK)
    axes.plot([-0.9, 0.9], [0.0, 0.0], color="#e08214", linewidth=5, solid_capstyle="butt")
    axes.text(0.72, 0.32, "scanned part:\nthe virtual aperture", color="#e08214")
    axes.fill_betweenx([0.95, 2.75], 0.42, 0.48, color="0.45")
    axes.text(0.52, 2.35, "screen: the rig\ndoes not see\nwhat is behind it", color=DARK, va="center")
    axes.plot([HIDDEN[0] - 0.22, HIDDEN[0] + 0.22], [HIDDEN[1]] * 2, color=RED, linewidth=6)
    axes.text(*beside(HIDDEN, 0.0, 0.14), "hidden object", color=RED, ha="center", va="top")
    for place, name, color in ((LASER, "laser and\ngalvo mirror", GREEN), (DETECTOR, "detector", BLUE)):
        axes.plot(*place, "s", color=color, markersize=12)
        axes.text(*beside(place, 0.0, 0.12), name, color=color, ha="center", va="top")
    for start, end, color in (
        (LASER, X_P, GREEN),
        (X_P, HIDDEN, GREEN),
        (HIDDEN, X_C, BLUE),
        (X_C, DETECTOR, BLUE),
    ):
        axes.annotate(
            "", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "shrinkA": 6, "shrinkB": 4}
        )
    axes.plot(*X_P, "o", color=GREEN, markersize=9)
    axes.plot(*X_C, "o", color=BLUE, markersize=9)
    axes.text(X_P[0], -0.2, "laser spot $x_p$\n(it moves)", color=GREEN, ha="center")
    axes.text(X_C[0], -0.2, "detector spot\n$x_c$", color=BLUE, ha="center")
    axes.text(*beside(X_P + 0.3 * (HIDDEN - X_P), -0.1, 0.14), "$r_p$", color=GREEN, fontsize=15)
    axes.text(*beside((X_C + HIDDEN) / 2, 0.07, -0.02), "$r_c$", color=BLUE, fontsize=15)
    draw_axes(axes)
    axes.set(xlim=(-1.4, 1.55), ylim=(2.9, -0.45), aspect="equal")
    axes.set_axis_off()
    axes.set_title("the room, seen from above (not to scale)")


def draw_axes(axes: Axes) -> None:
    """Draw the frame, beside where it begins so that nothing is hidden."""
    begin = np.array([-1.2, 1.2])
    for step, name in (([0.35, 0.0], "x"), ([0.0, 0.35], "z")):
        axes.annotate("", begin + step, begin, arrowprops={"arrowstyle": "-|>", "color": "black"})
        axes.text(*(begin + 1.25 * np.array(step)), name, ha="center", va="center", fontsize=12)
    axes.plot(*begin, "o", color="white", markeredgecolor="black", markersize=10)
    axes.plot(*begin, ".", color="black")
    axes.text(*beside(begin, -0.12, -0.06), "y, up", ha="right", va="center")


def draw_times(axes: Axes) -> None:
    """Draw what is counted at one laser spot: the first bounce, which is gated off, and hidden light."""
    t_ns = np.linspace(-2.0, 16.0, 1000)
    path_m = float(np.linalg.norm(HIDDEN - X_P) + np.linalg.norm(X_C - HIDDEN))
    back_ns = 1e9 * path_m / C_M_PER_S
    counts = 0.6 * np.exp(-(((t_ns - back_ns) / 0.35) ** 2)) + 0.03
    first = np.exp(-((t_ns / 0.2) ** 2))
    open_ = t_ns > 2.5
    axes.fill_between(t_ns, 0, 1.15, where=~open_, color="0.9")
    axes.text(0.25, 1.08, "gate closed", color=DARK, ha="center")
    axes.plot(t_ns[~open_], first[~open_], "--", color="0.55")
    axes.plot(t_ns[open_], counts[open_], color=BLUE)
    axes.annotate("first bounce:\nnot counted", (0.15, 0.6), (3.1, 0.75), arrowprops={"arrowstyle": "->"})
    axes.annotate(
        f"third bounce\n$t = (r_p + r_c)\\,/\\,c$\n= {path_m:.2f} m / c = {back_ns:.1f} ns",
        (back_ns, 0.63),
        (back_ns, 0.8),
        ha="center",
        arrowprops={"arrowstyle": "->"},
    )
    axes.text(4.2, 0.07, "dark counts, room light", color=DARK, fontsize=9)
    axes.set(xlim=(-2, 16), ylim=(0, 1.15), yticks=[], ylabel="photons in a bin")
    axes.set_xlabel("rectified time t (ns): 0 is the pulse on the wall")
    axes.set_title("transient of this laser spot")


def main(folder: Path) -> None:
    """Draw both and save them."""
    figure = Figure(figsize=(13, 6.6), layout="constrained")
    room, times = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    draw_room(room)
    draw_times(times)
    save(figure, folder / "geometry.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
