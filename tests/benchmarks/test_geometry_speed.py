"""How long walls and volumes off any grid take, beside the grid's own, and how time grows.

Run with ``pytest tests/benchmarks/test_geometry_speed.py -n 0 --benchmark-only -s``.
"""

from time import perf_counter

import numpy as np
import pytest
from test_rsd_speed import scan, seconds_of_ffts

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.defaults import voxels
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse


def best_s(*arguments):
    times = []
    for _ in range(3):
        begun = perf_counter()
        image(*arguments)
        times.append(perf_counter() - begun)
    return min(times)


def test_volume_off_the_walls_grid(benchmark):
    capture, _ = scan(128, 128, 2 / 128, 4096, 4e-12)
    pulse = VirtualPulse(0.06)
    on = voxels(capture, pulse, depth_m=(0.5, 1.5, 1 / 63))
    half = np.linspace(-0.49, 0.49, 64)
    whole = np.linspace(-0.98, 0.98, 64)
    on_s = best_s(capture, pulse, on)
    off_s = benchmark.pedantic(best_s, (capture, pulse, VoxelGrid(half, half, on.z_m)), rounds=1)
    wide_s = best_s(capture, pulse, VoxelGrid(whole, whole, on.z_m))
    size = 64 * 64 * len(on.z_m)
    print(f"\non the grid {on_s:.2f} s, {on_s / on.size * 1e9:.0f} ns a voxel")
    for name, taken_s in (("off it, half as wide", off_s), ("off it, as wide", wide_s)):
        ratio = taken_s / size / (on_s / on.size)
        print(f"{name} {taken_s:.2f} s, {taken_s / size * 1e9:.0f} ns a voxel: {ratio:.1f} times")


@pytest.mark.parametrize("wavelength_m", [0.06, 0.12])
@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize("bent", [False, True])
def test_irregular_wall(benchmark, bent, confocal, wavelength_m):
    regular, point_m = scan(64, 64, 2 / 64, 4096, 4e-12)
    laser_m = regular.laser_m.copy()
    laser_m[:, :2] += np.random.default_rng(0).uniform(-0.01, 0.01, (4096, 2))
    laser_m[:, 2] = bent * 0.05 * (laser_m[:, :2] ** 2).sum(axis=1)
    spots_m = laser_m if confocal else regular.detector_m
    path_m = np.linalg.norm(laser_m - point_m, axis=1) + np.linalg.norm(spots_m - point_m, axis=1)
    counts = np.zeros((4096, 4096), np.uint16)
    counts[np.arange(4096), (path_m / C_M_PER_S / 4e-12).astype(int)] = 100
    capture = Capture(ArrayHistograms(counts), 4e-12, np.zeros(1), laser_m, spots_m)
    grid = VoxelGrid(np.linspace(-1, 1, 64), np.linspace(-1, 1, 64), np.linspace(0.5, 1.5, 64))
    taken_s = benchmark.pedantic(best_s, (capture, VirtualPulse(wavelength_m), grid), rounds=1)
    print(f"\n4096 irregular positions onto 64 x 64 x 64: {taken_s:.2f} s")
    assert taken_s < 10


def test_growth(benchmark):
    print("\nside  bins  planes     s   FFTs alone  ratio")
    for side, bins, planes in ((64, 2048, 32), (128, 2048, 32), (64, 4096, 32), (64, 2048, 64)):
        capture, _ = scan(side, side, 2 / side, bins, 8e-12)
        pulse = VirtualPulse(0.12)
        grid = voxels(capture, pulse, depth_m=(0.5, 0.5 + (planes - 1) / 64, 1 / 64))
        depth_blocks = image(capture, pulse, grid).depth_blocks
        pairs = sum((part.planes.stop - part.planes.start) * len(part.band.weights) for part in depth_blocks)
        taken_s, floor_s = best_s(capture, pulse, grid), seconds_of_ffts((2 * side, 2 * side), pairs)
        print(f"{side:4} {bins:5} {planes:7} {taken_s:6.2f} {floor_s:10.2f} {taken_s / floor_s:8.2f}")
    benchmark.pedantic(best_s, (capture, pulse, grid), rounds=1)
