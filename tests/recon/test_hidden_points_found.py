"""Points planted in the hidden scene are found where they are, by both solvers, in every geometry."""

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.defaults import voxels
from recon.depth import compensate_falloff, depth_map, front_view
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse
from support.hidden_points import histograms, snake, wall

POINT = np.array([0.083, -0.057, 0.613])
PULSE = VirtualPulse(0.06)
BIN = 8e-12


def found(capture, grid, solver="rsd"):
    intensity = compensate_falloff(image(capture, PULSE, grid, solver=solver).intensity, grid.z_m, 2)
    _, j, i = np.unravel_index(intensity.argmax(), intensity.shape)
    return np.array([grid.x_m[i], grid.y_m[j], depth_map(intensity, grid.z_m)[j, i]])


def taken(confocal, laser_m, first_bin_s=0.0, detector_m=(-0.04, 0.03, 0.0)):
    spots = laser_m if confocal else np.array([detector_m])
    counts = histograms(POINT, laser_m, spots, 1000, BIN, first_bin_s, falloff=False)
    return Capture(ArrayHistograms(counts), BIN, np.atleast_1d(first_bin_s), laser_m, spots)


LASER = wall(32, 28, 0.015)
DELAYS = np.random.default_rng(9).uniform(0, 2e-9, len(LASER))
WALLS = {
    "rows": (LASER, 0.0),
    "snake": (snake(LASER, 32), 0.0),
    "square skipped": (LASER[np.abs(LASER[:, :2] - [-0.04, 0.03]).max(axis=1) > 0.03], 0.0),
    "off centre": (wall(32, 28, 0.015, (0.2, 0.1)), 0.0),
    "late first bin": (LASER, 2.4e-9),
    "a first bin for each": (LASER, DELAYS),
}


@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize("name", WALLS)
def test_rsd_finds_the_point(name, confocal):
    laser_m, first_bin_s = WALLS[name]
    capture = taken(confocal, laser_m, first_bin_s)
    fine = VoxelGrid.from_spec(0.3, 0.3, 0.01, (0.5, 0.75, 0.02))
    # Half a voxel, the promise. Depth is refined, but slopes: off the axis the pulse's front is curved.
    assert np.all(np.abs(found(capture, fine) - POINT) <= [0.005, 0.005, 0.01])


@pytest.mark.parametrize("confocal", [False, True])
def test_the_advised_grid_finds_it_too(confocal):
    capture = taken(confocal, LASER)
    grid = voxels(capture, PULSE, depth_m=(0.5, 0.75, 0.02))
    np.testing.assert_allclose(grid.x_m, np.unique(LASER[:, 0]), atol=1e-12)
    assert np.all(np.abs(found(capture, grid) - POINT) <= [0.0075, 0.0075, 0.01])


@pytest.mark.parametrize("geometry", ["scattered", "curved wall", "pairs"])
def test_backprojection_takes_any_positions(geometry):
    random = np.random.default_rng(11)
    laser_m = random.uniform(-0.25, 0.25, (700, 3)) * [1, 1, 0]
    detector_m = np.array([[0.03, 0.02, 0.0]])
    if geometry == "curved wall":
        laser_m[:, 2] = 0.3 * laser_m[:, 0] ** 2 - 0.1 * laser_m[:, 1]
        detector_m[:, 2] = -0.01
    if geometry == "pairs":
        detector_m = random.uniform(-0.25, 0.25, (700, 3)) * [1, 1, 0]
    first_bin_s = random.uniform(0, 1e-9, 5)[random.integers(0, 5, 700)]
    counts = histograms(POINT, laser_m, detector_m, 1000, BIN, first_bin_s, falloff=False)
    capture = Capture(ArrayHistograms(counts), BIN, first_bin_s, laser_m, detector_m)
    grid = VoxelGrid(
        POINT[0] + 0.01 * np.arange(-6, 7), POINT[1] + 0.01 * np.arange(-6, 7), np.arange(0.55, 0.68, 0.01)
    )
    assert np.all(np.abs(found(capture, grid, "backprojection") - POINT) <= [0.005, 0.005, 0.01])


def test_falloff_is_undone_and_both_points_are_seen():
    near, far = np.array([-0.1, 0.0, 0.5]), np.array([0.12, 0.0, 1.0])
    counts = histograms([near, far], LASER, LASER, 1000, BIN)
    capture = Capture(ArrayHistograms(counts), BIN, np.zeros(1), LASER, LASER)
    grid = voxels(capture, PULSE, depth_m=(0.4, 1.1, 0.02))
    field = image(capture, PULSE, grid).field
    here, there = grid.z_m < 0.6, grid.z_m > 0.9

    def far_to_near(amplitude):
        return np.abs(amplitude[there]).max() / np.abs(amplitude[here]).max()

    # 1/z^4 counts and 1/z of the kernel: 32 on the axis, less since the wall is as wide as the near depth.
    assert 1 / 32 < far_to_near(field) < 1 / 15
    lifted = compensate_falloff(field, grid.z_m)
    # (1.0/0.5)^2, peaks being at most a plane off: (1 + 0.02/0.5)^2.
    assert far_to_near(lifted) / far_to_near(field) == pytest.approx(4, rel=0.09)
    view = np.abs(lifted[there]) ** 2
    j, i = np.unravel_index(front_view(view).argmax(), view.shape[1:])
    assert (grid.x_m[i], grid.y_m[j]) == pytest.approx(far[:2], abs=0.0075 + 1e-9)
    assert depth_map(view, grid.z_m[there])[j, i] == pytest.approx(1.0, abs=0.01)


def test_depth_is_refined_and_masked():
    z_m = np.linspace(0.5, 1.0, 26)
    true_m = np.array([[0.713, 0.62, 0.5, 1.0]])
    intensity = np.exp(-(((z_m[:, None, None] - true_m) / 0.05) ** 2)).astype(np.float32)
    intensity[:, 0, 1] *= 0.05
    depth = depth_map(intensity, z_m, threshold=0.1)
    assert np.isnan(depth[0, 1])
    np.testing.assert_allclose(depth[0, [0, 2, 3]], true_m[0, [0, 2, 3]], atol=1e-5)
    assert np.all(np.isnan(depth_map(np.zeros((5, 2, 2), np.float32), z_m[:5])))
