"""One detection hides others: the first photon of a gate, the hold-off, and what afterpulses add."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from simulators.bench import LightState
from simulators.detector import Afterpulsing, Detector
from simulators.detector.dead_time import RUN, in_order
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport

FREE = LightState(emitting=True, biased=True, hold_off_s=100e-9)
GATED = replace(FREE, gated=True, gate_delay_s=30e-9, gate_width_s=40e-9)
SHARP = Detector(dark_hz=0, ambient_hz=0, jitter_fwhm_s=0, electronics_fwhm_s=0, tail_fraction=0)
HELD = replace(SHARP, holds_off=True)
PERIOD_S = 100e-9


def in_gate(mean, pulses, rng):
    """Photons spread evenly over the inside of the gate, ``mean`` a pulse."""
    return 31e-9 + 38e-9 * rng.random(rng.poisson(mean * pulses))


def gaps(seen):
    return np.diff(seen.pulse) * PERIOD_S + np.diff(seen.time_s)


@pytest.mark.parametrize("mean", [0.05, 0.8, 3.0])
def test_the_first_photon_of_a_gate_wins(mean):
    """Coates 1968: exp(-m before it) (1 - exp(-m in it)) of the gates that open; one in 1e6."""
    pulses, rng = 300_000, np.random.default_rng(1)
    seen = HELD.detect(in_gate(mean, pulses, rng), GATED, pulses * PERIOD_S, rng)
    opened = pulses - len(seen)  # each detection keeps exactly the next gate closed
    share = mean / 20
    chance = np.exp(-share * np.arange(20)) * -np.expm1(-share)
    expected = opened * np.append(chance, np.exp(-mean))
    counts, _ = np.histogram(seen.time_s, 31e-9 + np.linspace(0, 38e-9, 21))
    observed = np.append(counts, opened - len(seen))
    assert ((observed - expected) ** 2 / expected).sum() < chi2.isf(1e-6, 20)
    assert len(seen) / opened == pytest.approx(-np.expm1(-mean), abs=5 * np.sqrt(0.25 / opened))


@pytest.mark.parametrize(
    ("hold_off_s", "apart"), [(40e-9, 1), (100e-9, 2), (190e-9, 2), (250e-9, 3), (1e-6, 11)]
)
def test_hold_off_keeps_whole_gates_closed(hold_off_s, apart):
    """With 3 photons a gate some gate of the first that may open has one; none before it ever has."""
    rng = np.random.default_rng(2)
    light = replace(GATED, hold_off_s=hold_off_s, gate_width_s=30e-9)
    arrivals_s = 31e-9 + 5e-9 * rng.random(rng.poisson(3 * 50_000))
    seen = HELD.detect(arrivals_s, light, 50_000 * PERIOD_S, rng)
    assert np.diff(seen.pulse).min() == apart
    assert gaps(seen).min() >= hold_off_s


def test_no_more_than_every_second_gate_at_10_mhz():
    rng = np.random.default_rng(3)
    seen = HELD.detect(in_gate(40.0, 2000, rng), GATED, 2000 * PERIOD_S, rng)
    assert len(seen) == 1000


@pytest.mark.parametrize("mean", [0.002, 0.8, 5.0])
def test_counts_scatter_as_the_renewal_of_gates_says(mean):
    """Variance over mean (1 - p) / (1 + p)^2 with p = 1 - exp(-m): 1 for faint light, far less for bright.

    From the gates between detections, 1 + geometric. 5 sigma of a variance of 800 exposures, and 1 % for the
    ends of 1000 gates.
    """
    rng, counts = np.random.default_rng(4), []
    for _ in range(800):
        counts.append(len(HELD.detect(in_gate(mean, 1000, rng), GATED, 1000 * PERIOD_S, rng)))
    lit = -np.expm1(-mean)
    expected = (1 - lit) / (1 + lit) ** 2
    spread = np.sqrt((2 + 1 / np.mean(counts)) / 800)
    found = np.var(counts, ddof=1) / np.mean(counts)
    assert found == pytest.approx(expected, rel=5 * spread + 0.01, abs=1.5 / np.mean(counts) * (mean > 1))


def test_free_running_the_dead_time_is_not_extended():
    """Gaps of at least the hold-off, and r / (1 + r h) detections a second; 5 sigma of a Poisson count."""
    rng, rate_hz, duration_s = np.random.default_rng(5), 8e6, 0.02
    arrivals_s = PERIOD_S * rng.random(rng.poisson(rate_hz * duration_s))
    seen = HELD.detect(arrivals_s, FREE, duration_s, rng)
    expected = rate_hz * duration_s / (1 + rate_hz * 100e-9)
    assert gaps(seen).min() >= 100e-9 - 1e-18
    assert len(seen) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert HELD.detected_hz(rate_hz, FREE) * duration_s == pytest.approx(expected)


def test_without_two_photons_close_together_hold_off_changes_nothing():
    """The same seed gives the same detections, with the response, to the last bit."""
    arrivals_s = 31e-9 + 38e-9 * np.random.default_rng(7).random(40)
    detector = Detector()
    plain = detector.detect(arrivals_s, GATED, 0.4, np.random.default_rng(8))
    assert gaps(plain).min() > 1e-6, "chosen seed: one photon in some 10 ms"
    held = replace(detector, holds_off=True).detect(arrivals_s, GATED, 0.4, np.random.default_rng(8))
    assert np.array_equal(plain.time_s, held.time_s)
    assert np.array_equal(plain.pulse, held.pulse)


def test_the_stated_rate_is_what_is_counted_with_all_effects():
    """Bright light, all faults of the detector: 100 exposures of 1 ms within 5 sigma and 0.2 %."""
    detector = Detector(holds_off=True, afterpulsing=Afterpulsing(0.02))
    photons = HiddenScenePhotons(
        Transport.of_scene(scene("letters")), optics=Optics(power_w=40.0), detector=detector
    )
    spot, rng = (0.3, 0.2, 0.0), np.random.default_rng(9)
    for light in (GATED, replace(FREE, power=0.05)):
        counts = [len(photons.detections(spot, light, 1e-3, rng)) for _ in range(100)]
        expected = photons.rate_hz(spot, light) * 0.1
        assert np.sum(counts) == pytest.approx(expected, abs=5 * np.sqrt(expected) + 2e-3 * expected)


def test_afterpulses_follow_with_their_probability_and_decay():
    """Faint light, so that what follows soon follows from an avalanche; 5 sigma."""
    rng = np.random.default_rng(10)
    detector = replace(HELD, afterpulsing=Afterpulsing(0.10, 50e-9))
    light = replace(FREE, hold_off_s=40e-9)
    seen = detector.detect(PERIOD_S * rng.random(200_000), light, 400.0, rng)
    after = gaps(seen)
    soon = after[after < 1e-6]
    expected = 0.10 * np.exp(-40 / 50) + 500 * 1e-6  # the second: two photons by chance
    assert len(soon) / len(after) == pytest.approx(expected, abs=5 * np.sqrt(expected / len(after)))
    assert soon.min() >= 40e-9
    chance = 500 * 1e-6 / expected * 0.5e-6  # what chance adds to the mean
    assert (soon - 40e-9).mean() == pytest.approx(50e-9 + chance, abs=5 * 60e-9 / np.sqrt(len(soon)))
    assert len(seen) == pytest.approx(200_000 / (1 - 0.10 * np.exp(-40 / 50)), rel=5e-3)


def test_afterpulses_of_a_gated_detector_fall_into_open_gates():
    """Slow release, so that many outlast the closed gate: all in gates that opened after the hold-off."""
    rng = np.random.default_rng(11)
    detector = replace(HELD, afterpulsing=Afterpulsing(0.5, 300e-9))
    arrivals_s = np.full(20_000, 50e-9)
    seen = detector.detect(arrivals_s, GATED, 20.0, rng)
    added = seen.time_s != 50e-9
    assert added.sum() > 500
    half_edge_s = 200e-12 / 0.6 / 2
    assert seen.time_s.min() >= 30e-9 - half_edge_s
    assert seen.time_s.max() <= 70e-9 + half_edge_s
    assert np.diff(seen.pulse).min() >= 2


def test_chains_of_afterpulses_do_not_end_with_the_memory_for_them():
    """Half of all avalanches set off another: twice as many detections as photons, from a single one on."""
    rng = np.random.default_rng(12)
    detector = replace(SHARP, afterpulsing=Afterpulsing(0.5, 50e-9))
    total = sum(len(detector.detect(np.array([1e-9]), FREE, 1e-3, rng)) for _ in range(4000))
    assert total == pytest.approx(8000, abs=5 * np.sqrt(4000 * 2))  # variance p / (1 - p)^2 = 2 each
    many = detector.detect(PERIOD_S * rng.random(50_000), FREE, 1.0, rng)
    assert len(many) == pytest.approx(100_000, abs=5 * np.sqrt(50_000 * 2))
    assert (gaps(many) >= 0).all()


def test_all_of_it_repeats_itself_from_its_seed():
    detector = replace(HELD, afterpulsing=Afterpulsing(0.1))
    arrivals_s = in_gate(0.5, 1000, np.random.default_rng(0))
    one, two, other = (
        detector.detect(arrivals_s, GATED, 1e-4, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert np.array_equal(one.pulse, two.pulse)
    assert np.array_equal(one.time_s, two.time_s)
    assert not np.array_equal(one.pulse, other.pulse)


def test_nothing_comes_of_nothing():
    detector = replace(HELD, afterpulsing=Afterpulsing(0.5))
    assert len(detector.detect(np.empty(0), GATED, 1.0, np.random.default_rng(0))) == 0
    assert detector.detected_hz(0.0, GATED) == 0


@pytest.mark.parametrize(("number", "pulses"), [(0, 9), (1, 1), (RUN - 1, 9), (2 * RUN, 9), (5 * RUN, 10**6)])
def test_events_are_put_in_order_of_arrival(number, pulses):
    """As numpy sorts them; some times lie beyond the period, so that pulses overtake each other."""
    draw, period_s = np.random.default_rng(number), 1e-7
    times_s, moments = draw.uniform(-1e-8, 2.5e-7, number), draw.random(number)
    of_pulse, time_s = in_order(times_s, moments, pulses, period_s)
    pulse = (moments * pulses).astype(np.int64)
    expected = np.argsort(pulse * period_s + times_s)
    arrival_s = of_pulse * period_s + time_s
    # seconds hold times of a million periods to 1e-17 s only: who is nearer than that is in either order
    np.testing.assert_allclose(arrival_s, (pulse * period_s + times_s)[expected], atol=1e-16, rtol=0)
    assert sorted(time_s) == sorted(times_s)
