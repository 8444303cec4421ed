"""What is called a surface, and how sure that is: glints, noise, nothing, little things, layers."""

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.noise import photon_noise, quiet_level, tallied
from recon.surface import find
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import histograms, wall
from support.thorough import THOROUGH

BIN = 16e-12
LASER = wall(21, 21, 0.06)
DETECTOR = np.array([[0.05, -0.1, 0.0]])
PULSE = VirtualPulse(0.08)
GRID = VoxelGrid(np.arange(-0.6, 0.61, 0.06), np.arange(-0.6, 0.61, 0.06), np.arange(0.5, 1.62, 0.04))


def seen(counts, confocal=False, window=None):
    spots_m = LASER if confocal else DETECTOR
    capture = Capture(ArrayHistograms(counts), BIN, np.zeros(1), LASER, spots_m)
    window = window or Window()
    read, tally = tallied(capture, PULSE, window)
    found = image(read, PULSE, GRID, window=window)
    return find(found, photon_noise(tally, PULSE, GRID) if tally.whole else quiet_level(found.intensity))


def expected(points_m, confocal=False):
    """A mean of one count a position from these points together."""
    counts = histograms(points_m, LASER, LASER if confocal else DETECTOR, 900, BIN)
    return counts / counts.sum(axis=1).mean()


def plate(x_m, y_m, z_m, pitch_m=0.02):
    x, y = np.meshgrid(np.arange(*x_m, pitch_m), np.arange(*y_m, pitch_m))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z_m)])


@pytest.mark.parametrize("confocal", [False, True], ids=["one spot", "confocal"])
@pytest.mark.parametrize("background", [0.01, 0.3, 30])
def test_nothing_is_called_nothing(confocal, background):
    """In 99 of 100 images at least: of those drawn for each of six kinds one may fail by chance, not two."""
    rng = np.random.default_rng(1)
    draws = [
        rng.poisson(background / 900, (len(LASER), 900)).astype(np.uint32)
        for _ in range(25 if THOROUGH else 10)
    ]
    empty = [seen(counts, confocal).empty for counts in draws]
    assert sum(empty) >= len(draws) - 1
    assert not np.isfinite(seen(draws[empty.index(True)], confocal).depth_m).any()


def test_noise_is_exponential_about_the_level_that_is_computed():
    """Images of background alone: ratios to the level have mean one, and their tail is e^-3 at 3."""
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(20 if THOROUGH else 8):
        counts = rng.poisson(30 / 900, (len(LASER), 900)).astype(np.uint32)
        capture = Capture(ArrayHistograms(counts), BIN, np.zeros(1), LASER, DETECTOR)
        read, tally = tallied(capture, PULSE, Window())
        found = image(read, PULSE, GRID).intensity
        noise = photon_noise(tally, PULSE, GRID)
        ratios += [plane / noise.plane(k, plane.shape) for k, plane in enumerate(found)]
    # Some 8 x 1500 independent cells: the mean is known to 1 %, and 600 of them are in the tail. Ten counts
    # that are added to a few hundred in a pulse, and the record's edges, take some per cent.
    assert np.mean(ratios) == pytest.approx(1, abs=0.1)
    assert (np.array(ratios) > 3).mean() == pytest.approx(np.exp(-3), rel=0.25)


@pytest.mark.parametrize("confocal", [False, True], ids=["one spot", "confocal"])
def test_a_little_thing_in_background_is_seen(confocal):
    """One point with three counts a position in thirty of background, in every draw."""
    rng = np.random.default_rng(3)
    mean = 3 * expected([[0.12, -0.06, 0.9]], confocal) + 30 / 900
    for _ in range(20 if THOROUGH else 8):
        found = seen(rng.poisson(mean).astype(np.uint32), confocal)
        assert not found.empty
        j, i = np.unravel_index(np.nanargmax(found.contrast), found.contrast.shape)
        assert (GRID.x_m[i], GRID.y_m[j]) == pytest.approx((0.12, -0.06), abs=0.001)
        assert found.depth_m[j, i] == pytest.approx(0.9, abs=0.01)
        assert found.confidence[j, i] > 0.999
        # beside it is noise, and is not taken for a surface: at most two of 441 pixels; both sides scanned at
        # this spacing make ghosts, which are no noise
        away = np.hypot(GRID.x_m[None] - 0.12, GRID.y_m[:, None] + 0.06) > 0.35
        assert confocal or np.isfinite(found.depth_m[away]).sum() <= 2


def test_a_glint_does_not_hide_a_plate():
    """A point a hundred times as bright as what is seen of a plate elsewhere."""
    rng = np.random.default_rng(4)
    plain = expected(plate((-0.5, -0.1), (-0.2, 0.2), 1.0))
    glint = expected([[0.42, 0.3, 0.7]])
    both = seen(rng.poisson(200 * plain + 60 * glint + 0.01).astype(np.uint32))
    on_plate = np.ix_((GRID.y_m > -0.19) & (GRID.y_m < 0.19), (GRID.x_m > -0.49) & (GRID.x_m < -0.11))
    found = np.isfinite(both.depth_m[on_plate])
    assert found.mean() > 0.4
    assert np.median(both.depth_m[on_plate][found]) == pytest.approx(1.0, abs=0.01)


def test_two_layers_have_a_threshold_each():
    """A near plate and one behind it with a tenth of its light are both seen, each at its depth."""
    near, far = plate((-0.5, -0.05), (-0.3, 0.3), 0.8), plate((0.1, 0.5), (-0.3, 0.3), 1.3)
    mean = 400 * expected(near) + 60 * expected(far)
    found = seen(np.random.default_rng(5).poisson(mean).astype(np.uint32))
    middle = slice(8, 13)
    left, right = found.depth_m[middle, 3:8], found.depth_m[middle, 13:18]
    assert np.nanmedian(left) == pytest.approx(0.8, abs=0.01)
    assert np.nanmedian(right) == pytest.approx(1.3, abs=0.01)
    assert np.isfinite(left).mean() > 0.4
    assert np.isfinite(right).mean() > 0.4


def test_without_counted_photons_the_quiet_part_is_the_noise():
    found = seen(expected([[0.12, -0.06, 0.9]]).astype(np.float32))
    assert not found.empty
    assert 1 <= np.isfinite(found.depth_m).sum() < 40
    assert seen(np.zeros((len(LASER), 900), np.float32)).empty


def test_a_tally_of_several_passes_counts_each_bin_once():
    counts = np.random.default_rng(6).poisson(1.0, (len(LASER), 900)).astype(np.uint32)
    capture = Capture(ArrayHistograms(counts, block_positions=100), BIN, np.zeros(1), LASER, DETECTOR)
    window = Window(start_s=2e-9)
    totals = []
    for passes in ([slice(0, 900)], [slice(0, 500), slice(300, 900), slice(0, 900)]):
        read, tally = tallied(capture, PULSE, window)
        for bins in passes:
            for positions, block in read.histograms.blocks(bins):
                np.testing.assert_array_equal(block, counts[positions, bins])
        totals.append(tally.cells)
    np.testing.assert_allclose(totals[1], totals[0], rtol=1e-5)
    weights = window.end_weights(900, BIN)
    start = window.start_weights(np.zeros(1), slice(0, 900), BIN)[0]
    weights[: len(start)] *= start
    # the window's weights are taken at the cells' centres
    np.testing.assert_allclose(totals[0].sum(), (counts * weights).sum(), rtol=2e-3)
