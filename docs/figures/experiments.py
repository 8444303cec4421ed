"""Repeat the experiments of Liu et al. (2019) with the simulated rig: all that `docs/experiments.md` shows.

    python docs/figures/experiments.py FOLDER

Scans, volumes and their pictures go to the folder; what is there is not made again. Commands are printed as
they are run. It takes about an hour of one core, most of it for the photons of the exposures of 1 s.
"""

import subprocess
import sys
from pathlib import Path

import experiments_sheets as sheets
from small import shrink

IMAGES = Path(__file__).parents[1] / "images"

FINE = ("--grid", "72x52", "--spacing", "2.5cm")
COARSE = ("--grid", "18x13", "--spacing", "10cm")
#: Preset of each counted scan, and what is changed of it.
SCANS = {
    "office-10ms": ("office-10ms",),
    "office-5ms": ("office-5ms",),
    "office-1ms": ("office-1ms",),
    "office-1s": ("office-1s", *COARSE),
    "large-depth-1s": ("large-depth-1s", *COARSE),
    "nlos-letters-1s": ("nlos-letters-1s", *COARSE),
    "shelf-1s": ("shelf-1s", *COARSE),
    "shelf-1000ms": ("shelf-1s", *FINE),
    "shelf-1000ms-lit": ("shelf-1s-lit", *FINE),
    "shelf-200ms": ("shelf-200ms", *FINE),
    "shelf-50ms": ("shelf-50ms", *FINE),
    "shelf-200ms-lit": ("shelf-1s-lit", "--exposure", "200ms", *FINE),
    "shelf-50ms-lit": ("shelf-50ms-lit", *FINE),
}
TABLE = (
    "large-depth-1s",
    "nlos-letters-1s",
    "shelf-1s",
    "office-1s",
    "office-10ms",
    "office-5ms",
    "office-1ms",
)

OFFICE = ("--wavelength", "6cm", "--depth", "0.5m:3.2m:2cm", "--width", "1.8m", "--height", "1.3m")
SHELF = ("--wavelength", "6cm", "--depth", "1m:1.7m:1cm", "--voxel", "1.25cm", "--width", "1.2m")

#: The paper's grid for the letters; every other position of its grid for the bookshelf.
BINS = ("--bin-width", "16ps", "--bins", "1600")
SQUARE = ("--grid", "128x128", "--spacing", "1.4cm", *BINS)
LETTERS = ("--wavelength", "5.6cm", "--depth", "1m:2m:1cm", "--voxel", "1cm")
BOOKS = ("--wavelength", "4cm", "--depth", "1.5m:2.2m:1cm", "--voxel", "1cm")
#: Scene of each rendered scan, the light that is followed, how it is imaged, and the scene that is its truth:
#: the corridor's walls are outside of the volume.
RENDERS = {
    "roughness 1": ("letters-rd", ("--roughness", "1"), LETTERS, "letters-rd"),
    "roughness 0.4": ("letters-rd", ("--roughness", "0.4"), LETTERS, "letters-rd"),
    "roughness 0.2": ("letters-rd", ("--roughness", "0.2"), LETTERS, "letters-rd"),
    "bookshelf": ("bookshelf", ("--bounces", "3"), BOOKS, "bookshelf"),
    "in its corridor": ("bookshelf-corridor", ("--bounces", "5"), BOOKS, "bookshelf"),
}
#: Lengths of the virtual pulse, in wavelengths: the default, and what the paper says.
CYCLES = ("2", "6")


def rig(*arguments: str | Path) -> str:
    """Run a command of the program and return what it prints."""
    told = [str(argument) for argument in arguments]
    print("rig", *told, flush=True)
    return subprocess.run(
        [sys.executable, "-m", "rig", *told], check=True, stdout=subprocess.PIPE, text=True
    ).stdout


def imaged(scan: Path, *arguments: str, tag: str = "") -> Path:
    """Return the volume of a scan."""
    volume = scan.with_name(f"{scan.stem}{tag}-volume.h5")
    if not volume.exists():
        rig("recon", scan, *arguments, "--out", volume, "--image", volume.with_suffix(".png"))
    return volume


def counted(folder: Path) -> None:
    """Scan with the presets, and draw what was counted and what is seen of it."""
    scans = {name: folder / f"{name}.h5" for name in SCANS}
    for name, (preset, *changes) in SCANS.items():
        if not scans[name].exists():
            rig("scan", "--preset", preset, *changes, "--out", scans[name])
    print(rig("stats", *(scans[name] for name in TABLE)))
    rig("plot", scans["office-1s"], "--image", IMAGES / "raw_office_1s.png")
    short = [scans[f"office-{exposure}"] for exposure in ("10ms", "5ms", "1ms")]
    rig("plot", *short, "--image", IMAGES / "raw_office_short.png")
    office = {scan.stem: imaged(scan, *OFFICE) for scan in short}
    sheets.exposures([office], IMAGES / "office_exposures.png", depths=True, names="office")
    endless = folder / "shelf-noise-free.h5"
    if not endless.exists():
        rig("sim", "render", "shelf", endless, *FINE, *BINS)
    reference = imaged(endless, *SHELF)
    rows = []
    for light, told in (("", "lights off"), ("-lit", "lights on")):
        rows.append({"noise-free": reference})
        for time in ("1000ms", "200ms", "50ms"):
            rows[-1][f"{time}, {told}"] = imaged(scans[f"shelf-{time}{light}"], *SHELF)
    sheets.exposures(rows, IMAGES / "shelf_exposures.png", names="shelf")


def rendered(folder: Path) -> None:
    """Render noise-free scans, and draw how wrong the depths are that are found in them."""
    found = {}
    for name, (scene, light, imaging, true) in RENDERS.items():
        scan = folder / f"{name.replace(' ', '-')}.h5"
        if not scan.exists():
            rig("sim", "render", scene, scan, *light, *SQUARE)
        truth = f"scene:{true}"
        for cycles in CYCLES:
            volume = imaged(scan, *imaging, "--cycles", cycles, tag=f"-{cycles}")
            print(rig("measure", volume, "--truth", truth))
            print(f"{name}, {cycles} cycles:", sheets.told(sheets.depth_errors(volume, truth)))
            found.setdefault(name, (volume, truth))
    sheets.errors(found, IMAGES / "depth_errors.png")


def main(folder: Path) -> None:
    """Make all scans, volumes and pictures, and print the tables."""
    folder.mkdir(exist_ok=True)
    counted(folder)
    rendered(folder)
    for name in ("raw_office_1s", "raw_office_short", "office_exposures", "shelf_exposures", "depth_errors"):
        shrink(IMAGES / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
