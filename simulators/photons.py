"""What the detector of the bench sees: light of a hidden scene, stray light and background."""

from math import dist

import numpy as np
from numpy.typing import NDArray

from simulators.bench import BenchGeometry, LightState
from simulators.constants import C_M_PER_S
from simulators.detector import FWHM_PER_SIGMA, Detector
from simulators.geometry import cut
from simulators.optics import Optics
from simulators.scenes import Scene
from simulators.transport import Transport

Spot = tuple[float, float, float]

#: Times, in pulse widths, at which the gate is asked whether any light of a pulse can pass.
PULSE_SPAN = np.linspace(-3, 3, 13)


class HiddenScenePhotons:
    """Detections of light that went laser, wall, hidden surfaces, wall, detector; satisfies `bench.Photons`.

    A photon is detected at

        electronics_delay + |galvo - x_p|/c + path/c + |x_c - head|/c + pulse + response ,

    where three bounces have the path |x_p - x| + |x - x_c|, after its sync pulse, folded into one sync
    period. Pulse and response have their Gaussian cores about zero, so peaks stand where the geometry puts
    them; the response's tail delays the mean by ``tail_fraction * tail_s``. The whole electronics delay is
    counted before the light leaves the galvo, so
    that the time at the detector, which the gate goes by, is that at the timing input but for the response.

    Left out so far: dead time and pile-up, afterpulses, ringing of the gate.

    Parameters
    ----------
    scene
        What is hidden.
    geometry
        Where galvo, detector head and detector spot are; the delay of the electronics.
    optics
        Laser, wall and lens.
    detector
        Detector and electronics.
    bounces
        3, 4 or 5, see `simulators.transport.Transport`.

    Raises
    ------
    ValueError
        If so many bounces cannot be followed.
    """

    def __init__(
        self,
        scene: Scene,
        geometry: BenchGeometry | None = None,
        optics: Optics | None = None,
        detector: Detector | None = None,
        *,
        bounces: int = 3,
    ) -> None:
        self.geometry = geometry or BenchGeometry()
        self.optics = optics or Optics()
        self.detector = detector or Detector()
        albedo = self.optics.wall_albedo
        light = Transport(cut(scene), scene.triangles_m, bounces=bounces, wall_albedo=albedo)
        self._ways = light.towards(self.geometry.detector_spot_m)
        per_photon_m2 = self.optics.collection_m2(self.geometry) * self.detector.efficiency
        self._detections_m2_hz = self.optics.photons_per_s * per_photon_m2
        self._lit: tuple[Spot, list[NDArray[np.float64]]] | None = None

    def detections(
        self, laser_spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw the detections of ``duration_s``: times after sync at the timing input [s], shuffled."""
        if not light.biased:
            return np.empty(0)
        background = rng.poisson(self.detector.background_hz(light) * duration_s)
        times_s = [self.detector.background_times(background, light, rng)]
        if light.emitting and light.power > 0:
            arrivals_s = np.concatenate(
                [
                    self._hidden_s(laser_spot_m, light, duration_s, rng),
                    self._stray_s(laser_spot_m, light, duration_s, rng),
                ]
            )
            seen_s = arrivals_s[rng.random(len(arrivals_s)) < self.detector.sensitivity(arrivals_s, light)]
            times_s.append(seen_s + self.detector.delays(len(seen_s), rng))
        shuffled_s = np.concatenate(times_s)
        rng.shuffle(shuffled_s)
        return shuffled_s % (1 / light.repetition_hz)

    def rate_hz(self, laser_spot_m: Spot, light: LightState) -> float:
        """Return the expected detections a second; the gate's edges are met at the patches' centres."""
        rate_hz = self.detector.background_hz(light)
        if not (light.biased and light.emitting):
            return rate_hz
        seen_per_m2 = 0.0
        for way in self._ways:
            weight_per_m2, path_m = way.arrivals(laser_spot_m)
            arrival_s = self._legs_s(laser_spot_m) + path_m / C_M_PER_S
            seen_per_m2 += float(weight_per_m2 @ self.detector.sensitivity(arrival_s, light))
        stray = float(self.detector.sensitivity(self._stray_arrival_s(laser_spot_m), light))
        stray_hz = self.optics.stray_per_pulse * light.repetition_hz * stray
        return rate_hz + light.power * (self._detections_m2_hz * seen_per_m2 + stray_hz)

    def _hidden_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Light of the hidden scene, bounce by bounce."""
        paths_m = []
        for way, weight_per_m2 in zip(self._ways, self._from_spot(spot_m), strict=True):
            expected = self._detections_m2_hz * light.power * duration_s * float(weight_per_m2.sum())
            paths_m.append(way.random_paths(spot_m, weight_per_m2, rng.poisson(expected), rng))
        path_m = np.concatenate(paths_m)
        return self._legs_s(spot_m) + path_m / C_M_PER_S + self._pulse_s(len(path_m), rng)

    def _stray_s(
        self, spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """First-bounce light: the laser spot itself, as the detector's lens sees it."""
        arrival_s = self._stray_arrival_s(spot_m)
        span_s = arrival_s + PULSE_SPAN * self.optics.pulse_fwhm_s
        if not self.detector.sensitivity(span_s, light).any():
            return np.empty(0)  # the gate keeps out all of it: nothing to draw
        per_s = self.optics.stray_per_pulse * light.repetition_hz * light.power
        number = rng.poisson(per_s * duration_s)
        return arrival_s + self._pulse_s(number, rng)

    def _pulse_s(self, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
        return self.optics.pulse_fwhm_s / FWHM_PER_SIGMA * rng.standard_normal(number)

    def _from_spot(self, spot_m: Spot) -> list[NDArray[np.float64]]:
        """Weights of each way's patches; the last spot is remembered, for exposures without movement."""
        if self._lit is None or self._lit[0] != spot_m:
            self._lit = (spot_m, [way.from_spot(spot_m)[0] for way in self._ways])
        return self._lit[1]

    def _legs_s(self, spot_m: Spot) -> float:
        """Time from sync to laser spot, and from detector spot to timing input [s]."""
        there_m = dist(self.geometry.galvo_m, spot_m)
        back_m = dist(self.geometry.detector_spot_m, self.geometry.detector_head_m)
        return self.geometry.electronics_delay_s + (there_m + back_m) / C_M_PER_S

    def _stray_arrival_s(self, spot_m: Spot) -> NDArray[np.float64]:
        """When light straight from the laser spot to the lens arrives; no light goes along a flat wall."""
        path_m = dist(self.geometry.galvo_m, spot_m) + dist(spot_m, self.geometry.detector_head_m)
        return np.array(self.geometry.electronics_delay_s + path_m / C_M_PER_S)
