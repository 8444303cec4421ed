"""Depths are read from the pulse's time: neither its length nor the fall with depth moves a surface."""

from dataclasses import replace

import numpy as np
import pytest

from recon.capture import C_M_PER_S, ArrayHistograms, Capture
from recon.depth import peak_depth
from recon.errors import ReconError
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import histograms, wall
from support.thorough import some

BIN = 4e-12
DETECTOR = np.array([[0.05, -0.1, 0.0]])


def taken(points_m, confocal, side=41, pitch_m=0.02, strengths=None):
    laser_m = wall(side, side, pitch_m)
    spots_m = laser_m if confocal else DETECTOR
    begin_s = 2 * max(0.0, float(np.min(points_m, axis=0)[2]) - 0.4) / C_M_PER_S
    counts = histograms(points_m, laser_m, spots_m, 900, BIN, begin_s, strengths=strengths)
    return Capture(ArrayHistograms(counts), BIN, np.array([begin_s]), laser_m, spots_m)


def read(capture, pulse, x_m, y_m, z_m, solver="rsd", **options):
    step_m = pulse.wavelength_m / 2
    planes = z_m - 3.3 * step_m + step_m * np.arange(8)  # the surface is between planes
    grid = VoxelGrid(np.atleast_1d(x_m), np.atleast_1d(y_m), planes[planes > 0.05])
    found = image(capture, pulse, grid, solver=solver, window=Window(fall_s=0), **options)
    return peak_depth(found.intensity, grid.z_m, found.late_s)


@pytest.mark.parametrize("confocal", [True, False], ids=["confocal", "one spot"])
@pytest.mark.parametrize("cycles", [1.2, 2, 6])
@pytest.mark.parametrize("depth_m", [0.3, 1.0, 3.0])
def test_a_point_is_where_it_is(confocal, cycles, depth_m):
    """To a hundredth of the planes' spacing, between which lateness is nearly a straight line.

    The power of 1/r alone would move it by s^2/z, 17 mm at 0.3 m for six cycles of 8 cm.
    """
    point_m = np.array([[0.1, -0.06, depth_m]])
    (found_m,) = read(taken(point_m, confocal), VirtualPulse(0.08, cycles), 0.1, -0.06, depth_m).ravel()
    assert found_m == pytest.approx(depth_m, abs=4e-4)


@pytest.mark.filterwarnings("error")
def test_numbers_too_large_for_single_precision_are_imaged_right_or_refused():
    """A power of two changes no digit: the depth is the same, until the intensity itself is too large."""
    capture, depths_m = taken(np.array([[0.1, -0.06, 1.0]]), True, side=11), []
    ((_, counts),) = capture.histograms.blocks()
    for scale in (1, 2**40, 2**70):
        held = ArrayHistograms(counts.astype(np.float32) * np.float32(scale))
        arguments = (replace(capture, histograms=held), VirtualPulse(0.08, 2), 0.1, -0.06, 1.0)
        if scale == 2**70:
            with pytest.raises(ReconError, match=r"square is too large.*divide the counts"):
                read(*arguments)
        else:
            depths_m.append(read(*arguments).item())
    assert depths_m[0] == pytest.approx(depths_m[1], abs=1e-6)
    assert depths_m[0] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(("cycles", "confocal"), some((2, True), (6, False), (6, True), (2, False), short=2))
def test_a_plane_is_where_it_is(confocal, cycles):
    """One that fades outwards, before a wide wall, since edges have waves of their own.

    Within a millimetre in the mean; single pixels, where such waves are left, within two and a half.
    """
    axis_m = np.arange(-0.5, 0.5001, 0.02)
    x_m, y_m = np.meshgrid(axis_m, axis_m)
    plane_m = np.column_stack([x_m.ravel(), y_m.ravel(), np.full(x_m.size, 0.3)])
    fading = np.exp(-(plane_m[:, 0] ** 2 + plane_m[:, 1] ** 2) / (2 * 0.2**2))
    capture = taken(plane_m, confocal, side=61, strengths=fading)
    pulse = VirtualPulse(0.06, cycles)
    found_m = read(capture, pulse, [-0.06, 0.0, 0.06], [-0.06, 0.06], 0.3)
    assert abs(found_m.mean() - 0.3) < 1e-3
    assert np.abs(found_m - 0.3).max() < 2.5e-3


@pytest.mark.parametrize("confocal", [True, False], ids=["confocal", "one spot"])
@pytest.mark.parametrize(
    ("solver", "options"), [("direct", {}), ("rsd", {"fft": False}), ("backprojection", {})]
)
def test_all_solvers_read_the_same_time(confocal, solver, options):
    point_m = np.array([[0.1, -0.06, 0.5]])
    capture = taken(point_m, confocal, side=21, pitch_m=0.03)
    pulse = VirtualPulse(0.1, 3)
    (found_m,) = read(capture, pulse, 0.1, -0.06, 0.5, solver, **options).ravel()
    # the table's straight lines are right to a 64th of sigma_t at each position, 0.5 mm, and so in the mean
    assert found_m == pytest.approx(0.5, abs=2e-4)


def test_pairs_and_scattered_positions_are_read_alike():
    rng = np.random.default_rng(3)
    point_m = np.array([[0.1, -0.06, 0.6]])
    laser_m = np.column_stack([rng.uniform(-0.4, 0.4, (900, 2)), np.zeros(900)])
    for spots_m in (DETECTOR, rng.permutation(laser_m)):
        counts = histograms(point_m, laser_m, spots_m, 900, BIN, 1.5e-9)
        capture = Capture(ArrayHistograms(counts), BIN, np.array([1.5e-9]), laser_m, spots_m)
        (found_m,) = read(capture, VirtualPulse(0.1, 3), 0.1, -0.06, 0.6).ravel()
        assert found_m == pytest.approx(0.6, abs=2e-4)


def test_lateness_is_the_change_with_time():
    """Held against the image a little earlier and later."""
    point_m = np.array([[0.02, 0.01, 0.5]])
    capture = taken(point_m, False, side=21, pitch_m=0.03)
    pulse, step_s = VirtualPulse(0.1, 2), 2e-12
    grid = VoxelGrid(np.array([0.0, 0.05]), np.array([0.0]), np.array([0.45, 0.5, 0.55]))

    def at(delay_s):
        moved = replace(capture, first_bin_s=capture.first_bin_s - delay_s)
        return image(moved, pulse, grid, window=Window(fall_s=0))

    slope = np.log(np.abs(at(step_s).field) / np.abs(at(-step_s).field)) / (2 * step_s)
    np.testing.assert_allclose(at(0).late_s, slope * pulse.sigma_s**2, atol=2e-3 * pulse.sigma_s)
    assert at(0).late_s[0, 0, 0] > 0 > at(0).late_s[2, 0, 0]
