"""Planted points give back what a record lacks, within the interval; records that cannot tell say so."""

from dataclasses import replace

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.estimate import EstimateError, bin_width, time_origin, wall_size
from support.hidden_points import histograms, wall
from support.thorough import THOROUGH, some

BIN_S, BINS = 16e-12, 700
SIDE_M = 23 * 0.035
ONE_SPOT_M = np.array([[0.05, -0.02, 0.0]])
GEOMETRIES = pytest.mark.parametrize("confocal", [True, False], ids=["confocal", "one spot"])


def _capture(counts, detector_m=None):
    laser_m = wall(24, 24, 0.035)
    return Capture(
        ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, laser_m if detector_m is None else detector_m
    )


def _points(seed, confocal):
    """Photons of five points about 0.7 m away on a background of 0.005, by a response with sigma 40 ps."""
    random = np.random.default_rng(seed)
    points_m = np.column_stack([random.uniform(-0.3, 0.3, (5, 2)), random.uniform(0.5, 0.9, 5)])
    laser_m = wall(24, 24, 0.035)
    detector_m = laser_m if confocal else ONE_SPOT_M
    mean = histograms(points_m, laser_m, detector_m, BINS, BIN_S)
    response = np.exp(-((np.arange(-8, 9) * BIN_S / 40e-12) ** 2) / 2)
    spread = np.apply_along_axis(np.convolve, 1, mean, response / response.sum(), "same")
    counts = random.poisson(0.2 * spread + 0.005).astype(np.uint32)
    return _capture(counts, None if confocal else ONE_SPOT_M)


@GEOMETRIES
@pytest.mark.parametrize("seed", range(2 if THOROUGH else 1))
def test_points_tell_time_zero(seed, confocal):
    """To a fifth of the depth of focus, lambda (2 D / a)^2 / 2 = 0.26 m or 1.7 ns.

    The wavelength is 0.17 m. Points look smaller when they are imaged nearer, which pulls the maximum there.
    """
    late = replace(_points(seed, confocal), first_bin_s=np.array([5e-9]))
    found = time_origin(late)
    assert found.low <= 5e-9 <= found.high
    assert abs(found.value - 5e-9) < 0.35e-9


@GEOMETRIES
@pytest.mark.parametrize("seed", range(2 if THOROUGH else 1))
def test_points_tell_the_bin_width(seed, confocal):
    """Stretched times move the focus by twice their part of the depth: half the error above, over 0.7 m."""
    wide = replace(_points(seed, confocal), bin_width_s=40e-12)
    found = bin_width(wide)
    assert found.low <= BIN_S <= found.high
    assert found.value == pytest.approx(BIN_S, rel=0.035)


@pytest.mark.parametrize("confocal", some(True, False, short=1))
def test_points_tell_the_walls_size_as_they_tell_the_bin_width(confocal):
    """A wall twice as large and times twice as long give the same record."""
    right = _points(0, confocal)
    small = replace(right, laser_m=right.laser_m / 2, detector_m=right.detector_m / 2)
    found, width = wall_size(small), bin_width(right)
    assert found.low <= SIDE_M <= found.high
    # the same trials of the same images, up to how many bins are merged
    assert found.value / SIDE_M == pytest.approx(BIN_S / width.value, rel=0.01)


@pytest.mark.parametrize("estimate", some(time_origin, bin_width, wall_size, short=1))
def test_noise_tells_nothing(estimate):
    counts = np.random.default_rng(0).poisson(0.3, (576, BINS)).astype(np.uint32)
    with pytest.raises(EstimateError, match="The data do not determine it"):
        estimate(_capture(counts))


def test_a_plane_parallel_to_the_wall_tells_no_time():
    """All its records are alike, so that any earlier plane is as good."""
    delay_s = (np.arange(BINS) + 0.5) * BIN_S
    mean = np.where(delay_s > 4e-9, (4e-9 / delay_s) ** 5, 0) * 20
    counts = np.random.default_rng(0).poisson(np.broadcast_to(mean, (576, BINS))).astype(np.uint32)
    with pytest.raises(EstimateError, match="The data do not determine it"):
        time_origin(_capture(counts))


def test_a_dark_record_tells_nothing():
    with pytest.raises(EstimateError, match="dark"):
        time_origin(_capture(np.zeros((576, BINS), np.uint32), ONE_SPOT_M))


def test_pairs_are_not_tried():
    capture = _points(0, True)
    with pytest.raises(EstimateError, match="pairs"):
        bin_width(replace(capture, detector_m=capture.laser_m[::-1].copy()))


def test_what_is_before_the_fade_is_not_looked_at():
    """A glare of all positions, 100 times brighter, in the first nanosecond."""
    clean = _points(1, False)
    counts = clean.histograms.counts.copy()
    counts[:, 10:40] += np.random.default_rng(0).poisson(100, (576, 30)).astype(np.uint32)
    found = time_origin(_capture(counts, ONE_SPOT_M), fade_from_s=1e-9)
    assert found.value == pytest.approx(time_origin(clean).value, abs=0.05e-9)


def test_a_first_bounce_does_not_disturb_the_bin_width():
    """It is far brighter than all else, and its tail of 0.1 ns is dark before the points come."""
    clean = _points(0, True)
    delay_s = (np.arange(BINS) + 0.5) * BIN_S
    bounce = np.random.default_rng(1).poisson(np.broadcast_to(500 * np.exp(-delay_s / 0.1e-9), (576, BINS)))
    lit = _capture((clean.histograms.counts + bounce).astype(np.uint32))
    assert bin_width(lit).value == pytest.approx(bin_width(clean).value, rel=0.01)


def test_time_zero_may_lie_after_the_records_light():
    """Counted from any moment: here hidden light arrives 3 to 5 ns before the axis begins."""
    early = replace(_points(0, False), first_bin_s=np.array([-9e-9]))
    found = time_origin(early)
    assert found.low <= -9e-9 <= found.high
