"""How well the program images by default, beside its version 0.1 before the short pulse: docs/defaults.md.

    python docs/figures/quality.py FOLDER [RENDERED ...] [--volumes FOLDER]

Scans of the simulated rig go to FOLDER, and so do their images; what is there is not made again. RENDERED are
published files that hold their truth (``rendered_letters.h5``). A table is printed: of each scan the overlap
with the truth, median and mean of the absolute depth error within 5 cm, and the share of pixels within 5 cm.

With ``--volumes`` no scan is imaged: the volume files of that folder, ``NAME-volume.h5``, made by any
version, are measured. So the columns of the version before were made, which are kept here in `BEFORE`.
"""

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from recon.measures import CLOSE_M, overlap
from rig.files import read_volume
from rig.image.truth import true_depth
from simulators.scenes import scene
from simulators.transport.renderer import Transport

#: Photons a position that the letters are thinned to, and what a position of the confocal capture has.
FEW, CONFOCAL_PHOTONS = 30, 2000
HEAD = "λ | overlap | median | mean | within 5 cm"


@dataclass(frozen=True)
class Row:
    """A scan of a built-in scene, and its name in the table."""

    title: str
    scene: str
    grid: str = "180x130"
    spacing: str = "1cm"
    exposure: str = "10ms"


ROWS = {
    "letters-10ms": Row("letters, 180 x 130, 1 cm, 10 ms", "letters"),
    "letters-1ms": Row("the same, 1 ms", "letters", exposure="1ms"),
    "letters-few": Row(f"the same, thinned to {FEW} photons a position", "letters"),
    "letters-10ms-3cm": Row("letters, 60 x 44, 3 cm, 10 ms", "letters", "60x44", "3cm"),
    "letters-1ms-3cm": Row("the same, 1 ms", "letters", "60x44", "3cm", "1ms"),
    "letters-10ms-5cm": Row("letters, 36 x 26, 5 cm, 10 ms", "letters", "36x26", "5cm"),
    "letters-confocal": Row(f"letters, confocal, 90 x 65, 2 cm, {CONFOCAL_PHOTONS} photons", "letters"),
    "office-10ms": Row("office, 180 x 130, 10 ms", "office"),
    "shelf-10ms": Row("shelf, the same", "shelf"),
    "bookshelf-10ms": Row("bookshelf, the same", "bookshelf"),
    "bookshelf-rendered": Row("the same, without noise and instrument", "bookshelf"),
    "large-depth-10ms": Row("large depth, 180 x 130, 10 ms", "large-depth"),
    "patches-10ms-2cm": Row("patches, 90 x 65, 2 cm, 10 ms", "patches", "90x65", "2cm"),
}
TITLES = {
    "rendered_letters": "rendered R and D, 128 x 128 (path tracer)",
    "rendered_letters_g32": "the same, 32 x 32",
}
#: Cells of version 0.1 before the short pulse: what it made of the same scans with nothing asked.
BEFORE = {
    "letters-10ms": "4 cm | 0.83 | 3.7 | 4.4 | 99 %",
    "letters-1ms": "4 cm | 0.81 | 4.0 | 5.0 | 99 %",
    "letters-few": "4 cm | 0.69 | 7.0 | 8.3 | 98 %",
    "letters-10ms-3cm": "12 cm | 0.54 | 14.6 | 16.3 | 95 %",
    "letters-1ms-3cm": "12 cm | 0.54 | 15.1 | 16.4 | 94 %",
    "letters-10ms-5cm": "20 cm | 0.40 | 19.5 | 21.8 | 73 %",
    "letters-confocal": "8 cm | 0.81 | 7.3 | 8.3 | 99 %",
    "office-10ms": "4 cm | 0.08 | 6.0 | 9.1 | 90 %",
    "shelf-10ms": "4 cm | 0.12 | 5.6 | 7.7 | 97 %",
    "bookshelf-10ms": "4 cm | 0.63 | 3.6 | 5.7 | 86 %",
    "bookshelf-rendered": "4 cm | 0.63 | 3.4 | 5.4 | 86 %",
    "large-depth-10ms": "4 cm | 0.42 | 0.0 | 1.2 | 100 %",
    "patches-10ms-2cm": "8 cm | 0.19 | 3.1 | 5.9 | 100 %",
    "rendered_letters": "5.6 cm | 0.81 | 5.2 | 6.2 | 96 %",
    "rendered_letters_g32": "22.4 cm | 0.66 | 21.0 | 23.6 | 47 %",
}


def rig(*arguments: str | Path) -> None:
    """Run a command of the program."""
    print("rig", *arguments, file=sys.stderr, flush=True)
    subprocess.run([sys.executable, "-m", "rig", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def scanned(name: str, folder: Path) -> Path:
    """Return the scan of a row."""
    path, row = folder / f"{name}.h5", ROWS[name]
    if path.exists():
        return path
    if name == "letters-few":
        thinned(scanned("letters-10ms", folder), path)
    elif name == "letters-confocal":
        confocal(row.scene, folder / "confocal-neutral.h5")
        rig("import", folder / "confocal-neutral.h5", path)
    elif name.endswith("rendered"):
        rig("sim", "render", row.scene, path, "--bin-width", "16ps", "--bins", "1600")
    else:
        size = ("--grid", row.grid, "--spacing", row.spacing, "--exposure", row.exposure)
        rig("scan", "--scene", row.scene, *size, "--out", path)
    return path


def thinned(scan: Path, target: Path) -> None:
    """Keep each photon of a scan with one probability, so that positions have `FEW` of them."""
    rng = np.random.default_rng(5)
    target.write_bytes(scan.read_bytes())
    with h5py.File(target, "r+") as file:
        file["transients"].pop("checksum", None)  # what follows is meant
        counts = file["transients/counts"]
        kept = FEW * len(counts) / file["stop"].attrs["photons"]
        for start in range(0, len(counts), 512):
            block = counts[start : start + 512]
            counts[start : start + 512] = rng.binomial(block.astype(np.int64), kept).astype(block.dtype)


def confocal(name: str, target: Path) -> None:
    """Write photons of a scene, counted where the laser is: noise, but no instrument; neutral layout."""
    x_m, y_m = (0.02 * (np.arange(count) - (count - 1) / 2) for count in (90, 65))
    laser_m = np.stack([*np.meshgrid(x_m, y_m), np.zeros((65, 90))], axis=-1).reshape(-1, 3)
    edges_s = 16e-12 * np.arange(1001)
    mean = Transport.of_scene(scene(name)).transients(laser_m, laser_m, edges_s)
    counts = np.random.default_rng(6).poisson(mean * CONFOCAL_PHOTONS / mean.sum(axis=1).mean())
    with h5py.File(target, "w") as file:
        file.create_dataset("counts", data=counts.astype(np.uint16), compression="gzip")
        file["laser_position_m"] = file["detector_position_m"] = laser_m
        file["time_s"] = (edges_s[:-1] + edges_s[1:]) / 2
        file.attrs.update(bin_width_s=16e-12, time_origin="wall", confocal=True)


def figures(volume_path: Path, truth: str) -> str:
    """Return a row's cells."""
    volume = read_volume(volume_path)
    true_m = true_depth(truth, volume.x_m, volume.y_m)
    seen, there = np.isfinite(volume.depth_m), np.isfinite(true_m)
    error_m = np.abs(volume.depth_m - true_m)[seen & there]
    close_m = error_m[error_m <= CLOSE_M]
    close = 100 * len(close_m) / len(error_m)
    return (
        f"{100 * volume.parameters['wavelength_m']:.3g} cm | {overlap(seen, there):.2f} | "
        f"{1e3 * np.median(close_m):.1f} | {1e3 * close_m.mean():.1f} | {close:.0f} %"
    )


def imaged(scan: Path) -> Path:
    """Return the volume that `rig recon` makes when nothing is asked."""
    volume = scan.with_name(f"{scan.stem}-volume.h5")
    if not volume.exists():
        rig("recon", scan, "--out", volume, "--image", volume.with_suffix(".png"))
    return volume


def imported(file: Path, folder: Path) -> Path:
    """Return a published file as a scan."""
    scan = folder / f"{file.stem}.h5"
    if not scan.exists():
        rig("import", file, scan)
    return scan


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("folder", type=Path)
    asked.add_argument("rendered", type=Path, nargs="*")
    asked.add_argument("--volumes", type=Path)
    options = asked.parse_args()
    options.folder.mkdir(exist_ok=True)
    names = {name: (row.title, f"scene:{row.scene}") for name, row in ROWS.items()}
    names |= {file.stem: (TITLES.get(file.stem, file.stem), str(file)) for file in options.rendered}
    files = {file.stem: file for file in options.rendered}
    print(f"| scan | {HEAD} | before: {HEAD} |\n|{' --- |' * 11}")
    for name, (title, truth) in names.items():
        if options.volumes:
            volume = options.volumes / f"{name}-volume.h5"
        else:
            folder = options.folder
            scan = imported(files[name], folder) if name in files else scanned(name, folder)
            volume = imaged(scan)
        before = BEFORE[name]
        print(f"| {title} | {figures(volume, truth)} | {before} |", flush=True)


if __name__ == "__main__":
    main()
