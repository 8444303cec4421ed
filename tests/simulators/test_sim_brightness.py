"""One factor makes a bench as bright as wanted, counted with its background and its hold-off."""

import re

import numpy as np
import pytest

from simulators.bench import LightState
from simulators.detector import Detector
from simulators.optics.brightness import tuned
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport

GATED = LightState(emitting=True, biased=True, gated=True, gate_delay_s=31.5e-9, gate_width_s=40e-9)
SPOTS = [(-0.5, 0.2, 0.0), (0.1, -0.3, 0.0), (0.6, 0.5, 0.0)]


@pytest.mark.parametrize("rate_hz", [5e3, 200e3, 2e6])
def test_the_mean_rate_is_the_one_asked_for(rate_hz):
    photons = HiddenScenePhotons(Transport.of_scene(scene("letters")), detector=Detector(holds_off=True))
    (bright,) = tuned([photons], SPOTS, GATED, rate_hz)
    assert np.mean([bright.rate_hz(spot, GATED) for spot in SPOTS]) == pytest.approx(rate_hz, rel=1e-3)
    rng = np.random.default_rng(0)
    counted = sum(len(bright.detections(spot, GATED, 0.02, rng)) for spot in SPOTS) / 3 / 0.02
    assert counted == pytest.approx(rate_hz, rel=1e-3 + 5 / np.sqrt(rate_hz * 0.06))


@pytest.mark.parametrize(("name", "rate_hz"), [("empty", 1e5), ("letters", 100.0), ("letters", 6e6)])
def test_what_no_factor_gives_is_refused(name, rate_hz):
    """Nothing to see; less than the background; more than every second gate."""
    photons = HiddenScenePhotons(Transport.of_scene(scene(name)), detector=Detector(holds_off=True))
    with pytest.raises(ValueError, match=re.escape(f"no brightness gives {rate_hz:g} counts")):
        tuned([photons], SPOTS, GATED, rate_hz)
