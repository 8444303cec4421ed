"""Measures give the numbers of shapes whose numbers are known, and nothing where there is none."""

from math import isnan, log, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.ndimage import binary_dilation

from recon.depth import compensate_falloff, depth_map
from recon.measures import (
    contrast,
    depth_error,
    displacement_m,
    half_maximum_width,
    overlap,
    predicted,
    pulse_depth_m,
    sampled_depth,
    signal_to_noise,
    surface_of_mesh,
    surface_of_voxels,
    surroundings,
    widths,
)

# --- widths


@given(st.floats(-0.4, 0.4), st.floats(0.03, 0.2), st.floats(0, 30), st.integers(3, 12), st.floats(1e-6, 1e6))
def test_a_gaussian_has_its_width_wherever_it_is(shift, fwhm, offset, samples, height):
    """Three samples or more in the full width; the spline is then within a percent, as its docstring says."""
    axis = offset + np.arange(-2.0, 2.0, fwhm / samples)
    profile = height * np.exp(-4 * log(2) * ((axis - offset - shift) / fwhm) ** 2)
    found = half_maximum_width(profile, axis)
    assert found.fwhm_m == pytest.approx(fwhm, rel=0.01)
    assert found.peak_m == pytest.approx(offset + shift, abs=0.01 * fwhm)


def test_a_slit_has_its_width_and_first_minimum():
    axis = np.arange(-5, 5, 0.05)
    found = half_maximum_width(np.sinc(axis) ** 2, axis)
    # sinc^2 is 1/2 at 0.4429 and first zero at 1; a twentieth of that between samples
    assert found.fwhm_m == pytest.approx(0.8859, abs=1e-3)
    assert found.first_minimum_m == pytest.approx(1, abs=1e-3)


def test_what_does_not_fall_to_the_half_has_no_width():
    axis = np.linspace(0, 1, 20)
    assert isnan(half_maximum_width(axis, axis).fwhm_m)
    assert isnan(half_maximum_width(1 - 0.1 * (axis - 0.5) ** 2, axis).fwhm_m)
    assert isnan(half_maximum_width(np.zeros(20), axis).fwhm_m)
    assert isnan(half_maximum_width(np.ones(2), axis[:2]).fwhm_m)


def test_each_axis_has_its_own_width():
    axes = [np.arange(-0.3, 0.3, 0.02), np.arange(-0.2, 0.2, 0.01), np.arange(0.8, 1.2, 0.01)]
    x, y, z = axes
    wanted = (0.1, 0.05, 0.08)
    falls = [
        np.exp(-4 * log(2) * ((a - c) / w) ** 2)
        for a, c, w in zip(axes, (0.033, 0.021, 1), wanted, strict=True)
    ]
    intensity = falls[2][:, None, None] * falls[1][:, None] * falls[0]
    assert_allclose([width.fwhm_m for width in widths(intensity, x, y, z)], wanted, rtol=0.01)


def test_the_formulas_of_diffraction():
    far = predicted(0.04, 1000.0, 1.8)
    # far away all angles are small: sin theta = d / 2L
    assert far.near_m == pytest.approx(far.one_m, rel=1e-6)
    assert far.both_m == pytest.approx(0.61 * 0.04 * 1000 / 1.8)
    near = predicted(0.04, 1e-6, 1.8)
    # from one side to the other of the half space
    assert near.near_m == pytest.approx(1.22 * 0.02)
    middle = predicted(0.04, 0.9, 1.8)
    assert middle.near_m == pytest.approx(1.22 * 0.04 * sqrt(2) / 2)
    assert middle.slit_zero_m == pytest.approx(0.02 * sqrt(2))
    assert middle.slit_fwhm_m == pytest.approx(0.02 * sqrt(2) * 0.8859, rel=1e-3)
    # a pulse |u|^2 of full width 6 lambda in u
    assert pulse_depth_m(0.04, 6) == pytest.approx(0.24 / sqrt(2) / 2)


# --- depth


def test_errors_of_depth():
    truth = np.array([[1.0, 1.0, 1.0, np.nan, 1.0]])
    found = np.array([[1.01, 0.99, 1.10, 1.0, np.nan]])
    error = depth_error(found, truth)
    assert error.pixels == 3
    assert error.median_m == pytest.approx(0.01)
    assert error.mean_m == pytest.approx(0.1 / 3)
    assert error.median_absolute_m == pytest.approx(0.01)
    assert error.mean_absolute_m == pytest.approx(0.12 / 3)
    assert error.rms_m == pytest.approx(sqrt((1e-4 + 1e-4 + 1e-2) / 3))
    assert error.close == pytest.approx(2 / 3)
    assert overlap(np.isfinite(found), np.isfinite(truth)) == pytest.approx(3 / 5)


def test_no_common_pixel_has_no_error():
    nothing = np.full((2, 2), np.nan)
    error = depth_error(nothing, np.ones((2, 2)))
    assert error.pixels == 0
    assert isnan(error.median_m)
    assert isnan(error.close)
    assert overlap(np.isfinite(nothing), np.ones((2, 2), bool)) == 0
    assert isnan(overlap(np.isfinite(nothing), np.isfinite(nothing)))


def test_a_map_is_taken_at_the_nearest_pixel_and_nowhere_else():
    x_m, y_m = np.array([0.0, 0.1, 0.2]), np.array([0.1, 0.0])  # any order
    taken = sampled_depth(np.array([[1, 2, 3], [4, 5, np.nan]]), x_m, y_m, np.array([-0.06, 0.04, 0.19]), y_m)
    np.testing.assert_array_equal(taken, [[np.nan, 1, 3], [np.nan, 4, np.nan]])


def test_the_first_voxel_is_the_surface():
    occupied = np.zeros((3, 1, 3), bool)
    occupied[1, 0, 0] = occupied[2, 0, 0] = occupied[2, 0, 1] = True
    np.testing.assert_array_equal(surface_of_voxels(occupied, np.array([1.0, 1.5, 2])), [[1.5, 2.0, np.nan]])


@given(st.integers(0, 2**32 - 1))
def test_a_mesh_is_what_single_rays_hit(seed):
    """Against each ray solved as three equations: origin + t z = a + u (b - a) + v (c - a)."""
    rng = np.random.default_rng(seed)
    triangles = rng.uniform([-1, -1, -0.5], [1, 1, 2], (6, 3, 3))
    x, y = np.linspace(-0.9, 0.93, 7), np.linspace(-0.95, 0.9, 6)
    expected = np.full((6, 7), np.inf)
    for a, b, c in triangles:
        solve = np.linalg.inv(np.stack([b - a, c - a, [0, 0, -1.0]], axis=1))
        for j, i in np.ndindex(6, 7):
            u, v, t = solve @ (np.array([x[i], y[j], 0.0]) - a)
            if min(u, v, 1 - u - v) >= 0 and t > 0:
                expected[j, i] = min(expected[j, i], t)
    found = surface_of_mesh(triangles, x, y)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    # slivers are solved badly by either way: a millionth
    there = np.isfinite(found)
    assert_allclose(found[there], expected[there], rtol=1e-6)


def test_neighbouring_triangles_leave_no_gap():
    corners = np.array([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], float)
    square = corners[[[0, 1, 2], [2, 3, 0]]]  # the shared edge runs through pixels, the second wound back
    axis = np.linspace(-1, 1, 21)
    assert_allclose(surface_of_mesh(square, axis, axis), np.full((21, 21), 2.0), rtol=1e-15)


@pytest.mark.parametrize("wavelength_m", [0.04, 0.2])
def test_a_lift_by_depth_does_not_move_the_surface(wavelength_m):
    """A pulse of 6 cycles at 0.8 m, with the solver's z^-2, lifted by z^4."""
    z_m = np.arange(0.3, 1.5, wavelength_m / 8)
    variance = (pulse_depth_m(wavelength_m, 6) / 2.355) ** 2
    intensity = (np.exp(-((z_m - 0.8) ** 2) / (2 * variance)) / z_m**2)[:, None, None].astype(np.float32)
    lifted = compensate_falloff(intensity, z_m, power=4)
    moved_m = 2 * variance / 0.8
    assert depth_map(lifted, z_m)[0, 0] - 0.8 == pytest.approx(moved_m, rel=0.1)
    # the parabola through a Gaussian's logarithm is exact; single precision of its values
    assert depth_map(lifted, z_m, lifted=2.0)[0, 0] == pytest.approx(0.8, abs=1e-4)


def test_the_lift_still_tells_which_surface_is_seen():
    z_m = np.arange(0.5, 2.5, 0.02)
    near, far = (np.exp(-(((z_m - place) / 0.05) ** 2)) for place in (0.8, 1.6))
    intensity = (near + far / 8)[:, None, None].astype(np.float32)
    lifted = compensate_falloff(intensity, z_m, power=4)
    assert depth_map(lifted, z_m, lifted=2.0)[0, 0] == pytest.approx(1.6, abs=0.01)


# --- contrast and noise


def test_the_background_keeps_its_distance():
    axis = np.arange(11) * 0.1
    occupied = np.zeros((11, 11), bool)
    occupied[5, 5] = True
    around = surroundings(occupied, axis, axis, 0.25)
    distance = np.hypot(axis[:, None] - 0.5, axis - 0.5)
    np.testing.assert_array_equal(around, distance > 0.25)
    assert surroundings(np.zeros((2, 2), bool), axis[:2], axis[:2], 1.0).all()


def test_contrast_and_noise():
    front = np.array([[9.0, 3.0, 1.0, 3.0]])
    occupied = np.array([[True, False, False, False]])
    assert contrast(front, occupied, ~occupied) == pytest.approx((9 - 7 / 3) / (9 + 7 / 3))
    # background 3, 1, 3: mean 7/3, standard deviation sqrt(8)/3
    assert signal_to_noise(front, ~occupied) == pytest.approx((9 - 7 / 3) / (sqrt(8) / 3))
    assert isnan(contrast(front, occupied & False, ~occupied))
    assert isnan(signal_to_noise(front, occupied))


# --- displacement


@pytest.mark.parametrize(("rows", "columns"), [(0, 0), (3, -2), (-5, 4)])
def test_displacement_is_that_of_a_moved_shape_whatever_its_blur(rows, columns):
    x_m, y_m = np.arange(60) * 0.02, np.arange(50) * 0.03
    shape = np.zeros((50, 60), bool)
    shape[15:35, 20:24] = shape[31:35, 20:38] = shape[23:26, 20:33] = True  # no symmetry of its own
    moved = np.roll(shape, (rows, columns), axis=(0, 1))
    blurred = binary_dilation(moved, iterations=2)
    for seen in (moved, blurred):
        # the shifts that are taken together are whole pixels, evenly about the right one
        found = displacement_m(seen, shape, x_m, y_m)
        assert found == pytest.approx((columns * 0.02, rows * 0.03), abs=0.005)
    assert np.isnan(displacement_m(np.zeros_like(shape), shape, x_m, y_m)).all()
