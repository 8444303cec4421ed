"""The mirror's model: forward and back, against the bench's own geometry, and where it was measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rig.errors import RefusedError
from rig.model.pointing import Pointing, outside
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


@pytest.mark.parametrize("mirrors", [1, 2])
@given(x_m=st.floats(-0.9, 0.9), y_m=st.floats(-0.7, 0.7))
def test_the_beam_goes_where_it_is_sent(mirrors, x_m, y_m):
    pointing = crooked(mirrors)
    spots = np.array([[x_m, y_m, 0.0], [0.1, 0.2, 0.0]])
    # Newton's last step is below 1e-12 rad, and a rad is some 3 m here
    assert pointing.spots_m(pointing.angles_rad(spots)) == pytest.approx(spots, abs=1e-11)


@pytest.mark.parametrize("mirrors", [1, 2])
@given(x_rad=st.floats(-0.4, 0.4), y_rad=st.floats(-0.3, 0.3))
def test_it_is_the_same_mirror_as_the_benchs(mirrors, x_rad, y_rad):
    model = crooked(mirrors)
    rotation = Rotation.from_rotvec(model.rotation_rad).as_matrix()
    bench = BenchGeometry(
        galvo_m=model.mirror_m,
        mount=MirrorMount(
            rotation=tuple(map(tuple, rotation.tolist())),
            offset_rad=model.offset_rad,
            gain=model.gain,
            mirrors=mirrors,
            separation_m=model.separation_m,
        ),
    )
    assert model.spots_m((x_rad, y_rad)) == pytest.approx(bench.laser_spot_m((x_rad, y_rad)), abs=1e-12)


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
