"""Scenes that others measured: objects appear at their depth, in their place, upright and not mirrored."""

import h5py
import numpy as np
import pytest

from recon.defaults import voxels
from recon.depth import compensate_falloff, depth_map, front_view
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse
from support.published import load, published


def test_two_letters_at_two_depths():
    capture, window = load("lct_su")
    grid = VoxelGrid(np.linspace(-0.35, 0.35, 64), np.linspace(-0.35, 0.35, 64), np.arange(0.45, 1.2, 0.02))
    result = image(capture, VirtualPulse(0.04), grid, window=window)
    lifted = np.abs(compensate_falloff(result.field, grid.z_m)) ** 2
    depth = depth_map(lifted, grid.z_m, threshold=0.15)
    assert np.median(depth[depth < 0.85]) == pytest.approx(0.65, abs=0.03)
    assert np.median(depth[depth > 0.85]) == pytest.approx(1.04, abs=0.03)
    # Upright and not mirrored. Camera's right is -x. An S has its upper stem left and its lower stem right.
    near = front_view(lifted[grid.z_m < 0.85])

    def brightness(x, y):
        rows = np.abs(grid.y_m - y) < 0.03
        columns = np.abs(grid.x_m - x) < 0.025
        return near[np.ix_(rows, columns)].mean()

    assert brightness(x=0.16, y=0.03) > 3 * brightness(x=-0.08, y=0.03)
    assert brightness(x=-0.08, y=-0.12) > 3 * brightness(x=0.16, y=-0.12)


def test_one_detector_digit():
    capture, window = load("phasor_figure4_nonconfocal")
    pulse = VirtualPulse(0.06)
    grid = voxels(capture, pulse, depth_m=(0.7, 1.2, 0.02))
    intensity = image(capture, pulse, grid, window=window).intensity
    depth = depth_map(intensity, grid.z_m, threshold=0.15)
    front = front_view(intensity)
    assert np.average(depth[np.isfinite(depth)], weights=front[np.isfinite(depth)]) == pytest.approx(
        0.95, abs=0.03
    )
    # The published box of the digit is x 0.05 to 0.47, y -0.23 to 0.23; its blur ends at the voxel at 0.55.
    j, i = np.nonzero(np.isfinite(depth))
    assert 0 < grid.x_m[i].min() < grid.x_m[i].max() < 0.56
    assert -0.4 < grid.y_m[j].min() < grid.y_m[j].max() < 0.4


def test_nine_dots_ten_centimetres_apart():
    capture, window = load("lct_dot_chart_40cm")
    axis = np.arange(-0.18, 0.181, 0.004)
    grid = VoxelGrid(axis, axis, np.arange(0.32, 0.5, 0.01))
    intensity = image(capture, VirtualPulse(0.03), grid, window=window).intensity
    for y in (-0.1, 0.0, 0.1):
        for x in (-0.1, 0.0, 0.1):
            rows, columns = (np.flatnonzero(np.abs(axis - centre) < 0.035) for centre in (y, x))
            around = intensity[:, rows][:, :, columns]
            k, j, i = np.unravel_index(around.argmax(), around.shape)
            assert (axis[columns[i]], axis[rows[j]]) == pytest.approx((x, y), abs=0.012)
            assert grid.z_m[k] == pytest.approx(0.40, abs=0.03)


def test_rendered_letters_whose_record_begins_late():
    capture, window = load("rendered_letters")
    assert capture.first_bin_s[0] > 0
    pulse = VirtualPulse(0.056)
    grid = voxels(capture, pulse, depth_m=(1.1, 1.9, 0.03), width_m=1.0, height_m=1.0)
    intensity = image(capture, pulse, grid, window=window).intensity
    with h5py.File(published("rendered_letters.h5")) as file:
        truth_m, x_m, y_m = (file["truth"][name][:] for name in ("depth_m", "x_m", "y_m"))
    truth_m = truth_m[np.abs(y_m[:, None] - grid.y_m).argmin(axis=0)][
        :, np.abs(x_m[:, None] - grid.x_m).argmin(axis=0)
    ]
    depth_m = depth_map(intensity, grid.z_m, threshold=0.05)
    # The median, since the near letter's blur covers the far one's border.
    for letter_m in (1.25, 1.70):
        there = np.isfinite(depth_m) & (np.abs(truth_m - letter_m) < 0.01)
        assert there.sum() > 100
        assert np.median(np.abs(depth_m - truth_m)[there]) < 0.015
