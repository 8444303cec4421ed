"""Image planted points at the paper's size on a device and on numpy; print time and error as JSON.

    python tests/benchmarks/device_check.py [cuda|cpu] [torch|cupy|numpy]

Needs numpy and the device's library; run it from the repository's root.
"""

import json
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from recon.aperture import recognise
from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.sampling import CONFOCAL, depth_blocks, plane_times_s
from recon.solvers.rsd import array as rsd_array
from recon.spectrum import spectra
from recon.wave import VirtualPulse
from recon.window import Window

POINTS_M = np.array([[0.2, 0.1, 0.8], [-0.3, -0.2, 1.4], [0.1, 0.3, 2.2]])
DETECTOR_M = np.array([0.1, -0.05, 0.0])
BINS, BIN_WIDTH_S = 6500, 4e-12


def scan() -> Capture:
    """180 x 130 positions 1 cm apart, and three points."""
    x, y = np.meshgrid((np.arange(180) - 89.5) * 0.01, (np.arange(130) - 64.5) * 0.01)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    counts = np.zeros((x.size, BINS), np.uint16)
    for point_m in POINTS_M:
        path_m = np.linalg.norm(laser_m - point_m, axis=1) + np.linalg.norm(DETECTOR_M - point_m)
        counts[np.arange(x.size), (path_m / C_M_PER_S / BIN_WIDTH_S).astype(int)] += 100
    return Capture(ArrayHistograms(counts), BIN_WIDTH_S, np.zeros(1), laser_m, DETECTOR_M[None])


def main() -> None:
    """Run it."""
    device = sys.argv[1] if len(sys.argv) > 1 else "cuda"
    on = rsd_array.backend(device, sys.argv[2] if len(sys.argv) > 2 else None)
    capture, pulse = scan(), VirtualPulse(0.04)
    aperture = recognise(capture.laser_m)
    axes = aperture.x.coordinates_m, aperture.y.coordinates_m
    grid = VoxelGrid(*axes, np.arange(0.5, 3.0, 0.02))
    parts = depth_blocks(capture, pulse, grid)
    begun = perf_counter()
    emitted = spectra(capture, parts, Window())
    times_s = np.stack([plane_times_s(capture, grid, CONFOCAL, z_m) for z_m in grid.z_m])
    spectra_s = perf_counter() - begun

    def image(where: rsd_array.Backend, step: int = 1) -> tuple[np.ndarray, float]:
        field = np.zeros(grid.shape, np.complex64)
        begun = perf_counter()
        for part, spectrum in zip(parts, emitted, strict=True):
            index = np.arange(part.planes.start, part.planes.stop)
            index = index[index % step == 0]
            if part.reached and len(index):
                planes = VoxelGrid(*axes, grid.z_m[index])
                fields = rsd_array.focus_block(
                    aperture,
                    spectrum * part.band.weights[:, None],
                    part.band,
                    planes,
                    1,
                    times_s[index],
                    on=where,
                )
                for plane, (one,) in zip(index, fields, strict=True):
                    field[plane] = one
        return field, perf_counter() - begun

    _, first_s = image(on)
    field, again_s = image(on)
    step = 16  # numpy takes some planes only: it is slow
    reference, numpy_s = image(rsd_array.backend("cpu"), step)
    taken = np.arange(0, len(grid.z_m), step)
    intensity = np.abs(field) ** 2 * grid.z_m[:, None, None] ** 4
    found = []
    for point_m in POINTS_M:
        near = np.flatnonzero(np.abs(grid.z_m - point_m[2]) < 0.2)
        k, j, i = np.unravel_index(intensity[near].argmax(), (len(near), *grid.shape[1:]))
        found.append([grid.x_m[i], grid.y_m[j], grid.z_m[near[k]]])
    name = on.xp.cuda.get_device_name() if device == "cuda" and on.xp.__name__ == "torch" else device
    print(
        json.dumps(
            {
                "device": name,
                "library": f"{on.xp.__name__} {on.xp.__version__}",
                "voxels": grid.shape[::-1],
                "planes_times_frequencies": sum(
                    (part.planes.stop - part.planes.start) * len(part.band.weights) for part in parts
                ),
                "spectra_on_cpu_s": round(spectra_s, 3),
                "first_s": round(first_s, 3),
                "again_s": round(again_s, 3),
                "numpy_s_scaled_to_all_planes": round(numpy_s * len(grid.z_m) / len(taken), 1),
                "max_error_of_peak": float(
                    np.abs(field[taken] - reference[taken]).max() / np.abs(reference).max()
                ),
                "planted_m": POINTS_M.tolist(),
                "found_m": np.round(found, 4).tolist(),
            }
        )
    )


if __name__ == "__main__":
    main()
