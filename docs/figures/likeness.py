"""Image what others measured with nothing asked, beside version 0.1 before the short pulse: docs/measured.md.

    python docs/figures/likeness.py DATA FOLDER [--volumes FOLDER]

DATA is as for `measured_sets.py`, with pictures of a plain back-projection in ``reference/``: ``NAME.png``,
and ``NAME.json``, which tells its axes. Scans and volumes go to FOLDER; what is there is not made again. A
table is printed: of each set the wavelength, the likeness of the front view to that picture, and the depth of
its objects. With ``--volumes`` the volume files of that folder, made by any version, are measured: so the
columns of `BEFORE` were made.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.image import imread
from measured_sets import SETS, MeasuredSet, found_m
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from recon.depth import front_view
from rig.files import read_volume
from rig.files.volume import Volume

#: Which picture shows the same object, where the file has another name.
SAME = {
    "original/lct/data_resolution_chart_40cm.mat": "lct_resolution_chart_40cm",
    "original/lct/data_s_u.mat": "lct_su",
    "original/ahn/2019_transient.mat": "ahn_2019",
    "original/xiao18m/4.mat": "xiao18m_L",
    "figure_4": "phasor_figure4_nonconfocal",
    "statue": "fk_statue",
}
#: Where a picture's front view is: in its left part, dark from edge to edge.
LEFT_PART = slice(0, 220)
HEAD = "λ | likeness | depth found"
#: Cells of version 0.1 before the short pulse, with nothing asked.
BEFORE = {
    "lct_resolution_chart_40cm.h5": "2.54 cm | 0.85 | 0.410 m",
    "lct_dot_chart_40cm.h5": "2.54 cm | 0.88 | 0.407 m",
    "lct_su.h5": "4.44 cm | 0.92 | 0.644 m and 1.046 m",
    "lct_exit_sign.h5": "5.08 cm | 0.93 | 0.815 m",
    "lct_mannequin.h5": "4.44 cm | 0.88 | 0.536 m",
    "ahn_2019.h5": "8 cm | 0.88 | 1.091 m",
    "fk_statue.h5": "12.7 cm | 0.87 | 1.090 m",
    "xiao18m_L.h5": "10.6 cm | 0.08 | 0.918 m",
    "phasor_figure4_nonconfocal.h5": "8 cm | 0.92 | 0.960 m",
    "rendered_letters.h5": "5.6 cm | – | 1.255 m and 1.701 m",
    "rendered_letters_g32.h5": "22.4 cm | – | 1.331 m and 1.722 m",
    "zaragoza_bunny_sim.h5": "3.81 cm | 0.93 | 0.437 m",
    "original/lct/data_resolution_chart_40cm.mat": "2.54 cm | 0.86 | 0.410 m",
    "original/lct/data_s_u.mat": "4.44 cm | 0.91 | 0.644 m and 1.045 m",
    "original/ahn/2019_transient.mat": "8 cm | 0.88 | 1.091 m",
    "original/cc_socr/figure_4/full/sub_Sig.mat": "8 cm | 0.92 | 0.960 m",
    "original/cc_socr/figure_4/random/sub_Sig.mat": "37.7 cm | 0.76 | 1.092 m",
    "original/cc_socr/figure_4/random/data.mat": "38 cm | 0.76 | 1.092 m",
    "original/cc_socr/figure_4/sparse/sub_Sig.mat": "38.8 cm | 0.77 | 1.089 m",
    "original/cc_socr/statue/full/sub_Sig.mat": "12.7 cm | 0.87 | 1.090 m",
    "original/cc_socr/statue/random/sub_Sig.mat": "59.8 cm | 0.68 | 1.452 m",
    "original/cc_socr/statue/random/data.mat": "59.8 cm | 0.68 | 1.452 m",
    "original/xiao18m/4.mat": "10.6 cm | 0.08 | 0.918 m",
    "original/km143/mannequin.mat": "28.1 cm | – | none",
}


def name_of(one: MeasuredSet) -> str:
    """Return a set's name among files."""
    return one.path.removeprefix("original/").replace("/", "_").rsplit(".", 1)[0]


def picture_of(one: MeasuredSet, data: Path) -> Path | None:
    """Return the picture of a set's object."""
    name = next((name for part, name in SAME.items() if part in one.path), Path(one.path).stem)
    picture = data / "reference" / f"{name}.png"
    return picture if picture.exists() else None


def read_picture(path: Path) -> tuple[NDArray, NDArray, NDArray]:
    """Return a picture's front view (y, x), 0 to 1, ascending in its axes x and y [m]."""
    pixels = imread(path)[..., :3]
    dark = pixels[:, LEFT_PART].min(axis=2) < 0.9
    columns = np.flatnonzero(dark.mean(axis=0) > 0.7)
    rows = np.flatnonzero(dark[:, columns[0] : columns[-1]].mean(axis=1) > 0.9)
    panel = pixels[rows[0] + 1 : rows[-1], columns[0] + 1 : columns[-1]]
    shades = colormaps["hot"](np.linspace(0, 1, 256))[:, :3]
    value = ((panel[:, :, None] - shades) ** 2).sum(axis=-1).argmin(axis=-1) / 255
    axes = json.loads(path.with_suffix(".json").read_text())["grid_m"]
    x_m, y_m = (
        np.linspace(*axes[axis][:2], length) for axis, length in zip("xy", value.T.shape, strict=True)
    )
    return value[::-1, ::-1], x_m, y_m  # drawn with y upwards, and with x growing to the left


def likeness(volume: Volume, path: Path) -> float:
    """Correlate the front view of the intensity with a picture, each without its mean; 1 is the same."""
    shown, x_m, y_m = read_picture(path)
    front = RegularGridInterpolator(
        (volume.y_m, volume.x_m), front_view(volume.intensity), bounds_error=False
    )
    seen = front(np.stack(np.meshgrid(y_m, x_m, indexing="ij"), axis=-1))
    inside = np.isfinite(seen)
    return float(np.corrcoef(seen[inside], shown[inside])[0, 1])


def figures(one: MeasuredSet, volume_path: Path, data: Path) -> str:
    """Return a row's cells."""
    volume, picture = read_volume(volume_path), picture_of(one, data)
    like = f"{likeness(volume, picture):.2f}" if picture else "–"
    depths = " and ".join(f"{depth:.3f} m" for depth in found_m(volume, one.published_m)) or "none"
    return f"{100 * volume.parameters['wavelength_m']:.3g} cm | {like} | {depths}"


def imaged(one: MeasuredSet, data: Path, folder: Path) -> Path:
    """Return the volume that `rig import` and `rig recon` make of a set."""
    volume = folder / f"{name_of(one)}-volume.h5"
    if not volume.exists():
        scan = folder / f"{name_of(one)}.h5"
        if not scan.exists():
            rig("import", data / one.path, scan, *one.options())
        rig("recon", scan, "--out", volume, "--image", volume.with_suffix(".png"))
    return volume


def rig(*arguments: str | Path) -> None:
    """Run a command of the program."""
    print("rig", *arguments, file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "rig", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("data", type=Path)
    asked.add_argument("folder", type=Path)
    asked.add_argument("--volumes", type=Path)
    options = asked.parse_args()
    options.folder.mkdir(exist_ok=True)
    print(f"| set | {HEAD} | before: {HEAD} | published |\n|{' --- |' * 8}")
    for one in SETS:
        if not (options.data / one.path).exists():
            print(f"{one.path} is not in {options.data}: left out", file=sys.stderr)
            continue
        if options.volumes:
            volume = options.volumes / f"{name_of(one)}-volume.h5"
        else:
            volume = imaged(one, options.data, options.folder)
        published = " and ".join(f"{depth:.2f} m" for depth in one.published_m) or "none"
        now, before = figures(one, volume, options.data), BEFORE[one.path]
        print(f"| {one.name} | {now} | {before} | {published} |", flush=True)


if __name__ == "__main__":
    main()
