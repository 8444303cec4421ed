"""Draw docs/images/calibration.png: a misaligned rig's picture before its calibration, and after it.

It takes some minutes. Make it with

    python docs/figures/calibration.py WORK_FOLDER docs/images/calibration.png
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from recon.depth import compensate_falloff
from rig.files import Volume, read_volume
from rig.pictures import draw_front, save

CONFIG = Path(__file__).parents[2] / "configs" / "misaligned.toml"
DEPTHS = "0.5m:2m:1cm"
DEPTH_COLOURS = Normalize(0.9, 1.6)


def rig(folder: Path, *arguments: str) -> str:
    """Run a command of the program in a folder, and return what it prints."""
    print("rig", *arguments, file=sys.stderr)
    command = [sys.executable, "-m", "rig", *arguments]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def imaged(folder: Path, scan: str, name: str, *options: str) -> tuple[Volume, dict]:
    """Image a scan, and measure the image against the scene."""
    rig(folder, "recon", scan, "--depth", DEPTHS, "--out", f"{name}.h5", "--image", f"{name}.png", *options)
    measured = json.loads(rig(folder, "measure", f"{name}.h5", "--truth", "scene:letters", "--json"))
    return read_volume(folder / f"{name}.h5"), measured


def main(folder: Path, picture: Path) -> None:
    """Scan, calibrate, scan again, and draw."""
    folder.mkdir(parents=True, exist_ok=True)
    config = ("--config", str(CONFIG))
    rig(folder, "scan", *config, "--out", "before.h5")
    panels = {"before the calibration": imaged(folder, "before.h5", "before-volume")}
    rig(folder, "calibrate", "all", *config)
    rig(folder, "scan", *config, "--out", "after.h5")
    panels["a new scan after it"] = imaged(folder, "after.h5", "after-volume")
    store = ("--calibrations", "calibrations-misaligned")
    panels["the first scan, seen with it"] = imaged(folder, "before.h5", "again-volume", *store)
    figure = Figure(figsize=(13, 7), layout="constrained")
    axes = figure.subplots(2, len(panels))
    for column, (title, (volume, measured)) in enumerate(panels.items()):
        front = np.sqrt(compensate_falloff(volume.intensity, volume.z_m, 4.0).max(axis=0))
        drawn = draw_front(axes[0, column], front / front.max(), volume.x_m, volume.y_m, "inferno")
        aside, depth = measured["displacement"], measured["depth"]
        axes[0, column].set_title(
            f"{title}\noff by {aside['x_m'] * 100:+.1f} cm in x, {aside['y_m'] * 100:+.1f} cm in y; "
            f"{depth['median_m'] * 100:+.1f} cm in depth",
            fontsize=10,
        )
        axes[1, column].set_facecolor("0.82")
        depths = draw_front(axes[1, column], volume.depth_m, volume.x_m, volume.y_m, "viridis", DEPTH_COLOURS)
        print(title, json.dumps({"displacement": aside, "depth": depth, "overlap": measured["overlap"]}))
    figure.colorbar(drawn, ax=axes[0], label="amplitude / maximum, intensity times z⁴")
    figure.colorbar(depths, ax=axes[1], label="depth z (m)", extend="both")
    save(figure, picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
