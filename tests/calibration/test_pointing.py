"""The mirror's model: forward and back, against the bench's own geometry, and where it was measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rig.errors import RefusedError
from rig.model.pointing import Pointing, _turn, outside
from simulators.bench import BenchGeometry
from simulators.motion.mount import MirrorMount

TURN = (0.03, -0.09, 0.02)


def crooked(mirrors, **changes):
    given = {
        "mirror_m": (-0.2, 0.05, 2.4),
        "rotation_rad": TURN,
        "offset_rad": (0.01, -0.006),
        "gain": (1.01, 0.99),
        "mirrors": mirrors,
        "separation_m": 0.02 if mirrors == 2 else 0.0,
    }
    return Pointing(**(given | changes))


#: (angle of incidence, its direction) of one mirror [deg].
INCIDENCES = [(0, 0), (10, -60), (22.5, 0), (45, 180), (45, 37)]
MOUNTS = [(2, 0.0, 0.0), *((1, *np.radians(one)) for one in INCIDENCES)]


@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_turns_are_those_of_the_library(vector_rad):
    np.testing.assert_allclose(_turn(vector_rad), Rotation.from_rotvec(vector_rad).as_matrix(), atol=1e-14)


def met_at(angle_rad, direction_rad):
    return (angle_rad * np.cos(direction_rad), angle_rad * np.sin(direction_rad))


@pytest.mark.parametrize(("mirrors", "angle_rad", "direction_rad"), MOUNTS)
@given(x_m=st.floats(-0.9, 0.9), y_m=st.floats(-0.7, 0.7))
def test_the_beam_goes_where_it_is_sent(mirrors, angle_rad, direction_rad, x_m, y_m):
    pointing = crooked(mirrors, incidence_rad=met_at(angle_rad, direction_rad))
    spots = np.array([[x_m, y_m, 0.0], [0.1, 0.2, 0.0]])
    # Newton's last step, and rounding of one mirror, are below 1e-12 rad, and a rad is some 3 m here
    assert pointing.spots_m(pointing.angles_rad(spots)) == pytest.approx(spots, abs=1e-11)


@pytest.mark.parametrize(("mirrors", "angle_rad", "direction_rad"), MOUNTS)
@given(x_rad=st.floats(-0.4, 0.4), y_rad=st.floats(-0.3, 0.3))
def test_it_is_the_same_mirror_as_the_benchs(mirrors, angle_rad, direction_rad, x_rad, y_rad):
    """The bench has a formula of its own; some spots are 5 m off at 45 degrees: 1e-12 of that is rounding."""
    model = crooked(mirrors, incidence_rad=met_at(angle_rad, direction_rad))
    rotation = Rotation.from_rotvec(model.rotation_rad).as_matrix()
    bench = BenchGeometry(
        galvo_m=model.mirror_m,
        mount=MirrorMount(
            rotation=tuple(map(tuple, rotation.tolist())),
            offset_rad=model.offset_rad,
            gain=model.gain,
            incidence_rad=angle_rad,
            incidence_direction_rad=direction_rad,
            mirrors=mirrors,
            separation_m=model.separation_m,
        ),
    )
    assert model.spots_m((x_rad, y_rad)) == pytest.approx(bench.laser_spot_m((x_rad, y_rad)), abs=1e-11)


def test_met_along_its_normal_the_tangents_are_independent():
    """As the maker defines the angles: the spot is distance times tangent, to rounding."""
    angles = np.random.default_rng(0).uniform(-0.6, 0.6, (100, 2))
    expected = 2.5 * np.tan(angles) + (0.1, -0.2)
    spots = Pointing((0.1, -0.2, 2.5)).spots_m(angles)
    np.testing.assert_allclose(spots[:, :2], expected, rtol=0, atol=4e-15)


@pytest.mark.parametrize("incidence_deg", [22.5, 45.0])
def test_in_the_plane_of_incidence_the_beam_turns_by_twice_the_mirrors_angle(incidence_deg):
    """For any incidence. Out of that plane it turns by cos(incidence) of it, for small angles."""
    incidence = np.radians(incidence_deg)
    pointing = Pointing((0.0, 0.0, 2.5), incidence_rad=(incidence, 0.0))
    angles = np.linspace(-0.4, 0.4, 9)
    along = pointing.spots_m(np.stack([angles, 0 * angles], axis=1))
    np.testing.assert_allclose(along[:, :2], np.stack([2.5 * np.tan(angles), 0 * angles], axis=1), atol=1e-14)
    tiny = 1e-4
    _, y_m, _ = pointing.spots_m((0.0, tiny))
    # the next term of y is of third order, 1e-8 of it; x is of second order
    assert y_m == pytest.approx(2.5 * np.cos(incidence) * tiny, rel=1e-7)


def test_a_beam_from_behind_the_mirror_goes_nowhere():
    """Met at 80 degrees, a mirror that is turned away by 15 shows its back."""
    pointing = Pointing((0.0, 0.0, 2.5), incidence_rad=(np.radians(80.0), 0.0))
    assert np.isfinite(pointing.spots_m((0.1, 0.0))).all()
    assert np.isnan(pointing.spots_m((-np.radians(30.0), 0.0))).all()


def test_a_beam_away_from_the_wall_meets_it_nowhere():
    assert np.isnan(Pointing((0, 0, 2.5), rotation_rad=(0, 2.0, 0)).spots_m((0.0, 0.0))).all()


def test_nothing_outside_the_measured_area_is_aimed_at():
    square = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    pointing = crooked(1, area_m=square)
    pointing.angles_rad([0.5, 0.5, 0.0])
    with pytest.raises(RefusedError, match=r"x = 60 cm, y = 0 mm is 10 cm outside the area.*calibrate galvo"):
        pointing.angles_rad([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]])


def test_distances_outside_a_polygon():
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert outside(triangle, np.array([[0.2, -0.3], [0.25, 0.25]])) == pytest.approx([0.3, -0.25])
