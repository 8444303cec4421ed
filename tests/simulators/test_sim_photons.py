"""What is detected: when, how often, and that it follows from the switches and the geometry."""

from dataclasses import fields, replace
from math import dist

import numpy as np
import pytest
from scipy.stats import chi2

from simulators.bench import Bench, BenchGeometry, LightState
from simulators.constants import C_M_PER_S
from simulators.detector import Detector
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport
from support.exact_light import EXACT, NO_STRAY

SPOT = (0.3, 0.2, 0.0)
FREE = LightState(emitting=True, biased=True)
#: Opens after the direct light of every spot in the aperture has passed, before the scene's first.
GATED = replace(FREE, gated=True, gate_delay_s=34e-9, gate_width_s=40e-9)


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def photons():
    return HiddenScenePhotons(Transport.of_scene(scene("letters")))


@pytest.fixture(scope="module")
def exact():
    """Three-bounce light alone, in an instrument without any blur."""
    return HiddenScenePhotons(Transport.of_scene(scene("letters")), optics=NO_STRAY, detector=EXACT)


def test_one_watt_of_green_light_is_2_68e18_photons_a_second():
    assert Optics().photons_per_s == pytest.approx(2.68e18, rel=2e-3)


def test_the_default_scene_has_the_mean_rate_of_the_paper(photons):
    """205 000 detections a second over the grid of 1.8 m x 1.3 m, asked every 10 cm."""
    spots = [(x, y, 0.0) for x in np.arange(-0.85, 0.9, 0.1) for y in np.arange(-0.6, 0.65, 0.1)]
    mean_hz = np.mean([photons.rate_hz(spot, GATED) for spot in spots])
    assert mean_hz == pytest.approx(205e3, rel=0.02)


@pytest.mark.parametrize(
    "light",
    [replace(FREE, emitting=False), replace(FREE, power=0.0), replace(FREE, biased=False)],
    ids=["not emitting", "no power", "no bias"],
)
@pytest.mark.parametrize("gated", [False, True])
def test_no_light_is_seen(exact, light, gated):
    light = replace(light, gated=gated)
    assert exact.rate_hz(SPOT, light) == 0
    assert len(exact.detections(SPOT, light, 1.0, rng())) == 0


def test_an_unbiased_detector_counts_nothing_at_all(photons):
    assert len(photons.detections(SPOT, replace(FREE, biased=False), 10.0, rng())) == 0
    assert photons.rate_hz(SPOT, replace(FREE, biased=False)) == 0


def test_in_the_dark_only_background_is_counted(photons):
    """510 a second for 100 s, and four tenths of it in the gate; 5 sigma."""
    for light, duty in ((replace(FREE, emitting=False), 1.0), (replace(GATED, emitting=False), 0.4)):
        expected = 510 * 100 * duty
        assert photons.rate_hz(SPOT, light) == pytest.approx(510 * duty)
        times_s = photons.detections(SPOT, light, 100.0, rng(4)).time_s
        assert len(times_s) == pytest.approx(expected, abs=5 * np.sqrt(expected))
        assert times_s.min() >= 0
        assert times_s.max() < 100e-9


def test_counts_are_poisson_with_the_stated_rate(photons):
    """Mean within 5 sigma; variance over mean within 5 sqrt(2 / n) of 1, for n exposures."""
    n, draw = 1500, rng(1)
    for light in (FREE, GATED, replace(GATED, power=0.3)):
        counts = np.array([len(photons.detections(SPOT, light, 1e-4, draw)) for _ in range(n)])
        expected = photons.rate_hz(SPOT, light) * 1e-4
        assert counts.mean() == pytest.approx(expected, abs=5 * np.sqrt(expected / n))
        assert counts.var(ddof=1) / counts.mean() == pytest.approx(1, abs=5 * np.sqrt(2 / n) * 1.2)


def test_light_is_proportional_to_power(exact):
    full, part = exact.rate_hz(SPOT, FREE), exact.rate_hz(SPOT, replace(FREE, power=0.25))
    assert part == pytest.approx(0.25 * full, rel=1e-12)


def test_arrival_is_electronics_and_all_legs_of_the_way():
    """Every photon of the 2 cm patch, within the spread of its corners."""
    geometry = BenchGeometry((-0.3, 0.1, 2.4), (0.25, -0.2, 2.6), electronics_delay_s=7e-9)
    looked_at_m = (0.1, 0.05, 0.0)
    point = HiddenScenePhotons(
        Transport.of_scene(scene("point")),
        geometry,
        replace(NO_STRAY, power_w=500.0),
        EXACT,
        detector_spot_m=looked_at_m,
    )
    times_s = point.detections(SPOT, FREE, 1.0, rng()).time_s
    legs_m = dist(geometry.galvo_m, SPOT) + dist(looked_at_m, geometry.detector_head_m)
    corners = [(x, y, 1.0) for x in (-0.01, 0.01) for y in (-0.01, 0.01)]
    through_m = [dist(SPOT, q) + dist(q, looked_at_m) for q in corners]
    assert len(times_s) > 1000
    assert times_s.min() >= 7e-9 + (legs_m + min(through_m)) / C_M_PER_S - 1e-15
    assert times_s.max() <= 7e-9 + (legs_m + max(through_m)) / C_M_PER_S + 1e-15
    assert np.ptp(times_s) > 0.8 * np.ptp(through_m) / C_M_PER_S  # points all over the patch, not its centre


def test_times_beyond_a_period_are_folded_into_it():
    late = BenchGeometry(electronics_delay_s=12.3e-9 + 3e-7)
    args = {"optics": NO_STRAY, "detector": EXACT}
    letters = Transport.of_scene(scene("letters"))
    folded = HiddenScenePhotons(letters, late, **args).detections(SPOT, FREE, 1e-2, rng()).time_s
    usual = HiddenScenePhotons(letters, **args).detections(SPOT, FREE, 1e-2, rng()).time_s
    assert folded == pytest.approx(usual, abs=1e-18)


def test_draws_follow_the_expected_transient(exact):
    """Chi-square over 4e5 photons in 16 ps bins; one failure in a million, seed fixed."""
    built, geometry = scene("letters"), exact.geometry
    edges_s = np.arange(4e-9, 16e-9, 16e-12)
    spots = np.array([SPOT]), np.array([exact.detector_spot_m])
    expected = Transport.of_scene(built).transients(*spots, edges_s)[0]
    legs_m = dist(geometry.galvo_m, SPOT) + dist(exact.detector_spot_m, geometry.detector_head_m)
    shift_s = geometry.electronics_delay_s + legs_m / C_M_PER_S
    drawn, _ = np.histogram(exact.detections(SPOT, FREE, 2.0, rng(6)).time_s, edges_s + shift_s)
    expected *= drawn.sum() / expected.sum()
    enough = expected > 20
    assert drawn.sum() > 2e5
    statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
    assert statistic < chi2.isf(1e-6, enough.sum())


def test_the_gate_passes_photons_only_inside_and_all_of_them_there(exact):
    """A gate of 1 ns in the middle of the scene: edges of 333 ps in full, half of it outside each way."""
    light = replace(GATED, gate_delay_s=36.5e-9, gate_width_s=1e-9)
    free_s = exact.detections(SPOT, FREE, 1.0, rng(1)).time_s
    gated_s = exact.detections(SPOT, light, 1.0, rng(2)).time_s
    half_s = 200e-12 / 0.6 / 2
    assert len(gated_s) > 1000
    assert gated_s.min() >= 36.5e-9 - half_s
    assert gated_s.max() <= 37.5e-9 + half_s
    inside = [np.count_nonzero(np.abs(t - 37e-9) < 0.5e-9 - half_s) for t in (free_s, gated_s)]
    assert inside[0] == pytest.approx(inside[1], abs=5 * np.sqrt(sum(inside)))
    assert len(gated_s) == pytest.approx(exact.rate_hz(SPOT, light), abs=5 * np.sqrt(len(gated_s)))


def test_pulse_spreads_light_before_the_gate_and_response_after_it():
    """Light before the gate is let in by a long pulse only; what gets in is blurred past the gate's edge."""
    light = replace(FREE, gated=True, gate_delay_s=50e-9, gate_width_s=10e-9)
    late = replace(EXACT, electronics_fwhm_s=1e-9)
    built = Transport.of_scene(scene("point"))
    bright = replace(NO_STRAY, power_w=500.0)
    assert HiddenScenePhotons(built, optics=bright, detector=late).rate_hz(SPOT, light) == 0
    assert (
        len(HiddenScenePhotons(built, optics=bright, detector=late).detections(SPOT, light, 1.0, rng())) == 0
    )
    long = replace(bright, pulse_fwhm_s=20e-9)
    times_s = (
        HiddenScenePhotons(built, optics=long, detector=EXACT).detections(SPOT, light, 1.0, rng()).time_s
    )
    assert len(times_s) > 100
    assert times_s.min() > 49.8e-9
    blurred_s = (
        HiddenScenePhotons(built, optics=long, detector=late).detections(SPOT, light, 1.0, rng()).time_s
    )
    assert blurred_s.min() < 49.8e-9


def test_stray_light_stands_at_the_direct_path_unless_the_gate_keeps_it_out():
    empty = HiddenScenePhotons(
        Transport.of_scene(scene("empty")),
        optics=Optics(stray_per_pulse=0.02, pulse_fwhm_s=0),
        detector=EXACT,
    )
    g = empty.geometry
    path_m = dist(g.galvo_m, SPOT) + dist(SPOT, g.detector_head_m)
    direct_s = g.electronics_delay_s + path_m / C_M_PER_S
    times_s = empty.detections(SPOT, FREE, 0.1, rng()).time_s
    assert times_s == pytest.approx(direct_s, abs=1e-18)
    assert len(times_s) == pytest.approx(20_000, abs=5 * np.sqrt(20_000))  # 0.02 of 1e6 pulses
    assert len(empty.detections(SPOT, GATED, 0.1, rng())) == 0
    early = replace(GATED, gate_delay_s=direct_s - 1e-9)
    assert len(empty.detections(SPOT, early, 0.1, rng())) > 19_000
    assert empty.rate_hz(SPOT, early) == pytest.approx(0.02 * 1e7)


def test_the_response_of_the_whole_system_is_65_ps_wide():
    """Stray light is a single path: its histogram is the response. 1e6 photons, 1 ps bins smoothed over 5."""
    quiet = Detector(dark_hz=0, ambient_hz=0)
    empty = HiddenScenePhotons(
        Transport.of_scene(scene("empty")), optics=Optics(stray_per_pulse=0.1), detector=quiet
    )
    times_s = empty.detections((0.0, 0.0, 0.0), FREE, 1.0, rng(2)).time_s
    g = empty.geometry
    path_m = dist(g.galvo_m, (0, 0, 0)) + dist((0, 0, 0), g.detector_head_m)
    counts, edges_s = np.histogram(
        times_s - g.electronics_delay_s - path_m / C_M_PER_S, np.arange(-200.5, 300.5) * 1e-12
    )
    smooth = np.convolve(counts, np.ones(5) / 5, "same")
    above = np.flatnonzero(smooth > smooth.max() / 2)
    assert len(above) == pytest.approx(65, abs=2)
    centre_s = (edges_s[above[0]] + edges_s[above[-1] + 1]) / 2
    assert abs(centre_s) < 2e-12  # the core is not delayed; the tail moves the half-height by a part of this


def test_the_same_seed_gives_the_same_photons_whatever_was_asked_before(photons):
    first = photons.detections(SPOT, GATED, 1e-3, rng(5)).time_s
    photons.rate_hz((-0.5, 0.1, 0.0), FREE)
    photons.detections((-0.5, 0.1, 0.0), FREE, 1e-3, rng(9))
    assert np.array_equal(photons.detections(SPOT, GATED, 1e-3, rng(5)).time_s, first)
    assert not np.array_equal(photons.detections(SPOT, GATED, 1e-3, rng(6)).time_s, first)


def test_detections_come_in_order_over_all_pulses(photons):
    """Times rise but for the response, and pulses are met evenly: chi-square over 100 parts."""
    seen = photons.detections(SPOT, FREE, 0.1, rng(3))
    assert (np.diff(seen.pulse * 100e-9 + seen.time_s) > -2e-9).all()
    assert seen.pulse.min() >= 0
    assert seen.pulse.max() < 10**6 + 1
    parts, _ = np.histogram(seen.pulse, np.linspace(0, 10**6, 101))
    statistic = ((parts - parts.mean()) ** 2 / parts.mean()).sum()
    assert statistic < chi2.isf(1e-6, 99)


@pytest.mark.benchmark
def test_speed_of_one_position(benchmark, photons):
    """One exposure of 10 ms at a spot never seen before, about 2000 photons."""
    spots = iter((-0.4 + 1e-6 * i, 0.1, 0.0) for i in range(10**6))
    draw = rng()
    benchmark(lambda: photons.detections(next(spots), GATED, 1e-2, draw))


@pytest.mark.parametrize("periods_later", [0, 1, 3])
def test_a_gate_that_opens_for_every_fourth_pulse_sees_a_quarter_at_the_same_times(photons, periods_later):
    """Without hold-off, since that lasts as long while gates come more seldom; 5 sigma of Poisson counts."""
    at = replace(GATED, hold_off_s=0.0)
    late_s = periods_later / at.repetition_hz
    divided = replace(at, gate_every=4, gate_delay_s=at.gate_delay_s + late_s)
    every, fourth = (_drawn_on_a_bench(photons, light, 1.0) for light in (at, divided))
    assert len(fourth) == pytest.approx(len(every) / 4, abs=5 * np.sqrt(len(every) / 4 + len(every) / 16))
    bins = np.linspace(30e-9, 80e-9, 26)
    a, b = (np.histogram(one.time_s, bins)[0] for one in (every, fourth))
    total, share = (a + b)[a + b > 20], len(fourth) / (len(every) + len(fourth))
    chi = ((b[a + b > 20] - total * share) ** 2 / (total * share * (1 - share))).sum()
    assert chi < chi2.ppf(1 - 1e-6, len(total) - 1)
    assert (fourth.pulse % 4 == 0).all()
    assert np.mean(every.pulse % 4 == 0) == pytest.approx(0.25, abs=5 * np.sqrt(0.19 / len(every)))


def _drawn_on_a_bench(photons, light, duration_s):
    bench = Bench([photons])
    bench.change_light(**{field.name: getattr(light, field.name) for field in fields(light)})
    (found,) = bench.detections(bench.clock.now_s(), bench.clock.now_s() + duration_s)
    rate_hz = bench.count_rate_hz(0)
    assert len(found) == pytest.approx(rate_hz * duration_s, rel=0.05)  # afterpulses are some 2 %
    return found
