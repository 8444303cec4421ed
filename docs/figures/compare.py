"""Compare all methods on simulated scenes and published sets: tables and picture of ``docs/compare.md``.

    python docs/figures/compare.py DATA FOLDER

DATA is where the published sets are, in the neutral layout. Scans, sheets and results go to FOLDER; what is
there is not made again. Tables are printed. It takes about half an hour of one core.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from measured_sets import SETS
from small import shrink

PICTURE = Path(__file__).parents[1] / "images" / "compare.png"
WIDTH = 1200
SIMULATED = {
    "letters, 60 x 44": ("letters", "60x44", "3cm", "0.8m:1.8m:5mm"),
    "letters, 90 x 65": ("letters", "90x65", "2cm", "0.8m:1.8m:5mm"),
    "point, 60 x 44": ("point", "60x44", "3cm", "0.8m:1.2m:5mm"),
    "shelf, 60 x 44": ("shelf", "60x44", "3cm", "1m:1.7m:5mm"),
}
SHOWN = "letters, 60 x 44"
#: The sets in the neutral layout come first; the others are the same captures. The largest comes last here.
PUBLISHED = sorted(SETS[:12], key=lambda one: one.path == "rendered_letters.h5")


def rig(*arguments: str | Path) -> str:
    """Run a command of the program and return what it prints."""
    told = [str(argument) for argument in arguments]
    print("rig", *told, file=sys.stderr, flush=True)
    done = subprocess.run([sys.executable, "-m", "rig", *told], check=True, stdout=subprocess.PIPE, text=True)
    return done.stdout


def compared(file: Path, depth: str, folder: Path) -> dict[str, Any]:
    """Return the comparison of a file."""
    told = folder / f"{file.stem}.json"
    if not told.exists():
        told.write_text(rig("compare", file, "--depth", depth, "--out", folder / "sheets", "--json"))
    (one,) = json.loads(told.read_text())["comparisons"]
    return dict(one)


def simulated(folder: Path) -> dict[str, dict[str, Any]]:
    """Scan the simulated scenes, 10 ms a position, and compare."""
    found = {}
    for name, (scene, grid, spacing, depth) in SIMULATED.items():
        scan = folder / f"{name.replace(', ', '-').replace(' ', '')}.h5"
        if not scan.exists():
            size = ("--grid", grid, "--spacing", spacing, "--exposure", "10ms")
            rig("scan", "--scene", scene, *size, "--out", scan)
        found[name] = compared(scan, depth, folder)
    return found


def published(data: Path, folder: Path) -> dict[str, dict[str, Any]]:
    """Compare the published sets that are there."""
    found = {}
    for one in PUBLISHED:
        if not (data / one.path).exists():
            print(f"{one.path} is not in {data}: left out", file=sys.stderr)
            continue
        near, far, _ = one.depth_m
        step = 0.005 if one.wavelength_m < 0.15 else 0.01
        name = one.name.replace("the same", "rendered R, D")  # "the same" as the row before, there
        found[name] = compared(data / one.path, f"{near:g}m:{far:g}m:{step:g}m", folder)
    return found


def number(value: float | None, form: str, times: float = 1.0) -> str:
    """Write a number, or that there is none."""
    return "–" if value is None else f"{value * times:{form}}"


def name_of(method: dict[str, Any]) -> str:
    """Write a method's name, marked if the data were converted for it."""
    return f"`{method['method']}`" + (" *" if method["approximate"] else "")


def with_truth(found: dict[str, dict[str, Any]]) -> None:
    """Print a row for each method of each set whose truth is known."""
    heads = ("set", "method", "across", "deep", "contrast", "S/N", "overlap", "depth error", "within 5 cm")
    print("|", " | ".join((*heads, "time", "memory")), "|")
    print("| --- " * 2 + "| ---: " * 9 + "|")
    for name, one in found.items():
        title = f"{name}, λ {one['wavelength_m'] * 100:.2g} cm"
        for method in one["methods"]:
            cells = (
                number(method["across_m"], ".1f", 100) + " cm",
                number(method["deep_m"], ".1f", 100) + " cm",
                number(method["contrast"], ".2f"),
                number(method["signal_to_noise"], ".0f"),
                number(method["overlap"], ".2f"),
                number(method["depth"]["median_absolute_m"], ".1f", 1000) + " mm",
                number(method["depth"]["close"], ".0f", 100) + " %",
                number(method["processor_s"], ".1f") + " s",
                number(method["memory_bytes"], ".0f", 1e-6) + " MB",
            )
            print("|", " | ".join((title, name_of(method), *cells)), "|")
            title = ""


def without(found: dict[str, dict[str, Any]]) -> None:
    """Print a row for each set without a truth: width across, width in depth, signal to noise."""
    methods = [method["method"] for method in next(iter(found.values()))["methods"]]
    print("| set |", " | ".join(f"`{method}`" for method in methods), "|")
    print("| --- " * (1 + len(methods)) + "|")
    for name, one in found.items():
        cells = [
            f"{number(method['across_m'], '.1f', 100)} / {number(method['deep_m'], '.1f', 100)} / "
            f"{number(method['signal_to_noise'], '.0f')}" + (" *" if method["approximate"] else "")
            for method in one["methods"]
        ]
        print("|", " | ".join((f"{name}, λ {one['wavelength_m'] * 100:.2g} cm", *cells)), "|")


def main(data: Path, folder: Path) -> None:
    """Compare all, print the tables, and store the picture."""
    folder.mkdir(exist_ok=True)
    found = simulated(folder)
    shrink(Path(found[SHOWN]["sheet"]), PICTURE, WIDTH)
    found |= published(data, folder)
    with_truth({name: one for name, one in found.items() if one["truth"]})
    print()
    without({name: one for name, one in found.items() if not one["truth"]})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
