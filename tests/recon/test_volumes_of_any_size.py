"""Choosing voxels and warning about them costs neither an overflow nor the memory of a volume."""

import tracemalloc

import numpy as np

from recon import VoxelGrid, defaults
from recon.capture import ArrayHistograms, Capture
from recon.sampling import path_limits_m
from recon.wave import VirtualPulse


def wall(*, confocal=False):
    x, y = np.meshgrid(np.arange(3) * 0.1, np.arange(2) * 0.1)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(6)], axis=1)
    detector_m = laser_m if confocal else np.array([[0.05, 0.02, 0.0]])
    first_s = np.zeros(len(detector_m))
    return Capture(ArrayHistograms(np.ones((6, 2000))), 16e-12, first_s, laser_m, detector_m)


def test_one_voxel_wider_than_any_wall():
    for width_m, voxel_m in ((0.02, 1e308), (1e308, 1e307)):
        grid = defaults.voxels(
            wall(), VirtualPulse(0.04, 6.0), width_m=width_m, height_m=0.02, voxel_m=voxel_m,
            depth_m=(0.4, 0.4, 3.0),
        )  # fmt: skip
        assert np.isfinite(grid.x_m).all()


def test_warnings_do_not_fill_the_volume():
    grid = VoxelGrid(np.linspace(-1, 1, 1000), np.linspace(-1, 1, 1000), np.linspace(0.5, 1, 8))
    tracemalloc.start()
    defaults.warnings(wall(), VirtualPulse(0.04, 6.0), grid)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < grid.size / 8  # a bit for each voxel; one plane of float64 is as much as all that


def test_the_shortest_path_is_that_of_all_voxels():
    grid = VoxelGrid(np.linspace(-0.3, 0.5, 5), np.linspace(0.4, 0.9, 4), np.linspace(0.5, 1, 3))
    for capture in (wall(), wall(confocal=True)):
        expected_m, _ = path_limits_m(capture, grid)
        np.testing.assert_allclose(defaults.shortest_path_m(capture, grid), expected_m, rtol=1e-14)
