"""A hidden scene that moves: its photons are those of the scene where it is at that moment."""

from dataclasses import replace
from math import dist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.bench import Bench, BenchGeometry, LightState
from simulators.clock import BenchClock
from simulators.constants import C_M_PER_S
from simulators.detector import Detector
from simulators.motion.path import STEP_M, BackAndForth
from simulators.moving import MovingScenePhotons
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport

FREE = LightState(emitting=True, biased=True)
EXACT = Detector(dark_hz=0, ambient_hz=0, jitter_fwhm_s=0, tail_fraction=0, electronics_fwhm_s=0)
DARK_WALL = Optics(pulse_fwhm_s=0.0, stray_per_pulse=0.0)
SPOT, SEEN = (0.3, -0.2, 0.0), (-0.1, 0.05, 0.0)
MOTION = BackAndForth((0.6, -0.2, 0.1), 2.0)


def moving(name="point", motion=MOTION):
    return MovingScenePhotons(
        Transport.of_scene(scene(name)), motion, None, DARK_WALL, EXACT, detector_spot_m=SEEN
    )


def standing(name, offset_m):
    # the patches are moved: cutting a moved scene halves edges that are equally long in another order
    patches = tessellate(scene(name))
    patches = patches._replace(corners_m=patches.corners_m + offset_m, centre_m=patches.centre_m + offset_m)
    built = Transport(patches, scene(name).moved(offset_m).triangles_m)
    return HiddenScenePhotons(built, None, DARK_WALL, EXACT, detector_spot_m=SEEN)


@given(st.floats(0, 20))
def test_the_way_is_straight_even_and_leads_back(at_s):
    offset_m = np.array(MOTION.offset_m(MOTION.step_at(at_s)))
    part = at_s / 2 % 2
    exact_m = (min(part, 2 - part) - 0.5) * np.array(MOTION.travel_m)
    assert dist(offset_m, exact_m) <= STEP_M / 2 * (1 + 1e-9)


@given(st.floats(0, 5), st.floats(1e-6, 5))
def test_a_time_is_cut_into_pieces_in_which_little_moves(begin_s, duration_s):
    pieces = list(MOTION.pieces(begin_s, duration_s))
    assert sum(part_s for _, part_s in pieces) == pytest.approx(duration_s)
    speed = np.linalg.norm(MOTION.travel_m) / MOTION.duration_s
    assert max(part_s for _, part_s in pieces) * speed <= STEP_M * (1 + 1e-9)


@pytest.mark.parametrize("name", ["letters", "shelf"])  # what hides parts of itself; what is glossy, too
def test_a_moved_scene_sends_the_light_of_one_that_stands_there(name):
    at_s = 0.7
    offset_m = MOTION.offset_m(MOTION.step_at(at_s))
    (moved, _), *_ = moving(name).at(at_s)._lit(0.0)
    (stands, _), *_ = standing(name, offset_m)._lit(0.0)
    light, path_m = moved[0].arrivals(SPOT)
    expected, expected_m = stands[0].arrivals(SPOT)
    # patch by patch the same, but for the rounding of corners that were moved
    np.testing.assert_allclose(path_m, expected_m, atol=1e-9)
    np.testing.assert_allclose(light, expected, rtol=1e-6, atol=1e-9 * expected.max())
    assert moving(name).at(at_s).rate_hz(SPOT, FREE) == pytest.approx(
        standing(name, offset_m).rate_hz(SPOT, FREE), rel=1e-6
    )


def test_a_long_exposure_sees_the_whole_way():
    photons = moving(motion=BackAndForth((0.6, 0.0, 0.0), 1.0))
    bright = replace(FREE, power=100.0)
    times_s = photons.at(0.0).detections(SPOT, bright, 1.0, np.random.default_rng(1)).time_s
    outside_s = photons._outside_s(SPOT)
    path_m = (times_s - outside_s) % 1e-7 * C_M_PER_S
    ends = [dist(SPOT, (x, 0, 1)) + dist((x, 0, 1), SEEN) for x in (-0.3, 0.3, 0.1)]
    # the patch is 2 cm wide; the nearest place is where the sum of both distances is least, near x = 0.1
    assert path_m.min() == pytest.approx(min(ends), abs=0.01)
    assert path_m.max() == pytest.approx(max(ends), abs=0.02)


def test_the_bench_draws_the_scene_as_it_is_at_that_time():
    geometry = BenchGeometry()
    photons = MovingScenePhotons(
        Transport.of_scene(scene("point")), MOTION, geometry, DARK_WALL, EXACT, detector_spot_m=SEEN
    )
    bench = Bench([photons], geometry, clock=BenchClock())
    bench.change_light(emitting=True, biased=True)
    spot = geometry.laser_spot_m(bench.mirror.position(0.0))
    for at_s in (0.0, 0.5, 1.7, 2.6, 4.3):
        bench.clock.sleep(at_s + 0.02 - bench.clock.now_s())
        (seen,) = bench.detections(at_s, at_s + 0.02)
        hidden_m = np.add((0.0, 0.0, 1.0), MOTION.offset_m(MOTION.step_at(at_s + 0.01)))
        outside_s = photons._outside_s(spot)
        path_m = (np.median(seen.time_s) - outside_s) % 1e-7 * C_M_PER_S
        # a patch of 2 cm seen at a slant, and 6 mm of motion in the exposure
        assert path_m == pytest.approx(dist(spot, hidden_m) + dist(hidden_m, SEEN), abs=0.01)


def test_a_bench_that_goes_on_draws_other_photons():
    benches = [Bench([moving()], clock=BenchClock(begin_s=begin_s)) for begin_s in (0.0, 0.0, 3.0)]
    seen = []
    for bench in benches:
        bench.change_light(emitting=True, biased=True)
        now_s = bench.clock.now_s()
        bench.clock.sleep(0.5)
        seen.append(bench.detections(now_s, now_s + 0.5)[0].time_s)
    assert np.array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[0][:10], seen[2][:10])
