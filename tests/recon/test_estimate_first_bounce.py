"""Time zero is read off the first bounce where a confocal record holds one, and off nothing else."""

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.estimate import from_first_bounce, profile
from support.hidden_points import histograms, wall

BIN_S, BINS, ZERO_S = 16e-12, 600, 1.234e-9
POINTS_M = np.array([[0.1, 0.0, 0.5], [-0.1, 0.1, 0.6]])


def _record(seed, *, bounce, detector_m=None):
    """Photons of hidden points, 1.234 ns late, on a background of 0.1; the response has a sigma of 40 ps."""
    laser_m = wall(12, 12, 0.04)
    detector_m = laser_m if detector_m is None else detector_m
    mean = 0.1 + 0.2 * histograms(POINTS_M, laser_m, detector_m, BINS, BIN_S, -ZERO_S)
    centres_s = (np.arange(BINS) + 0.5) * BIN_S - ZERO_S
    mean += bounce * np.exp(-((centres_s / 40e-12) ** 2) / 2)
    counts = np.random.default_rng(seed).poisson(mean).astype(np.uint32)
    return Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), laser_m, detector_m)


@pytest.mark.parametrize("seed", range(5))
def test_a_first_bounce_is_time_zero_to_a_bin(seed):
    """12 x 12 records with about 5000 photons each: their median peak errs by less than a bin."""
    found = from_first_bounce(profile(_record(seed, bounce=1000)))
    assert found.low <= ZERO_S <= found.high
    assert abs(found.value - ZERO_S) <= BIN_S
    assert found.high - found.low < 150e-12


def test_records_with_delays_of_their_own_are_brought_together():
    """The same records, each cut by its own number of bins, tell the same."""
    whole = _record(0, bounce=1000)
    cut = np.arange(whole.positions) % 7
    counts = np.stack([row[k : k + BINS - 7] for row, k in zip(whole.histograms.counts, cut, strict=True)])
    moved = Capture(ArrayHistograms(counts), BIN_S, cut * BIN_S, whole.laser_m, whole.detector_m)
    # the last seven bins are missing, which moves the median of the sum, and nothing else
    assert from_first_bounce(profile(moved)).value == pytest.approx(
        from_first_bounce(profile(whole)).value, abs=1e-15
    )


def test_hidden_points_are_no_first_bounce():
    assert from_first_bounce(profile(_record(0, bounce=0))) is None


def test_one_detector_spot_has_none_at_time_zero():
    assert from_first_bounce(profile(_record(0, bounce=1000, detector_m=np.zeros((1, 3))))) is None


def test_a_plane_parallel_to_the_wall_lasts_too_long():
    """Matt, 0.3 m away: 1/r^5 in depth r from each position, the same from all; nothing comes later."""
    whole = _record(0, bounce=0)
    depth_m = ((np.arange(BINS) + 0.5) * BIN_S - ZERO_S) * 299_792_458 / 2
    mean = np.where(depth_m > 0.3, (0.3 / np.maximum(depth_m, 0.3)) ** 5, 0) * 1000 + 0.1
    counts = np.random.default_rng(0).poisson(np.broadcast_to(mean, (whole.positions, BINS)))
    plane = Capture(ArrayHistograms(counts), BIN_S, np.zeros(1), whole.laser_m, whole.detector_m)
    assert from_first_bounce(profile(plane)) is None
