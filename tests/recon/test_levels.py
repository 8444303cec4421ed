"""Low frequencies on coarse lattices, against the sum itself and against one lattice for all of a band."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.aperture import LatticeAxis, recognise
from recon.grid import VoxelGrid
from recon.solvers.rsd.lattice import Wave
from recon.solvers.rsd.levels import (
    DESIGNED,
    LevelPropagator,
    Scene,
    Side,
    plan_levels,
    window_half_widths,
    work_points,
)
from recon.solvers.rsd.regular import LatticePropagator
from recon.wave import VirtualPulse
from support.hidden_points import C

DETECTOR_M = np.array([0.1, -0.05, 0.0])
OMEGA = 2 * np.pi * C / 0.04
#: Error of each interpolation, as a part of the wave: of the order of single precision's, over many FFTs.
ERROR = 1e-5


def centred(count, spacing_m, centre_m=0.0):
    return centre_m + (np.arange(count) - (count - 1) / 2) * spacing_m


def wall(columns=96, rows=72, pitch_m=0.01):
    x, y = (one.ravel() for one in np.meshgrid(centred(columns, pitch_m), centred(rows, pitch_m)))
    return np.stack([x, y, 0 * x], axis=1)


def emissions(many, positions, seed=4):
    parts = np.random.default_rng(seed).normal(size=(many, 2 * positions))
    return parts.astype(np.float32).view(np.complex64)


def by_detector(grid, z_m):
    across = (grid.x_m - DETECTOR_M[0]) ** 2 + (grid.y_m[:, None] - DETECTOR_M[1]) ** 2
    return np.sqrt(across + z_m**2)[None] / C


def at_once(grid, z_m):
    return np.full((1, 1, 1), 1.3e-9)


def both(laser_m, band, grid, factor, moments):
    """Return the same plane by one lattice and by levels, with slopes, and the levels."""
    emitted = emissions(len(band), len(laser_m))
    near_m = float(grid.z_m[0])
    aperture = recognise(laser_m)
    one = LatticePropagator(aperture, emitted, band, grid, factor).focus(near_m, moments(grid, near_m), OMEGA)
    through = LevelPropagator(aperture, emitted, band, grid, factor, moments, 2**28, 1)
    levels = plan_levels(Scene.of(aperture, grid, factor, moments), band)
    return one, through.focus(near_m, OMEGA), levels


def summed(laser_m, band, grid, row, column):
    """Return the field of a voxel of the first plane, term by term in double precision."""
    z_m, omega = grid.z_m[0], band.frequencies_rad_per_s
    r = np.sqrt((grid.x_m[column] - laser_m[:, 0]) ** 2 + (grid.y_m[row] - laser_m[:, 1]) ** 2 + z_m**2)
    terms = emissions(len(band), len(laser_m)) * np.exp(1j * np.outer(omega, r / C)) / r
    return (np.exp(1j * omega * by_detector(grid, z_m)[0, row, column]) * terms.sum(axis=1)).sum()


def differ(one, other):
    """Return the greatest difference of field and of slope, as a part of each one's peak."""
    return [float(np.abs(a - b).max() / np.abs(a).max()) for a, b in zip(one, other, strict=True)]


@pytest.mark.parametrize(("factor", "moments"), [(1, by_detector), (1, at_once), (2, at_once)])
@pytest.mark.parametrize("near_m", [0.6, 1.0, 3.0])
def test_levels_are_one_lattice(near_m, factor, moments):
    grid = VoxelGrid(centred(96, 0.01), centred(72, 0.01), np.array([near_m]))
    band = VirtualPulse(0.06 * factor, 2).band(12e-9 * factor)
    one, found, levels = both(wall(), band, grid, factor, moments)
    assert levels[0].x.taps
    # Each wave is interpolated twice along two axes; errors of all waves add up by chance.
    assert max(differ(one, found)) < 2 * ERROR


def test_levels_are_the_sum():
    grid = VoxelGrid(centred(96, 0.01), centred(72, 0.01), np.array([1.5]))
    laser_m, band = wall(), VirtualPulse(0.05, 2).band(12e-9)
    _, found, levels = both(laser_m, band, grid, 1, by_detector)
    assert len(levels) > 1
    places = [(0, 0), (71, 95), (11, 40), (30, 5)]
    errors = [found[0][place] - summed(laser_m, band, grid, *place) for place in places]
    assert np.abs(errors).max() < 2 * ERROR * np.abs(found[0]).max()


@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 40),
    st.floats(0.004, 0.05),
    st.floats(-0.6, 0.6),
    st.floats(0.3, 4),
    st.floats(2, 6),
    st.floats(0.05, 0.3),
)
def test_any_voxels(count, spacing_m, centre_m, near_m, cycles, wavelength_m):
    """Levels are as good as one lattice, whose windows for voxels off the wall are less exact than theirs."""
    grid = VoxelGrid(centred(count, spacing_m, centre_m), centred(9, 0.02), np.array([near_m]))
    laser_m, band = wall(32, 24), VirtualPulse(wavelength_m, cycles).band(5e-9)
    one, found, _ = both(laser_m, band, grid, 1, by_detector)
    rows, columns = (0, 5), tuple({0, count // 3, count - 1})
    wanted = np.array([[summed(laser_m, band, grid, row, column) for column in columns] for row in rows])
    of_one, of_levels = (np.abs(each[0][np.ix_(rows, columns)] - wanted).max() for each in (one, found))
    # what is interpolated is as large as terms that add up by chance, also where the few voxels are dark
    scale = np.sqrt(len(laser_m) * 2 * len(band)) / near_m
    assert of_levels < 2 * of_one + 4 * ERROR * max(scale, float(np.abs(one[0]).max()))


def random_windows(many):
    """Yield random waves, steps of lattices, and half-widths of windows, for those that have any."""
    random = np.random.default_rng(8)
    for _ in range(many):
        wavenumber, near_m, reach_m, step_m = 10 ** random.uniform([1, -1.3, -1.3, -3], [3.3, 1, 0.8, -0.5])
        half_width = float(window_half_widths(wavenumber, near_m, reach_m, np.array([step_m]))[0])
        if np.isfinite(half_width):
            yield Wave(wavenumber, near_m, reach_m), step_m, int(half_width)


def test_windows_interpolate_as_well_as_they_should():
    errors = np.array([wave.error(step_m, width, DESIGNED) for wave, step_m, width in random_windows(1500)])
    assert len(errors) > 700
    # Kaiser's formula is for a spectrum that ends; that of a wave within a window has tails, the more the
    # fewer windows there are in the longest offset.
    assert errors.max() < 4 * ERROR
    assert np.quantile(errors, 0.98) <= ERROR


@pytest.mark.parametrize("near_m", [0.3, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("reach_m", [0.6, 1.3, 1.8])
def test_windows_of_a_usual_room_are_as_good_as_designed(near_m, reach_m):
    for wavenumber in (70.0, 110.0, 160.0, 240.0):
        steps_m = np.geomspace(0.011, 0.08, 12)
        widths = window_half_widths(wavenumber, near_m, reach_m, steps_m)
        for step_m, width in zip(steps_m, widths, strict=True):
            if np.isfinite(width):
                assert (
                    Wave(wavenumber, near_m, reach_m).error(step_m, int(width), DESIGNED) <= 2 * ERROR
                )  # where one window is as long as the offset


def scene(near_m, slope=0.5):
    y, x = (
        Side(
            LatticeAxis(-0.005 * (many - 1), 0.01, many), -0.005 * (many - 1), 0.005 * (many - 1), many, slope
        )
        for many in (130, 180)
    )
    return Scene(y, x, near_m, 1)


def test_deep_rooms_take_less():
    band = VirtualPulse(0.04, 2).band(12e-9)
    taken = [
        work_points(plan_levels(scene(near_m), band)) / len(band) / (270 * 360) for near_m in (0.5, 1.5, 3)
    ]
    assert taken == sorted(taken, reverse=True)
    assert taken[0] < 0.85
    assert taken[-1] < 0.5


def test_levels_cover_the_band_in_turn():
    for near_m in np.geomspace(0.1, 20, 12):
        band = VirtualPulse(0.04, 2).band(12e-9)
        parts = [level.part for level in plan_levels(scene(float(near_m)), band)]
        edges = [0, *(part.stop for part in parts)]
        assert [part.start for part in parts] == edges[:-1]
        assert edges[-1] == len(band)


@pytest.mark.parametrize("slope", [1.0, 7.0])
def test_moments_that_change_faster_than_light_are_read_on_one_lattice(slope):
    (level,) = plan_levels(scene(2.0, slope), VirtualPulse(0.04, 2).band(12e-9))
    assert level.x.taps is None


def test_runs_of_a_band_add_up():
    grid = VoxelGrid(centred(96, 0.01), centred(72, 0.01), np.array([1.0]))
    aperture, band = recognise(wall()), VirtualPulse(0.05, 2).band(12e-9)
    emitted = emissions(len(band), len(wall()))

    def focused(part):
        part_of_band, given = band[part], emitted[part]
        return LevelPropagator(aperture, given, part_of_band, grid, 1, by_detector, 2**28, 1).focus(
            1.0, OMEGA
        )

    whole = focused(slice(0, len(band)))
    cut = focused(slice(0, 11)) + focused(slice(11, len(band)))
    # on the same lattices; phases go from frequency to frequency, and each step is rounded to 24 bits
    assert max(differ(whole, cut)) < len(band) * 2**-24
