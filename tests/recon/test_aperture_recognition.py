"""Any regular grid is recognised, in any order and with gaps; an irregular one is refused by name."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.aperture import TOLERANCE_M, recognise
from recon.errors import GeometryError
from support.hidden_points import wall


@st.composite
def grids(draw):
    """A grid, the true indices, and the positions: shuffled, thinned, with the noise of a text file."""
    nx, ny = draw(st.integers(2, 40)), draw(st.integers(2, 40))
    pitch_m = draw(st.floats(0.002, 0.1))
    centre_m = (draw(st.floats(-1, 1)), draw(st.floats(-1, 1)))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    spots = wall(nx, ny, pitch_m, centre_m)
    column, row = np.tile(np.arange(nx), ny), np.repeat(np.arange(ny), nx)
    kept = random.random(nx * ny) > draw(st.floats(0, 0.2))
    kept[[0, 1, nx, nx * ny - 1]] = True  # both pitches and both extents can be seen
    order = random.permutation(np.flatnonzero(kept))
    noise_m = random.uniform(-1, 1, spots.shape) * draw(st.sampled_from([0, 1e-9, 1e-4]))
    return pitch_m, column[order], row[order], (spots + noise_m)[order]


@settings(max_examples=150)
@given(grids())
def test_numbers_every_position(grid):
    pitch_m, column, row, spots = grid
    found = recognise(spots)
    np.testing.assert_array_equal(found.column, column)
    np.testing.assert_array_equal(found.row, row)
    # Two lines with 1e-4 m of noise each, 1 pitch apart, are the worst case.
    assert found.x.pitch_m == pytest.approx(pitch_m, abs=2e-4)
    assert found.y.pitch_m == pytest.approx(pitch_m, abs=2e-4)


def test_missing_lines_do_not_change_the_pitch():
    spots = wall(30, 20, 0.01)
    x = np.round((spots[:, 0] + 0.145) / 0.01).astype(int)
    found = recognise(spots[~np.isin(x, [3, 4, 5, 11, 28])])
    assert found.x.pitch_m == pytest.approx(0.01)
    assert found.x.count == 30


def test_mostly_missing_lines_fall_back_to_the_smallest_step():
    at = np.array([0, 2, 4, 6, 7, 9, 11, 13])
    spots = np.array([[0.01 * i, 0.01 * j, 0] for i in at for j in range(5)])
    found = recognise(spots)
    np.testing.assert_array_equal(found.column, np.repeat(at, 5))


def test_a_single_line_is_an_aperture():
    found = recognise(wall(50, 1, 0.01))
    assert (found.x.count, found.y.count) == (50, 1)
    assert found.y.pitch_m == pytest.approx(0.01)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("off_m", [3 * TOLERANCE_M, 0.0025, 0.005, 0.0075])
def test_names_the_stray(axis, off_m):
    spots = wall(30, 20, 0.01)
    spots[333, axis] += off_m
    with pytest.raises(GeometryError, match=f"position 333 at {'xy'[axis]}"):
        recognise(spots)


def test_names_what_is_off_the_plane():
    spots = wall(5, 5, 0.01)
    spots[7, 2] = 0.003
    with pytest.raises(GeometryError, match=r"position 7 is 3.00 mm off the plane"):
        recognise(spots)


@pytest.mark.parametrize("count", [30, 1000])
def test_refuses_scattered_spots(count):
    spots = np.random.default_rng(5).uniform(-1, 1, (count, 3)) * [1, 1, 0]
    with pytest.raises(GeometryError, match="off the best even spacing"):
        recognise(spots)
