"""The RSD solver against the sum that defines the image, and against the back-projection solver."""

from dataclasses import replace

import numpy as np
import pytest

from recon.camera import ConfocalCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.imaging import image, plan, planes
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import exact, histograms, wall, worst
from support.thorough import some

PITCH = 0.02
PULSE = VirtualPulse(0.08)
BIN = 16e-12
BINS = 700
POINTS = np.array([[0.11, -0.06, 0.52], [-0.2, 0.14, 0.75]])


def capture(confocal=False, first_bin_s=0.0, laser_m=None, detector_m=(0.03, -0.05, 0.0), points_m=POINTS):
    laser_m = wall(24, 20, PITCH) if laser_m is None else laser_m
    spots = laser_m if confocal else np.array([detector_m])
    counts = histograms(points_m, laser_m, spots, BINS, BIN, first_bin_s)
    return Capture(ArrayHistograms(counts, 100), BIN, np.atleast_1d(first_bin_s), laser_m, spots)


def voxels(pitch=PITCH, x0=-0.23, y0=-0.19, nx=24, ny=20, z_m=(0.5, 0.52, 0.54, 0.74, 0.76)):
    return VoxelGrid(x0 + pitch * np.arange(nx), y0 + pitch * np.arange(ny), np.array(z_m))


def correlation(a, b):
    return abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b)


@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize(
    "grid",
    [
        voxels(),
        voxels(x0=-0.23 + 0.1, y0=-0.19 - 0.06, nx=11, ny=7),  # on the lattice, off centre
        voxels(pitch=2 * PITCH, nx=10, ny=9),  # every second lattice point
        voxels(nx=1, ny=1),
    ],
    ids=["same", "off-centre", "double-pitch", "one-voxel"],
)
def test_is_the_discrete_sum_on_the_lattice(confocal, grid):
    taken = capture(confocal)
    result = image(taken, PULSE, grid)
    # Single precision: 1e-7 for each of some 30 frequencies and as many FFT stages.
    assert worst(result.field, exact(taken, result)) < 3e-5


@pytest.mark.parametrize("confocal", [False, True])
@pytest.mark.parametrize(
    "grid",
    [
        voxels(pitch=0.013, x0=-0.171, y0=-0.122, nx=27, ny=19),
        voxels(pitch=0.01, nx=20, ny=17),
        voxels(pitch=0.031, x0=0.1, y0=-0.4, nx=9, ny=8),  # beyond the wall
    ],
    ids=["finer", "half-pitch", "beyond"],
)
def test_is_the_discrete_sum_between_lattice_points(confocal, grid):
    taken = capture(confocal)
    result = image(taken, PULSE, grid)
    # The interpolation is designed for 3e-4 along each axis.
    assert worst(result.field, exact(taken, result)) < 1e-3


def test_takes_a_wall_that_is_coarser_than_the_wave_needs():
    taken = capture(laser_m=wall(12, 10, 2 * PITCH))
    pulse = VirtualPulse(0.05)
    result = image(taken, pulse, voxels(pitch=0.017))
    assert worst(result.field, exact(taken, result)) < 1e-3


@pytest.mark.parametrize(
    ("first", "confocal"),
    some(("each", False), ("scalar", True), ("each", True), ("scalar", False), short=2),
)
def test_honours_the_time_of_the_first_bin(first, confocal):
    spread = np.random.default_rng(3).uniform(-5e-10, 5e-10, 480) if first == "each" else 0.0
    taken = capture(confocal, first_bin_s=2e-9 + spread)
    result = image(taken, PULSE, voxels())
    assert worst(result.field, exact(taken, result)) < 3e-5
    # The same scene in another clock is the same image, up to how a count is shared between bins: a bin is
    # 4.8 mm of path, lambda/17, and linear sharing damps and shifts by less than (pi/17)^2/2 = 2 %.
    assert correlation(result.field, image(capture(confocal), PULSE, voxels()).field) > 0.999


def test_order_and_missing_positions_do_not_matter():
    laser_m = wall(24, 20, PITCH)
    kept = np.random.default_rng(1).permutation(np.flatnonzero(np.hypot(*(laser_m[:, :2] - 0.03).T) > 0.03))
    taken = capture(laser_m=laser_m[kept])
    result = image(taken, PULSE, voxels())
    assert worst(result.field, exact(taken, result)) < 3e-5


@pytest.mark.parametrize("confocal", [False, True])
def test_agrees_with_the_time_domain(confocal):
    taken = capture(confocal, first_bin_s=1e-9)
    grid = voxels(pitch=0.025, nx=16, ny=14)
    one = image(taken, PULSE, grid).field
    other = image(taken, PULSE, grid, solver="backprojection").field
    # The band is cut at 3 sigma, which takes 0.27 % of the pulse away; everything else is smaller.
    assert correlation(one, other) > 0.9999
    assert worst(one, other) < 1e-2


def test_pulse_copies_do_not_reach_the_volume():
    # One count at each end of what the volume can see, far from the other end's voxels: no ghost may appear.
    grid = voxels(z_m=np.arange(0.3, 1.0, 0.02))
    taken = capture(points_m=np.array([[0.01, 0.01, 0.3]]))
    result = np.abs(image(taken, PULSE, grid).field)
    assert result[grid.z_m > 0.7].max() < 2e-2 * result.max()


@pytest.mark.parametrize("confocal", [False, True])
def test_is_linear_in_the_counts(confocal):
    near, far = (capture(confocal, points_m=POINTS[[i]]) for i in (0, 1))
    both = replace(near, histograms=ArrayHistograms(near.histograms.counts + 3 * far.histograms.counts))
    fields = [image(each, PULSE, voxels()).field for each in (near, far, both)]
    assert worst(fields[0] + 3 * fields[1], fields[2]) < 1e-5


def test_moving_wall_and_scene_moves_the_image():
    shift = np.array([0.37, -0.21, 0.0])
    moved = capture(
        laser_m=wall(24, 20, PITCH) + shift,
        detector_m=shift + np.array([0.03, -0.05, 0]),
        points_m=POINTS + shift,
    )
    grid = voxels()
    there = VoxelGrid(grid.x_m + shift[0], grid.y_m + shift[1], grid.z_m)
    # The generator's float32 counts differ in rounding only.
    assert worst(image(moved, PULSE, there).field, image(capture(), PULSE, grid).field) < 1e-4


def test_few_frequencies_at_a_time_give_the_same():
    whole = image(capture(), PULSE, voxels()).field
    parts = []
    problem = plan(capture(), PULSE, voxels(), ConfocalCamera(), Window(), parts.append)
    cut = np.concatenate(list(planes(replace(problem, wall_bytes=5 * 8 * 48 * 40), "rsd")))
    assert worst(cut, whole) < 1e-5
    assert parts == sorted(parts)
    assert parts[-1] == pytest.approx(1)


def test_refuses_what_it_cannot_image():
    irregular = wall(24, 20, PITCH)
    irregular[17, 0] += 0.004
    with pytest.raises(GeometryError, match=r"position 17 .*Use the rsd solver"):
        image(capture(laser_m=irregular), PULSE, voxels(), solver="fresnel")
    pairs = capture()
    pairs = replace(pairs, detector_m=pairs.laser_m[::-1].copy())
    with pytest.raises(GeometryError, match="480 detector spots"):
        image(pairs, PULSE, voxels(), solver="fresnel")
    with pytest.raises(ReachError, match=r"the record holds 0.00 to 11.20 ns"):
        image(capture(), PULSE, voxels(z_m=(5.0, 5.1)))
    with pytest.raises(ParameterError, match="in front of the wall"):
        image(capture(), PULSE, voxels(z_m=(0.0, 0.1)))
    with pytest.raises(ParameterError, match="no such solver"):
        image(capture(), PULSE, voxels(), solver="magic")
