"""Scenes that others measured, by the baselines: each object at its depth and in its place."""

import numpy as np
import pytest

from recon.depth import compensate_falloff, depth_map
from recon.grid import VoxelGrid
from recon.solvers.classic.solve import baseline_image
from support.published import load


@pytest.mark.parametrize("solver", ["log-fbp", "lct", "fk"])
def test_two_letters(solver):
    capture, window = load("lct_su")
    axis = np.linspace(-0.35, 0.35, 32 if solver == "log-fbp" else 64)
    grid = VoxelGrid(axis, axis, np.arange(0.45, 1.2, 0.02))
    result = baseline_image(capture, grid, solver=solver, window=window)
    lifted = compensate_falloff(result.intensity, grid.z_m, result.falloff_power)
    depth = depth_map(lifted, grid.z_m, threshold=0.1)
    assert np.median(depth[depth < 0.85]) == pytest.approx(0.65, abs=0.03)
    assert np.median(depth[depth > 0.85]) == pytest.approx(1.04, abs=0.03)
    # Upright and not mirrored: an S has its upper stem left and its lower right, and camera's left is +x.
    near = lifted[grid.z_m < 0.85].max(axis=0)
    contrast = 2 if solver == "log-fbp" else 3  # it blurs by a voxel of 2.3 cm

    def brightness(x, y):
        return near[np.ix_(np.abs(axis - y) < 0.03, np.abs(axis - x) < 0.025)].mean()

    assert brightness(x=0.16, y=0.03) > contrast * brightness(x=-0.08, y=0.03)
    assert brightness(x=-0.08, y=-0.12) > contrast * brightness(x=0.16, y=-0.12)


@pytest.mark.parametrize("solver", ["log-fbp", "lct", "fk"])
def test_one_detector_digit(solver):
    capture, window = load("phasor_figure4_nonconfocal")
    axis = np.arange(-0.6, 0.61, 0.03)
    grid = VoxelGrid(axis, axis, np.arange(0.7, 1.2, 0.02))
    result = baseline_image(capture, grid, solver=solver, window=window)
    k, j, i = np.unravel_index(result.intensity.argmax(), result.intensity.shape)
    # The published box of the digit, and its depth of 0.90 to 0.97 m with half a voxel around.
    assert 0.05 <= axis[i] <= 0.47
    assert -0.23 <= axis[j] <= 0.23
    assert 0.89 <= grid.z_m[k] <= 0.98
