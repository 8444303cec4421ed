"""Draw docs/images/refocus.png: a photo camera refocused on two letters, exact and with the paraxial wave.

The two letters stand at different depths. Each panel has its own scale. Make it with

    rig scan --scene letters --exposure 10ms --out letters.h5
    python docs/figures/refocus.py letters.h5 docs/images/refocus.png
"""

import sys
from pathlib import Path

import numpy as np
from small import shrink

from recon import defaults
from recon.camera import PhotoCamera
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.solvers import fresnel
from recon.wave import VirtualPulse
from recon.window import Window
from rig.files import ScanFile, Volume
from rig.show.saving import save
from rig.show.sheet import sheet

WAVELENGTH_M = 0.04
#: In front of both letters, on the F, between, on the R, and behind both.
FOCUS_M = np.array([0.7, 1.0, 1.25, 1.5, 2.0])

#: Part of each panel's pixels below full scale: the far letter is dim beside the near one, even out of focus.
BRIGHTEST = 0.98


def main(scan_path: str, picture_path: str) -> None:
    """Image the scan with both solvers, and draw a row for each."""
    pulse = VirtualPulse(WAVELENGTH_M)
    panels, titles = [], []
    with ScanFile(scan_path) as scan:
        capture = scan.capture()
        across = defaults.voxels(capture, pulse, depth_m=(1.0, 1.0, 1.0))
        grid = VoxelGrid(across.x_m, across.y_m, FOCUS_M)
        window = Window(start_s=scan.fade_from_s)
        for solver in ("rsd", "fresnel"):
            taken = image(capture, pulse, grid, camera=PhotoCamera(), solver=solver, window=window)
            for z_m, plane in zip(FOCUS_M, np.abs(taken.field), strict=True):
                figure = fresnel.figure(capture, WAVELENGTH_M, z_m)
                note = f" (d⁴/4L³λ = {figure:.2g})" if solver == "fresnel" else ""
                titles.append(f"{solver}: {z_m:.2f} m{note}")
                panels.append(np.minimum(plane / np.quantile(plane, BRIGHTEST), 1))
    volume = Volume(
        np.zeros((0, 0, 0), np.float32),
        grid.x_m,
        grid.y_m,
        grid.z_m,
        parameters={"camera": "photo", "wavelength_m": WAVELENGTH_M},
        scan="refocused on two letters, 1 m and 1.5 m away",
    )
    label = f"amplitude /\nits {BRIGHTEST:.0%} quantile"
    save(sheet(np.array(panels), titles, volume, label, len(FOCUS_M)), picture_path)
    shrink(Path(picture_path))


if __name__ == "__main__":
    main(*sys.argv[1:])
