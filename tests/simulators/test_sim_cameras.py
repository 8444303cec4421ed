"""The cameras: their lens by laws, their pictures by what a person would measure in them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.bench import Bench
from simulators.optics.cameras import Camera, Checkerboard, Sensor, default_cameras
from simulators.optics.lens import WALL, Distortion, Intrinsics, Lens, Pose, meet

LEFT, RIGHT = default_cameras()
PINHOLE = Camera(LEFT.pose, distortion=Distortion(0, 0, 0, 0))
ANGLES = st.floats(-0.4, 0.4)


def centroid(image, near, half=8):
    """Centre and sum of what is brighter than the rim of a window."""
    column, row = np.rint(near).astype(int)
    part = image[row - half : row + half + 1, column - half : column + half + 1].astype(float)
    part -= np.mean([part[0], part[-1], part[:, 0], part[:, -1]])
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    return np.array([(part * x).sum(), (part * y).sum()]) / part.sum() + (column, row), part.sum()


@given(x=st.floats(-1.2, 1.2), y=st.floats(-0.9, 0.9))
def test_a_pixel_s_ray_meets_the_point_that_it_shows(x, y):
    for camera in (LEFT, RIGHT):
        pixel = camera.lens.project(np.array([x, y, 0.0]))
        assert meet(camera.pose.position_m, camera.lens.rays(pixel), WALL)[0] == pytest.approx(
            [x, y], abs=1e-9
        )


@given(k1=st.floats(-0.2, 0.2), k2=st.floats(-0.1, 0.1), p1=st.floats(-1e-3, 1e-3), x=ANGLES, y=ANGLES)
def test_undistorting_is_the_inverse_of_distorting(k1, k2, p1, x, y):
    distortion = Distortion(k1, k2, p1, -p1, 0.01)
    ideal = np.array([[x, y]])
    assert distortion.undistort(distortion.distort(ideal)) == pytest.approx(ideal, abs=1e-12)


def test_a_pinhole_keeps_straight_lines_and_barrel_distortion_bends_them_outwards():
    line_m = np.column_stack([np.linspace(-1, 1, 21), np.full(21, 0.8), np.zeros(21)])
    pose = Pose.looking_at((0.0, 0.0, 2.5), (0.0, 0.0, 0.0))
    pinhole = Lens(pose, Intrinsics(), Distortion(0, 0, 0, 0)).project(line_m)
    assert np.ptp(pinhole[:, 1]) < 1e-9
    assert pinhole[:, 0] == pytest.approx(639.5 + 1100 * line_m[:, 0] / 2.5)
    assert pinhole[0, 1] == pytest.approx(479.5 - 1100 * 0.8 / 2.5)  # up on the wall is up in the image
    barrel = Lens(pose, Intrinsics(), Distortion(-0.1, 0, 0, 0)).project(line_m)
    assert barrel[10, 1] < barrel[0, 1] - 1


def test_one_who_looks_the_other_way_sees_nothing_of_the_wall():
    away = Lens(Pose.looking_at((0.0, 0.0, 2.5), (0.0, 0.0, 5.0)), Intrinsics(), Distortion())
    assert np.isnan(away.project(np.zeros(3))).all()
    assert np.isnan(meet(away.pose.position_m, away.rays(np.array([[600.0, 400.0]])), WALL)).all()
    with pytest.raises(ValueError, match="no upward direction"):
        Pose.looking_at((0.0, 0.0, 0.0), (0.0, 2.0, 0.0))


@pytest.mark.parametrize("camera", [LEFT, RIGHT], ids=["left", "right"])
@pytest.mark.parametrize("spot", [(0.0, 0.0, 0.0), (0.88, 0.6, 0.0), (-0.85, -0.63, 0.0)])
def test_the_spot_s_centroid_is_its_projection(camera, spot):
    """Mean of 8 pictures within 5 standard errors; one picture is good to some hundredths of a pixel."""
    rng = np.random.default_rng(1)
    pixel = camera.lens.project(np.array(spot))[0]
    found = [centroid(camera.image_of_spot(spot, 1.0, rng), pixel) for _ in range(8)]
    centres = np.array([centre for centre, _ in found])
    assert (centres.std(axis=0) < 0.1).all()
    # 2e-3 pixel for what the window cuts off
    assert np.abs(centres.mean(axis=0) - pixel) == pytest.approx(0, abs=5 * centres.std() / np.sqrt(8) + 2e-3)
    light = np.mean([sum_ for _, sum_ in found]) * camera.sensor.e_per_count
    # noise of 17 x 17 pixels with 40 electrons each, and of the rim's mean: 1600 of 60 000 a picture
    assert light == pytest.approx(camera.sensor.spot_e, rel=5 * 0.027 / np.sqrt(8))


def test_two_cameras_find_the_spot_in_space():
    """Where the rays of both centroids pass each other: within a millimetre of the wall and of the spot."""
    spot, rng = np.array([0.41, -0.27, 0.0]), np.random.default_rng(2)
    rays = []
    for camera in (LEFT, RIGHT):
        centre, _ = centroid(camera.image_of_spot(tuple(spot), 1.0, rng), camera.lens.project(spot)[0])
        rays.append((camera.pose.position_m, camera.lens.rays(centre)[0]))
    (a, u), (b, v) = rays
    lengths, *_ = np.linalg.lstsq(np.column_stack([u, -v]), b - a, rcond=None)
    middle = (a + lengths[0] * u + b + lengths[1] * v) / 2
    assert middle == pytest.approx(spot, abs=1e-3)


def test_noise_has_the_variance_of_electrons_and_of_reading():
    sensor = Sensor(white_e=2000.0, read_e=12.0, e_per_count=4.0)
    camera = Camera(LEFT.pose, sensor=sensor, wall_m=(9.0, 9.0))
    part = camera.image_of_spot((0, 0, 0), 0.0, np.random.default_rng(3))[400:600, 500:800].astype(float)
    variance = (2000 + 12**2) / 16 + 1 / 12  # rounding to whole counts
    assert part.mean() == pytest.approx(64 + 500, abs=5 * np.sqrt(variance / part.size))
    assert part.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / part.size))


def test_a_bright_spot_fills_its_pixels_and_no_more():
    camera = Camera(LEFT.pose, sensor=Sensor(spot_e=1e7))
    image = camera.image_of_spot((0.0, 0.0, 0.0), 1.0, np.random.default_rng(0))
    assert image.dtype == np.uint16
    assert image.shape == (960, 1280)
    assert image.max() == 4095


@pytest.mark.parametrize("spot", [(50.0, 0.0, 0.0), (-50.0, 0.0, 0.0), (0.0, 60.0, 0.0), (0.0, -60.0, 0.0)])
def test_a_spot_out_of_sight_changes_nothing(spot):
    lit, dark = (PINHOLE.image_of_spot(spot, p, np.random.default_rng(0)) for p in (1.0, 0.0))
    assert np.array_equal(lit, dark)


def test_a_camera_sees_where_the_mirror_really_points_and_whether_light_comes():
    bench, rng = Bench(), np.random.default_rng(4)

    def brightest():
        image = LEFT.image(bench, rng)
        row, column = np.unravel_index(image.argmax(), image.shape)
        return np.array([column, row]), int(image.max())

    bench.steer(0.1, 0.1)
    bench.clock.sleep(0.1)
    dark = brightest()[1]
    bench.change_light(emitting=True)
    at, bright = brightest()
    assert bright > 3 * dark
    spot = bench.geometry.laser_spot_m((0.1, 0.1))
    assert at == pytest.approx(LEFT.lens.project(np.array(spot))[0], abs=1)
    bench.steer(-0.1, -0.05)
    bench.clock.sleep(0.5e-3)  # on its way
    middle, _ = brightest()
    true = bench.geometry.laser_spot_m(bench.position_rad)
    assert middle == pytest.approx(LEFT.lens.project(np.array(true))[0], abs=1)
    bench.clock.sleep(0.1)
    end, _ = brightest()
    assert np.linalg.norm(middle - at) > 10
    assert np.linalg.norm(middle - end) > 10


def test_a_checkerboard_s_corners_are_where_their_projections_are():
    """Around each inner corner fields alternate, and most so within a pixel of the projection."""
    turn = 0.3
    axes = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    board = Checkerboard(Pose(axes, np.array([-0.3, -0.2, 0.3])))
    image = LEFT.image_of_board(board, np.random.default_rng(5)).astype(float)
    corners = LEFT.lens.project(board.corners_m)
    assert len(corners) == 54
    shifts = [(dx, dy) for dx in range(-3, 4) for dy in range(-3, 4)]

    def alternates(column, row):
        """Mean of two opposite quadrants of 8 x 8 pixels less that of the other two."""
        left, right = slice(column - 8, column), slice(column + 1, column + 9)
        above, below = slice(row - 8, row), slice(row + 1, row + 9)
        same = image[above, left].mean() + image[below, right].mean()
        return same - image[above, right].mean() - image[below, left].mean()

    signs = []
    for column, row in np.rint(corners).astype(int):
        found = [alternates(column + dx, row + dy) for dx, dy in shifts]
        best = int(np.abs(found).argmax())
        assert max(map(abs, shifts[best])) <= 1
        assert abs(found[best]) > 0.9 * 2 * 0.8 * 375  # white less black, twice; 375 counts are white
        signs.append(np.sign(found[best]))
    signs = np.reshape(signs, (6, 9))
    assert (signs[:, 1:] == -signs[:, :-1]).all()
    assert (signs[1:] == -signs[:-1]).all()
