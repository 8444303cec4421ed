"""How long the RSD solver takes, beside the time that its FFTs alone would take.

The floor is what an FFT solver with a kernel for each plane and frequency pays if it does nothing else: a
transform of the kernel and an inverse one of the field, complex64, padded to twice the wall, by the same
library on the same threads.
Run with ``pytest tests/benchmarks -n 0 --benchmark-only -s``.
"""

from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from time import perf_counter

import ducc0
import numpy as np
import pytest

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.defaults import voxels
from recon.imaging import image
from recon.sampling import depth_blocks
from recon.spectrum import spectra
from recon.wave import VirtualPulse
from recon.window import Window


def scan(nx, ny, pitch_m, bins, bin_width_s):
    x, y = np.meshgrid((np.arange(nx) - (nx - 1) / 2) * pitch_m, (np.arange(ny) - (ny - 1) / 2) * pitch_m)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    detector_m = np.array([[0.1, -0.05, 0.0]])
    point_m = np.array([0.2, 0.1, 0.8])
    path_m = np.linalg.norm(laser_m - point_m, axis=1) + np.linalg.norm(detector_m - point_m)
    counts = np.zeros((x.size, bins), np.uint16)
    counts[np.arange(x.size), (path_m / C_M_PER_S / bin_width_s).astype(int)] = 100
    return Capture(ArrayHistograms(counts), bin_width_s, np.zeros(1), laser_m, detector_m), point_m


def seconds_of_ffts(shape, pairs):
    """Time of `pairs` kernel transforms and inverse transforms, from a sample of them."""
    sample = 200

    def one(_):
        field = np.ones(shape, np.complex64)
        begun = perf_counter()
        for _ in range(sample):
            ducc0.fft.c2c(field, out=field, nthreads=1)
            ducc0.fft.c2c(field, out=field, forward=False, inorm=2, nthreads=1)
        return perf_counter() - begun

    workers = cpu_count() or 1
    with ThreadPoolExecutor(workers) as threads:
        slowest = max(threads.map(one, range(workers)))
    return slowest / sample / workers * pairs


CASES = {
    "paper": (scan, (180, 130, 0.01, 6500, 4e-12), 0.04, (0.5, 3.0, 0.02), (264, 360)),
    "128x128x4096": (scan, (128, 128, 2 / 128, 4096, 4e-12), 0.06, (0.5, 1.5, 1 / 63), (256, 256)),
}


@pytest.mark.parametrize("name", CASES)
def test_speed(benchmark, name):
    make, size, wavelength_m, depth_m, padded = CASES[name]
    capture, point_m = make(*size)
    pulse = VirtualPulse(wavelength_m)
    grid = voxels(capture, pulse, depth_m=depth_m)
    result = benchmark.pedantic(image, (capture, pulse, grid), warmup_rounds=1, rounds=3)
    k, j, i = np.unravel_index(result.intensity.argmax(), grid.shape)
    assert abs(grid.x_m[i] - point_m[0]) <= (grid.x_m[1] - grid.x_m[0]) / 2 + 1e-9
    assert abs(grid.y_m[j] - point_m[1]) <= (grid.y_m[1] - grid.y_m[0]) / 2 + 1e-9
    assert abs(grid.z_m[k] - point_m[2]) <= 2 * (grid.z_m[1] - grid.z_m[0])
    begun = perf_counter()
    spectra(capture, depth_blocks(capture, pulse, grid), Window())
    reading = perf_counter() - begun
    pairs = sum(
        (part.planes.stop - part.planes.start) * len(part.band.weights) for part in result.depth_blocks
    )
    floor = seconds_of_ffts(padded, pairs)
    total = benchmark.stats.stats.min
    benchmark.extra_info.update(
        voxels=grid.size,
        planes_times_frequencies=pairs,
        spectra_s=reading,
        propagation_s=total - reading,
        fft_floor_s=floor,
        ratio=(total - reading) / floor,
    )
    print(f"\n{name}: {total:.2f} s, {reading:.2f} s of it spectra; FFTs alone {floor:.2f} s")
    assert total - reading < 1.5 * floor
