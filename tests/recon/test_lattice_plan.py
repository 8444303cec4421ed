"""Any wall and any voxels, one frequency: FFT lengths, wrapping and interpolation against the sum itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.aperture import LatticeAxis, recognise
from recon.camera import ConfocalCamera, Plane
from recon.grid import VoxelGrid
from recon.solvers.rsd.lattice import plan_axis
from recon.solvers.rsd.regular import LatticePropagator
from recon.wave import Band, VirtualPulse
from support.hidden_points import C, wall

WAVELENGTH = 0.05
BAND = Band(2 * np.pi * C / WAVELENGTH, 1.0, np.ones(1))


@st.composite
def axes(draw, pitch_m):
    """Voxels on the lattice, at a multiple of its pitch, or anywhere."""
    count = draw(st.integers(1, 7))
    if draw(st.booleans()):
        first, stride = draw(st.integers(-30, 30)), draw(st.integers(1, 3))
        return pitch_m * (first + stride * np.arange(count))
    return draw(st.floats(-0.5, 0.5)) + draw(st.floats(0.003, 0.07)) * np.arange(count)


@st.composite
def scenes(draw):
    pitch_m = draw(st.sampled_from([0.0125, 0.02, 0.04]))
    laser_m = wall(draw(st.integers(1, 12)), draw(st.integers(2, 9)), pitch_m)
    laser_m -= laser_m[0]
    grid = VoxelGrid(draw(axes(pitch_m)), draw(axes(pitch_m)), np.array([draw(st.floats(0.1, 1))]))
    return laser_m, grid, draw(st.booleans()), draw(st.integers(0, 2**32))


@settings(max_examples=60)
@given(scenes())
def test_one_frequency_is_the_sum(scene):
    laser_m, grid, confocal, seed = scene
    random = np.random.default_rng(seed)
    emitted = random.normal(size=(len(laser_m), 2)).astype(np.float32).view(np.complex64).ravel()
    detector_m = np.array([0.1, -0.2, 0.0])
    propagator = LatticePropagator(recognise(laser_m), emitted[None], BAND, grid, 2 if confocal else 1)
    times_s = np.zeros((1, 1, 1))
    if not confocal:
        plane = Plane(grid.x_m[None], grid.y_m[:, None], grid.z_m[0], detector_m)
        times_s = ConfocalCamera().reading_times_s(plane)
    found = propagator.focus(grid.z_m[0], times_s)
    y, x = np.meshgrid(grid.y_m, grid.x_m, indexing="ij")
    voxels = np.stack([x, y, np.full_like(x, grid.z_m[0])], axis=-1)
    r_p = np.linalg.norm(voxels[..., None, :] - laser_m, axis=-1)
    path = 2 * r_p if confocal else r_p + np.linalg.norm(voxels - detector_m, axis=-1)[..., None]
    wanted = (np.exp(2j * np.pi * path / WAVELENGTH) / r_p) @ emitted
    # Interpolation is designed for 3e-4 of the field along each axis. A field of random phases may vanish at
    # a few voxels, so that its scale is taken from the terms of the sum.
    scale = (np.abs(emitted) / r_p).sum(axis=-1).max()
    assert np.abs(found[0] - wanted).max() < 7e-4 * scale


@given(
    st.integers(1, 300),
    st.floats(0.001, 0.1),
    st.integers(1, 200),
    st.floats(-3, 3),
    st.floats(0.001, 0.1),
    st.floats(0.01, 0.3),
)
def test_nothing_wraps_around(count, pitch_m, voxels, start_m, voxel_m, wavelength_m):
    axis = LatticeAxis(0.0, pitch_m, count)
    plan = plan_axis(axis, start_m + voxel_m * np.arange(voxels), 2 * np.pi / wavelength_m)
    # Interpolation reads before the first voxel and after the last.
    beyond_m = plan.step_m * max(0, plan.weights.shape[1] // 2 - 1)
    last_m = start_m + voxel_m * (voxels - 1)
    longest_m = max(last_m + beyond_m, axis.coordinates_m[-1] - start_m + beyond_m)
    assert plan.half * plan.step_m >= longest_m - 2e-3 * plan.step_m
    assert plan.read <= plan.folded
    assert plan.folded * plan.fold == plan.length
    # Of a wave that is not known, no more than three quarters of the critical rate are interpolated from.
    assert plan.step_m * 2 / wavelength_m <= 0.75 + 1e-9 or (
        plan.spread is None and plan.weights.shape[1] == 1
    )
    assert np.all((plan.wall >= 0) & (plan.wall < plan.length))


def centred(count, spacing_m, centre_m=0.0):
    return centre_m + (np.arange(count) - (count - 1) / 2) * spacing_m


#: Voxels off a wall of 128 x 128 positions 1 cm apart, and as many on its grid that reach as far.
OFF_THE_GRID = {
    "shifted": (centred(128, 0.01, 0.0037), centred(128, 0.01)),
    "half as wide": (centred(64, 0.01, 0.0037), centred(64, 0.01)),
    "coarser": (centred(64, 0.02, 0.0037), centred(64, 0.02, 0.005)),
    "1.2 times as coarse": (centred(107, 0.012), centred(107, 0.01)),
}


@pytest.mark.parametrize("near_m", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("cycles", [2, 6])
@pytest.mark.parametrize("voxels", OFF_THE_GRID)
def test_voxels_off_the_grid_take_at_most_twice_the_work(voxels, cycles, near_m):
    wall_axis = LatticeAxis(-0.635, 0.01, 128)
    wavenumber = VirtualPulse(0.04, cycles).band(10e-9).last_rad_per_s / C
    plans = [plan_axis(wall_axis, at_m, wavenumber, near_m) for at_m in OFF_THE_GRID[voxels]]
    # The wave's transform is on the whole lattice, and that back on what is left when it was folded.
    off, on = (plan.length**2 + plan.folded**2 for plan in plans)
    assert off <= 2 * on


@pytest.mark.parametrize("near_m", [0.06, 0.3, 1.0, 2.0])
@pytest.mark.parametrize(("count", "spacing_m"), [(64, 0.02), (85, 0.015), (107, 0.012), (128, 0.0025)])
def test_a_wave_is_interpolated_as_well_as_it_should_be(count, spacing_m, near_m):
    """A wide wall, where the wave's oscillation and so its interpolation differ from place to place."""
    x, y = (grid.ravel() for grid in np.meshgrid(centred(128, 0.01), centred(4, 0.01)))
    laser_m = np.stack([x, y, 0 * x], axis=1)
    grid = VoxelGrid(centred(count, spacing_m, 0.0037), centred(5, spacing_m, 0.3), np.array([near_m]))
    wavelength_m = 2 * np.pi * C / VirtualPulse(0.04).band(10e-9).last_rad_per_s
    band = Band(2 * np.pi * C / wavelength_m, 1.0, np.ones(1))
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, len(x))
    emitted = np.exp(1j * phases).astype(np.complex64)
    found = LatticePropagator(recognise(laser_m), emitted[None], band, grid, 1).fields(near_m)[0]
    r = np.sqrt((grid.x_m[:, None] - x) ** 2 + (grid.y_m[:, None, None] - y) ** 2 + near_m**2)
    wanted = (np.exp(2j * np.pi * r / wavelength_m) / r) @ emitted
    # 3e-4 of each term along each of two axes; by chance, the errors add up to no more than three times
    # the root of their squares.
    scale = np.sqrt((1 / r**2).sum(axis=-1).max())
    assert np.abs(found - wanted).max() < 3 * 2 * 3e-4 * scale
