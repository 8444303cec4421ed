"""The detector put together: what it counts by itself, what it misses, and how it blurs time."""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.bench import Detections, LightState, no_detections
from simulators.detector import gate
from simulators.detector.dead_time import Afterpulsing, avalanches, detected_hz, fold, in_order
from simulators.detector.gate import Ringing
from simulators.detector.response import delays, sigma_s


@dataclass(frozen=True)
class Detector:
    """A silicon single-photon avalanche diode and the electronics up to the timing input.

    By default it is ideal but for its gate's edges, its background and its response in time: ringing,
    hold-off and afterpulses are off.

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
    ringing
        Of the sensitivity after the gate opens.
    holds_off
        Whether the detector is off for `LightState.hold_off_s` after a detection (the paper's dead time is
        100 ns), so that the first photon of a gate wins.
    afterpulsing
        Carriers trapped in an avalanche.
    """

    efficiency: float = 0.30
    dark_hz: float = 10.0
    ambient_hz: float = 500.0
    jitter_fwhm_s: float = 30e-12
    tail_s: float = 53e-12
    tail_fraction: float = 0.07
    electronics_fwhm_s: float = 46e-12
    gate_edge_s: float = 200e-12
    ringing: Ringing = field(default_factory=Ringing)
    holds_off: bool = False
    afterpulsing: Afterpulsing = field(default_factory=Afterpulsing)

    def sensitivity(self, arrival_s: NDArray[np.float64], light: LightState) -> NDArray[np.float64]:
        """Return what part of the photons arriving at the detector at these times after sync may be detected.

        The gate repeats with the sync. Its sensitivity is one half at ``gate_delay_s`` and
        ``gate_delay_s + gate_width_s``, exactly zero further than half an edge outside and one further than
        half an edge inside, where ringing makes it a little more or less, at most ``ringing.peak``.
        """
        return gate.sensitivity(arrival_s, light, self.gate_edge_s, self.ringing)

    def ever_sensitive(self, first_s: float, last_s: float, light: LightState) -> bool:
        """Return whether any photon may be detected that arrives between two times after sync [s]."""
        return gate.ever_open(first_s, last_s, light, self.gate_edge_s)

    def passing(
        self,
        arrival_s: NDArray[np.float64],
        light: LightState,
        rng: np.random.Generator,
    ) -> NDArray[np.int64]:
        """Draw which of the photons arriving at these (n,) times after sync [s] may be detected.

        Ringing lets more than one of one pass: give `ringing`.peak times as many photons as arrive.

        Returns
        -------
        ndarray
            Places of those that pass, ascending.
        """
        return gate.passing(arrival_s, light, self.gate_edge_s, self.ringing, rng)

    def background_hz(self, light: LightState) -> float:
        """Return dark and ambient counts a second, over open and closed times."""
        if not light.sensitive:
            return 0.0
        width_s = light.gate_width_s + self.ringing.added_s
        duty = width_s * light.repetition_hz if gate.gates(light) else 1.0
        return self._steady_hz(light) * duty

    def background_times(
        self, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw when dark and ambient counts fall, after the sync [s]: evenly while sensitive."""
        if not light.sensitive:
            return np.empty(0)
        duty = light.gate_width_s * light.repetition_hz if gate.gates(light) else 1.0
        expected = self._steady_hz(light) * duty * duration_s
        return gate.times_inside(expected, light, self.gate_edge_s, self.ringing, rng)

    def _steady_hz(self, light: LightState) -> float:
        """Return dark counts and steady light, counts a second while sensitive."""
        return self.dark_hz + (0.0 if light.covered else self.ambient_hz + light.lamp_hz)

    def detect(
        self,
        seen_s: NDArray[np.float64],
        light: LightState,
        duration_s: float,
        rng: np.random.Generator,
        moments: NDArray[np.float64] | None = None,
    ) -> Detections:
        """Make detections out of what a ready detector would detect in ``duration_s``.

        Parameters
        ----------
        seen_s
            (n,) times after the sync pulse [s] of photons that passed the gate, and of background.
        moments
            (n,) when that pulse comes, as a part of the duration; by default it is drawn evenly.
        """
        if not len(seen_s):
            return no_detections()
        period_s = 1 / light.repetition_hz
        pulse, time_s = _detected(
            seen_s,
            np.empty(0) if moments is None else moments,
            max(round(duration_s / period_s), 1),
            period_s,
            self._dead_s(light),
            (self.afterpulsing.probability, self.afterpulsing.decay_s),
            (sigma_s(self.jitter_fwhm_s, self.electronics_fwhm_s), self.tail_s, self.tail_fraction),
            rng,
        )
        return Detections(pulse, time_s)

    def _dead_s(self, light: LightState) -> tuple[float, float, float]:
        """Return how long the detector is off, as `avalanches` takes it."""
        hold_s = light.hold_off_s if self.holds_off else -1.0
        if not gate.gates(light):
            return hold_s, 0.0, -1.0
        open_s = light.gate_width_s + self.gate_edge_s * gate.FULL_EDGE
        return hold_s, gate.opening_s(light, self.gate_edge_s), open_s

    def detected_hz(self, seen_hz: float, light: LightState) -> float:
        """Return the detections a second out of ``seen_hz`` that a ready detector would detect."""
        return detected_hz(seen_hz, light, holds_off=self.holds_off, afterpulsing=self.afterpulsing)


@njit(cache=True, error_model="numpy", nogil=True)
def _detected(seen, moments, pulses, period, dead, afterpulses, response, rng):  # type: ignore[no-untyped-def]
    """All that happens to events in the detector, at once: each call would hand the generator over again."""
    if len(moments) == 0:
        moments = np.empty(len(seen))
        for i in range(len(seen)):
            moments[i] = rng.random()
    pulse, time = in_order(seen, moments, pulses, period)
    if dead[0] >= 0.0 or afterpulses[0] > 0.0:
        pulse, time = avalanches(pulse, time, period, dead, afterpulses, rng)
    sigma, tail, fraction = response
    time += delays(len(time), sigma, tail, fraction, rng)
    fold(pulse, time, period)
    return pulse, time
