"""An image cut into parts: whatever the cut, their fields give the numbers of the whole."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from recon import parts
from recon.camera import PhotoCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import MemoryBoundError, ParameterError
from recon.grid import VoxelGrid
from recon.imaging import image, plan
from recon.noise import photon_noise, tallied
from recon.sampling import CONFOCAL
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import histograms, wall

PULSE = VirtualPulse(0.08, 2)
BIN = 16e-12
MB = 10**6
#: Sums in another order: 1e-7 for each of a few dozen frequencies and FFT stages.
ROUNDING = 1e-5


def capture(shape):
    side = 24
    laser_m = wall(side, side, 1.0 / side)
    random = np.random.default_rng(4)
    detector_m = np.array([[0.1, -0.05, 0.0]])
    if shape in {"scattered", "curved"}:
        laser_m[:, :2] += random.uniform(-0.01, 0.01, (len(laser_m), 2))
    if shape == "curved":
        laser_m[:, 2] = 0.1 * laser_m[:, 0] ** 2
    if shape == "pixels":  # four channels to each laser spot
        laser_m = np.repeat(laser_m, 4, axis=0)
        detector_m = np.tile([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0], [0.2, 0.1, 0]], (side**2, 1))
    if shape == "confocal":
        detector_m = laser_m
    counts = histograms([[0.1, 0.05, 0.7]], laser_m, detector_m, 800, BIN)
    return Capture(ArrayHistograms(counts), BIN, np.zeros(1), laser_m, detector_m)


def voxels(side=20, planes=10):
    # off the wall's lattice, so that lattices are interpolated
    axis = np.linspace(-0.41, 0.43, side)
    return VoxelGrid(axis, axis, np.linspace(0.5, 0.9, planes))


def in_parts(found, tally=None):
    """What computes planes part by part, in this process, with spectra of three runs of positions."""

    def by(problem, solver):
        wanted = list({part.takes.name: part.takes for part in found.parts}.values())
        edges = np.linspace(0, problem.capture.positions, 4).astype(int)
        runs = [slice(a, b) for a, b in pairwise(edges)]
        counts = (tally.capture if tally else problem.capture).histograms.counts
        pieces = []
        for reading in parts.readings(problem, wanted, runs, tally):
            kept, other = reading.taken(ArrayHistograms(counts[reading.positions], 50))
            pieces.append(kept)
            if tally:
                tally.absorb(other)
        at = {takes.name: number for number, takes in enumerate(wanted)}
        for slab in found.slabs:
            total = np.zeros(slab.shape, np.complex64)
            for part in slab.parts:
                number = at[part.takes.name]
                total += part.field(np.concatenate([piece[number] for piece in pieces], axis=1))
            yield from total

    return by


def planned(taken, grid=None, camera=CONFOCAL):
    return replace(
        plan(taken, PULSE, grid or voxels(), camera, Window()), slopes=not isinstance(camera, PhotoCamera)
    )


def beside(found):
    return max(len(slab.parts) for slab in found.slabs)


@pytest.mark.parametrize("shape", ["regular", "scattered", "curved", "pixels", "confocal"])
def test_parts_give_the_numbers_of_the_whole(shape, monkeypatch):
    taken, grid = capture(shape), voxels()
    monkeypatch.setattr(parts, "LEAST_WORK_S", 0.0)  # cut what is quick, too
    found = parts.cut(planned(taken), "rsd", workers=3, memory_bytes=2000 * MB)
    assert len(found.parts) > 8
    whole = image(taken, PULSE, grid)
    cut = image(taken, PULSE, grid, by=in_parts(found))
    assert np.abs(cut.field - whole.field).max() < ROUNDING * np.abs(whole.field).max()
    bright = np.abs(whole.field) > 0.1 * np.abs(whole.field).max()
    assert np.abs(cut.late_s - whole.late_s)[bright].max() < 1e-3 * PULSE.sigma_s


@pytest.mark.parametrize(("shape", "least"), [("regular", 3), ("curved", 2), ("pixels", 4)])
def test_what_adds_up_gives_the_same_numbers(shape, least, monkeypatch):
    """One plane, which cannot be cut in depth: by frequencies, positions, detector spots."""
    taken, grid = capture(shape), voxels(planes=1)
    monkeypatch.setattr(parts, "LEAST_WORK_S", 0.0)
    found = parts.cut(planned(taken, grid), "rsd", workers=4, memory_bytes=2000 * MB)
    assert beside(found) >= least
    whole, cut = (image(taken, PULSE, grid, by=by) for by in (None, in_parts(found)))
    assert np.abs(cut.field - whole.field).max() < ROUNDING * np.abs(whole.field).max()
    # a sum of parts: it is not one of them
    one = image(taken, PULSE, grid, by=lambda *_: iter(found.parts[0].field(np.zeros(spectra_of(found)))))
    assert not np.allclose(one.field, whole.field)


def spectra_of(found):
    problem = found.parts[0].problem
    return len(problem.band), problem.capture.positions


@pytest.mark.parametrize("solver", ["fresnel", "rsd"])
def test_a_photo_is_cut_too(solver):
    taken = capture("regular")
    found = parts.cut(planned(taken, camera=PhotoCamera()), solver, workers=2, memory_bytes=2000 * MB)
    whole, cut = (
        image(taken, PULSE, voxels(), camera=PhotoCamera(), solver=solver, by=by)
        for by in (None, in_parts(found))
    )
    assert np.abs(cut.field - whole.field).max() < ROUNDING * np.abs(whole.field).max()


def test_counts_are_summed_up_as_by_one_reader():
    taken = capture("regular")
    counts = np.round(10 * taken.histograms.counts).astype(np.uint32)
    taken = replace(taken, histograms=ArrayHistograms(counts))
    levels = []
    found = parts.cut(planned(taken), "rsd", workers=2, memory_bytes=2000 * MB)
    for parted in (False, True):
        reading, tally = tallied(taken, PULSE, Window())
        image(reading, PULSE, voxels(), by=in_parts(found, tally) if parted else None)
        levels.append(photon_noise(tally, PULSE, voxels()).levels)
        assert tally.whole
    np.testing.assert_allclose(levels[1], levels[0], rtol=1e-5)


def test_the_least_traffic_is_chosen(monkeypatch):
    monkeypatch.setattr(parts, "LEAST_WORK_S", 0.0)
    # many positions and few voxels: sending all spectra to each part would cost more than fields do
    few = parts.cut(planned(capture("regular"), voxels(4, 8)), "rsd", workers=2, memory_bytes=2000 * MB)
    assert beside(few) > 1
    # the other way round: fields are large, and each plane is sent once
    many = parts.cut(planned(capture("regular"), voxels(96, 12)), "rsd", workers=2, memory_bytes=2000 * MB)
    assert beside(many) == 1
    # the cuts that were not chosen would send all spectra to each part, or all planes from each
    every = 8 * len(few.blocks[0].band) * 24 * 24
    assert few.traffic_bytes < len(few.parts) * every
    assert many.traffic_bytes < len(many.parts) * 8 * 2 * 96 * 96 * 12


def test_parts_are_cut_until_they_fit():
    taken, grid = capture("regular"), voxels(80, 60)
    roomy = parts.cut(planned(taken, grid), "rsd", workers=1, memory_bytes=2000 * MB)
    tight = parts.cut(planned(taken, grid), "rsd", workers=1, memory_bytes=38 * MB)
    assert roomy.memory_bytes > 38 * MB >= tight.memory_bytes
    assert len(tight.parts) > len(roomy.parts)
    with pytest.raises(MemoryBoundError, match=r"Give each worker (\d+) MB"):
        parts.cut(planned(taken, grid), "rsd", workers=1, memory_bytes=30 * MB)


@pytest.mark.parametrize("solver", ["direct", "backprojection", "lct"])
def test_solvers_that_image_as_a_whole_say_so(solver):
    with pytest.raises(ParameterError, match="Use rsd or fresnel"):
        parts.cut(planned(capture("regular")), solver, workers=2, memory_bytes=2000 * MB)
