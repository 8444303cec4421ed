"""The gated single-photon detector: when it is sensitive, what it counts by itself, and how it blurs time."""

from dataclasses import dataclass
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from simulators.bench import LightState

#: Full width at half maximum of a Gaussian of unit standard deviation.
FWHM_PER_SIGMA = 2 * sqrt(2 * log(2))

#: A linear edge takes this many times as long from 0 to 1 as from 0.2 to 0.8.
FULL_EDGE = 1 / 0.6


@dataclass(frozen=True)
class Detector:
    """A silicon single-photon avalanche diode and the electronics up to the timing input.

    Attributes
    ----------
    efficiency
        Photon detection efficiency at 532 nm inside the gate (0.25 to 0.45 for such detectors; unconfirmed).
    dark_hz
        Dark counts a second while sensitive (10, the paper).
    ambient_hz
        Counts a second from room light while sensitive (unconfirmed; up to 1e5 with the lights on).
    jitter_fwhm_s
        Gaussian core of the detector's response [s] (30 ps, the paper).
    tail_s, tail_fraction
        Exponential tail of the response: time constant [s] (53 ps; Renna et al., IEEE Photonics J. 2020) and
        the fraction of detections delayed by it (0.07, unconfirmed).
    electronics_fwhm_s
        Gaussian response of sync, electronics and timing together [s]: what pulse and detector lack to the
        paper's 65 ps for the whole system.
    gate_edge_s
        Time that sensitivity takes from 20 to 80 %, opening and closing; the edges are taken as linear
        (200 ps; 110 to 300 ps published for such detectors).
    """

    efficiency: float = 0.30
    dark_hz: float = 10.0
    ambient_hz: float = 500.0
    jitter_fwhm_s: float = 30e-12
    tail_s: float = 53e-12
    tail_fraction: float = 0.07
    electronics_fwhm_s: float = 46e-12
    gate_edge_s: float = 200e-12

    def sensitivity(self, arrival_s: NDArray[np.float64], light: LightState) -> NDArray[np.float64]:
        """Return what part of the photons arriving at the detector at these times after sync may be detected.

        The gate repeats with the sync. Its sensitivity is one half at ``gate_delay_s`` and
        ``gate_delay_s + gate_width_s``, exactly zero further than half an edge outside and one further than
        half an edge inside.
        """
        if not light.biased:
            return np.zeros_like(arrival_s)
        if not _gates(light):
            return np.ones_like(arrival_s)
        edge_s, period_s = self.gate_edge_s * FULL_EDGE, 1 / light.repetition_hz
        into = (arrival_s - light.gate_delay_s + edge_s / 2) % period_s  # since the edge began to open
        beyond = into + period_s - light.gate_width_s  # since it began to close, one period before
        opening, closing = into / edge_s, (into - light.gate_width_s) / edge_s
        return np.clip(opening, 0, 1) - np.clip(closing, 0, 1) + 1 - np.clip(beyond / edge_s, 0, 1)

    def background_hz(self, light: LightState) -> float:
        """Return dark and ambient counts a second, over open and closed times."""
        if not light.biased:
            return 0.0
        duty = light.gate_width_s * light.repetition_hz if _gates(light) else 1.0
        return (self.dark_hz + self.ambient_hz) * duty

    def background_times(
        self, number: int, light: LightState, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw when dark and ambient counts fall, after the sync [s]: evenly while sensitive.

        Without laser pulses the gate runs on at the laser's repetition rate.
        """
        if not _gates(light):
            return rng.random(number) / light.repetition_hz
        edge_s = self.gate_edge_s * FULL_EDGE
        inside, edge = rng.random((2, number))  # two boxes convolved: the gate's trapezium
        return light.gate_delay_s + inside * light.gate_width_s + (edge - 0.5) * edge_s

    def delays(self, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw delays from arrival to timing input [s]: a Gaussian core about zero, and a tail after it."""
        sigma_s = sqrt(self.jitter_fwhm_s**2 + self.electronics_fwhm_s**2) / FWHM_PER_SIGMA
        delays_s = sigma_s * rng.standard_normal(number)
        late = np.flatnonzero(rng.random(number) < self.tail_fraction)
        delays_s[late] += self.tail_s * rng.standard_exponential(len(late))
        return delays_s


def _gates(light: LightState) -> bool:
    return light.gated and light.gate_width_s * light.repetition_hz < 1
