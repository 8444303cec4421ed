"""How well the program images by default, beside what it did with one threshold and a pulse of six cycles.

    python docs/figures/quality.py SCAN.h5[=TRUTH] ...

For each scan a row of the table in docs/defaults.md: overlap with the truth, median and mean of the absolute
depth error within 5 cm, and the share of pixels within 5 cm, of both. The truth is ``scene:NAME`` or a file,
as ``rig measure`` takes it; a simulated scan knows its own.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from recon import defaults
from recon.depth import compensate_falloff, depth_map
from recon.imaging import image
from recon.measures import CLOSE_M, overlap
from recon.wave import VirtualPulse
from recon.window import Window
from rig.files import ScanFile, read_volume
from rig.image.recalibrate import as_recorded
from rig.image.reconstruct import Request, reconstruct
from rig.image.truth import true_depth


def before(scan):
    """Image with six cycles of four spacings, threshold at a twentieth, peak of the intensity times z^2."""
    with ScanFile(scan) as file:
        seen = as_recorded(file)
        passed_m = defaults.shortest_wavelength_m(seen.instrument_response_s or 0.0)
        pulse = VirtualPulse(max(4 * defaults.spacing_m(seen.capture), passed_m), 6)
        grid = defaults.voxels(seen.capture, pulse)
        found = image(seen.capture, pulse, grid, window=Window(start_s=seen.fade_from_s))
    lifted = compensate_falloff(found.intensity, grid.z_m, 4)
    return grid.x_m, grid.y_m, depth_map(lifted, grid.z_m, 0.05, lifted=2), pulse.wavelength_m


def now(scan):
    """Image as `rig recon` does when nothing is asked."""
    with tempfile.TemporaryDirectory() as folder:
        volume_path = Path(folder, "volume.h5")
        result = reconstruct(scan, Request(), volume_path, Path(folder, "picture.png"))
        volume = read_volume(volume_path)
    return volume.x_m, volume.y_m, volume.depth_m, result.volume.parameters["wavelength_m"]


def figures(x_m, y_m, depth_m, wavelength_m, truth):
    """Return a row's cells."""
    true_m = true_depth(truth, x_m, y_m)
    seen, there = np.isfinite(depth_m), np.isfinite(true_m)
    error_m = np.abs(depth_m - true_m)[seen & there]
    close = error_m[error_m <= CLOSE_M]
    return (
        f"{100 * wavelength_m:.3g} cm | {overlap(seen, there):.2f} | {1e3 * np.median(close):.1f} | "
        f"{1e3 * close.mean():.1f} | {100 * len(close) / len(error_m):.0f} %"
    )


def main():
    """Print the table."""
    head = "λ | overlap | median, mm | mean, mm | within 5 cm"
    print(f"| scan | {head} | before: {head} |\n|{' --- |' * 11}")
    for argument in sys.argv[1:]:
        name, _, truth = argument.partition("=")
        scan = Path(name)
        if not truth:
            with ScanFile(scan) as file:
                truth = f"scene:{file.config.simulation.scene}"
        print(f"| {scan.stem} | {figures(*now(scan), truth)} | {figures(*before(scan), truth)} |", flush=True)


if __name__ == "__main__":
    main()
