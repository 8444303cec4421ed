"""Any wall, any pairs: planted points are found, and the image is the direct sum in double precision."""

from dataclasses import replace

import numpy as np
import pytest

from recon.camera import ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.depth import compensate_falloff, depth_map
from recon.grid import VoxelGrid
from recon.imaging import image, plan, planes
from recon.solvers.rsd import direct_f32, dispatch
from recon.wave import VirtualPulse
from recon.window import Window
from support.hidden_points import C, exact, histograms, wall, worst
from support.thorough import some

PULSE = VirtualPulse(0.08, 6)
BIN, BINS = 16e-12, 700
POINTS = np.array([[0.11, -0.06, 0.52], [-0.2, 0.14, 0.75]])
RANDOM = np.random.default_rng(8)

_jittered = wall(24, 20, 0.02)
_jittered[:, :2] += RANDOM.uniform(-8e-3, 8e-3, (480, 2))


def bent(depth):
    spots = _jittered.copy()
    spots[:, 2] = depth(spots[:, 0], spots[:, 1])
    return spots


WALLS = {
    "jittered": _jittered,
    "random": RANDOM.uniform(-0.25, 0.25, (480, 3)) * [1, 1, 0],
    "curved": bent(lambda x, y: 0.1 * (x / 0.24) ** 2 - 0.05),
    "tilted": bent(lambda x, y: 0.35 * x - 0.1 * y),
    "behind": bent(lambda x, y: 0 * x - 0.07),
    "grid": wall(24, 20, 0.02),
}
DETECTORS = {
    "one": lambda spots: np.array([[0.03, -0.05, 0.01]]),
    "confocal": lambda spots: spots.copy(),
    "three": lambda spots: spots[RANDOM.integers(0, 3, len(spots))],
    "pairs": lambda spots: RANDOM.permutation(spots),
}
GRIDS = {
    "as the wall": VoxelGrid(
        -0.21 + 0.02 * np.arange(12), -0.19 + 0.02 * np.arange(11), np.array([0.52, 0.75])
    ),
    "finer, aside": VoxelGrid(
        0.05 + 0.013 * np.arange(9), -0.3 + 0.009 * np.arange(8), np.array([0.33, 0.52])
    ),
    "coarse, beyond": VoxelGrid(-0.6 + 0.11 * np.arange(8), np.array([-0.06]), np.array([0.52])),
}


def taken(spots, geometry, first_bin_s=0.0, points_m=POINTS):
    detector_m = DETECTORS[geometry](spots)
    counts = histograms(points_m, spots, detector_m, BINS, BIN, first_bin_s)
    return Capture(ArrayHistograms(counts, 100), BIN, np.atleast_1d(first_bin_s), spots, detector_m)


def by_fft(name, geometry="one"):
    """Both ways, of which the quicker is taken; one, without a plane or with a run for each record."""
    return (False,) if name in ("curved", "tilted") or geometry == "pairs" else (False, True)


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
@pytest.mark.parametrize(
    ("name", "geometry", "fft"),
    [(name, spots, fft) for name in WALLS for spots in DETECTORS for fft in by_fft(name, spots)],
)
def test_is_the_direct_sum(name, geometry, grid, fft):
    spots = WALLS[name]
    capture = taken(spots, geometry, 1e-9)
    result = image(capture, PULSE, grid, fft=fft)
    # Spreading is designed for 3e-4 along each axis, and reading likewise; the table's straight lines for
    # 1.2e-4 and its single-precision paths for 1e-4. "Beyond" holds no point, so its peak is a side lobe.
    assert worst(result.field, exact(capture, result)) < (1e-3 if len(grid.y_m) > 1 else 5e-3)


@pytest.mark.parametrize("first_bin_s", some(2e-9, 0.0, short=1))
@pytest.mark.parametrize("geometry", DETECTORS)
@pytest.mark.parametrize("name", WALLS)
def test_finds_the_point(name, geometry, first_bin_s):
    point_m = np.array([0.083, -0.057, 0.613])
    capture = taken(WALLS[name], geometry, first_bin_s, point_m)
    grid = VoxelGrid(0.03 + 0.01 * np.arange(12), -0.11 + 0.01 * np.arange(12), 0.5 + 0.02 * np.arange(12))
    intensity = compensate_falloff(image(capture, PULSE, grid).intensity, grid.z_m, 2)
    _, j, i = np.unravel_index(intensity.argmax(), intensity.shape)
    found_m = [grid.x_m[i], grid.y_m[j], depth_map(intensity, grid.z_m)[j, i]]
    # Half a voxel, and the rounding of 0.613.
    assert np.all(np.abs(found_m - point_m) <= [0.0051, 0.0051, 0.01])


def test_each_record_may_begin_at_its_own_time():
    first_bin_s = RANDOM.uniform(0, 2e-9, 480)
    capture = taken(WALLS["curved"], "pairs", first_bin_s)
    result = image(capture, PULSE, GRIDS["as the wall"])
    assert worst(result.field, exact(capture, result)) < 1e-3


@pytest.mark.parametrize("geometry", ["one", "confocal", "pairs"])
def test_each_frequency_is_the_direct_sum(geometry):
    spots, band = WALLS["curved"][:90], PULSE.band(6e-8)
    assert len(band) > direct_f32.ANCHOR
    emitted = (RANDOM.normal(size=(len(band), 180)).astype(np.float32)).view(np.complex64)
    detector_m = DETECTORS[geometry](spots)
    capture = Capture(ArrayHistograms(np.zeros((90, BINS))), BIN, np.zeros(1), spots, detector_m)
    grid = GRIDS["finer, aside"]
    found = direct_f32.TermwisePropagator(capture, emitted, band, grid).fields(0.52)
    y, x = np.meshgrid(grid.y_m, grid.x_m, indexing="ij")
    voxels = np.stack([x, y, np.full_like(x, 0.52)], axis=-1)[:, :, None]
    r_p = np.linalg.norm(voxels - spots, axis=-1)
    # The leg to the one detector spot is the camera's.
    path_m = r_p if geometry == "one" else r_p + np.linalg.norm(voxels - detector_m, axis=-1)
    for field, frequency, spectrum in zip(found, band.frequencies_rad_per_s, emitted, strict=True):
        wanted = (np.exp(1j * frequency * path_m / C) / r_p) @ spectrum
        # Single precision, 1e-7 for each of up to 64 steps.
        assert np.abs(field - wanted).max() < 3e-5 * np.abs(wanted).max()


@pytest.mark.parametrize(
    ("name", "fft"), [(name, fft) for name in ("jittered", "curved") for fft in by_fft(name)]
)
@pytest.mark.parametrize(
    "camera", [PhotoCamera(), TransientCamera(np.linspace(2e-9, 5e-9, 5))], ids=lambda c: c.name
)
def test_other_cameras_see_what_the_direct_solver_shows(name, camera, fft):
    problem = plan(taken(WALLS[name], "one", 1e-9), PULSE, GRIDS["as the wall"], camera, Window())
    problem = replace(problem, fft=fft)
    found, wanted = (np.stack(list(planes(problem, solver))) for solver in ("rsd", "direct"))
    assert found.shape == (2, problem.frames, 11, 12)
    assert worst(found, wanted) < 1e-3


@pytest.mark.parametrize("geometry", ["one", "pairs"])
def test_few_positions_at_a_time_give_the_same(geometry):
    capture, grid = taken(WALLS["curved"], geometry), GRIDS["as the wall"]
    parts = []
    problem = plan(capture, PULSE, grid, ConfocalCamera(), Window(), parts.append)
    whole = np.stack(list(planes(problem, "rsd")))
    parts.clear()
    cut = np.stack(list(planes(replace(problem, working_bytes=10**5), "rsd")))
    assert worst(cut, whole) < 1e-5
    assert parts == sorted(parts)
    assert parts[-1] == pytest.approx(1)


def test_the_way_that_costs_less_is_taken():
    band = PULSE.band(6e-9)
    large = VoxelGrid(np.linspace(-1, 1, 64), np.linspace(-1, 1, 64), np.linspace(0.5, 1.5, 64))
    many = RANDOM.uniform(-1, 1, (4096, 3)) * [1, 1, 0]
    few = many[:20]

    def runs(spots, geometry="one"):
        counts = ArrayHistograms(np.zeros((len(spots), 1)))
        return dispatch.planar_groups(Capture(counts, BIN, np.zeros(1), spots, DETECTORS[geometry](spots)))

    assert dispatch.quicker_on_lattice(runs(many), len(many), band, large)
    assert not dispatch.quicker_on_lattice(runs(few), len(few), band, large)
    assert not dispatch.quicker_on_lattice(runs(many, "pairs"), len(many), band, large)
    near = VoxelGrid(large.x_m, large.y_m, large.z_m - 0.4)  # evanescent waves still there
    assert not dispatch.quicker_on_lattice(runs(many), len(many), band, near)
    assert dispatch.quicker_on_lattice(runs(many), len(many), band, large, frames=9)
    assert len(runs(many, "three")) == 3
    assert not runs(WALLS["curved"])
