"""Detections with interreflections: as many as the rate says, when the transport says."""

import numpy as np
import pytest
from scipy.stats import chi2

from simulators.bench import BenchGeometry, LightState
from simulators.constants import C_M_PER_S
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport
from support.exact_light import EXACT, NO_STRAY

SPOT = (0.3, 0.2, 0.0)
FREE = LightState(emitting=True, biased=True)
GEOMETRY = BenchGeometry(galvo_m=(0.0, 0.0, 1.0), detector_head_m=(0.0, 0.0, 1.0), electronics_delay_s=0.0)


@pytest.fixture(scope="module")
def five():
    return HiddenScenePhotons(Transport.of_scene(scene("shelf"), bounces=5), GEOMETRY, NO_STRAY, EXACT)


def test_more_bounces_are_more_light(five):
    three, four = (
        HiddenScenePhotons(Transport.of_scene(scene("shelf"), bounces=n), GEOMETRY, NO_STRAY, EXACT).rate_hz(
            SPOT, FREE
        )
        for n in (3, 4)
    )
    assert three < four < five.rate_hz(SPOT, FREE) < 1.5 * three


def test_counts_are_the_rate_and_times_are_the_transient(five):
    """5 sigma; chi-square in bins of 0.4 ns, twelve times those of the tails."""
    duration_s = 100_000 / five.rate_hz(SPOT, FREE)
    times_s = five.detections(SPOT, FREE, duration_s, np.random.default_rng(6)).time_s
    assert len(times_s) == pytest.approx(100_000, abs=5 * np.sqrt(100_000))
    legs_s = (np.linalg.norm(np.subtract(SPOT, GEOMETRY.galvo_m)) + 1.0) / C_M_PER_S
    edges_s = np.arange(6e-9, 40e-9, 0.4e-9)
    built = scene("shelf")
    spots = np.array([SPOT]), np.zeros((1, 3))
    expected = Transport.of_scene(built, bounces=5).transients(*spots, edges_s)[0]
    drawn, _ = np.histogram(times_s - legs_s, edges_s)
    expected *= len(times_s) / expected.sum()
    enough = expected > 20
    statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
    assert statistic < chi2.isf(1e-6, enough.sum())


def test_impossible_numbers_of_bounces_are_refused():
    with pytest.raises(ValueError, match="2 bounces cannot be followed: choose 3, 4 or 5"):
        Transport.of_scene(scene("point"), bounces=2)
