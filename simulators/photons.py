"""What one channel of the detector sees: light of a hidden scene, stray light and background."""

from collections.abc import Iterable, Sequence
from math import dist

import numpy as np
from numpy.typing import NDArray

from simulators.bench import BenchGeometry, Detections, LightState, Spot
from simulators.constants import C_M_PER_S
from simulators.detector import Detector
from simulators.detector.first_bounce import FirstBounce, direct_along_s, direct_s
from simulators.detector.response import sigma_s, spread
from simulators.optics.light import Optics
from simulators.track import Knot, Track, distance_m
from simulators.transport.light_paths import LightPaths, Renderer

#: A pulse's light comes within so many widths of its middle; the gate is asked whether any of it can pass.
PULSE_SPAN = 3.0


class HiddenScenePhotons:
    """Detections of light that went laser, wall, hidden surfaces, wall, detector; satisfies `bench.Photons`.

    A photon is detected at

        electronics_delay + |galvo - x_p|/c + path/c + |x_c - head|/c + pulse + response ,

    where three bounces have the path |x_p - x| + |x - x_c|, after its sync pulse, folded into one sync
    period. Pulse and response have their Gaussian cores about zero, so peaks stand where the geometry puts
    them; the response's tail delays the mean by ``tail_fraction * tail_s``. The whole electronics delay is
    counted before the light leaves the galvo, so that the time at the detector, which the gate goes by, is
    that at the timing input but for the response.

    Parameters
    ----------
    renderer
        What is hidden.
    geometry
        Where galvo and detector head are; the delay of the electronics.
    optics
        Laser, wall and lens.
    detector
        Detector and electronics.
    first_bounce
        What the first bounce leaves in the record although the gate is closed; by default nothing.
    detector_spot_m
        The spot on the wall that the channel looks at [m].
    """

    def __init__(
        self,
        renderer: Renderer,
        geometry: BenchGeometry | None = None,
        optics: Optics | None = None,
        detector: Detector | None = None,
        first_bounce: FirstBounce | None = None,
        *,
        detector_spot_m: Spot = (0.0, 0.0, 0.0),
    ) -> None:
        self.geometry = geometry or BenchGeometry()
        self.optics = optics or Optics()
        self.detector = detector or Detector()
        self.first_bounce = first_bounce or FirstBounce()
        self.detector_spot_m = detector_spot_m
        self._light_paths = renderer.light_paths(detector_spot_m)
        collection_m2 = self.optics.collection_m2(self.geometry.detector_head_m, detector_spot_m)
        per_photon_m2 = collection_m2 * self.detector.efficiency
        self._detections_m2_hz = self.optics.photons_per_s * per_photon_m2

    def detections(
        self, laser_spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> Detections:
        """Draw the detections of ``duration_s``, times after sync folded into one period [s]."""
        seen_s = [self.detector.background_times(light, duration_s, rng)]
        if light.sensitive and light.received > 0:
            peak = self.detector.ringing.peak if light.gated else 1.0
            arrivals_s = self._arrivals_s(laser_spot_m, light, duration_s * peak, rng)
            seen_s.append(arrivals_s[self.detector.passing(arrivals_s, light, rng)])
            if light.gated:
                seen_s.append(self._past_the_gate_s(laser_spot_m, light, duration_s, rng))
        return self.detector.detect(np.concatenate(seen_s), light, duration_s, rng)

    def detections_along(self, track: Track, light: LightState, rng: np.random.Generator) -> Detections:
        """Draw the detections while the laser spot goes its way, times after sync folded into one period [s].

        Each photon's path begins where the spot is when its pulse leaves; how much light goes which way is
        that of the knots, see `simulators.track`.
        """
        background_s = self.detector.background_times(light, track.duration_s, rng)
        seen = [(background_s, rng.random(len(background_s)))]
        if light.sensitive and light.received > 0:
            arrivals_s, moments = self._arrivals_along(track, light, rng)
            passing = self.detector.passing(arrivals_s, light, rng)
            seen.append((arrivals_s[passing], moments[passing]))
            if light.gated:
                seen.append(self._past_the_gate_along(track, light, rng))
        seen_s, moments = _together(seen)
        return self.detector.detect(seen_s, light, track.duration_s, rng, moments)

    def rate_hz(self, laser_spot_m: Spot, light: LightState) -> float:
        """Return the expected detections a second; the gate's edges are met at the patches' centres."""
        seen_hz = self.detector.background_hz(light)
        if light.sensitive and light.received > 0:
            seen_hz += self._light_hz(laser_spot_m, light)
        return self.detector.detected_hz(seen_hz, light)

    def _lit(self, duration_s: float) -> Iterable[tuple[tuple[LightPaths, ...], float]]:
        """Return the light of the scene, and how long [s] it is as it is, until a time is over."""
        return ((self._light_paths, duration_s),)

    def _light_hz(self, laser_spot_m: Spot, light: LightState) -> float:
        seen_per_m2 = 0.0
        light_paths, _ = next(iter(self._lit(0.0)))
        for paths in light_paths:
            weight_per_m2, path_m = paths.arrivals(laser_spot_m)
            arrival_s = self._outside_s(laser_spot_m) + path_m / C_M_PER_S
            seen_per_m2 += float(weight_per_m2 @ self.detector.sensitivity(arrival_s, light))
        stray = float(self.detector.sensitivity(np.array(direct_s(laser_spot_m, self.geometry)), light))
        stray_hz = self.optics.stray_per_pulse * light.repetition_hz * stray
        light_hz = light.received * (self._detections_m2_hz * seen_per_m2 + stray_hz)
        if light.gated:
            light_hz += self.first_bounce.rate_hz(
                laser_spot_m, self.detector_spot_m, self.geometry, light, self.detector.sensitivity
            )
        return light_hz

    def _arrivals_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw all light that the gate has yet to pass."""
        arrivals_s = [self._hidden_s(spot_m, light, duration_s, rng)]
        arrivals_s.append(self._stray_s(spot_m, light, duration_s, rng))
        if light.gated:
            pulses = duration_s * light.repetition_hz * light.received
            late_s = self.first_bounce.arrivals(spot_m, self.geometry, pulses, rng)
            arrivals_s.append(self._of_pulses(late_s, rng))
        return np.concatenate(arrivals_s)

    def _past_the_gate_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw the first bounce where the gate fails."""
        pulses = duration_s * light.repetition_hz * light.received
        early_s = self.first_bounce.passing_the_gate(spot_m, self.detector_spot_m, self.geometry, pulses, rng)
        return self._of_pulses(early_s, rng)

    def _hidden_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Light of the hidden scene, bounce by bounce."""
        drawn_m = []
        for light_paths, lit_s in self._lit(duration_s):
            for paths in light_paths:
                expected = self._detections_m2_hz * light.received * lit_s * paths.flux(spot_m)
                drawn_m.append(paths.sample(spot_m, rng.poisson(expected), rng))
        arrivals_s = np.concatenate(drawn_m)
        arrivals_s /= C_M_PER_S
        arrivals_s += self._outside_s(spot_m)
        return self._of_pulses(arrivals_s, rng)

    def _stray_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """First-bounce light: the laser spot itself, as the detector's lens sees it."""
        arrival_s = direct_s(spot_m, self.geometry)
        if not self._stray_may_pass(arrival_s, arrival_s, light):
            return np.empty(0)  # the gate keeps out all of it: nothing to draw
        per_s = self.optics.stray_per_pulse * light.repetition_hz * light.received
        number = rng.poisson(per_s * duration_s)
        return self._of_pulses(np.full(number, arrival_s), rng)

    def _of_pulses(self, times_s: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Spread times over the pulse's width, in place."""
        if len(times_s):  # handing the generator over takes as long as two thousand draws
            spread(times_s, sigma_s(self.optics.pulse_fwhm_s), rng)
        return times_s

    def _outside_s(self, spot_m: Spot) -> float:
        """Time from sync to laser spot, and from detector spot to timing input [s]."""
        there_m = dist(self.geometry.galvo_m, spot_m)
        back_m = dist(self.detector_spot_m, self.geometry.detector_head_m)
        return self.geometry.electronics_delay_s + (there_m + back_m) / C_M_PER_S

    def _arrivals_along(
        self, track: Track, light: LightState, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw all light that the gate has yet to pass, and the moments when its pulses leave."""
        peak = self.detector.ringing.peak if light.gated else 1.0
        lit_s = track.duration_s * peak * light.received
        drawn, begin_s = [], 0.0
        for light_paths, part_s in self._lit(track.duration_s):
            part = track.part(begin_s, begin_s + part_s)
            for paths in light_paths:
                for knot in part.knots:
                    power_s = lit_s * (part_s / track.duration_s) * knot.share
                    arrivals_s, moments = self._near(knot, paths, part, power_s, rng)
                    drawn.append((arrivals_s, (begin_s + moments * part_s) / track.duration_s))
            begin_s += part_s
        pulses = lit_s * light.repetition_hz
        direct = direct_along_s(track.spots_m, self.geometry)
        if self._stray_may_pass(float(direct.min()), float(direct.max()), light):
            moments = rng.random(rng.poisson(self.optics.stray_per_pulse * pulses))
            drawn.append((direct_along_s(track.at(moments), self.geometry), moments))
        if light.gated:
            drawn.append(self.first_bounce.arrivals_along(track, self.geometry, pulses, rng))
        arrivals_s, moments = _together(drawn)
        return self._of_pulses(arrivals_s, rng), moments

    def _near(
        self, knot: Knot, paths: LightPaths, track: Track, lit_s: float, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw light of the hidden scene that goes as from one knot, in ``lit_s`` of light at full power."""
        number = rng.poisson(self._detections_m2_hz * lit_s * paths.flux(knot.spot_m))
        moments = knot.moments(number, rng)
        spots_m = track.at(moments)
        path_m = distance_m(spots_m, self.geometry.galvo_m) + paths.sample(knot.spot_m, number, rng, spots_m)
        path_m += dist(self.detector_spot_m, self.geometry.detector_head_m)
        return self.geometry.electronics_delay_s + path_m / C_M_PER_S, moments

    def _past_the_gate_along(
        self, track: Track, light: LightState, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw the first bounce where the gate fails, and the moments when its pulses leave."""
        pulses = track.duration_s * light.repetition_hz * light.received
        early_s, moments = self.first_bounce.passing_the_gate_along(
            track, self.detector_spot_m, self.geometry, pulses, rng
        )
        return self._of_pulses(early_s, rng), moments

    def _stray_may_pass(self, first_s: float, last_s: float, light: LightState) -> bool:
        """Return whether the gate lets any light of pulses through that arrive between these times."""
        span_s = PULSE_SPAN * self.optics.pulse_fwhm_s
        return self.detector.ever_sensitive(first_s - span_s, last_s + span_s, light)


def _together(
    pairs: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.concatenate([times_s for times_s, _ in pairs]), np.concatenate([when for _, when in pairs])
