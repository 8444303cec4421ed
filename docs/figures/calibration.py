"""Draw docs/images/calibration.png: a misaligned rig's picture before its calibration, and after it.

It takes some minutes. Make it with

    python docs/figures/calibration.py WORK_FOLDER docs/images/calibration.png
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from small import shrink

from recon.depth import compensate_falloff
from rig.files import Volume, read_volume
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS, NO_SURFACE
from rig.show.saving import save
from rig.show.volume import draw_front

CONFIGS = Path(__file__).parents[2] / "configs"
DEPTHS = "0.5m:2m:1cm"
DEPTHS_SHOWN = Normalize(0.9, 1.6)


def rig(folder: Path, *arguments: str) -> str:
    """Run a command of the program in a folder, and return what it prints."""
    print("rig", *arguments, file=sys.stderr)
    command = [sys.executable, "-m", "rig", *arguments]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def imaged(folder: Path, scan: str, name: str, *options: str) -> None:
    """Image a scan."""
    rig(folder, "recon", scan, "--depth", DEPTHS, "--out", f"{name}.h5", "--image", f"{name}.png", *options)


def experiment(folder: Path) -> None:
    """Scan, calibrate, and scan again."""
    folder.mkdir(parents=True, exist_ok=True)
    # calibrations go beside their configuration
    config = ("--config", shutil.copy(CONFIGS / "misaligned.toml", folder))
    rig(folder, "scan", *config, "--out", "before.h5")
    imaged(folder, "before.h5", "before-volume")
    rig(folder, "calibrate", "all", *config)
    rig(folder, "scan", *config, "--out", "after.h5")
    imaged(folder, "after.h5", "after-volume")
    imaged(folder, "before.h5", "again-volume", "--calibrations", "calibrations-misaligned")


def draw(folder: Path, picture: Path) -> None:
    """Measure the three images against the scene, and draw them."""
    panels = {
        "before the calibration": "before-volume.h5",
        "a new scan after it": "after-volume.h5",
        "the first scan, seen with it": "again-volume.h5",
    }
    figure = Figure(figsize=(12, 6), layout="constrained")
    axes = figure.subplots(2, len(panels), sharex=True, sharey=True)
    for column, (title, name) in enumerate(panels.items()):
        volume: Volume = read_volume(folder / name)
        measured = json.loads(rig(folder, "measure", name, "--truth", "scene:letters", "--json"))
        front = np.sqrt(compensate_falloff(volume.intensity, volume.z_m, 4.0).max(axis=0))
        drawn = draw_front(
            axes[0, column],
            front / front.max(),
            volume.x_m,
            volume.y_m,
            AMPLITUDE_COLOURS,
            Normalize(0, 1),
        )
        aside, depth = measured["displacement"], measured["depth"]
        axes[0, column].set_title(
            f"{title}\noff by {aside['x_m'] * 1e3:.0f}, {aside['y_m'] * 1e3:.0f}, "
            f"{depth['median_m'] * 1e3:.0f} mm in x, y, depth".replace(" -0", " 0"),
            fontsize=10,
        )
        axes[0, column].set_facecolor("black")
        axes[1, column].set_facecolor(NO_SURFACE)
        assert volume.depth_m is not None
        depths = draw_front(
            axes[1, column], volume.depth_m, volume.x_m, volume.y_m, DEPTH_COLOURS, DEPTHS_SHOWN
        )
        print(title, json.dumps({"displacement": aside, "depth": depth, "overlap": measured["overlap"]}))
    for panel in axes.flat:
        panel.set(xlim=(0.9, -0.9), ylim=(-0.65, 0.65))
        panel.label_outer()
    figure.colorbar(drawn, ax=axes[0], label="amplitude / maximum,\nintensity times z⁴")
    figure.colorbar(depths, ax=axes[1], label="depth z (m), blank: none", extend="both")
    save(figure, picture)
    shrink(picture)


if __name__ == "__main__":
    experiment(Path(sys.argv[1]))
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
