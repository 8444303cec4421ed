"""Each laser with each pixel: runs of lasers add up to the direct sum of all pairs."""

import re
from dataclasses import replace

import numpy as np
import pytest

from recon.by_lasers import image, image_and_noise, of_run, partial, planned, runs
from recon.camera import ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, MemoryBoundError
from recon.exhaustive import ArrayLaserHistograms, Exhaustive
from recon.grid import VoxelGrid
from recon.imaging import image as image_of_pairs
from recon.imaging import pictured, plan
from recon.noise import photon_noise, tallied
from recon.sampling import CONFOCAL
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import exact, histograms, wall, worst

PULSE = VirtualPulse(0.12, 3)
BIN, BINS = 32e-12, 300
POINTS = np.array([[0.12, -0.06, 0.6], [-0.2, 0.12, 0.8]])
GRID = VoxelGrid(-0.27 + 0.06 * np.arange(8), -0.15 + 0.06 * np.arange(6), np.array([0.6, 0.8]))


def run_by_run(problem, capture):
    """Image three lasers at a time, as workers of a cluster do."""
    for lasers in runs(capture, problem, 10**9, 3):
        yield of_run(capture.block(lasers), problem, 10**9)


def pairs(laser_m, pixel_m, first_bin_s=0.0):
    """All pairs as an ordinary capture, laser by laser, the pixels focusing."""
    lit_m, seen_m = np.repeat(laser_m, len(pixel_m), axis=0), np.tile(pixel_m, (len(laser_m), 1))
    counts = histograms(POINTS, lit_m, seen_m, BINS, BIN, np.ravel(first_bin_s)[0])
    return Capture(ArrayHistograms(counts), BIN, np.atleast_1d(first_bin_s).ravel(), seen_m, lit_m)


def exhaustive(capture, laser_m, pixel_m):
    counts = capture.histograms.counts.reshape(len(laser_m), len(pixel_m), BINS)
    first_bin_s = capture.first_bin_s
    first_bin_s = first_bin_s.reshape((1, 1) if first_bin_s.size == 1 else counts.shape[:2])
    return Exhaustive(ArrayLaserHistograms(counts), BIN, first_bin_s, laser_m, pixel_m)


LASERS, PIXELS = wall(4, 4, 0.2, (0.01, 0.0)), wall(16, 16, 0.06)


@pytest.fixture(scope="module")
def both():
    capture = pairs(LASERS, PIXELS, 0.5e-9)
    return capture, exhaustive(capture, LASERS, PIXELS)


@pytest.mark.parametrize("fft", [True, False])
def test_is_the_direct_sum_of_all_pairs(both, fft):
    """By lattices and by tables, which have an error of 1.2e-4 by their straight lines."""
    capture, whole = both
    problem = replace(planned(whole, PULSE, GRID, CONFOCAL, Window()), fft=fft)
    found = pictured(problem, partial(whole.block(slice(None)), problem), "rsd", PULSE)
    assert worst(found.field, exact(capture, found)) < (1e-4 if fft else 2e-4)
    of_pairs = image_of_pairs(capture, PULSE, GRID, solver="direct")
    assert worst(found.field, of_pairs.field) < (1e-4 if fft else 2e-4)
    bright = np.abs(found.field) > 0.1 * np.abs(found.field).max()
    # lateness is a ratio, of fields a tenth of the peak at the least, known to 2e-3 of themselves
    np.testing.assert_allclose(found.late_s[bright], of_pairs.late_s[bright], atol=5e-3 * PULSE.sigma_s)


@pytest.mark.parametrize("camera", [ConfocalCamera(), PhotoCamera()])
def test_runs_add_up(both, camera):
    _, whole = both
    problem = planned(whole, PULSE, GRID, camera, Window())
    parts = [list(partial(whole.block(slice(k, k + 5)), problem)) for k in range(0, 16, 5)]
    total = sum(np.stack(part)[:, 0] for part in parts)
    assert worst(total, image(whole, PULSE, GRID, camera=camera).field) < 1e-5


@pytest.mark.parametrize("sides", [(LASERS, PIXELS), (PIXELS, LASERS[:5]), (PIXELS[::17], PIXELS[1::9])])
def test_each_side_may_focus_and_start_at_its_own_time(sides):
    """Lasers finer than pixels, and sides that are no even grid; each pair's record begins where it does."""
    begins_s = np.random.default_rng(3).uniform(0.2e-9, 0.4e-9, len(sides[0]) * len(sides[1]))
    lit_m, seen_m = np.repeat(sides[0], len(sides[1]), axis=0), np.tile(sides[1], (len(sides[0]), 1))
    counts = histograms(POINTS, lit_m, seen_m, BINS, BIN, begins_s)
    swapped = len(sides[0]) > len(sides[1])
    ends = (lit_m, seen_m) if swapped else (seen_m, lit_m)
    capture = Capture(ArrayHistograms(counts), BIN, begins_s, *ends)
    found = image(exhaustive(capture, *sides), PULSE, GRID)
    # spreading over a lattice is designed for 3e-4 along each axis
    assert worst(found.field, exact(capture, found)) < 1e-3


def test_a_bound_on_memory_cuts_runs_and_passes(both):
    _, whole = both
    problem = planned(whole, PULSE, GRID, CONFOCAL, Window())
    usual = image(whole, PULSE, GRID)
    with pytest.raises(MemoryBoundError, match="Allow") as refused:
        image(whole, PULSE, GRID, memory_bytes=1000)
    least = int(re.search(r"Allow (\d+) MB", str(refused.value))[1]) * 1_000_000
    lengths = [len(list(runs(whole, problem, least + more))) for more in (0, 10**9)]
    assert lengths[0] > lengths[1] == 1
    # another number of lasers may go another way: the tables' straight lines are right to 1.2e-4
    assert worst(image(whole, PULSE, GRID, memory_bytes=least).field, usual.field) < 2e-4


def test_noise_of_counted_photons_adds_up_over_runs(both):
    """Tiles are others than those of all pairs: places differ by a tenth of the wall, and paths little."""
    capture, whole = both
    counts = np.random.default_rng(6).poisson(whole.histograms.counts * 50)
    counted = replace(whole, histograms=ArrayLaserHistograms(counts))
    pairs_counted = replace(capture, histograms=ArrayHistograms(counts.reshape(-1, BINS)))
    found, noise = image_and_noise(counted, PULSE, GRID)
    assert worst(found.field, image(counted, PULSE, GRID).field) < 1e-6
    tallying, tally = tallied(pairs_counted, PULSE, Window())
    image_of_pairs(tallying, PULSE, GRID)
    np.testing.assert_allclose(noise.levels, photon_noise(tally, PULSE, GRID).levels, rtol=0.05)
    assert (
        image_and_noise(replace(whole, histograms=ArrayLaserHistograms(counts * 0.5)), PULSE, GRID)[1] is None
    )
    there, noise_there = image_and_noise(counted, PULSE, GRID, by=run_by_run)
    assert worst(there.field, found.field) < 1e-6
    np.testing.assert_allclose(noise_there.levels, noise.levels, rtol=0.05)  # tiles of other runs


def test_an_outline_plans_as_all_pairs_do(both):
    capture, whole = both
    of_all, outline = (
        plan(capture, PULSE, GRID, CONFOCAL, Window()),
        planned(whole, PULSE, GRID, CONFOCAL, Window()),
    )
    for one, other in zip(of_all.depth_blocks, outline.depth_blocks, strict=True):
        assert one.bins == other.bins
        assert one.band.step_rad_per_s == other.band.step_rad_per_s
    assert not Exhaustive(whole.histograms, BIN, np.zeros((1, 1)), PIXELS, PIXELS).outline().confocal


def test_a_flash_has_no_one_source(both):
    with pytest.raises(GeometryError):
        image(both[1], PULSE, GRID, camera=TransientCamera(np.zeros(2)))
