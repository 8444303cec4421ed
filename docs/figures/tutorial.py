"""Make the pictures of docs/tutorial from the files that its commands made.

    python docs/figures/tutorial.py FOLDER docs/images

`tutorial_letters.png` and `tutorial_plot.png` are pictures of the commands, smaller;
`tutorial_wavelengths.png` has the front views of three volumes.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from rig.files.volume import read_volume
from rig.show.volume import draw_front, save

VOLUMES = {
    "letters-2-volume.h5": "20 cm",
    "letters-volume.h5": "5.25 cm, as chosen",
    "letters-3-volume.h5": "3 cm",
    "arrow-volume.h5": "the arrow",
}
#: Width in pixels and number of colours of the stored pictures, to keep them small.
WIDTH, COLOURS = 1000, 128


def shrink(source: Path, target: Path) -> None:
    """Write a picture with fewer pixels and colours."""
    with Image.open(source) as full:
        height = round(full.height * WIDTH / full.width)
        small = full.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
    small.quantize(COLOURS).save(target, optimize=True)


def main(folder: Path, images: Path) -> None:
    """Make all three."""
    shrink(folder / "letters.png", images / "tutorial_letters.png")
    shrink(folder / "letters-plot.png", images / "tutorial_plot.png")
    figure = Figure(figsize=(13, 2.9), layout="constrained")
    for axes, (name, title) in zip(figure.subplots(1, len(VOLUMES)), VOLUMES.items(), strict=True):
        volume = read_volume(folder / name)
        # the amplitude that rig recon shows
        amplitude = np.sqrt(volume.intensity * volume.z_m[:, None, None] ** 4).max(axis=0)
        draw_front(axes, amplitude, volume.x_m, volume.y_m, "inferno")
        axes.set_title(title)
    save(figure, images / "tutorial_wavelengths.png")
    shrink(images / "tutorial_wavelengths.png", images / "tutorial_wavelengths.png")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
