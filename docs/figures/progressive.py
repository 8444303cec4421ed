"""How soon a scan shows what it will show: likeness with the final picture against time, in two orders.

    python docs/figures/progressive.py LETTERS.h5 OFFICE.h5 docs/images/progressive.png

The scans may have been measured in any order: the photons of a position do not depend on when it is visited,
so that both orders are made from the same scan. Drawn beside are the pictures at a 64th, an eighth and
the end. Likeness is the correlation of the front views (`recon.accumulate.likeness`).
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from small import shrink

from recon.accumulate import Coming, GrowingPicture, likeness, subset
from recon.window import Window
from rig.files import ScanFile
from rig.image.recalibrate import as_recorded
from rig.show.volume import X_LABEL

PARTS = (1 / 16, 1 / 8, 3 / 16, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1)
ORDERS = {"raster": "snake", "progressive": "progressive"}
PORTION = 512


def pictures(scan, order):
    """Return (part of the time, picture) at the ends of rounds and at `PARTS`."""
    seen, grid = as_recorded(scan), scan.plan.passes[0].positions.model_copy(update={"order": order})
    measured = seen.capture
    number = {_key(spot_m): index for index, spot_m in enumerate(measured.laser_m)}
    visited = np.array([number[_key(spot_m)] for spot_m in grid.spots_m])
    window = Window(start_s=seen.fade_from_s)
    growing = GrowingPicture(
        Coming(subset(measured, visited), grid.rounds, window, seen.instrument_response_s)
    )
    counts = np.concatenate([block.astype(np.uint16) for _, block in measured.histograms.blocks()])
    found, first = [], 0
    for end in sorted({*grid.rounds, *(round(part * len(visited)) for part in PARTS)}):
        for begin in range(first, end, PORTION):
            growing.add(begin, counts[visited[begin : min(begin + PORTION, end)]])
        found.append((end / len(visited), growing.picture()))
        first = end
    return found


def _key(spot_m):
    return tuple(np.rint(np.asarray(spot_m[:2]) * 1e4).astype(int))


def main():
    """Draw the figure, and print the numbers."""
    *scans, target = map(Path, sys.argv[1:])
    figure = Figure((12, 3.2 * len(scans)), layout="constrained")
    rows = figure.subplots(len(scans), 4, squeeze=False, width_ratios=(1.5, 1, 1, 1))
    for (axes, *views), path in zip(rows, scans, strict=True):
        with ScanFile(path) as scan:
            found = {name: pictures(scan, order) for name, order in ORDERS.items()}
        final = found["progressive"][-1][1].front
        for name, ones in found.items():
            parts, alike = zip(*((part, likeness(one.front, final)) for part, one in ones), strict=True)
            axes.step(parts, alike, where="post", marker="o", label=name)
            print(
                path.stem, name, *(f"{part:.4f}:{like:.3f}" for part, like in zip(parts, alike, strict=True))
            )
        axes.set(xlabel="part of the time", ylabel="likeness", ylim=(0, 1.02), title=path.stem)
        axes.legend(loc="lower right")
        for view, (part, one) in zip(views, _drawn(found["progressive"]), strict=True):
            x_m, y_m = one.grid.x_m, one.grid.y_m
            view.imshow(one.front, origin="lower", cmap="gray", extent=(x_m[0], x_m[-1], y_m[0], y_m[-1]))
            view.xaxis.set_inverted(True)  # as the virtual camera sees it
            view.set(title=f"{part:.3f} of the time, λ {100 * one.pulse.wavelength_m:.3g} cm", xlabel=X_LABEL)
    figure.savefig(target, dpi=110)
    shrink(target)


def _drawn(found):
    """Return the pictures after a 64th, an eighth and all of the time."""
    return [min(found, key=lambda one: abs(one[0] - part)) for part in (1 / 64, 1 / 8, 1)]


if __name__ == "__main__":
    main()
