"""Planted points are found by every baseline in every geometry that it takes; others are refused."""

import numpy as np
import pytest

from recon.capture import ArrayHistograms, Capture
from recon.depth import compensate_falloff
from recon.errors import GeometryError, ParameterError, ReachError
from recon.grid import VoxelGrid
from recon.solvers.classic.solve import baseline_image
from recon.window import Window
from support.hidden_points import histograms, snake, wall

POINT = np.array([0.083, -0.057, 0.613])
BIN = 8e-12
# Planes are dense: off the axis a front is slanted, and a plane that passes d beside the point shows its peak
# d/tan(slant) aside, six times d here.
GRID = VoxelGrid.from_spec(0.3, 0.3, 0.01, (0.513, 0.72, 0.01))
VOXEL = np.array([0.01, 0.01, 0.01])
FILTERED = ("bp", "laplacian-fbp", "log-fbp")
TRANSFORMS = ("lct", "fk")


def found(capture, solver, grid=GRID):
    result = baseline_image(capture, grid, solver=solver)
    seen = compensate_falloff(result.amplitude, grid.z_m, result.falloff_power / 2)
    k, j, i = np.unravel_index(seen.argmax(), seen.shape)
    return np.array([grid.x_m[i], grid.y_m[j], grid.z_m[k]])


def taken(laser_m, detector_m, first_bin_s=0.0, falloff=True, bins=1000):
    first_bin_s = np.atleast_1d(first_bin_s)
    counts = histograms(POINT, laser_m, detector_m, bins, BIN, first_bin_s, falloff)
    return Capture(ArrayHistograms(counts, 300), BIN, first_bin_s, laser_m, detector_m)


LASER = wall(32, 28, 0.015)
SPOT = np.array([[-0.04, 0.03, 0.0]])
RANDOM = np.random.default_rng(9)
DELAYS = RANDOM.uniform(0, 2e-9, len(LASER))
WALLS = {
    "rows": (LASER, 0.0),
    "snake": (snake(LASER, 32), 0.0),
    "square skipped": (LASER[np.abs(LASER[:, :2] - SPOT[0, :2]).max(axis=1) > 0.03], 0.0),
    "off centre": (wall(32, 28, 0.015, (0.2, 0.1)), 0.0),
    "oblong pitch": (wall(32, 28, 0.015) * [1, 1.2, 1], 0.0),
    "late first bin": (LASER, 2.4e-9),
    "a first bin for each": (LASER, DELAYS),
}


@pytest.mark.parametrize("solver", FILTERED + TRANSFORMS)
@pytest.mark.parametrize("name", WALLS)
def test_confocal_point_is_found(name, solver):
    laser_m, first_bin_s = WALLS[name]
    # One voxel, not half: values are read at voxel centres, without a fit, and the lattice of lct and fk has
    # a pitch of 1.5 voxels, so that the peak may be read from the cell beside.
    assert np.all(np.abs(found(taken(laser_m, laser_m, first_bin_s), solver) - POINT) <= VOXEL)


@pytest.mark.parametrize("solver", FILTERED)
@pytest.mark.parametrize("name", WALLS)
def test_one_detector_point_is_found(name, solver):
    laser_m, first_bin_s = WALLS[name]
    assert np.all(np.abs(found(taken(laser_m, SPOT, first_bin_s), solver) - POINT) <= VOXEL)


@pytest.mark.parametrize("solver", TRANSFORMS)
@pytest.mark.parametrize("name", WALLS)
def test_one_detector_point_is_found_by_normal_moveout(name, solver):
    laser_m, first_bin_s = WALLS[name]
    capture = taken(laser_m, SPOT, first_bin_s)
    # Moveout brings the point nearer by b^2 cos^2(theta)/(8 r): 5.6 mm at most on these walls, 0.6 mm on
    # average.
    assert np.all(np.abs(found(capture, solver) - POINT) <= VOXEL)
    result = baseline_image(capture, GRID, solver=solver)
    assert "approximation" in result.notes[0]
    assert ("treated as dark" in result.notes[-1]) == (name == "square skipped")


@pytest.mark.parametrize("solver", FILTERED + TRANSFORMS)
@pytest.mark.parametrize("geometry", ["scattered", "curved wall", "pairs"])
def test_any_positions_are_imaged_or_refused_by_name(geometry, solver):
    random = np.random.default_rng(11)
    laser_m = random.uniform(-0.25, 0.25, (700, 3)) * [1, 1, 0]
    detector_m = np.array([[0.03, 0.02, 0.0]])
    if geometry == "curved wall":
        laser_m[:, 2] = 0.3 * laser_m[:, 0] ** 2 - 0.1 * laser_m[:, 1]
        detector_m[:, 2] = -0.01
    if geometry == "pairs":
        detector_m = random.uniform(-0.25, 0.25, (700, 3)) * [1, 1, 0]
    first_bin_s = random.uniform(0, 1e-9, 5)[random.integers(0, 5, 700)]
    capture = taken(laser_m, detector_m, first_bin_s, falloff=False)
    if solver in FILTERED:
        assert np.all(np.abs(found(capture, solver) - POINT) <= VOXEL)
    else:
        with pytest.raises(GeometryError, match="back-projection"):
            baseline_image(capture, GRID, solver=solver)


@pytest.mark.parametrize("solver", FILTERED + TRANSFORMS)
@pytest.mark.parametrize("detector_m", [None, SPOT], ids=["confocal", "one detector"])
def test_where_the_record_begins_does_not_matter(detector_m, solver):
    """The same record with its empty start cut off, in all positions alike or in each by another amount."""
    whole = taken(LASER, LASER if detector_m is None else detector_m)
    counts = whole.histograms.counts
    cut = 300
    late = Capture(
        ArrayHistograms(counts[:, cut:]), BIN, np.array([cut * BIN]), whole.laser_m, whole.detector_m
    )
    # Each record of its own begins and ends 0 to 36 bins later; nothing is there to fade. Back-projection
    # sums bins by fours: by whole fours later, the same are summed.
    shifts = 4 * RANDOM.integers(0, 10, len(LASER))
    padded = np.pad(counts, ((0, 0), (0, 40)))
    own = np.stack([row[shift : shift + 1000] for row, shift in zip(padded, shifts, strict=True)])
    each = Capture(ArrayHistograms(own), BIN, shifts * BIN, whole.laser_m, whole.detector_m)
    none = Window(fall_s=0)
    images = [baseline_image(one, GRID, solver=solver, window=none).amplitude for one in (whole, late, each)]
    # Single precision, 1e-7 of a path of some hundred bins, and of sums that the filters take differences of.
    for moved in images[1:]:
        assert np.abs(moved - images[0]).max() <= 1e-3 * images[0].max()


@pytest.mark.parametrize("solver", TRANSFORMS)
def test_voxels_beside_the_wall_and_of_any_pitch(solver):
    """A point beside the wall is found on voxels that are off the wall's lattice and reach beyond it."""
    point = np.array([0.31, 0.02, 0.5])
    counts = histograms(point, LASER, LASER, 1000, BIN)
    capture = Capture(ArrayHistograms(counts), BIN, np.zeros(1), LASER, LASER)
    grid = VoxelGrid(np.arange(0.204, 0.44, 0.022), np.arange(-0.1, 0.1, 0.022), np.arange(0.4, 0.62, 0.022))
    assert np.all(np.abs(found(capture, solver, grid) - point) <= 0.022)


@pytest.mark.parametrize("solver", FILTERED + TRANSFORMS)
def test_fades_hide_what_comes_early(solver):
    near = np.array([0.0, 0.0, 0.35])
    counts = histograms([near, POINT], LASER, LASER, 1000, BIN)
    capture = Capture(ArrayHistograms(counts), BIN, np.zeros(1), LASER, LASER)
    grid = VoxelGrid.from_spec(0.3, 0.3, 0.01, (0.3, 0.75, 0.01))
    # The near point's light comes at 2.3 to 2.8 ns, the far one's from 4.1 ns.
    faded = baseline_image(capture, grid, solver=solver, window=Window(start_s=3.2e-9)).amplitude
    k, j, i = np.unravel_index(faded.argmax(), faded.shape)
    assert np.all(np.abs([grid.x_m[i], grid.y_m[j], grid.z_m[k]] - POINT) <= VOXEL)


def test_nonsense_is_refused():
    capture = taken(LASER, LASER)
    with pytest.raises(ParameterError, match="log-fbp"):
        baseline_image(capture, GRID, solver="inverse")
    with pytest.raises(ParameterError, match="no such filter"):
        baseline_image(capture, GRID, solver="fk", snr=1.0)
    with pytest.raises(ParameterError, match="not positive"):
        baseline_image(capture, GRID, solver="lct", snr=0.0)
    with pytest.raises(ParameterError, match="in front of the wall"):
        baseline_image(capture, VoxelGrid(GRID.x_m, GRID.y_m, np.zeros(1)), solver="bp")
    with pytest.raises(ReachError):
        baseline_image(capture, VoxelGrid.from_spec(0.1, 0.1, 0.1, (5, 6, 0.1)), solver="lct")
