"""Light of a moving mirror: each photon leaves the wall where the mirror points when its pulse leaves.

What is drawn along a way is held against mirrors that stand at many places of it.
"""

from itertools import pairwise
from math import dist

import numpy as np
import pytest

from simulators.bench import Bench, BenchGeometry, LightState
from simulators.constants import C_M_PER_S
from simulators.detector import Afterpulsing, Detector, Ringing
from simulators.detector.first_bounce import FirstBounce
from simulators.motion.mount import MirrorMount, rotated
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.track import KNOT_M, Track
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport

BRIGHT = Optics(stray_per_pulse=0, pulse_fwhm_s=0, power_w=50.0)
EXACT = Detector(dark_hz=0, ambient_hz=0, jitter_fwhm_s=0, tail_fraction=0, electronics_fwhm_s=0)
QUIET = Detector(dark_hz=0, ambient_hz=0)
PERIOD_S = 100e-9

#: Lines of points 1 cm apart, a millisecond each, with a jump back over 60 cm between two lines.
TICKS = np.array([(-0.14 + 0.004 * (k % 60), 0.1 - 0.004 * (k // 60)) for k in range(120)])


class OneMirror:
    """All light comes from one place, as in a mirror, and as much from everywhere."""

    def light_paths(self, detector_spot_m):
        self.detector_spot_m = detector_spot_m
        return (self,)

    def flux(self, laser_spot_m):
        return 1e-4

    def sample(self, laser_spot_m, number, rng, from_m=None):
        spots = np.tile(laser_spot_m, (number, 1)) if from_m is None else from_m
        return np.linalg.norm(spots - np.array((0.0, 0.0, 1.0)), axis=1) + dist(
            (0.0, 0.0, 1.0), self.detector_spot_m
        )


def scanning(photons, *, ticks=TICKS, seed=1, **light):
    """A bench whose mirror goes through the ticks, and has begun to."""
    bench = Bench([photons], photons.geometry, seed=seed)
    bench.change_light(emitting=True, biased=True, **light)
    bench.steer(*ticks[0])
    bench.clock.sleep(20e-3)
    start_s = bench.clock.now_s()
    bench.follow(start_s + 1e-3 * np.arange(len(ticks)), ticks)
    bench.clock.sleep(1e-3 * len(ticks))
    return bench, start_s


def standing(bench, start_s, duration_s, steps):
    """Where the mirror is at the middle of even steps, asked one by one."""
    times_s = start_s + (np.arange(steps) + 0.5) / steps * duration_s
    return [bench.geometry.laser_spot_m(bench.mirror.position(t)) for t in times_s]


def test_each_photon_is_timed_from_where_the_mirror_was():
    """To 0.3 ps for the jump of 60 cm: w^2 e dt^2 / 8 in place, and two legs; far less in a line."""
    photons = HiddenScenePhotons(OneMirror(), None, BRIGHT, EXACT)
    bench, start_s = scanning(photons)
    (seen,) = bench.detections(start_s, start_s + 0.12)
    assert len(seen) > 10_000
    g = bench.geometry
    spots = g.laser_spots_m(bench.mirror.positions(start_s + (seen.pulse + 0.5) * PERIOD_S))
    for_all_m = dist((0, 0, 1), (0, 0, 0)) + dist((0, 0, 0), g.detector_head_m)
    path_m = [dist(g.galvo_m, spot) + dist(spot, (0, 0, 1)) + for_all_m for spot in spots]
    expected_s = g.electronics_delay_s + np.array(path_m) / C_M_PER_S
    late_s = (seen.time_s - expected_s + PERIOD_S / 2) % PERIOD_S - PERIOD_S / 2
    most_m = (2 * np.pi * 400 * 20e-6) ** 2 / 8 * 0.6  # of a jump of 60 cm
    assert np.abs(late_s).max() < 2 * most_m / C_M_PER_S
    in_a_line = seen.pulse < 590_000
    assert np.abs(late_s[in_a_line]).max() < 0.03e-12  # 1 cm in place of 60, and rounding
    assert np.bincount(seen.pulse // 100_000).min() > 0.7 * len(seen) / 12  # from all of the time


@pytest.mark.parametrize("bounces", [3, 4])
def test_light_of_a_scene_comes_as_it_does_from_standing_mirrors(bounces):
    """Number, mean time and spread in each eighth of the way, against 100 standing mirrors in it."""
    built = scene("letters" if bounces == 3 else "shelf")
    rendered = Transport(
        tessellate(built, 0.02 if bounces == 3 else 0.08), built.triangles_m, bounces=bounces
    )
    photons = HiddenScenePhotons(rendered, BenchGeometry(), BRIGHT, EXACT)
    if bounces == 4:  # what the fourth bounce adds, alone
        photons._light_paths = photons._light_paths[1:]
    bench, start_s = scanning(photons, ticks=TICKS[:64])
    (seen,) = bench.detections(start_s, start_s + 64e-3)
    outside_m = dist((0, 0, 0), bench.geometry.detector_head_m)
    for eighth in range(8):
        weights, paths_m, rates_hz = [], [], []
        for spot in standing(bench, start_s + eighth * 8e-3, 8e-3, 100):
            weight, path_m = photons._light_paths[0].arrivals(spot)
            weights.append(weight[weight > 0])
            paths_m.append(path_m[weight > 0] + dist(bench.geometry.galvo_m, spot) + outside_m)
            rates_hz.append(photons.rate_hz(spot, bench.light))
        weight, path_m = np.concatenate(weights), np.concatenate(paths_m)
        expected = np.mean(rates_hz) * 8e-3
        here = (seen.pulse >= eighth * 80_000) & (seen.pulse < (eighth + 1) * 80_000)
        assert here.sum() == pytest.approx(expected, abs=5 * np.sqrt(expected))
        assert expected > 5000
        mean_m = np.average(path_m, weights=weight)
        spread_m = np.sqrt(np.average((path_m - mean_m) ** 2, weights=weight))
        got_m = (seen.time_s[here] - bench.geometry.electronics_delay_s) * C_M_PER_S
        # 1 mm for patches that are taken at their centres
        assert got_m.mean() == pytest.approx(mean_m, abs=5 * spread_m / np.sqrt(expected) + 1e-3)
        assert got_m.std() == pytest.approx(spread_m, abs=10 * spread_m / np.sqrt(2 * expected) + 1e-3)


EVERYTHING = FirstBounce(
    memory=1e-5, reflection_per_pulse=2e-3, failed_fraction=0.2, failed_radius_m=0.15, failed_per_pulse=2e-3
)
ALL_FAULTS = Detector(ringing=Ringing(0.1), holds_off=True, afterpulsing=Afterpulsing(0.02))


@pytest.mark.parametrize("gate", [{}, {"gated": True, "gate_delay_s": 28e-9}])
@pytest.mark.parametrize("detector", [QUIET, ALL_FAULTS])
def test_all_kinds_of_light_together_keep_the_rate_of_standing_mirrors(gate, detector):
    """Over a line past the detector's spot; 1 % more for what `rate_hz` leaves out of hold-off and pulses."""
    ticks = np.array([(-0.02 + 0.004 * k, 0.0) for k in range(60)])
    photons = HiddenScenePhotons(Transport.of_scene(scene("letters")), None, None, detector, EVERYTHING)
    bench, start_s = scanning(photons, ticks=ticks, **gate)
    (seen,) = bench.detections(start_s, start_s + 60e-3)
    rates_hz = [photons.rate_hz(spot, bench.light) for spot in standing(bench, start_s, 60e-3, 600)]
    expected = np.mean(rates_hz) * 60e-3
    assert len(seen) == pytest.approx(expected, abs=5 * np.sqrt(expected) + 0.01 * expected)
    assert expected > 10_000


def test_the_first_bounce_past_a_failing_gate_comes_only_where_it_fails():
    first = FirstBounce(failed_radius_m=0.05, failed_per_pulse=0.05)
    optics = Optics(stray_per_pulse=0, pulse_fwhm_s=0)
    photons = HiddenScenePhotons(OneMirror(), None, optics, EXACT, first)
    ticks = np.array([(0.04 + 0.004 * k, 0.0) for k in range(30)])
    bench, start_s = scanning(photons, ticks=ticks, gated=True, gate_delay_s=60e-9)
    (seen,) = bench.detections(start_s, start_s + 30e-3)
    spots = bench.geometry.laser_spots_m(bench.mirror.positions(start_s + (seen.pulse + 0.5) * PERIOD_S))
    # all of it is first bounce: the gate opens after all light of the scene
    assert len(seen) > 1000
    assert np.linalg.norm(spots, axis=1).max() < 0.05 + 2e-4  # what it goes in 20 us
    g = bench.geometry
    direct_m = [dist(g.galvo_m, spot) + dist(spot, g.detector_head_m) for spot in spots]
    assert seen.time_s == pytest.approx(g.electronics_delay_s + np.array(direct_m) / C_M_PER_S, abs=0.1e-12)


def test_knots_share_each_moment_between_the_two_next_to_it():
    rng = np.random.default_rng(0)
    way_m = np.column_stack([rng.uniform(0, 2e-3, 400).cumsum(), rng.normal(0, 1e-3, 400), np.zeros(400)])
    track = Track(way_m, 10e-3)
    knots = track.knots
    steps = np.array([np.diff(knot.reached, prepend=0.0) for knot in knots])
    assert steps.sum(axis=0) == pytest.approx(np.full(399, 1 / 399))
    assert (steps > 0).sum(axis=0).max() <= 2
    assert sum(knot.share for knot in knots) == pytest.approx(1.0)
    assert (knots[0].spot_m, knots[-1].spot_m) == (tuple(way_m[0]), tuple(way_m[-1]))
    gaps_m = [dist(one.spot_m, other.spot_m) for one, other in pairwise(knots)]
    assert max(gaps_m) <= KNOT_M
    moments = knots[3].moments(20_000, rng)
    drawn = np.bincount((moments * 399).astype(int), minlength=399)
    assert drawn[steps[3] == 0].sum() == 0
    wanted = 20_000 * steps[3] / steps[3].sum()
    assert (np.abs(drawn - wanted) <= 6 * np.sqrt(wanted) + 1).all()


def test_a_way_that_leads_nowhere_has_its_light_from_there():
    track = Track(np.tile([0.1, 0.2, 0.0], (50, 1)), 1e-3)
    assert {knot.spot_m for knot in track.knots} == {(0.1, 0.2, 0.0)}
    assert sum(knot.share for knot in track.knots) == pytest.approx(1.0)
    assert track.at(np.array([0.0, 0.5, 1.0])) == pytest.approx(np.tile([0.1, 0.2, 0.0], (3, 1)))


def test_the_spot_goes_straight_between_its_places():
    track = Track(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]]), 1e-3)
    places = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 0.0]]
    assert track.at(np.array([0.0, 0.25, 0.75, 1.0])) == pytest.approx(np.array(places))


@pytest.mark.parametrize("mirrors", [1, 2])
def test_many_angles_lead_where_each_does(mirrors):
    turn = tuple(map(tuple, rotated(0.05, -0.03, 0.02).tolist()))
    mount = MirrorMount(turn, (0.01, -0.02), (1.01, 0.98), mirrors=mirrors, separation_m=0.015)
    geometry = BenchGeometry(mount=mount)
    angles = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
    one_by_one = [geometry.laser_spot_m(tuple(pair)) for pair in angles]
    assert geometry.laser_spots_m(angles) == pytest.approx(np.array(one_by_one), abs=1e-12)
    with pytest.raises(ValueError, match="away from the wall"):
        BenchGeometry(mount=MirrorMount(tuple(map(tuple, rotated(0, 2.0, 0).tolist())))).laser_spots_m(angles)


def test_a_dark_bench_draws_background_alone():
    photons = HiddenScenePhotons(OneMirror(), detector=Detector(dark_hz=1e5, ambient_hz=0))
    track = Track(BenchGeometry().laser_spots_m(TICKS), 0.1)
    seen = photons.detections_along(track, LightState(biased=True), np.random.default_rng(0))
    assert len(seen) == pytest.approx(1e4, abs=500)
    assert (np.diff(seen.pulse) >= 0).all()
