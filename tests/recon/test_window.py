"""Edges of the record: where they begin, where they end, and what they do to an image."""

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.errors import ParameterError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import histograms, wall


def test_end_is_the_last_bins_raised_cosine():
    weights = Window(fall_s=0.4e-9).end_weights(100, 1e-11)
    assert np.all(weights[:60] == 1)
    np.testing.assert_allclose(weights[60:], (1 + np.cos(np.pi * (np.arange(40) + 0.5) / 40)) / 2, atol=1e-12)


def test_start_follows_each_position():
    first_bin_s = np.array([0.0, 0.5e-9])
    weights = Window(start_s=1e-9, rise_s=0.2e-9).start_weights(first_bin_s, slice(20, 200), 1e-11)
    assert weights.shape == (2, 100)  # until the later one has risen, at bin 120
    assert np.flatnonzero(weights[0])[0] + 20 == 100
    assert np.flatnonzero(weights[1])[0] + 20 == 50
    assert np.all(weights[1, 50:] == 1)
    assert weights[0, 110 - 20] == pytest.approx((1 - np.cos(np.pi * 10.5 / 20)) / 2)


def test_start_is_left_out_where_it_changes_nothing():
    window = Window(start_s=1e-9, rise_s=0.2e-9)
    assert window.start_weights(np.zeros(3), slice(120, 200), 1e-11).shape == (3, 0)
    assert window.start_weights(np.zeros(3), slice(119, 200), 1e-11).shape == (3, 1)
    assert np.all(window.start_weights(np.zeros(3), slice(10, 20), 1e-11) == np.zeros((3, 10)))
    assert Window().start_weights(np.zeros(3), slice(0, 200), 1e-11).shape == (3, 0)


def test_edges_without_length_are_sharp():
    window = Window(start_s=1e-9, rise_s=0, fall_s=0)
    assert np.all(window.end_weights(10, 1e-11) == 1)
    start = window.start_weights(np.zeros(1), slice(98, 110), 1e-11)[0]
    assert np.all(start[:2] == 0)
    assert np.all(start[2:] == 1)


@pytest.mark.parametrize("solver", ["rsd", "backprojection"])
def test_the_callers_counts_are_left_alone(solver):
    laser_m = wall(4, 4, 0.05)
    counts = np.ones((16, 400), np.float32)
    capture = Capture(ArrayHistograms(counts), 16e-12, np.zeros(1), laser_m, laser_m)
    grid = VoxelGrid(np.zeros(1), np.zeros(1), np.array([0.5]))
    image(capture, VirtualPulse(0.2), grid, solver=solver, window=Window(start_s=3e-9))
    assert np.all(counts == 1)


def test_refuses_negative_lengths():
    with pytest.raises(ParameterError, match="rise_s"):
        Window(rise_s=-1e-9)


@pytest.mark.parametrize("solver", ["rsd", "backprojection"])
def test_a_wall_peak_and_a_cut_background_do_not_image_as_shells(solver):
    laser_m = wall(16, 16, 0.02)
    counts = histograms([[0.05, -0.03, 0.55]], laser_m, laser_m, 300, 16e-12)
    counts += 0.02 * counts.max()  # ambient light, cut off by the record's end
    counts[:, 100:130] += 100 * counts.max()  # the wall's own light, until 2.1 ns
    capture = Capture(ArrayHistograms(counts), 16e-12, np.zeros(1), laser_m, laser_m)
    grid = VoxelGrid(np.linspace(-0.15, 0.15, 16), np.linspace(-0.15, 0.15, 16), np.arange(0.3, 0.75, 0.02))
    pulse = VirtualPulse(0.08)
    bare = image(capture, pulse, grid, solver=solver, window=Window(fall_s=0)).intensity
    soft = image(capture, pulse, grid, solver=solver, window=Window(start_s=2.1e-9)).intensity
    assert grid.z_m[np.unravel_index(bare.argmax(), bare.shape)[0]] < 0.5
    assert grid.z_m[np.unravel_index(soft.argmax(), soft.shape)[0]] == pytest.approx(0.55, abs=0.021)
