"""Frame by frame: each frame is the exact sum over its own photons; averaging keeps to its rule."""

from dataclasses import replace

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, ParameterError, ReconError
from recon.frames import FrameImager, frames_averaged
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.sparse import sparse
from recon.virtual_aperture import path_error_m, remapped
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import exact, histograms, wall

PULSE = VirtualPulse(0.08)
GRID = VoxelGrid(np.arange(-4, 5) * 0.05, np.arange(-3, 4) * 0.05, 0.7 + 0.2 * np.arange(10))
LASER = wall(16, 12, 0.05)
BINS, WIDTH_S = 700, 32e-12
ONE_SPOT = np.array([[0.01, 0.02, 0.0]])


def capture(laser_m=LASER, detector_m=ONE_SPOT, first_bin_s=0.0):
    nothing = np.broadcast_to(np.uint8(0), (len(laser_m), BINS))
    return Capture(
        ArrayHistograms(nothing), WIDTH_S, np.atleast_1d(first_bin_s), laser_m, np.asarray(detector_m)
    )


def seen(point_m, of, scale=1.0):
    begins_s = np.broadcast_to(of.first_bin_s, of.positions)
    counts = histograms(point_m, of.laser_m, of.detector_m, BINS, WIDTH_S, begins_s)
    return ArrayHistograms(counts * scale)


def difference(field, wanted):
    return float(np.abs(field - wanted).max() / np.abs(wanted).max())


def pixels(rows=4, columns=2, pitch_m=0.03):
    """Detector spots that fill the gap between lines of the laser 12 cm apart, and the lines."""
    spots_m = wall(columns, rows, pitch_m)
    x, y = np.meshgrid(np.arange(-5, 6) * 0.06, np.arange(-2, 3) * rows * pitch_m)
    laser_m = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return capture(np.repeat(laser_m, len(spots_m), axis=0), np.tile(spots_m, (len(laser_m), 1)))


@pytest.mark.parametrize("begins", ["one", "each"])
@pytest.mark.parametrize("start_s", [None, 5e-9])
def test_a_frame_is_the_exact_sum(begins, start_s):
    begin_s = np.array([0.3e-9]) if begins == "one" else np.random.default_rng(1).uniform(0, 1e-9, len(LASER))
    of = capture(first_bin_s=begin_s)
    counts = seen([0.1, 0.05, 1.2], of)
    window = Window(start_s=start_s)
    found = FrameImager(of, PULSE, GRID, window).image(counts)
    wanted = exact(replace(of, histograms=_softened(of, counts, window)), found)
    # single precision, and a lattice that is interpolated to 3e-4 of the peak along each axis
    assert difference(found.field, wanted) < 1e-3


def _softened(of, counts, window):
    """Weight counts as the window says, position by position, in few lines of its own."""
    times_s = of.first_bin_s[:, None] + (np.arange(BINS) + 0.5) * WIDTH_S
    start_s = -1 if window.start_s is None else window.start_s
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((times_s - start_s) / window.rise_s, 0, 1))
    last = np.clip((BINS - 0.5 - np.arange(BINS)) * WIDTH_S / window.fall_s, 0, 1)
    return ArrayHistograms(counts.counts * rise * (0.5 - 0.5 * np.cos(np.pi * last)))


@pytest.mark.filterwarnings("error")
def test_a_frame_too_bright_for_single_precision_is_refused():
    of = capture()
    imager = FrameImager(of, PULSE, GRID)
    with pytest.raises(ReconError, match=r"square is too large.*divide the counts"):
        imager.image(seen([0.1, 0.05, 1.2], of, scale=2.0**65))


def test_confocal_frames_are_the_usual_image():
    laser_m = wall(16, 12, 0.03)
    of = capture(laser_m, laser_m)
    counts = seen([0.1, 0.05, 1.2], of)
    found = FrameImager(of, PULSE, GRID).image(counts)
    assert difference(found.field, exact(replace(of, histograms=counts), found)) < 1e-3


def test_kept_kernels_change_nothing():
    of = capture()
    frames = [seen([x_m, 0.0, 1.2], of) for x_m in (0.1, 0.2)]
    kept, fresh = FrameImager(of, PULSE, GRID), FrameImager(of, PULSE, GRID, kernel_bytes=0)
    for frame in frames:
        np.testing.assert_array_equal(kept.image(frame).field, fresh.image(frame).field)


def test_a_moving_point_appears_where_it_was():
    of = capture()
    imager = FrameImager(of, PULSE, GRID, fresh_to_m=1.0)
    for x_m in np.arange(-4, 5) * 0.05:
        intensity = imager.image(seen([x_m, 0.05, 1.3], of)).intensity
        plane, row, column = np.unravel_index(intensity.argmax(), intensity.shape)
        place = GRID.x_m[column], GRID.y_m[row], GRID.z_m[plane]
        assert place == pytest.approx((x_m, 0.05, 1.3))  # the voxel


def test_averaging_begins_where_the_rule_says():
    z_m = np.array([0.5, 1.0, 1.99, 2.0, 2.5, 3.0, 3.7])
    np.testing.assert_array_equal(frames_averaged(z_m, 1.0), [1, 1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(frames_averaged(z_m, None), np.ones(7))
    with pytest.raises(ParameterError, match="z_0"):
        frames_averaged(z_m, 0.0)


def test_near_depths_are_never_smeared_and_far_ones_are_the_mean():
    of = capture()
    path = [seen([x_m, 0.0, 1.3], of) for x_m in (-0.2, -0.1, 0.0, 0.1, 0.2)]
    alone, averaging = FrameImager(of, PULSE, GRID), FrameImager(of, PULSE, GRID, fresh_to_m=0.6)
    single = [alone.image(frame).field for frame in path]
    found = [averaging.image(frame).field for frame in path]
    number = frames_averaged(GRID.z_m, 0.6)
    assert set(number) == {1, 2, 3, 4}
    for last, field in enumerate(found):
        for plane, many in enumerate(number):
            mean = np.mean([single[k][plane] for k in range(max(0, last + 1 - many), last + 1)], axis=0)
            # other depth blocks, so other frequencies: the pulse is cut at 3 sigma, 0.27 % of its peak
            assert np.abs(field[plane] - mean).max() < 6e-3 * np.abs(single).max(), (last, plane)


def test_noise_of_a_still_scene_falls_with_the_number_of_frames():
    of = capture()
    rng = np.random.default_rng(8)
    imagers = [FrameImager(of, PULSE, GRID, fresh_to_m=z_0) for z_0 in (None, 0.6)]
    total = np.zeros((2, len(GRID.z_m)))
    for number in range(24):
        frame = ArrayHistograms(rng.poisson(0.2, (of.positions, BINS)).astype("u2"))
        for one, imager in enumerate(imagers):
            power = imager.image(frame).intensity.mean(axis=(1, 2))
            total[one] += power if number >= 3 else 0  # the first three have not as many before them
    ratio = total[0] / total[1]
    # Even counts have no mean field but at the record's ends, so that power is variance, which falls as 1/N.
    # 21 frames of some ten independent speckles a plane: 7 %, and 1.5 times that for those that overlap.
    np.testing.assert_allclose(ratio, frames_averaged(GRID.z_m, 0.6), rtol=0.35)


def test_pixels_become_one_virtual_aperture():
    of = pixels()
    virtual = remapped(of)
    assert virtual.detector_m.shape == (1, 3)
    np.testing.assert_allclose(virtual.detector_m[0], 0, atol=1e-12)
    lines = np.unique(virtual.laser_m[:, 1].round(9))
    np.testing.assert_allclose(np.diff(lines), 0.03)  # no gap is left, and no line is seen twice
    one = capture()
    assert remapped(one) is one


@pytest.mark.parametrize("voxel_m", [(0.0, 0.0, 1.0), (0.4, -0.3, 0.8), (-0.2, 0.3, 2.0)])
def test_the_virtual_path_is_wrong_by_no_more_than_its_bound(voxel_m):
    of = pixels()
    aside_m = np.linalg.norm(of.detector_m, axis=1)
    apart_m = np.linalg.norm(of.laser_m, axis=1)
    # |u_p - u_c| is at most the distance of both spots over the least distance to the voxel, and the second
    # order is at most d^2 over that distance, for both legs
    bound_m = aside_m * (apart_m + aside_m) / voxel_m[2]
    assert (np.abs(path_error_m(of, np.array(voxel_m))) <= bound_m).all()


def test_frames_of_pixels_are_the_exact_sum_over_the_virtual_aperture():
    of = pixels()
    counts = seen([0.1, 0.05, 1.2], of)
    found = FrameImager(of, PULSE, GRID).image(counts)
    wanted = exact(replace(remapped(of), histograms=counts), found)
    assert difference(found.field, wanted) < 1e-3


def test_the_virtual_aperture_shows_what_each_detector_spot_would():
    point_m, of = np.array([0.1, 0.05, 1.3]), pixels()
    of = replace(of, histograms=seen(point_m, of))
    virtual = FrameImager(of, PULSE, GRID).image(of.histograms)
    each = image(of, PULSE, GRID)
    assert difference(each.field, exact(of, each)) < 1e-3
    one, other = (np.abs(found.field) for found in (virtual, each))
    peak = np.unravel_index(other.argmax(), other.shape)
    assert np.unravel_index(one.argmax(), one.shape) == peak
    # What is lost at the point is what the wrong phases of its pairs cost.
    phase = 2 * np.pi / PULSE.wavelength_m * path_error_m(of, point_m)
    r_p = np.linalg.norm(of.laser_m - point_m, axis=1)
    weight = of.histograms.counts.sum(axis=1) / r_p
    kept = abs((weight * np.exp(1j * phase)).sum()) / weight.sum()
    assert 0.9 < kept < 0.999
    # The pulse is late by up to 2 cm, of a sigma of 6.8: another 4 % of the few outermost pairs.
    assert one[peak] / other[peak] == pytest.approx(kept, abs=0.01)


def test_counts_that_are_kept_are_all_that_there_are():
    counts = np.random.default_rng(3).poisson(0.1, (30, 50)).astype("u2")
    photons = sparse(ArrayHistograms(counts, block_positions=7), slice(5, 40))
    again = np.zeros_like(counts)
    again[np.repeat(np.arange(30), np.diff(photons.offset)), photons.bins] = photons.counts
    np.testing.assert_array_equal(again[:, 5:40], counts[:, 5:40])
    assert not again[:, :5].any()
    assert not again[:, 40:].any()


def test_a_frame_of_another_scan_is_refused():
    imager = FrameImager(capture(), PULSE, GRID)
    with pytest.raises(GeometryError, match="counts of 192 positions"):
        imager.image(ArrayHistograms(np.zeros((3, BINS), "u2")))
