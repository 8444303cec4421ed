"""Draw docs/images/scenes.png: depth maps of all built-in scenes, as the wall sees them (seconds).

python docs/figures/scenes.py
"""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from rig.model.colours import DEPTH_COLOURS, NO_SURFACE
from rig.show.saving import save
from rig.show.volume import X_LABEL
from simulators.scenes import SCENES, scene

PICTURE = Path(__file__).parents[1] / "images" / "scenes.png"
#: Points of the aperture, off the edges that scenes have at whole centimetres [m].
X_M, Y_M = np.arange(-0.9, 0.9, 0.005) + 1e-4, np.arange(-0.65, 0.65, 0.005) + 1e-4
SCALE = Normalize(0.6, 3.0)


def main() -> None:
    """Draw a panel for each scene."""
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 5, sharex=True, sharey=True)
    for axes in panels.flat[len(SCENES) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, SCENES, strict=False):
        drawn = axes.imshow(
            scene(name).depth_map(X_M, Y_M)[:, ::-1],
            extent=(X_M[-1], X_M[0], Y_M[0], Y_M[-1]),
            origin="lower",
            cmap=DEPTH_COLOURS,
            norm=SCALE,
            interpolation="nearest",
        )
        axes.set_facecolor(NO_SURFACE)
        axes.set_title(name, size=10)
        axes.tick_params(labelsize=8)
    figure.supxlabel(X_LABEL, size=9)
    figure.supylabel("y (m)", size=9)
    figure.colorbar(drawn, ax=panels, label="depth z (m), blank: nothing", shrink=0.9)
    save(figure, PICTURE)


if __name__ == "__main__":
    main()
