"""The fits of the mirror's calibration: drawn data in, the bench's truth out, with honest errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rig.bench.simulated import true_geometry
from rig.calibrate.galvo.cameras import CalibratedCameras, CameraModel, board_points_m, calibrate_cameras
from rig.calibrate.galvo.mirror import (
    AIMED_TO_M,
    fit_flight,
    fit_mirror,
    numbers_covariance,
    spot_covariances_m2,
)
from rig.calibrate.galvo.routine import mirror_angles_rad
from rig.calibrate.galvo.spots import background, find_spot
from rig.calibrate.galvo.triangulation import locate, plane_of, triangulate
from rig.calibrate.geometry_fit import Arrivals, Spots
from rig.errors import CalibrationError
from rig.model.config import built_in_with
from rig.model.devices import Board
from rig.model.state import RigState
from simulators.detector.first_bounce import direct_s
from simulators.optics.cameras import Checkerboard, default_cameras
from simulators.optics.lens import Pose
from support.misaligned import misaligned, true_spots_m
from support.thorough import THOROUGH, some

SIZE = (1280, 960)


def as_model(camera):
    """The bench's camera in the calibration's terms."""
    i, d, pose = camera.intrinsics, camera.distortion, camera.pose
    matrix = np.array([[i.fx, 0, i.cx], [0, i.fy, i.cy], [0, 0, 1]])
    turn = Rotation.from_matrix(pose.rotation)
    return CameraModel.of(matrix, [d.k1, d.k2, d.p1, d.p2], turn, -pose.rotation @ pose.position_m)


CAMERAS = default_cameras()
MODELS = tuple(map(as_model, CAMERAS))


def test_the_calibration_s_lens_is_the_bench_s():
    points = np.random.default_rng(0).uniform((-1, -0.7, 0), (1, 0.7, 0.8), (50, 3))
    for model, camera in zip(MODELS, CAMERAS, strict=True):
        assert model.project(points) == pytest.approx(camera.lens.project(points), abs=1e-9)
        pixels = model.project(points)
        rays = np.pad(model.ideal(pixels), ((0, 0), (0, 1)), constant_values=1) @ model.pose[:, :3]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        assert rays == pytest.approx(camera.lens.rays(pixels), abs=1e-9)


# ---------------------------------------------------------------- the mirror from spots


def fitted_to_spots(config, rng):
    """Fit to spots good to 0.3 mm; return the fit, and errors with their pulls at other angles."""
    angles = np.array(mirror_angles_rad(config, 7, 5))
    seen = true_spots_m(config, angles) + 0.3e-3 * rng.standard_normal((35, 2))
    fit = fit_mirror(Spots(angles, seen, 0.3e-3**2 * np.eye(70)), config)
    others = 0.9 * np.array(mirror_angles_rad(config, 4, 3))
    off = fit.rig.pointing.spots_m(others)[:, :2] - true_spots_m(config, others)
    spread = spot_covariances_m2(fit.rig.pointing, numbers_covariance(fit), others)
    return fit, np.linalg.norm(off, axis=1), off / np.sqrt(np.einsum("nii->ni", spread))


@pytest.mark.parametrize(
    ("mirrors", "incidence"), some((2, None), (1, "22.5deg"), (1, None), (1, "45deg"), short=2)
)
def test_the_mirror_s_model_finds_the_truth_with_honest_errors(mirrors, incidence):
    """Many rigs, spots good to 0.3 mm: predicted spots within 1 mm, and pulls of about unit width."""
    rng = np.random.default_rng(1)
    pulls, errors = [], []
    for _ in range(20 if THOROUGH else 8):
        config = misaligned(signs=rng.choice([-1, 1], 16), mirrors=mirrors, incidence=incidence)
        _, off_m, pull = fitted_to_spots(config, rng)
        errors.append(off_m)
        pulls.append(pull)
    assert np.max(errors) < 1e-3
    # the spots of one rig share some 8 numbers: 64 independent ones of 8 rigs, so the width is good to 9 %
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(("angle", "direction"), [(22.5, 0.0), (45.0, 130.0)])
def test_an_incidence_that_nobody_configured_is_found(angle, direction):
    """Spots good to 0.3 mm tell it to 0.1 degrees or better, whatever was expected."""
    wrong = {"mirror_incidence": [f"{angle}deg", f"{direction}deg"]}
    galvo = {"max_angle_x": "35deg", "max_angle_y": "35deg"}
    config = built_in_with({"simulation": {"misalignment": wrong}, "galvo": galvo})
    fit, off_m, _ = fitted_to_spots(config, np.random.default_rng(13))
    assert off_m.max() < 1e-3
    phase = np.radians(direction)
    expected = angle * np.cos(phase), angle * np.sin(phase)
    assert np.degrees(fit.rig.pointing.incidence_rad) == pytest.approx(expected, abs=0.3)


def test_spots_are_measured_over_the_whole_scan_whatever_the_incidence():
    """The commands as configured cover 15 cm more than the scan, also where its outline bends."""
    limits = {"max_angle_x": "40deg", "max_angle_y": "40deg"}
    galvo = {"incidence": "45deg", "incidence_direction": "45deg", **limits}
    config = built_in_with({"galvo": galvo})
    spots_m = RigState(config).pointing.spots_m(mirror_angles_rad(config, 5, 3))
    x_m, y_m = np.meshgrid(np.linspace(-1.045, 1.045, 5), np.linspace(-0.795, 0.795, 3))
    x_m[1] = x_m[1, ::-1]  # there and back
    np.testing.assert_allclose(spots_m[:, :2], np.stack([x_m.ravel(), y_m.ravel()], axis=1), atol=1e-12)


def test_a_covariance_from_before_the_incidence_is_still_read():
    """(10, 10), without the two numbers: the same as with them at no error."""
    pointing = RigState(misaligned()).pointing
    angles, old = np.array([[0.1, -0.2], [0.3, 0.1]]), np.diag(np.linspace(1e-7, 1e-6, 10))
    whole = np.zeros((12, 12))
    whole[:10, :10] = old
    np.testing.assert_allclose(
        spot_covariances_m2(pointing, old, angles), spot_covariances_m2(pointing, whole, angles), rtol=1e-12
    )


def test_spots_that_no_mirror_makes_are_refused():
    config = misaligned()
    angles = np.array(mirror_angles_rad(config, 7, 5))
    seen = true_spots_m(config, angles)
    seen[::2, 0] += 0.02
    with pytest.raises(CalibrationError, match="from all places that the configured mirror can reach"):
        fit_mirror(Spots(angles, seen, 1e-3**2 * np.eye(70)), config)


# ---------------------------------------------------------------- the mirror from times of flight


def flight_data(config, rng):
    angles = np.array(mirror_angles_rad(config, 6, 5))
    geometry = true_geometry(config)
    arrival_s = np.array([direct_s((x, y, 0.0), geometry) for x, y in true_spots_m(config, angles)])
    steered = np.array([[0, 0], [-0.35, -0.25], [0.35, -0.25], [0.35, 0.25], [-0.35, 0.25]])
    marks_m = true_spots_m(config, steered) + 0.3e-3 * rng.standard_normal((5, 2))
    return angles, arrival_s + 1e-12 * rng.standard_normal(len(angles)), Spots(steered, marks_m, AIMED_TO_M)


@pytest.mark.parametrize("incidence", some("22.5deg", None, "45deg", short=1))
def test_times_of_flight_and_marks_find_the_truth_with_honest_errors(incidence):
    """Many rigs: within 5 mm everywhere, pulls of about unit width."""
    rng = np.random.default_rng(2)
    pulls, errors = [], []
    for _ in range(20 if THOROUGH else 8):
        config = misaligned(signs=rng.choice([-1, 1], 16), incidence=incidence)
        angles, arrival_s, marks = flight_data(config, rng)
        fit = fit_flight(Arrivals(angles, arrival_s, np.full(len(angles), 1e-13)), marks, config)
        off = fit.rig.pointing.spots_m(angles)[:, :2] - true_spots_m(config, angles)
        errors.append(np.linalg.norm(off, axis=1))
        spread = spot_covariances_m2(fit.rig.pointing, numbers_covariance(fit), angles)
        pulls.append(off / np.sqrt(np.einsum("nii->ni", spread)))
    assert np.max(errors) < 5e-3
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)


def test_flight_refuses_too_little_and_what_does_not_fit():
    config, rng = misaligned(), np.random.default_rng(3)
    angles, arrival_s, marks = flight_data(config, rng)
    arrivals, place_m, steered = (
        Arrivals(angles, arrival_s, np.full(len(angles), 1e-12)),
        marks.spot_m,
        marks.mirror_rad,
    )
    few = Arrivals(angles[:5], arrival_s[:5], arrivals.error_s[:5])
    for data, steered_to, reason in (
        (few, marks, "arrivals are too few"),
        (arrivals, Spots(steered[:3], place_m[:3], AIMED_TO_M), "3 marks are too few"),
        (arrivals, Spots(steered, place_m * (1, 0.01), AIMED_TO_M), "nearly on one line"),
        (arrivals, Spots(steered, place_m[[0, 2, 1, 3, 4]], AIMED_TO_M), "the configured rig does not fit"),
    ):
        with pytest.raises(CalibrationError, match=reason):
            fit_flight(data, steered_to, config)


# ---------------------------------------------------------------- boards


def seen_boards(rng, boards=9, marks=2, noise_px=0.06):
    board, marks_m, seen = Board(), np.array([(-0.6, -0.2), (0.0, -0.2)])[:marks], []
    for number in range(boards):
        turn, corner_m = np.eye(3), np.zeros(3)
        if number < marks:
            corner_m[:2] = marks_m[number]
        else:
            turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
            corner_m = rng.uniform((-0.8, -0.5, 0.3), (0.2, 0.1, 0.8))
        points_m = Checkerboard(Pose(turn.T, corner_m)).corners_m.reshape(6, 9, 3)
        seen.append([model.project(points_m) + noise_px * rng.standard_normal((6, 9, 2)) for model in MODELS])
    return seen, board, marks_m


def test_cameras_are_where_they_are():
    """Pulls of all 28 numbers; they hang together, so that their mean square is only good to a half or so."""
    seen, board, marks_m = seen_boards(np.random.default_rng(4))
    found = calibrate_cameras(seen, board, marks_m, 1e-5, SIZE)
    apart = np.concatenate([a.numbers - b.numbers for a, b in zip(found.cameras, MODELS, strict=True)])
    assert found.corners_px == pytest.approx(0.06 * np.sqrt(2), rel=0.1)
    chi2 = apart @ np.linalg.solve(found.covariance, apart)
    assert 10 < chi2 < 56  # 28 expected, 3.7 standard deviations either way
    for camera, model in zip(found.cameras, MODELS, strict=True):
        assert camera.position_m == pytest.approx(model.position_m, abs=5e-3)


def test_one_wrong_corner_does_no_harm_and_a_moved_board_is_refused():
    seen, board, marks_m = seen_boards(np.random.default_rng(5))
    seen[3][0][2, 2] += 9.0
    assert calibrate_cameras(seen, board, marks_m, 1e-5, SIZE).corners_px < 0.1
    for pair in seen[2:]:
        pair[1] = pair[1] + np.random.default_rng(6).uniform(3, 30, 2)
    with pytest.raises(CalibrationError, match="was a board moved"):
        calibrate_cameras(seen, board, marks_m, 1e-5, SIZE)


def test_boards_that_are_not_seen_are_refused():
    seen, board, marks_m = seen_boards(np.random.default_rng(7))
    few = seen[:2] + [[None, right] for _, right in seen[2:]]
    with pytest.raises(CalibrationError, match="camera 1 sees the whole board in 2 of 9"):
        calibrate_cameras(few, board, marks_m, 1e-5, SIZE)
    seen[1][1] = None
    with pytest.raises(CalibrationError, match="camera 2 does not see the whole board on the wall"):
        calibrate_cameras(seen, board, marks_m, 1e-5, SIZE)


def test_the_board_s_points_run_along_columns_first():
    assert board_points_m(Board())[1, 2] == pytest.approx((0.16, 0.08, 0.0))


# ---------------------------------------------------------------- spots


def picture(rng, spots=((60.3, 41.8),), light=15_000.0, full=4095):
    y, x = np.mgrid[:90, :120]
    mean = np.full((90, 120), 375.0) + 300 * (x > 60)
    for column, row in spots:
        mean += light / (2 * np.pi) * np.exp(-((x - column) ** 2 + (y - row) ** 2) / 2)
    return np.clip(np.rint(mean + 64 + np.sqrt(mean / 4 + 9) * rng.standard_normal(mean.shape)), 0, full)


@pytest.fixture(scope="module")
def dark():
    rng = np.random.default_rng(8)
    return background(np.stack([picture(rng, spots=()) for _ in range(8)]), 4095)


def test_the_noise_is_learnt_from_dark_pictures(dark):
    assert dark.counts_per_count == pytest.approx(0.25, rel=0.1)


def test_spots_are_found_as_well_as_said(dark):
    rng = np.random.default_rng(9)
    truth = rng.uniform((20, 20), (100, 70), (60, 2))
    found = [find_spot(picture(rng, [tuple(at)]), dark, "here") for at in truth]
    pulls = [np.linalg.solve(np.linalg.cholesky(s.covariance), s.centre - at)
             for s, at in zip(found, truth, strict=True)]  # fmt: skip
    assert np.max([np.linalg.norm(s.centre - at) for s, at in zip(found, truth, strict=True)]) < 0.1
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)  # 120 pulls: 6.5 %


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"spots": ()}, "here: no spot is seen"),
        ({"spots": ((30, 40), (80, 60))}, "here: two spots are seen"),
        ({"spots": ((4, 40),)}, "here: the spot is at the image's edge"),
        ({"light": 60_000.0}, "here: the spot is saturated"),
    ],
)
def test_bad_spots_are_refused_with_the_reason(dark, changes, reason):
    with pytest.raises(CalibrationError, match=reason):
        find_spot(picture(np.random.default_rng(10), **changes), dark, "here")


# ---------------------------------------------------------------- triangulation


def pixels_of(points_m, rng, models=MODELS):
    pixels = np.stack([model.project(points_m) for model in models], axis=1)
    covariances = np.broadcast_to(0.01**2 * np.eye(2), (*pixels.shape, 2))
    return pixels + 0.01 * rng.standard_normal(pixels.shape), covariances


def known(models=MODELS):
    return CalibratedCameras(models, 1e-16 * np.eye(28), 0.1)


def wall_points(rng, number=40):
    return np.column_stack([rng.uniform((-0.9, -0.6), (0.9, 0.6), (number, 2)), np.zeros(number)])


def test_spots_are_located_on_the_wall_and_strays_are_left_out():
    rng = np.random.default_rng(11)
    points_m = wall_points(rng)
    points_m[5, 2], points_m[9, 2] = 0.2, 0.4
    spots_m, _, on_wall = locate(known(), *pixels_of(points_m, rng))
    assert np.flatnonzero(~on_wall).tolist() == [5, 9]
    # 0.01 pixels are 25 um on the wall; the plane's tilt is good to some 10 urad
    assert spots_m == pytest.approx(points_m[on_wall, :2], abs=2e-4)


def test_a_tilted_board_s_frame_gives_way_to_the_wall():
    """Cameras that think the wall is tilted by 2 degrees: distances on it stay what they are."""
    rng, turn = np.random.default_rng(12), Rotation.from_rotvec([0.02, -0.03, 0])
    points_m = wall_points(rng)
    seen = pixels_of(turn.apply(points_m), rng)
    wall = plane_of(*triangulate(MODELS, *seen)[:2])
    assert np.arccos(wall.axes[2, 2]) == pytest.approx(np.hypot(0.02, 0.03), rel=0.01)
    spots_m, _, _ = locate(known(), *seen)
    apart = np.linalg.norm(spots_m - spots_m[0], axis=1)
    assert apart == pytest.approx(np.linalg.norm(points_m - points_m[0], axis=1), abs=3e-4)


def test_too_few_edge_on_and_contradicting_are_refused():
    rng = np.random.default_rng(13)
    points_m = wall_points(rng)
    with pytest.raises(CalibrationError, match="5 spots are too few"):
        locate(known(), *pixels_of(points_m[:5], rng))
    pixels, covariances = pixels_of(points_m, rng)
    with pytest.raises(CalibrationError, match="the two cameras contradict each other"):
        locate(known(), pixels + np.array([[0, 0], [0, 20]]), covariances)
    low = Pose.looking_at((2.6, 0.4, 0.3), (0.0, 0.0, 0.0))
    turn, shift = Rotation.from_matrix(low.rotation), -low.rotation @ low.position_m
    edge_on = CameraModel(np.concatenate([turn.as_rotvec(), shift, MODELS[1].numbers[6:]]))
    models = (MODELS[0], edge_on)
    with pytest.raises(CalibrationError, match="camera 2 sees the wall nearly edge-on"):
        locate(known(models), *pixels_of(points_m, rng, models))
    points_m[::2, 2] = rng.uniform(0.1, 0.6, 20)
    with pytest.raises(CalibrationError, match="of 40 spots lie on one plane"):
        locate(known(), *pixels_of(points_m, rng))
