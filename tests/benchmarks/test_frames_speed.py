"""How long a frame of a film takes, beside the time that its FFTs alone would take.

The floor is one inverse transform of the lattice for each plane and frequency, complex64, by the same library
on the same threads: what is left where the wave's transforms are kept from frame to frame. Both are measured
in one run, since other programs on the machine slow both down; the computer time of all threads is told, too.
Run with ``pytest tests/benchmarks/test_frames_speed.py -n 0 --benchmark-only -s``.
"""

from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from time import perf_counter, process_time

import ducc0
import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.frames import FrameImager
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.sparse import Photons
from recon.virtual_aperture import remapped
from recon.wave import VirtualPulse

PULSE = VirtualPulse(0.08)
#: Volumes: width and height, voxel, depths [m]. Nam et al.: 150 x 150 x about 200 voxels.
VOLUMES = {
    "100 x 100 x 13": (1.9, 0.019, (0.8, 1.4, 0.05)),
    "150 x 150 x 200": (1.9, 1.9 / 150, (0.5, 2.5, 2 / 199.5)),
}
BINS, FRAMES = 1024, 5


def rig(columns=190, rows=22, pixels=14, bins=BINS):
    """Positions and pixels of configs/video.toml."""
    pitch_m = 0.08638 / 14
    x_m, y_m = (np.arange(columns) - (columns - 1) / 2) * 0.01, (np.arange(rows) - (rows - 1) / 2) * 0.08638
    laser_m = np.stack(np.broadcast_arrays(x_m, y_m[:, None], 0.0), axis=-1).reshape(-1, 3)
    at_m = (np.arange(pixels) - (pixels - 1) / 2) * pitch_m
    spots_m = np.array([(x_m, y_m, 0.0) for x_m in (-0.005, 0.005) for y_m in at_m])
    pairs = len(laser_m) * len(spots_m)
    nothing = np.broadcast_to(np.uint8(0), (pairs, bins))
    laser_m, detector_m = np.repeat(laser_m, len(spots_m), axis=0), np.tile(spots_m, (len(laser_m), 1))
    return Capture(ArrayHistograms(nothing), 32e-12, np.array([-4e-9]), laser_m, detector_m)


def photons(positions, each=10.25):
    """As many as a pixel counts in 50 us at 205,000 a second, anywhere in the gate."""
    rng = np.random.default_rng(3)
    offset = np.concatenate([[0], np.cumsum(rng.poisson(each, positions))])
    return Photons(offset, rng.integers(250, BINS, offset[-1]).astype("i4"), np.ones(offset[-1], "f4"))


def seconds_of_ffts(shape, number):
    """Time, and computer time, of so many inverse transforms on all threads, from a sample of them."""
    sample = 200

    def one(_):
        field = np.ones(shape, np.complex64)
        for _ in range(sample):
            ducc0.fft.c2c(field, out=field, forward=False, inorm=2, nthreads=1)

    workers = cpu_count() or 1
    with ThreadPoolExecutor(workers) as threads:
        began_s, used_s = perf_counter(), process_time()
        list(threads.map(one, range(workers)))
        took_s, used_s = perf_counter() - began_s, process_time() - used_s
    return took_s / sample / workers * number, used_s / sample / workers * number


@pytest.mark.parametrize("name", VOLUMES)
def test_a_frame(benchmark, name):
    width_m, voxel_m, depth_m = VOLUMES[name]
    capture, grid = rig(), VoxelGrid.from_spec(width_m, width_m, voxel_m, depth_m)
    imager, frame = FrameImager(capture, PULSE, grid, fresh_to_m=1.0), photons(capture.positions)
    begun = imager.image(frame)  # what is kept for the next
    used_s, took = process_time(), []

    def one():
        began_s = perf_counter()
        imager.image(frame)
        took.append(perf_counter() - began_s)

    benchmark.pedantic(one, rounds=FRAMES if "13" in name else 1)
    used_s = (process_time() - used_s) / len(took)
    many = sum(len(part.band) * (part.planes.stop - part.planes.start) for part in begun.depth_blocks)
    side = 2 * int(np.ceil(width_m / voxel_m)) + 20
    floor_s, floor_used_s = seconds_of_ffts((side, side), many)
    print(
        f"\n{name}: {np.median(took):.2f} s a frame, {used_s:.2f} s of computer time; floor, {many:,} "
        f"transforms of {side} x {side}: {floor_s:.2f} s, {floor_used_s:.2f} s of computer time; "
        f"{np.median(took) / floor_s:.2f} and {used_s / floor_used_s:.2f} times that"
    )


def test_virtual_aperture_or_each_detector_spot(benchmark):
    capture, grid = rig(95, 11), VoxelGrid.from_spec(0.95, 0.95, 0.019, (0.7, 1.5, 0.1))
    counts = np.random.default_rng(4).poisson(0.01, (capture.positions, BINS)).astype("u1")
    full = Capture(
        ArrayHistograms(counts), capture.bin_width_s, capture.first_bin_s, capture.laser_m, capture.detector_m
    )
    times = {}
    for label, seen in (("each of 28", full), ("virtual", remapped(full))):
        began_s = process_time()
        image(seen, PULSE, grid)
        times[label] = process_time() - began_s
    imager = FrameImager(capture, PULSE, grid)
    imager.image(full.histograms)
    began_s = process_time()
    benchmark.pedantic(imager.image, (full.histograms,), rounds=1)
    times["virtual, frame after frame"] = process_time() - began_s
    print("\n" + ", ".join(f"{label}: {time_s:.2f} s of computer time" for label, time_s in times.items()))
