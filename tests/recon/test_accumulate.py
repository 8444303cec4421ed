"""An image that grows: equal to the usual one of what has arrived, in any order and any portions."""

import numpy as np
import pytest

from recon import defaults
from recon.accumulate import Accumulator, Coming, GrowingPicture, likeness
from recon.capture import ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.imaging import image
from recon.noise import photon_noise, tallied
from recon.sampling import depth_blocks
from recon.spectrum import spectra
from recon.surface import find
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import histograms, wall

PULSE = VirtualPulse(0.06)
GRID = VoxelGrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.1, 0.3, 7), np.linspace(0.4, 1.6, 25))
WINDOW = Window(start_s=3.1e-9)


def random_capture(first_bin_s):
    counts = np.random.default_rng(7).poisson(5, (48, 900)).astype(np.uint16)
    detector_m = np.array([[0.02, 0.01, 0.0]])
    return Capture(ArrayHistograms(counts), 16e-12, first_bin_s, wall(8, 6, 0.05), detector_m)


BEGINS = {"one": np.array([3e-10]), "each": np.random.default_rng(2).uniform(-1e-9, 1e-9, 48)}


@pytest.mark.parametrize("begins", BEGINS)
@pytest.mark.parametrize("portion", [1, 5, 48])
def test_portions_give_the_spectra_of_the_whole(begins, portion):
    capture = random_capture(BEGINS[begins])
    counts = capture.histograms.counts
    accumulator = Accumulator(capture, PULSE, GRID, WINDOW)
    order = np.random.default_rng(3).permutation(48)
    for first in range(0, 48, portion):
        some = order[first : first + portion]
        accumulator.add(some, counts[some])
    parts = depth_blocks(capture, PULSE, GRID)
    # sums of some hundred counts in single precision, added up in another order
    tolerance = 1e-6 * counts.sum(axis=1).max()
    for found, whole in zip(accumulator.spectra, spectra(capture, parts, WINDOW), strict=True):
        np.testing.assert_allclose(found, whole, atol=tolerance)


def test_the_image_and_its_surface_are_the_usual_ones():
    capture = hidden_points()
    grid = defaults.voxels(capture, PULSE)
    accumulator = Accumulator(capture, PULSE, grid, Window())
    accumulator.add(slice(None), capture.histograms.counts)
    found = accumulator.image()
    read, tally = tallied(capture, PULSE, Window())
    usual = image(read, PULSE, grid, window=Window())
    largest = float(np.abs(usual.field).max())
    np.testing.assert_allclose(found.field, usual.field, atol=1e-5 * largest)  # single precision
    surface, wanted = accumulator.surface(found), find(usual, photon_noise(tally, PULSE, grid))
    np.testing.assert_allclose(surface.contrast, wanted.contrast, rtol=1e-3, atol=1e-3)


def test_what_has_not_arrived_is_dark():
    capture = hidden_points()
    grid = defaults.voxels(capture, PULSE)
    accumulator = Accumulator(capture, PULSE, grid, Window())
    accumulator.add(slice(0, 60), capture.histograms.counts[:60])
    alone, among = accumulator.image(), accumulator.image(among=capture.positions)
    # single precision, and the grid of the wall is another: a part of it, and all of it
    np.testing.assert_allclose(alone.field, among.field, atol=1e-3 * float(np.abs(among.field).max()))


def test_a_position_that_comes_twice_is_added_up():
    capture = random_capture(BEGINS["each"])
    once, twice = (Accumulator(capture, PULSE, GRID, WINDOW) for _ in range(2))
    counts = capture.histograms.counts
    once.add(slice(None), 2 * counts)
    twice.add(slice(None), counts)
    twice.add(slice(None), counts)
    for found, wanted in zip(twice.spectra, once.spectra, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6 * counts.sum(axis=1).max())


def test_the_wavelength_of_the_moment_gets_shorter():
    capture = hidden_points()
    growing = GrowingPicture(Coming(capture, (40, 80, 160), Window(), 65e-12))
    counts = capture.histograms.counts
    positions, wavelengths_m, fronts = [], [], []
    for first in range(0, 160, 20):
        growing.add(first, counts[first : first + 20])
        picture = growing.picture()
        positions.append(picture.positions)
        wavelengths_m.append(picture.pulse.wavelength_m)
        fronts.append(picture.front)
    assert positions == [20, 40, 40, 80, 80, 80, 80, 160]
    assert wavelengths_m == sorted(wavelengths_m, reverse=True)
    assert wavelengths_m[0] > wavelengths_m[-1]
    assert wavelengths_m[-1] == defaults.wavelength(capture, 65e-12).value
    assert len({front.shape for front in fronts}) == 1


def test_likeness():
    one = np.random.default_rng(1).random((40, 50))
    assert likeness(one, 3 * one + 2) == pytest.approx(1)
    assert likeness(one, -one) == pytest.approx(-1)
    assert likeness(one, np.ones_like(one)) == 0
    other = np.random.default_rng(2).random((40, 50))
    assert abs(likeness(one, other)) < 5 / 2000**0.5  # five standard deviations of independent pixels


def hidden_points():
    """A lattice of 16 x 10 positions from coarse to fine: every 2nd, the centres of these, the rest."""
    column, row = np.tile(np.arange(16), 10), np.repeat(np.arange(10), 16)
    rounds = np.where(row % 2 != column % 2, 2, row % 2)
    laser_m = wall(16, 10, 0.04)[np.argsort(rounds, kind="stable")]
    detector_m = np.array([[0.02, 0.01, 0.0]])
    places_m = np.array([[0.1, 0.05, 0.8], [-0.15, 0.0, 1.0]])
    signal = histograms(places_m, laser_m, detector_m, bins=900, bin_width_s=16e-12)
    counts = np.random.default_rng(5).poisson(50 * signal / signal.max() + 0.2).astype(np.uint16)
    return Capture(ArrayHistograms(counts), 16e-12, np.zeros(1), laser_m, detector_m)


def photons_of(counts):
    """The photons of (n, bins) counts one by one: where those of each row begin, and their bins."""
    rows, bins = np.nonzero(counts)
    times = counts[rows, bins]
    offset = np.concatenate([[0], np.cumsum(counts.sum(axis=1, dtype=np.int64))])
    return offset, np.repeat(bins, times)


@pytest.mark.parametrize("begins", BEGINS)
@pytest.mark.parametrize("start_s", [None, 3.1e-9])
def test_photons_one_by_one_give_what_their_histograms_give(begins, start_s):
    capture, window = random_capture(BEGINS[begins]), Window(start_s=start_s)
    counts = capture.histograms.counts
    dense, sparse = (Accumulator(capture, PULSE, GRID, window) for _ in range(2))
    dense.add(slice(None), counts)
    order = np.random.default_rng(4).permutation(48)
    for some in np.array_split(order, 7):
        sparse.add_photons(some, *photons_of(counts[some]))
    tolerance = 1e-6 * counts.sum(axis=1).max()  # as above: some hundred counts, in another order
    for found, wanted in zip(sparse.spectra, dense.spectra, strict=True):
        np.testing.assert_allclose(found, wanted, atol=tolerance)
    assert sparse.arrived.all()
    image = dense.image()
    found, wanted = (one.surface(image).contrast for one in (sparse, dense))
    np.testing.assert_allclose(found, wanted, rtol=1e-4)  # sums of cells in single precision


def test_photons_of_a_position_that_comes_twice_in_one_portion_are_added_up():
    capture = random_capture(BEGINS["each"])
    counts = capture.histograms.counts
    dense, sparse = (Accumulator(capture, PULSE, GRID, WINDOW) for _ in range(2))
    dense.add(slice(None), counts)
    halves = np.random.default_rng(6).binomial(counts, 0.5)
    both = np.concatenate([halves, counts - halves])
    sparse.add_photons(np.tile(np.arange(48), 2), *photons_of(both))
    for found, wanted in zip(sparse.spectra, dense.spectra, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6 * counts.sum(axis=1).max())


def test_a_picture_grows_from_photons_as_from_histograms():
    capture = hidden_points()
    counts = capture.histograms.counts
    dense, sparse = (GrowingPicture(Coming(capture, (40, 80, 160), Window(), 65e-12)) for _ in range(2))
    for first in range(0, 160, 20):
        dense.add(first, counts[first : first + 20])
        sparse.add_photons(first, *photons_of(counts[first : first + 20]))
        wanted, found = dense.picture(), sparse.picture()
        assert (found.positions, found.pulse) == (wanted.positions, wanted.pulse)
        np.testing.assert_allclose(found.front, wanted.front, atol=1e-4 * float(wanted.front.max()))
