"""The first bounce behind the gate: pedestal, straight lines, failed gates; what the paper saw of them."""

from dataclasses import replace
from math import dist

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from simulators.bench import Bench, BenchGeometry, LightState
from simulators.constants import C_M_PER_S
from simulators.detector import Detector, Ringing
from simulators.detector.first_bounce import FirstBounce, direct_s
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport
from support.exact_light import EXACT, NO_STRAY

SPOT = (0.3, 0.2, 0.0)
GATED = LightState(emitting=True, biased=True, gated=True, gate_delay_s=31.5e-9, gate_width_s=40e-9)


def room(first_bounce, detector=EXACT, optics=NO_STRAY):
    return HiddenScenePhotons(
        Transport.of_scene(scene("empty")), optics=optics, detector=detector, first_bounce=first_bounce
    )


def expose(photons, duration_s=1.0, spot=SPOT, light=GATED, seed=0):
    return photons.detections(spot, light, duration_s, np.random.default_rng(seed))


def test_the_pedestal_decays_inside_the_gate_with_its_time_constant():
    """1000 a pulse, 1e-6 of them trapped, 1e7 pulses: 1e4 carriers, an exponential cut by the gate."""
    photons = room(FirstBounce(memory=1e-6, memory_decay_s=20e-9))
    seen = expose(photons)
    begun_s = direct_s(SPOT, photons.geometry)
    shares = np.exp(-(np.array([31.5e-9, 71.5e-9]) - begun_s) / 20e-9)
    expected = 1e4 * (shares[0] - shares[1]) / (1 - np.exp(-100 / 20))  # the gates of later pulses too
    assert len(seen) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert photons.rate_hz(SPOT, GATED) == pytest.approx(expected, rel=2e-3)  # 4000 waits
    inside = seen.time_s[(seen.time_s > 32e-9) & (seen.time_s < 71e-9)]
    ends = np.exp(-np.array([0.0, 39e-9]) / 20e-9)
    assert kstest(inside - 32e-9, lambda t: (1 - np.exp(-t / 20e-9)) / (1 - ends[1])).pvalue > 1e-6


def test_reflections_come_by_their_reflector_and_nearly_on_a_line():
    place_m = (3.0, 0.2, 0.5)
    geometry = BenchGeometry()
    photons = room(FirstBounce(reflection_per_pulse=1e-3, reflectors_m=(place_m,)))
    after_wall_s = []
    for x_m in np.linspace(-0.9, 0.9, 7):
        spot = (float(x_m), 0.0, 0.0)
        light = replace(GATED, gate_delay_s=20e-9, gate_width_s=60e-9)
        seen = expose(photons, spot=spot, light=light)
        path_m = dist(geometry.galvo_m, spot) + dist(spot, place_m) + dist(place_m, geometry.detector_head_m)
        assert seen.time_s == pytest.approx(geometry.electronics_delay_s + path_m / C_M_PER_S, abs=1e-18)
        expected = 1e4 / dist(spot, place_m) ** 2
        assert len(seen) == pytest.approx(expected, abs=5 * np.sqrt(expected))
        after_wall_s.append(seen.time_s[0] - dist(geometry.galvo_m, spot) / C_M_PER_S)
    straight = np.polyval(np.polyfit(np.arange(7), after_wall_s, 1), np.arange(7))
    # a path of 2.1 to 3.9 m bends by less than 2 cm over 1.8 m; that of a hidden object in the middle by 30
    assert np.abs(straight - after_wall_s).max() * C_M_PER_S < 0.02


def test_where_the_gate_fails_one_peak_fills_a_16_bit_counter_before_anything_real():
    """0.2 a pulse for 1 s, in a response 65 ps wide."""
    detector = Detector(dark_hz=0, ambient_hz=0, holds_off=True)
    photons = room(FirstBounce(failed_radius_m=0.05), detector, Optics(stray_per_pulse=0))
    near, far = (0.03, 0.03, 0.0), (0.04, 0.04, 0.0)
    seen = expose(photons, spot=near)
    counts, edges_s = np.histogram(seen.time_s, np.arange(28e-9, 88e-9, 4e-12))
    assert counts.max() > 65535
    peak_s = edges_s[counts.argmax()] + 2e-12
    assert peak_s == pytest.approx(direct_s(near, photons.geometry), abs=8e-12)
    legs_m = dist(photons.geometry.galvo_m, near) + dist((0, 0, 0), photons.geometry.detector_head_m)
    rectified_s = peak_s - photons.geometry.electronics_delay_s - legs_m / C_M_PER_S
    assert rectified_s < 3.3e-9
    assert len(expose(photons, spot=far)) == 0
    # a detection before the gate opens keeps that gate closed, not the next pulse from being seen
    expected = photons.rate_hz(near, GATED)
    assert len(seen) == pytest.approx(expected, rel=0.1)


def test_a_failed_gate_costs_the_hidden_scene_its_photons():
    """Each early detection keeps its own gate closed: 1 - exp(-0.2) of the gates are lost; 5 sigma."""
    detector = replace(EXACT, holds_off=True)
    lit = [
        HiddenScenePhotons(
            Transport.of_scene(scene("letters")), optics=NO_STRAY, detector=detector, first_bounce=bounce
        )
        for bounce in (FirstBounce(), FirstBounce(failed_fraction=1.0))
    ]
    late = [np.count_nonzero(expose(photons, spot=SPOT).time_s > 31e-9) for photons in lit]
    kept = late[1] / late[0]
    assert kept == pytest.approx(np.exp(-0.2), abs=0.01 + 5 * np.sqrt(2 / late[1]))


def test_failures_are_a_fixed_map_of_positions():
    """One in fifty of 5000 cells, the same at every visit and anywhere in the cell, another map by seed."""
    spots = [(x / 100, y / 100, 0.0) for x in range(-50, 50) for y in range(-25, 25)]
    maps = [
        np.array(
            [FirstBounce(failed_fraction=0.02, seed=seed).fails(spot, (0.0, 0.0, 0.0)) for spot in spots]
        )
        for seed in (1, 1, 2)
    ]
    assert maps[0].sum() == pytest.approx(100, abs=5 * 10)
    assert np.array_equal(maps[0], maps[1])
    assert not np.array_equal(maps[0], maps[2])
    moved = [
        FirstBounce(failed_fraction=0.02, seed=1).fails((x + 1e-4, y, 0.0), (0.0, 0.0, 0.0))
        for x, y, _ in spots
    ]
    assert np.array_equal(maps[0], moved)


@pytest.mark.parametrize(
    "change", [{"emitting": False}, {"power": 0.0}, {"biased": False}], ids=lambda change: next(iter(change))
)
def test_none_of_it_without_light(change):
    everything = FirstBounce(memory=1e-4, reflection_per_pulse=1e-2, failed_fraction=1.0)
    photons = room(everything)
    assert len(expose(photons)) > 1000
    assert len(expose(photons, light=replace(GATED, **change))) == 0
    assert photons.rate_hz(SPOT, replace(GATED, **change)) == 0


def test_all_of_it_is_proportional_to_the_light():
    photons = room(FirstBounce(memory=1e-5, reflection_per_pulse=1e-2, failed_fraction=1.0))
    full, part = photons.rate_hz(SPOT, GATED), photons.rate_hz(SPOT, replace(GATED, power=0.25))
    assert part == pytest.approx(0.25 * full)
    drawn = len(expose(photons, light=replace(GATED, power=0.25)))
    assert drawn == pytest.approx(part, abs=5 * np.sqrt(part))


def test_switched_off_the_bench_is_the_ideal_one_to_the_last_bit():
    plain = HiddenScenePhotons(Transport.of_scene(scene("letters")))
    off = HiddenScenePhotons(Transport.of_scene(scene("letters")), first_bounce=FirstBounce(seed=5))
    one, two = (Bench([photons], seed=3) for photons in (plain, off))
    for bench in (one, two):
        bench.change_light(**vars(GATED))
        bench.clock.sleep(0.01)
    (seen,), (other,) = one.detections(0.0, 0.01), two.detections(0.0, 0.01)
    assert len(seen) > 1000
    assert np.array_equal(seen.time_s, other.time_s)
    assert np.array_equal(seen.pulse, other.pulse)


def test_ringing_shapes_light_and_background_alike():
    """Chi-square of the first 3 ns of the gate against its sensitivity; 5 ps bins summed to 50 ps."""
    detector = replace(EXACT, ambient_hz=2e7, ringing=Ringing(0.10))
    photons = room(FirstBounce(), detector)
    fine_s = 31.3e-9 + 5e-12 * (np.arange(600) + 0.5)
    shape = detector.sensitivity(fine_s, GATED).reshape(-1, 10).sum(axis=1)
    assert shape.max() > 1.04 * 10
    seen = expose(photons, 0.1, light=replace(GATED, emitting=False))
    counts, _ = np.histogram(seen.time_s, np.append(fine_s[::10] - 2.5e-12, fine_s[-1] + 2.5e-12))
    expected = 2e7 * 0.1 * 5e-12 / 100e-9 * shape
    enough = expected > 20
    assert ((counts - expected)[enough] ** 2 / expected[enough]).sum() < chi2.isf(1e-6, enough.sum())
    assert len(seen) == pytest.approx(detector.background_hz(GATED) * 0.1, abs=5 * np.sqrt(len(seen)))
    stray = room(FirstBounce(), replace(detector, ambient_hz=0), Optics(stray_per_pulse=0.01, pulse_fwhm_s=0))
    swing_s = float(fine_s[detector.sensitivity(fine_s, GATED).argmax()])
    at_peak = replace(GATED, gate_delay_s=31.5e-9 + direct_s(SPOT, stray.geometry) - swing_s)
    expected = 1e5 * detector.sensitivity(np.array([swing_s]), GATED)[0]
    assert len(expose(stray, light=at_peak)) == pytest.approx(expected, abs=5 * np.sqrt(expected))
