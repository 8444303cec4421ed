"""Draw docs/images/measured_sets.png and print the table of docs/measured.md: what others measured.

    python docs/figures/measured_sets.py DATA docs/images/measured_sets.png

DATA is a folder with the neutral files (``lct_su.h5``, ...) and, in ``original/``, the files as published.
What is not there is left out, and said so.
"""

import sys
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from small import shrink

from recon.depth import compensate_falloff
from rig.files.volume import Volume
from rig.image.drawing import Drawing
from rig.image.reconstruct import reconstruct
from rig.image.request import Request
from rig.importers import import_scan
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS, NO_SURFACE
from rig.show.saving import save
from rig.show.volume import draw_front

PAIRS = 4
PS, CM = 1e-12, 0.01
#: Part of an object's greatest intensity that its pixels have: fainter ones are side lobes as often.
BRIGHT = 0.3


@dataclass(frozen=True)
class MeasuredSet:
    """A file, how it is imported and imaged, and at what depths its objects are, by those who measured it."""

    name: str
    path: str
    published_m: tuple[float, ...]
    wavelength_m: float
    depth_m: tuple[float, float, float]
    given: dict[str, Any] = field(default_factory=dict)
    voxel_m: float | None = None
    legible: bool = True
    """Whether an object is seen in the picture; if not, a depth says nothing."""

    def options(self) -> list[str]:
        """Return the options of ``rig import``."""
        named = {"bin_width_s": ("--bin-width", 1 / PS, "ps"), "wall_size_m": ("--wall-size", 1, "m")}
        told: list[str] = []
        for key, value in self.given.items():
            option, times, unit = named[key]
            told += [option, f"{value * times:g}{unit}"]
        return told

    def command(self) -> str:
        """Return the command lines."""
        told = "".join(f" {word}" for word in self.options())
        near, far, step = self.depth_m
        voxel = f" --voxel {self.voxel_m / CM:g}cm" if self.voxel_m else ""
        return (
            f"`rig import {Path(self.path).name} scan.h5{told}`, `rig recon scan.h5 --wavelength "
            f"{self.wavelength_m / CM:g}cm --depth {near:g}m:{far:g}m:{step / CM:g}cm{voxel}`"
        )


CHART, SU, FOUR, STATUE = (0.32, 0.5, 0.005), (0.5, 1.2, 0.01), (0.7, 1.2, 0.01), (0.8, 1.4, 0.02)
LCT = {"bin_width_s": 4 * PS}
OF_FOUR = {"bin_width_s": 16 * PS, "wall_size_m": 1.26}
OF_STATUE = {"bin_width_s": 32 * PS, "wall_size_m": 2.0}
CC = "original/cc_socr/"
SETS = (
    MeasuredSet("resolution chart", "lct_resolution_chart_40cm.h5", (0.40,), 3 * CM, CHART),
    MeasuredSet("dot chart", "lct_dot_chart_40cm.h5", (0.40,), 3 * CM, CHART),
    MeasuredSet("S before U", "lct_su.h5", (0.65, 1.04), 4 * CM, SU),
    MeasuredSet("EXIT sign", "lct_exit_sign.h5", (0.81,), 4 * CM, (0.6, 1.0, 0.01)),
    MeasuredSet("mannequin", "lct_mannequin.h5", (0.53,), 5 * CM, (0.4, 0.8, 0.01)),
    MeasuredSet("20 over 19", "ahn_2019.h5", (1.08,), 5 * CM, (0.9, 1.3, 0.01)),
    MeasuredSet("statue", "fk_statue.h5", (1.07,), 10 * CM, STATUE),
    MeasuredSet("L, 18 m away", "xiao18m_L.h5", (0.77,), 20 * CM, (0.5, 1.2, 0.02)),
    MeasuredSet("4, one detector spot", "phasor_figure4_nonconfocal.h5", (0.935,), 6 * CM, FOUR),
    MeasuredSet("rendered R, D", "rendered_letters.h5", (1.25, 1.70), 5.6 * CM, (1.0, 2.0, 0.02)),
    MeasuredSet("the same, coarse", "rendered_letters_g32.h5", (1.25, 1.70), 11 * CM, (1.0, 2.0, 0.02)),
    MeasuredSet("bunny, simulated", "zaragoza_bunny_sim.h5", (0.43,), 3 * CM, (0.3, 0.6, 0.005)),
    MeasuredSet("chart", "original/lct/data_resolution_chart_40cm.mat", (0.40,), 3 * CM, CHART, LCT),
    MeasuredSet("S before U", "original/lct/data_s_u.mat", (0.65, 1.04), 4 * CM, SU, LCT),
    MeasuredSet("20 over 19", "original/ahn/2019_transient.mat", (1.08,), 5 * CM, (0.9, 1.3, 0.01)),
    MeasuredSet("4, full", CC + "figure_4/full/sub_Sig.mat", (0.935,), 6 * CM, FOUR, OF_FOUR),
    MeasuredSet("4, random", CC + "figure_4/random/sub_Sig.mat", (0.935,), 6 * CM, FOUR, OF_FOUR, 2 * CM),
    MeasuredSet(
        "4, with setup",
        CC + "figure_4/random/data.mat",
        (0.935,),
        6 * CM,
        FOUR,
        {"bin_width_s": 16 * PS},
        2 * CM,
    ),
    MeasuredSet("4, sparse", CC + "figure_4/sparse/sub_Sig.mat", (0.935,), 6 * CM, FOUR, OF_FOUR, 2 * CM),
    MeasuredSet("statue, full", CC + "statue/full/sub_Sig.mat", (1.07,), 10 * CM, STATUE, OF_STATUE),
    MeasuredSet(
        "statue, random",
        CC + "statue/random/sub_Sig.mat",
        (1.07,),
        10 * CM,
        STATUE,
        OF_STATUE,
        3 * CM,
        legible=False,
    ),
    MeasuredSet(
        "statue, setup",
        CC + "statue/random/data.mat",
        (1.07,),
        10 * CM,
        STATUE,
        {"bin_width_s": 32 * PS},
        3 * CM,
        legible=False,
    ),
    MeasuredSet(
        "L, 18 m away",
        "original/xiao18m/4.mat",
        (0.77,),
        20 * CM,
        (0.5, 1.2, 0.02),
        {"bin_width_s": 32 * PS, "wall_size_m": 0.82},
    ),
    MeasuredSet(
        "mannequin, 1.43 km", "original/km143/mannequin.mat", (), 20 * CM, (0.3, 2.0, 0.02), legible=False
    ),
)


def image_of(measured: MeasuredSet, data: Path, folder: Path) -> tuple[Volume, tuple[str, ...], str]:
    """Import and image a set; return the volume, the warnings, and what the import took for granted."""
    scan = folder / "scan.h5"
    report = import_scan(data / measured.path, scan, **measured.given)
    request = Request(wavelength_m=measured.wavelength_m, depth_m=measured.depth_m, voxel_m=measured.voxel_m)
    result = reconstruct(scan, request, folder / "volume.h5", Drawing(folder / "picture.png"))
    return result.volume, result.warnings, f"{report.positions} positions, {report.bins} bins"


def found_m(volume: Volume, published_m: tuple[float, ...]) -> list[float]:
    """Return the median depth of bright pixels near each published one; halfway divides two; NaN for none."""
    seen = np.isfinite(volume.depth_m)
    depth_m = np.asarray(volume.depth_m)[seen]
    bright = compensate_falloff(volume.intensity, volume.z_m, 4.0).max(axis=0)[seen]
    part = np.digitize(depth_m, [(a + b) / 2 for a, b in pairwise(published_m)])
    medians = []
    for number in range(len(published_m)):
        here = part == number
        greatest = bright[here].max(initial=0)
        medians.append(
            float(np.median(depth_m[here & (bright >= BRIGHT * greatest)])) if greatest else np.nan
        )
    return medians


def main(data: str, path: str) -> None:
    """Image all sets, print their rows, and draw the sheet."""
    there = [one for one in SETS if (Path(data) / one.path).exists()]
    for one in SETS:
        if one not in there:
            print(f"{one.path} is not in {data}: left out", file=sys.stderr)
    rows = -(-len(there) // PAIRS)
    figure = Figure(figsize=(15, 2.0 * rows), layout=ConstrainedLayoutEngine(w_pad=0.1))
    FigureCanvasAgg(figure)
    parts = np.array(figure.subfigures(rows, PAIRS)).reshape(-1)
    print("| set | file | command lines | depth found | published |\n| --- | --- | --- | --- | --- |")
    for part, one in zip(parts, there, strict=False):
        with TemporaryDirectory() as folder:
            volume, warnings, size = image_of(one, Path(data), Path(folder))
        depths = " and ".join(f"{depth:.3f} m" for depth in found_m(volume, one.published_m))
        depths = depths if one.legible else "nothing"
        published = " and ".join(f"{depth:.2f} m" for depth in one.published_m) or "none"
        print(
            f"| {one.name} ({size}) | `{one.path}` | {one.command()} | {depths} | {published} |", flush=True
        )
        for warning in warnings:
            print(f"{one.path}: {warning}", file=sys.stderr)
        front, depth = part.subplots(1, 2)
        amplitude = np.sqrt(compensate_falloff(volume.intensity, volume.z_m, 4.0).max(axis=0))
        lit = amplitude / amplitude.max()
        draw_front(front, lit, volume.x_m, volume.y_m, AMPLITUDE_COLOURS, Normalize(0, 1))
        shown = np.asarray(volume.depth_m)
        drawn = draw_front(depth, shown, volume.x_m, volume.y_m, DEPTH_COLOURS, Normalize(*_range(shown)))
        depth.set_facecolor(NO_SURFACE)
        part.colorbar(drawn, ax=depth, shrink=0.7).ax.tick_params(labelsize=7)
        for axes in (front, depth):
            axes.set(xlabel="", ylabel="")
            axes.tick_params(labelsize=7)
        part.suptitle(f"{one.name}\nfound {depths}\npublished {published}", size=9)
    figure.supxlabel("left: amplitude, right: depth z (m), blank: none; x (m) grows to the left, y (m) up")
    save(figure, Path(path))
    shrink(Path(path))


def _range(depth_m: np.ndarray) -> tuple[float, float]:
    low, high = np.nanpercentile(depth_m, (2, 98))
    return float(low), float(max(high, low + 0.1))


if __name__ == "__main__":
    main(*sys.argv[1:])
