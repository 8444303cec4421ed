"""The gate's shape, the background it lets through, and the response of the whole system."""

from math import log, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import chi2, exponnorm, kstest, norm

from simulators.bench import LightState
from simulators.detector import Detector
from simulators.detector.response import delays, sigma_s
from simulators.optics.light import Optics

SIGMA = 1 / (2 * sqrt(2 * log(2)))
OPEN = LightState(biased=True)
GATED = LightState(biased=True, gated=True, gate_delay_s=33e-9, gate_width_s=40e-9)


def response(t_s, *, with_pulse):
    """Density of pulse, core, electronics and tail: the exponentially modified Gaussian of the textbooks."""
    d = Detector()
    widths = [d.jitter_fwhm_s, d.electronics_fwhm_s] + [Optics().pulse_fwhm_s] * with_pulse
    sigma_s = sqrt(sum(w * w for w in widths)) * SIGMA
    late = exponnorm.pdf(t_s, d.tail_s / sigma_s, scale=sigma_s)
    return (1 - d.tail_fraction) * norm.pdf(t_s, scale=sigma_s) + d.tail_fraction * late


def test_the_whole_system_is_65_ps_wide_with_its_peak_in_place():
    peak = minimize_scalar(lambda t: -response(t, with_pulse=True), bracket=(-20e-12, 0, 20e-12))
    half = -peak.fun / 2
    width_s = brentq(lambda t: response(t, with_pulse=True) - half, 0, 200e-12) - brentq(
        lambda t: response(t, with_pulse=True) - half, -200e-12, 0
    )
    assert width_s == pytest.approx(65e-12, abs=2e-12)
    assert abs(peak.x) < 2e-12


def test_delays_follow_the_response():
    """Chi-square of a million draws against the closed form; one failure in a million, seed fixed."""
    d = Detector()
    core_s = sigma_s(d.jitter_fwhm_s, d.electronics_fwhm_s)
    delays_s = delays(1_000_000, core_s, d.tail_s, d.tail_fraction, np.random.default_rng(3))
    edges_s = np.arange(-100e-12, 500e-12, 5e-12)
    drawn, _ = np.histogram(delays_s, edges_s)
    fine_s = np.linspace(edges_s[0], edges_s[-1], 20 * (len(edges_s) - 1) + 1)
    middle = (fine_s[1:] + fine_s[:-1]) / 2
    expected = 1e6 * np.diff(fine_s)[0] * response(middle, with_pulse=False).reshape(-1, 20).sum(axis=1)
    enough = expected > 20
    statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
    assert statistic < chi2.isf(1e-6, enough.sum())
    assert delays_s.mean() == pytest.approx(d.tail_fraction * d.tail_s, abs=5 * delays_s.std() / 1e3)


def test_the_gate_is_half_open_at_its_times_and_takes_its_edge_from_20_to_80_percent():
    detector = Detector(gate_edge_s=200e-12)
    edges_s = np.array([33e-9, 73e-9])
    assert detector.sensitivity(edges_s, GATED) == pytest.approx([0.5, 0.5], abs=1e-9)
    assert detector.sensitivity(33e-9 + np.array([-100e-12, 100e-12]), GATED) == pytest.approx([0.2, 0.8])
    assert detector.sensitivity(73e-9 + np.array([-100e-12, 100e-12]), GATED) == pytest.approx([0.8, 0.2])
    outside = np.array([0.0, 32.8e-9, 73.2e-9, 99.9e-9])
    assert detector.sensitivity(outside, GATED).tolist() == [0.0] * 4
    assert detector.sensitivity(np.array([33.2e-9, 50e-9, 72.8e-9]), GATED) == pytest.approx(
        [1.0] * 3, abs=1e-9
    )


@pytest.mark.parametrize(
    ("delay_s", "width_s"), [(33e-9, 40e-9), (80e-9, 40e-9), (-5e-9, 10e-9), (10e-9, 99.9e-9)]
)
def test_the_gate_repeats_with_the_sync_and_lets_through_its_duty(delay_s, width_s):
    light = LightState(biased=True, gated=True, gate_delay_s=delay_s, gate_width_s=width_s)
    t_s = (np.arange(100_000) + 0.5) * 1e-12
    detector = Detector()
    once = detector.sensitivity(t_s, light)
    assert once == pytest.approx(
        detector.sensitivity(t_s + 300e-9, light), abs=1e-6
    )  # 1e-6 of 333 ps: rounding
    assert ((once >= 0) & (once <= 1)).all()
    assert once.mean() == pytest.approx(width_s / 100e-9, abs=1e-5)  # midpoint rule at 1 ps
    assert detector.background_hz(light) == pytest.approx(510 * width_s / 100e-9)


def test_free_running_is_always_open_and_unbiased_never():
    t_s = np.linspace(0, 1e-7, 50)
    detector = Detector()
    assert (detector.sensitivity(t_s, OPEN) == 1).all()
    assert detector.background_hz(OPEN) == 510
    for gated in (False, True):
        dark = LightState(biased=False, gated=gated)
        assert (detector.sensitivity(t_s, dark) == 0).all()
        assert detector.background_hz(dark) == 0


def test_background_is_even_over_the_period_or_has_the_shape_of_the_gate():
    rng = np.random.default_rng(8)
    detector = Detector()
    free_s = detector.background_times(OPEN, 40.0, rng)
    assert kstest(free_s / 100e-9, "uniform").pvalue > 1e-6
    gated_s = detector.background_times(GATED, 1000.0, rng)
    assert len(gated_s) == pytest.approx(204_000, abs=5 * np.sqrt(204_000))
    t_s = np.arange(32.5e-9, 73.5e-9, 1e-12)
    below = np.cumsum(detector.sensitivity(t_s, GATED)) * 1e-12 / 40e-9
    assert kstest(gated_s, lambda t: np.interp(t, t_s + 0.5e-12, below)).pvalue > 1e-6
