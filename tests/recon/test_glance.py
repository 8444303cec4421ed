"""A quick, coarse image: alike the usual one of the same wavelength, from part of a wall too."""

import numpy as np
import pytest

from recon import defaults
from recon.accumulate import Coming, likeness
from recon.capture import ArrayHistograms, Capture
from recon.glance import Cells, Glance
from recon.imaging import image
from recon.window import Window
from support.hidden_points import histograms, wall

PLACES_M = np.array([[0.2, 0.1, 0.8], [-0.25, -0.05, 1.0]])


def capture_of(laser_m, begins_s=0.0):
    """Photons of two hidden points over a wall, in records that begin at different times."""
    detector_m = np.array([[0.02, 0.01, 0.0]])
    signal = histograms(PLACES_M, laser_m, detector_m, bins=900, bin_width_s=16e-12)
    counts = np.random.default_rng(5).poisson(20 * signal / signal.max()).astype(np.uint16)
    shift = np.rint(np.broadcast_to(begins_s, len(laser_m)) / 16e-12).astype(int)
    moved = np.stack([np.roll(row, -bins) for row, bins in zip(counts, shift, strict=True)])
    return Capture(ArrayHistograms(moved), 16e-12, shift * 16e-12, laser_m, detector_m)


def add(glance, capture, first, stop):
    counts = capture.histograms.counts[first:stop]
    rows, bins = np.nonzero(counts)
    offset = np.concatenate([[0], np.cumsum(counts.sum(axis=1, dtype=np.int64))])
    glance.add_photons(first, offset, np.repeat(bins, counts[rows, bins]))


def usual_front(capture, picture):
    found = image(capture, picture.pulse, picture.grid, window=Window())
    lifted = found.intensity * (picture.grid.z_m[:, None, None] ** found.falloff_power)
    return np.sqrt(lifted.max(axis=0))


def test_cells_hold_neighbours_and_keep_their_times():
    laser_m = wall(12, 8, 0.02)
    begins_s = np.random.default_rng(1).uniform(-1e-9, 1e-9, 96)
    capture = Capture(
        ArrayHistograms(np.zeros((96, 900))), 16e-12, begins_s, laser_m, np.array([[0.02, 0.01, 0.0]])
    )
    cells = Cells.of(capture, 0.04)
    assert cells.capture.positions == 6 * 4
    away_m = laser_m - cells.capture.laser_m[cells.of_position]
    assert np.abs(away_m).max() <= 0.02 + 1e-9  # half a cell
    shifted_s = begins_s - cells.capture.first_bin_s[cells.of_position]
    np.testing.assert_allclose(cells.later_bins * 16e-12, shifted_s, atol=8e-12)  # half a bin


def test_a_detector_spot_of_its_own_has_cells_of_its_own():
    laser_m = np.repeat(wall(12, 8, 0.02), 2, axis=0)
    detector_m = np.tile([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], (96, 1))
    capture = Capture(ArrayHistograms(np.zeros((192, 9))), 16e-12, np.zeros(1), laser_m, detector_m)
    cells = Cells.of(capture, 0.04)
    assert cells.capture.positions == 2 * 6 * 4
    np.testing.assert_array_equal(cells.capture.detector_m[cells.of_position], detector_m)


def test_its_image_is_like_the_usual_one_of_its_wavelength():
    begins_s = np.random.default_rng(1).uniform(-5e-10, 5e-10, 90 * 60)
    capture = capture_of(wall(90, 60, 0.01), begins_s)
    glance = Glance(Coming(capture, (capture.positions,), Window(), 65e-12))
    add(glance, capture, 0, capture.positions)
    picture = glance.picture()
    assert picture.positions == capture.positions
    assert picture.pulse.wavelength_m == pytest.approx(0.04)  # 2 cm cells: at most 60 of them
    # cells damp oblique waves by at most sinc(1/2 sin 45 deg) = 0.81 along an axis, the same for all objects
    assert likeness(picture.front, usual_front(capture, picture)) > 0.99


def test_what_was_visited_more_often_is_no_brighter():
    """Half of the wall once more, as in a round that is not complete: as with the whole wall."""
    laser_m = wall(40, 30, 0.02)
    column, row = np.tile(np.arange(40), 30), np.repeat(np.arange(30), 40)
    even = (column % 2 == 0) & (row % 2 == 0)
    capture = capture_of(laser_m[np.argsort(~even, kind="stable")])
    glance = Glance(Coming(capture, (300, 1200), Window(), 65e-12))
    add(glance, capture, 0, 300)
    before = glance.picture()
    add(glance, capture, 300, 750)
    between = glance.picture()
    assert (before.positions, between.positions) == (300, 750)
    assert before.pulse == between.pulse
    assert before.pulse.wavelength_m == pytest.approx(0.08)
    # measured 0.984; 0.928 if what was visited twice counted twice, and the aperture was tilted
    assert likeness(before.front, between.front) > 0.97
    add(glance, capture, 750, 1200)
    last = glance.picture()
    assert last.pulse.wavelength_m == pytest.approx(defaults.wavelength(capture, 65e-12).value)
    assert last.pulse.wavelength_m < 0.05


def test_part_of_a_raster_shows_what_its_aperture_resolves():
    capture = capture_of(wall(60, 40, 0.015))
    glance = Glance(Coming(capture, (capture.positions,), Window(), 65e-12))
    add(glance, capture, 0, capture.positions // 2)
    picture = glance.picture()
    column = picture.front.max(axis=0)  # lines go along x: it is resolved from the beginning
    for x_m, _, _ in PLACES_M:
        near = np.abs(picture.grid.x_m - x_m) < 0.05
        assert column[near].max() > 0.3 * column.max()
