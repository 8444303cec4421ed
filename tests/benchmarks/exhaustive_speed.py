"""How long an exhaustive capture takes: 16 x 16 lasers by 64 x 64 pixels, rendered and imaged on one core.

    python tests/benchmarks/exhaustive_speed.py FOLDER [--scene patches] [--lasers 16x16] [--pixels 64x64]

It prints processor seconds, peak memory and bytes read of each part, the floor of imaging (its FFTs alone),
and how far a crop of the image is from the sum of all pairs, term by term in double precision. The rendered
scan stays in the folder, and is used again.
"""

import argparse
import json
import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ONE_THREAD = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")
SPACING_M, BINS, WIDTH_S = 0.02, 384, 32e-12
WAVELENGTH_M, DEPTH_M = 0.06, (0.9, 1.35, 0.03)
MEMORY_BYTES = 2 * 10**9
#: Voxels of the crop: side along x and y, and planes.
CROP = 4


def render(folder: Path, scene: str, lasers: str, pixels: str) -> dict[str, Any]:
    """Render a scene, if that was not done before."""
    from rig.bench.render import TimeAxis, render_each_with_each
    from rig.commands.sim import exhaustive_spots_m
    from rig.model.config import built_in_with

    path = folder / f"exhaustive-{scene}-{lasers}-{pixels}.h5"
    if not path.exists():
        config = built_in_with({"simulation": {"scene": scene}})
        sides_m = exhaustive_spots_m(lasers, pixels, SPACING_M)
        render_each_with_each(*sides_m, config, TimeAxis(BINS, WIDTH_S), path)
    return {"file": str(path), "bytes": path.stat().st_size}


def image(path: str) -> dict[str, Any]:
    """Image it, and hold a crop against the direct sum of all pairs."""
    import numpy as np
    from ducc0.fft import c2c

    from recon.by_lasers import image as imaged
    from recon.by_lasers import planned, runs
    from recon.defaults import voxels
    from recon.sampling import CONFOCAL
    from recon.wave import VirtualPulse
    from recon.window import Window
    from rig.files.scan import ScanFile

    pulse, read = VirtualPulse(WAVELENGTH_M), _bytes_read()
    with ScanFile(path) as scan:
        whole = scan.exhaustive()
        assert whole is not None
        grid = voxels(whole.outline(), pulse, voxel_m=SPACING_M, depth_m=DEPTH_M)
        problem = planned(whole, pulse, grid, CONFOCAL, Window())
        began_s = time.process_time()
        found = imaged(whole, pulse, grid, memory_bytes=MEMORY_BYTES)
        took_s = time.process_time() - began_s
        facts = {"image_cpu_s": took_s, "read_bytes": _bytes_read() - read, "peak_bytes": _peak_bytes()}
        units = whole.lasers * sum(
            len(part.band) * (part.planes.stop - part.planes.start) for part in problem.depth_blocks
        )
        field = np.zeros((2 * len(grid.y_m), 2 * len(grid.x_m)), np.complex64)
        began_s = time.process_time()
        for _ in range(400):
            c2c(field, out=field, nthreads=1)
        fft_s = (time.process_time() - began_s) / 400
        facts |= {"voxels": grid.shape, "runs": len(list(runs(whole, problem, MEMORY_BYTES)))}
        facts |= {"lasers x planes x frequencies": units, "floor_cpu_s": 0.75 * fft_s * units}
        facts["crop_error"] = crop_error(whole, found)
        return facts


def crop_error(whole: Any, found: Any) -> float:
    """Return the worst difference of a few voxels from the sum over all pairs, in parts of the peak."""
    import numpy as np

    from recon.capture import C_M_PER_S
    from recon.spectrum import spectra

    peak = np.unravel_index(np.abs(found.field).argmax(), found.field.shape)
    some = [slice(max(0, at - CROP // 2), max(0, at - CROP // 2) + CROP) for at in peak]
    z_m, y_m, x_m = (
        axis[part] for axis, part in zip((found.grid.z_m, found.grid.y_m, found.grid.x_m), some, strict=True)
    )
    places = np.stack(np.meshgrid(z_m, y_m, x_m, indexing="ij"), axis=-1)[..., ::-1]
    wanted = np.zeros(places.shape[:3], complex)
    blocks = [
        part
        for part in found.depth_blocks
        if part.planes.start < some[0].stop and part.planes.stop > some[0].start
    ]
    for first in range(0, whole.lasers, 4):
        pairs = whole.pairs_of(slice(first, first + 4))
        of_blocks = spectra(pairs, blocks, found.window, None, np.complex128)
        for part, spectrum in zip(blocks, of_blocks, strict=True):
            for k in range(len(z_m)):
                if not part.planes.start <= some[0].start + k < part.planes.stop:
                    continue
                voxels_m = places[k].reshape(-1, 3)
                r_d = np.linalg.norm(voxels_m[:, None] - whole.pixel_m, axis=2)
                r_l = np.linalg.norm(voxels_m[:, None] - whole.laser_m[first : first + 4], axis=2)
                for f, omega in enumerate(part.band.frequencies_rad_per_s):
                    of_pairs = spectrum[f].reshape(r_l.shape[1], -1)
                    seen = (np.exp(1j * omega * r_d / C_M_PER_S) / r_d) @ of_pairs.T
                    lit = np.exp(1j * omega * r_l / C_M_PER_S)
                    sums = part.band.weights[f] * (seen * lit).sum(axis=1)
                    wanted[k] += sums.reshape(wanted.shape[1:])
    difference = np.abs(found.field[tuple(some)] - wanted).max()
    return float(difference / np.abs(found.field).max())


def _bytes_read() -> int:
    """Return what this process has read, from the disk or the system's cache."""
    lines = Path("/proc/self/io").read_text().splitlines()
    return int(lines[0].split()[1])


def _peak_bytes() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def alone(work: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Return what a fresh process on one core finds, with its processor time and peak memory."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measured, (work, *arguments))


def _measured(work: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    began_s, load = time.perf_counter(), os.getloadavg()[0]
    facts = work(*arguments)
    own = {"cpu_s": time.process_time(), "clock_s": time.perf_counter() - began_s, "load": load}
    return {"peak_bytes": _peak_bytes()} | facts | own


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scene", default="patches")
    parser.add_argument("--lasers", default="16x16")
    parser.add_argument("--pixels", default="64x64")
    given = parser.parse_args()
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    given.folder.mkdir(parents=True, exist_ok=True)
    rendering = alone(render, given.folder, given.scene, given.lasers, given.pixels)
    print(json.dumps({"render": rendering}, indent=1), flush=True)
    print(json.dumps({"image": alone(image, rendering["file"])}, indent=1))
