"""Make the pictures of docs/tutorial from the files that its commands made.

    python docs/figures/tutorial.py FOLDER docs/images

`tutorial_letters.png` and `tutorial_plot.png` are pictures of the commands, smaller;
`tutorial_wavelengths.png` has the front views of three volumes.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from small import shrink

from rig.files.volume import read_volume
from rig.model.colours import AMPLITUDE_COLOURS
from rig.show.saving import save
from rig.show.volume import draw_front

VOLUMES = {
    "letters-2-volume.h5": "20 cm",
    "letters-volume.h5": "5.25 cm, as chosen",
    "letters-3-volume.h5": "3 cm",
    "arrow-volume.h5": "the arrow",
}
#: Width of the stored pictures [pixels].
WIDTH = 1000


def main(folder: Path, images: Path) -> None:
    """Make all three."""
    shrink(folder / "letters.png", images / "tutorial_letters.png", WIDTH)
    shrink(folder / "letters-plot.png", images / "tutorial_plot.png", WIDTH)
    figure = Figure(figsize=(12, 2.6), layout="constrained")
    panels = figure.subplots(1, len(VOLUMES), sharey=True)
    for axes, (name, title) in zip(panels, VOLUMES.items(), strict=True):
        volume = read_volume(folder / name)
        # the amplitude that rig recon shows
        amplitude = np.sqrt(volume.intensity * volume.z_m[:, None, None] ** 4).max(axis=0)
        shown = draw_front(
            axes, amplitude / amplitude.max(), volume.x_m, volume.y_m, AMPLITUDE_COLOURS, Normalize(0, 1)
        )
        axes.set_title(title)
        axes.label_outer()
    figure.colorbar(shown, ax=panels, label="amplitude / maximum")
    save(figure, images / "tutorial_wavelengths.png")
    shrink(images / "tutorial_wavelengths.png", width=WIDTH)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
