"""Spectra of the record against the naive Fourier sum, and the choice of bins and frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from recon.capture import ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.sampling import depth_blocks, path_limits_m
from recon.spectrum import AHEAD, ahead, one_thread_each, spectra
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import C, histograms, wall

PULSE = VirtualPulse(0.06)
GRID = VoxelGrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.1, 0.3, 7), np.linspace(0.4, 1.6, 25))


def random_capture(dtype=np.uint16, first_bin_s=0.0, bins=900, confocal=False):
    random = np.random.default_rng(7)
    laser_m = wall(8, 6, 0.05)
    counts = random.poisson(5, (48, bins)).astype(dtype)
    detector_m = laser_m if confocal else np.array([[0.02, 0.01, 0.0]])
    return Capture(ArrayHistograms(counts, 7), 16e-12, np.atleast_1d(first_bin_s), laser_m, detector_m)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32, np.int64, np.float32, np.float64])
@pytest.mark.parametrize("each", [False, True])
def test_is_the_fourier_sum(dtype, each):
    first_bin_s = np.random.default_rng(2).uniform(-1e-9, 1e-9, 48) if each else np.array([3e-10])
    capture = random_capture(dtype, first_bin_s)
    window = Window(start_s=3.1e-9, rise_s=0.7e-9, fall_s=1.1e-9)
    parts = depth_blocks(capture, PULSE, GRID)
    assert len(parts) > 1
    counts = capture.histograms.counts.astype(float)
    since_s = (np.arange(900) + 0.5) * 16e-12
    times_s = np.broadcast_to(first_bin_s, 48)[:, None] + since_s
    rise = np.clip((times_s - 3.1e-9) / 0.7e-9, 0, 1)
    fall = np.clip((900 * 16e-12 - since_s) / 1.1e-9, 0, 1)
    faded = counts * (1 - np.cos(np.pi * rise)) / 2 * (1 - np.cos(np.pi * fall)) / 2
    for part, found in zip(parts, spectra(capture, parts, window), strict=True):
        for index, frequency in enumerate(part.band.frequencies_rad_per_s):
            wanted = (faded * np.exp(-1j * frequency * times_s))[:, part.bins].sum(axis=1)
            # Single precision of a sum of some hundred counts.
            np.testing.assert_allclose(found[index], wanted, atol=1e-6 * faded.sum(axis=1).max())


class _First(ArrayHistograms):
    """Yields the first positions only."""

    def blocks(self, bins=slice(None)):
        blocks = super().blocks(bins)
        yield from (next(blocks) for _ in range(3))


def test_takes_all_that_is_read_however_little():
    capture = random_capture()
    few = replace(capture, histograms=_First(capture.histograms.counts, 7))
    parts = depth_blocks(capture, PULSE, GRID)
    for found, whole in zip(spectra(few, parts, Window()), spectra(capture, parts, Window()), strict=True):
        assert np.abs(whole[:, :21]).min() > 0
        np.testing.assert_allclose(found[:, :21], whole[:, :21], atol=1e-6 * np.abs(whole).max())
        assert not found[:, 21:].any()


def test_threads_of_matrix_products_are_given_back_in_any_order():
    def threads():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    before = threads()
    one_thread_each.__enter__()
    one_thread_each.__enter__()
    one_thread_each.__exit__()
    assert set(threads()) == {1}
    one_thread_each.__exit__()
    assert threads() == before


@pytest.mark.parametrize(("size", "many"), [(10, 4), (45, 1), (1000, 1), (1, AHEAD), (0, AHEAD)])
def test_no_more_is_made_ahead_than_has_room(size, many):
    made = []

    def items():
        for number in range(40):
            made.append(number)
            yield number

    taken = []
    for item in ahead(items(), lambda _: size, 45):
        taken.append(item)
        assert len(made) <= len(taken) + many
    assert taken == made == list(range(40))


@pytest.mark.parametrize("confocal", [False, True])
def test_path_limits_hold_for_every_voxel(confocal):
    capture = random_capture(confocal=confocal)
    z, y, x = np.meshgrid(GRID.z_m, GRID.y_m, GRID.x_m, indexing="ij")
    voxels = np.stack([x, y, z], axis=-1).reshape(-1, 1, 3)
    paths = np.linalg.norm(voxels - capture.laser_m, axis=2)
    paths = paths + np.linalg.norm(voxels - capture.detector_m, axis=2)
    shortest, longest = path_limits_m(capture, GRID)
    assert shortest <= paths.min() <= shortest * 1.05
    assert longest * 0.95 <= paths.max() <= longest


@pytest.mark.parametrize("first_bin_s", [0.0, 2e-9, "each"])
def test_no_copy_of_the_pulse_meets_a_voxel(first_bin_s):
    if first_bin_s == "each":
        first_bin_s = np.linspace(-3e-9, 3e-9, 48)
    capture = random_capture(first_bin_s=first_bin_s)
    covered = []
    for part in depth_blocks(capture, PULSE, GRID):
        covered += range(*part.planes.indices(len(GRID.z_m)))
        planes = VoxelGrid(GRID.x_m, GRID.y_m, GRID.z_m[part.planes])
        shortest, longest = path_limits_m(capture, planes)
        times_s = np.add.outer(capture.first_bin_s, (np.array([part.bins.start, part.bins.stop])) * 16e-12)
        lag_s = max(times_s.max() - shortest / C, longest / C - times_s.min())
        # A copy stays 4 sigma away: 3.4e-4 of the pulse's peak.
        assert 2 * np.pi / part.band.step_rad_per_s - lag_s >= 4 * PULSE.sigma_s * (1 - 1e-9)
        # All that is within 4 sigma of a voxel's delay is used, as far as there is a record.
        assert times_s[:, 0].max() <= shortest / C - 4 * PULSE.sigma_s or part.bins.start == 0
        assert times_s[:, 1].min() >= longest / C + 4 * PULSE.sigma_s or part.bins.stop == 900
    assert covered == list(range(25))


def test_reads_only_the_bins_that_reach():
    class Watched(ArrayHistograms):
        asked = None

        def blocks(self, bins=slice(None)):
            type(self).asked = bins
            return super().blocks(bins)

    laser_m = wall(4, 4, 0.1)
    counts = histograms([[0, 0, 0.8]], laser_m, np.zeros(3), 4000, 16e-12)
    capture = Capture(Watched(counts), 16e-12, np.zeros(1), laser_m, np.zeros((1, 3)))
    grid = VoxelGrid(np.zeros(1), np.zeros(1), np.array([0.8]))
    parts = depth_blocks(capture, PULSE, grid)
    found = spectra(capture, parts, Window())
    asked = Watched.asked
    # One voxel: 1.6 m of path and a pulse of 0.6 sigma 8 = 1.2 m, of 19 m.
    assert (asked.stop - asked.start) * 16e-12 * C < 1.5
    assert np.abs(found[0]).max() == pytest.approx(counts.sum(axis=1).max(), rel=0.02)
