"""What distinguishes the cameras, and that one more is a few lines which no solver knows of."""

import re
from dataclasses import replace

import numpy as np
import pytest

from recon.camera import Camera, ConfocalCamera, PhotoCamera, TransientCamera
from recon.capture import ArrayHistograms, Capture
from recon.errors import GeometryError, MemoryBoundError, ParameterError, ReconError
from recon.filming import frame_times_s, video
from recon.grid import VoxelGrid
from recon.imaging import bounded, image, plan, planes
from recon.registry import WAVE_SOLVERS
from recon.wave import ContinuousWave, VirtualPulse
from recon.window import Window
from support.hidden_points import C, histograms, wall

PULSE = VirtualPulse(0.06)
LASER = wall(24, 20, 0.02)
DETECTOR = np.array([-0.04, 0.03, 0.0])
BIN = 8e-12
POINT = np.array([0.05, -0.03, 0.6])
GRID = VoxelGrid(0.02 * np.arange(-5, 6) + 0.01, 0.02 * np.arange(-5, 6) + 0.01, np.array([0.55, 0.6, 0.65]))


def captured(counts, detector_m=DETECTOR, first_bin_s=0.0):
    return Capture(ArrayHistograms(counts), BIN, np.array([first_bin_s]), LASER, np.atleast_2d(detector_m))


def by_way_of(path, strength):
    """Counts of light p -> path[0] -> path[1] ... -> DETECTOR: a point at path[0] that is lit later."""
    detour_m = sum(np.linalg.norm(a - b) for a, b in zip(path, [*path[1:], DETECTOR], strict=True))
    r_p = np.linalg.norm(LASER - path[0], axis=1)
    counts = np.zeros((len(LASER), 2000), np.float32)
    at = (r_p + detour_m) / C / BIN - 0.5
    n = np.floor(at).astype(int)
    rows = np.arange(len(LASER))
    counts[rows, n], counts[rows, n + 1] = strength * (n + 1 - at), strength * (at - n)
    return counts


class DelayedCamera(ConfocalCamera):
    """Sees what is read some time after the flash reached it."""

    name = "delayed"

    def __init__(self, delay_s):
        self.delay_s = delay_s

    def reading_times_s(self, plane):
        return super().reading_times_s(plane) + self.delay_s


class ApodisedCamera(ConfocalCamera):
    """Sees less of the aperture's edge."""

    name = "apodised"

    def aperture_weights(self, laser_m):
        return np.exp(-(laser_m[:, :2] ** 2).sum(axis=1) / 0.15**2)


@pytest.mark.parametrize("solver", WAVE_SOLVERS)
@pytest.mark.parametrize("confocal", [False, True])
def test_a_new_camera_needs_no_change_of_a_solver(solver, confocal):
    delay_s = 3e-9
    spots = LASER if confocal else DETECTOR
    counts = histograms(POINT, LASER, spots, 2000, BIN, falloff=False)
    late = np.roll(counts, round(delay_s / BIN), axis=1)
    now = image(captured(counts, spots), PULSE, GRID, solver=solver).field
    then = image(captured(late, spots), PULSE, GRID, solver=solver, camera=DelayedCamera(delay_s)).field
    # Both sums are the same but for other frequencies: the band is cut at 3 sigma, 0.27 %, sampled elsewhere.
    assert np.abs(then - now).max() < 1e-2 * np.abs(now).max()


@pytest.mark.parametrize("solver", WAVE_SOLVERS)
def test_apodisation_is_a_weight_of_each_position(solver):
    counts = histograms(POINT, LASER, DETECTOR, 2000, BIN, falloff=False)
    camera = ApodisedCamera()
    weighted = counts * camera.aperture_weights(LASER)[:, None].astype(np.float32)
    field = image(captured(counts), PULSE, GRID, solver=solver, camera=camera).field
    wanted = image(captured(weighted), PULSE, GRID, solver=solver).field
    assert np.abs(field - wanted).max() < 1e-5 * np.abs(wanted).max()  # single precision


def test_the_reading_may_be_any_function_of_place_and_moment():
    class Warped(Camera):
        """Reads every voxel at two moments of its own."""

        name = "warped"

        def reading_times_s(self, plane):
            x_m, y_m = plane.x_m, plane.y_m
            return np.stack([2.0e-9 + x_m / C + 0 * y_m, 2.2e-9 + y_m * x_m / C])

    capture = captured(histograms(POINT, LASER, DETECTOR, 2000, BIN))
    frames = {}
    for solver in ("rsd", "direct", "backprojection"):
        frames[solver] = np.stack(list(planes(plan(capture, PULSE, GRID, Warped(), Window()), solver)))
        assert frames[solver].shape == (3, 2, 11, 11)
    scale = np.abs(frames["direct"]).max()
    assert np.abs(frames["rsd"] - frames["direct"]).max() < 1e-3 * scale
    assert np.abs(frames["backprojection"] - frames["direct"]).max() < 1e-2 * scale
    with pytest.raises(ParameterError, match=r"warped camera: .* 2 frames"):
        image(capture, PULSE, GRID, camera=Warped())


def test_the_photo_camera_knows_neither_the_lamp_nor_its_clock():
    counts = histograms(POINT, LASER, DETECTOR, 2000, BIN)
    seen = [
        image(capture, PULSE, GRID, camera=PhotoCamera()).intensity
        for capture in (
            captured(counts),
            captured(counts, DETECTOR + 0.3),
            captured(counts, first_bin_s=5e-9),
        )
    ]
    for other in seen[1:]:
        np.testing.assert_allclose(other, seen[0], atol=1e-5 * seen[0].max())


def test_the_photo_camera_focuses_by_choice_of_the_plane():
    near, far = np.array([-0.11, 0.01, 0.4]), np.array([0.11, 0.01, 1.2])
    counts = sum(histograms(point, LASER, DETECTOR, 2000, BIN, falloff=False) for point in (near, far))
    x_m = 0.02 * np.arange(-10, 11) + 0.01
    grid = VoxelGrid(x_m, x_m, np.array([0.4, 1.2]))
    intensity = image(captured(counts), VirtualPulse(0.04), grid, camera=PhotoCamera()).intensity
    for plane, point in enumerate((near, far)):
        j, i = np.unravel_index(intensity[plane].argmax(), intensity[plane].shape)
        assert (x_m[i], x_m[j]) == pytest.approx(point[:2], abs=1e-9)


@pytest.mark.parametrize("solver", ["rsd", "backprojection"])
def test_light_by_way_of_another_surface_is_seen_there_and_later(solver):
    first, second = np.array([-0.11, 0.05, 0.6]), np.array([0.13, -0.05, 0.6])
    counts = by_way_of([first], 100) + by_way_of([second], 100) + by_way_of([first, second], 100)
    grid = VoxelGrid(0.02 * np.arange(-9, 10) + 0.01, 0.02 * np.arange(-5, 6) + 0.01, np.array([0.6]))
    times_s = np.arange(1.5e-9, 4.5e-9, 0.05e-9)
    film = video(captured(counts), PULSE, grid, TransientCamera(times_s), solver=solver)
    assert film.intensity.shape == (len(times_s), 11, 19)

    def brightest(point):
        i, j = (np.abs(axis - at).argmin() for axis, at in zip((grid.x_m, grid.y_m), point[:2], strict=True))
        at_point = film.intensity[:, j, i]
        peaks = (at_point[1:-1] > at_point[:-2]) & (at_point[1:-1] >= at_point[2:])
        return times_s[1:-1][peaks & (at_point[1:-1] > 0.4 * at_point.max())]

    third = [np.linalg.norm(point - DETECTOR) / C for point in (first, second)]
    fourth = third[1] + np.linalg.norm(first - second) / C  # the flash lights `second`, which lights `first`
    # Half a frame, and as much again for what the other flashes' skirts pull.
    np.testing.assert_allclose(brightest(first), [third[0], fourth], atol=0.05e-9)
    np.testing.assert_allclose(brightest(second), [third[1]], atol=0.05e-9)


def test_planes_go_to_the_sink_and_make_the_video():
    capture = captured(histograms(POINT, LASER, DETECTOR, 2000, BIN))
    planes = {}
    camera = TransientCamera(np.linspace(1e-9, 4e-9, 13))
    for over in ("max", "sum"):
        film = video(capture, PULSE, GRID, camera, over=over, sink=planes.__setitem__)
        assert list(planes) == [0, 1, 2]
        together = getattr(np.stack(list(planes.values())), over)(axis=0)
        np.testing.assert_allclose(film.intensity, together, rtol=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("solver", ["rsd", "direct"])
def test_a_film_too_bright_for_single_precision_is_refused(solver):
    """A power of two changes no digit, until the intensity itself is too large; then no plane is written."""
    counts = histograms(POINT, LASER, DETECTOR, 2000, BIN).astype(np.float32)
    camera, kept = TransientCamera(np.array([2e-9, 3e-9])), {}
    usual = video(captured(counts), PULSE, GRID, camera, solver=solver).intensity
    large = video(captured(counts * np.float32(2**40)), PULSE, GRID, camera, solver=solver).intensity
    np.testing.assert_array_equal(large, usual * np.float32(2**80))
    with pytest.raises(ReconError, match=r"square is too large.*divide the counts"):
        video(captured(counts * np.float32(2**65)), PULSE, GRID, camera, solver=solver, sink=kept.__setitem__)
    assert not kept


def test_unasked_frames_begin_before_the_light_and_end_with_the_record():
    capture = captured(histograms(POINT, LASER, DETECTOR, 2000, BIN))
    times_s = frame_times_s(capture, PULSE, GRID)
    nearest_s = 0.55 / C
    assert times_s[0] < nearest_s < times_s[0] + 6 * 0.06 / C
    assert np.linalg.norm(POINT - DETECTOR) / C < times_s[-1] < 2000 * BIN
    np.testing.assert_allclose(frame_times_s(capture, PULSE, GRID, (1e-9, 2e-9, 0.25e-9))[-1], 2e-9)
    with pytest.raises(ParameterError, match="must ascend"):
        frame_times_s(capture, PULSE, GRID, (2e-9, 1e-9, 1e-9))


def test_refusals_say_what_is_wrong():
    with pytest.raises(ParameterError, match="no frames"):
        TransientCamera(np.empty(0))
    with pytest.raises(ParameterError, match="continuous wave"):
        ContinuousWave(-0.04)


@pytest.mark.parametrize("camera", [ConfocalCamera(), PhotoCamera()])
def test_pairs_are_served_by_the_solvers_that_take_them(camera):
    spots = np.random.default_rng(4).permutation(LASER)
    capture = captured(histograms(POINT, LASER, spots, 2000, BIN), spots)
    with pytest.raises(GeometryError, match="480 detector spots"):
        image(capture, PULSE, GRID, solver="fresnel", camera=camera)
    direct = image(capture, PULSE, GRID, solver="direct", camera=camera).field
    _, j, i = np.unravel_index(np.abs(direct).argmax(), direct.shape)
    assert np.all(np.abs([GRID.x_m[i], GRID.y_m[j]] - POINT[:2]) <= 0.01 + 1e-9)
    quick = image(capture, PULSE, GRID, camera=camera).field
    # The table's straight lines are right to 1.2e-4, and its single-precision paths to 1e-4.
    assert np.abs(quick - direct).max() < 1e-3 * np.abs(direct).max()
    if camera.name == "confocal":
        in_time = image(capture, PULSE, GRID, solver="backprojection", camera=camera).field
        assert np.abs(in_time - direct).max() < 1e-2 * np.abs(direct).max()


def test_little_memory_gives_the_same_video():
    capture = captured(histograms(POINT, LASER, DETECTOR, 2000, BIN))
    camera = TransientCamera(np.linspace(1e-9, 4e-9, 13))
    whole = video(capture, PULSE, GRID, camera).intensity
    # a few of the wall's spectra
    problem = replace(plan(capture, PULSE, GRID, camera, Window()), wall_bytes=3 * 8 * 48 * 40)
    with pytest.raises(MemoryBoundError) as refused:
        bounded(problem, "rsd", 1)
    least = int(re.search(r"Allow (\d+) MB", str(refused.value))[1]) * 10**6  # one thread
    little = (np.abs(np.stack(list(planes(bounded(problem, "rsd", least), "rsd")))) ** 2).max(axis=0)
    np.testing.assert_allclose(little, whole, atol=1e-6 * whole.max())


def test_a_surface_picks_one_depth_for_each_pixel():
    capture = captured(histograms(POINT, LASER, DETECTOR, 2000, BIN))
    camera, planes = TransientCamera(np.linspace(1e-9, 4e-9, 5)), []
    surface_m = np.full((11, 11), np.nan)
    surface_m[2, 3], surface_m[4, 5] = 0.56, 0.7
    film = video(
        capture,
        PULSE,
        GRID,
        camera,
        over="surface",
        surface_m=surface_m,
        sink=lambda index, frames: planes.append(frames),
    )
    wanted = np.zeros_like(film.intensity)
    wanted[:, 2, 3], wanted[:, 4, 5] = planes[0][:, 2, 3], planes[2][:, 4, 5]
    np.testing.assert_array_equal(film.intensity, wanted)
    with pytest.raises(ParameterError, match="a surface is used with 'surface' only"):
        video(capture, PULSE, GRID, camera, over="surface")


@pytest.mark.parametrize("solver", ["rsd", "fresnel", "backprojection"])
def test_what_cannot_be_is_refused_before_the_record_is_read(solver):
    class Unread(ArrayHistograms):
        def blocks(self, bins=slice(None)):
            raise AssertionError("read")

    # The rsd solver takes any wall, but a device none that is not flat.
    irregular = LASER + np.random.default_rng(1).uniform(0, 0.01, LASER.shape)
    device = "cuda" if solver == "rsd" else "cpu"
    laser_m, camera = (LASER, PhotoCamera()) if solver == "backprojection" else (irregular, ConfocalCamera())
    capture = Capture(Unread(np.zeros((480, 2000))), BIN, np.zeros(1), laser_m, DETECTOR[None])
    with pytest.raises((GeometryError, ParameterError)):
        image(capture, PULSE, GRID, solver=solver, camera=camera, device=device)
