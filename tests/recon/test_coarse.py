"""A coarse copy of a capture: no photon is lost, and its picture is like that of the capture."""

import numpy as np
import pytest

from recon import defaults
from recon.accumulate import likeness
from recon.capture import ArrayHistograms, Capture
from recon.coarse import coarse
from recon.imaging import image
from recon.wave import VirtualPulse
from support.hidden_points import histograms, wall

PLACES_M = np.array([[0.2, 0.1, 0.8], [-0.25, -0.05, 1.0]])


@pytest.mark.parametrize("confocal", [False, True])
def test_its_image_is_like_that_of_the_capture(confocal):
    """Records that begin at different times, 100 positions across, so that cells hold four of them."""
    laser_m = wall(100, 60, 0.01)
    detector_m = laser_m if confocal else np.array([[0.02, 0.01, 0.0]])
    signal = histograms(PLACES_M, laser_m, detector_m, bins=1200, bin_width_s=8e-12)
    shift = np.random.default_rng(3).integers(-40, 40, len(laser_m))
    counts = np.rint(200 * signal / signal.max()).astype(np.uint16)
    moved = np.stack([np.roll(row, -bins) for row, bins in zip(counts, shift, strict=True)])
    capture = Capture(ArrayHistograms(moved), 8e-12, shift * 8e-12, laser_m, detector_m)
    found = coarse(capture)
    assert found.side_m == pytest.approx(0.02)
    assert found.capture.positions == 50 * 30
    assert found.capture.confocal == confocal
    # what is moved in time beyond an end of the record is dark here, so that all photons are still there
    assert found.counts.sum(dtype=np.int64) == counts.sum(dtype=np.int64)
    pulse = VirtualPulse(max(found.shortest_m, 0.08))
    grid = defaults.voxels(found.capture, pulse, depth_m=(0.7, 1.1, 0.04))
    fronts = [np.abs(image(one, pulse, grid).field).max(axis=0) for one in (capture, found.capture)]
    # a cell of half a wavelength damps what arrives at 45 degrees by 0.8 and leaves what is straight ahead
    assert likeness(*fronts) > 0.97


def test_a_copy_is_of_a_bounded_size(monkeypatch):
    """Of more than fits the bins are wider, and the wave longer."""
    laser_m = wall(40, 30, 0.01)
    nothing = np.zeros((1200, 4096), np.uint16)
    capture = Capture(ArrayHistograms(nothing), 1e-12, np.zeros(1), laser_m, np.zeros((1, 3)))
    usual = coarse(capture)
    monkeypatch.setattr("recon.coarse.MOST_BYTES", 2**17)
    small = coarse(capture)
    assert small.counts.nbytes <= 2**17 < usual.counts.nbytes
    assert small.shortest_m > usual.shortest_m
