"""Light of the first bounce that gets past the gate: trapped carriers, stray reflections, failed gates.

The paper (Methods, raw data of the office scene) names these as the likely sources of its artefacts. All
strengths here are unconfirmed; each is off where it is 0.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b
from math import dist, hypot

import numpy as np
from numpy.typing import NDArray

from simulators.bench import BenchGeometry, LightState, Spot
from simulators.constants import C_M_PER_S
from simulators.track import Track, distance_m

#: What part of the photons arriving at some times after sync is detected.
Sensitivity = Callable[[NDArray[np.float64], LightState], NDArray[np.float64]]

#: Positions are told apart by cells of the wall of this size [m].
CELL_M = 0.01


@dataclass(frozen=True)
class FirstBounce:
    """What the first bounce leaves in the record.

    Attributes
    ----------
    per_pulse
        Detections that a full-power pulse's first bounce would make in a linear detector without a gate: 1e4
        to 1e5 times the 0.02 of the hidden scene (1000; order of magnitude). It scales the memory.
    memory
        Fraction of the carriers of gated-off light that come to the junction later (1e-6 to 1e-4; Dalla Mora
        et al., J. Appl. Phys. 2015, for the effect): a pedestal that decays inside the gate.
    memory_decay_s
        Time constant of the pedestal [s] (30 ns; tens of ns).
    reflection_per_pulse
        Detections a pulse from each stray reflection, 1 m from the laser spot, before the gate.
    reflectors_m
        Places outside the wall that reflect the laser spot into the lens. Their delay grows nearly linearly
        across the wall: straight lines in the raw data.
    failed_fraction
        Fraction of positions at which the gate does not block the first bounce, drawn by cells of the wall.
    failed_radius_m
        It also fails at this distance from the detector's spot, and nearer [m].
    failed_per_pulse
        Detections a pulse where it fails: a peak that fills a 16-bit counter within 1 s.
    seed
        Seed of the map of failures.
    """

    per_pulse: float = 1000.0
    memory: float = 0.0
    memory_decay_s: float = 30e-9
    reflection_per_pulse: float = 0.0
    reflectors_m: tuple[Spot, ...] = ((1.6, -0.4, 0.8), (-1.5, 0.7, 0.4), (0.3, -1.4, 1.1))
    failed_fraction: float = 0.0
    failed_radius_m: float = 0.0
    failed_per_pulse: float = 0.2
    seed: int = 0

    def arrivals(
        self, spot_m: Spot, geometry: BenchGeometry, pulses: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw arrivals of reflections and memory for so many full-power pulses [s after sync].

        The gate has yet to pass them; neither the pulse's width nor the response is in them.
        """
        if not (self.memory or self.reflection_per_pulse):
            return np.empty(0)
        times_s = [
            np.full(rng.poisson(per_pulse * pulses), arrival_s)
            for arrival_s, per_pulse in self._reflections(spot_m, geometry)
        ]
        trapped = rng.poisson(self.per_pulse * self.memory * pulses)
        waits_s = self.memory_decay_s * rng.standard_exponential(trapped)
        times_s.append(direct_s(spot_m, geometry) + waits_s)
        return np.concatenate(times_s)

    def passing_the_gate(
        self,
        spot_m: Spot,
        detector_spot_m: Spot,
        geometry: BenchGeometry,
        pulses: float,
        rng: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Draw the first bounce itself where the gate fails to block it [s after sync]."""
        if not self.fails(spot_m, detector_spot_m):
            return np.empty(0)
        return np.full(rng.poisson(self.failed_per_pulse * pulses), direct_s(spot_m, geometry))

    def arrivals_along(
        self, track: Track, geometry: BenchGeometry, pulses: float, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw `arrivals` while the laser spot goes its way, and the moments when their pulses leave."""
        waiting = rng.random(rng.poisson(self.per_pulse * self.memory * pulses))
        waits_s = self.memory_decay_s * rng.standard_exponential(len(waiting))
        times_s, moments = [direct_along_s(track.at(waiting), geometry) + waits_s], [waiting]
        for place_m in self.reflectors_m if self.reflection_per_pulse else ():
            for knot in track.knots:
                per_pulse = self._reflected(dist(knot.spot_m, place_m))
                when = knot.moments(rng.poisson(per_pulse * pulses * knot.share), rng)
                spots_m = track.at(when)
                path_m = distance_m(spots_m, geometry.galvo_m) + distance_m(spots_m, place_m)
                path_m += dist(place_m, geometry.detector_head_m)
                times_s.append(geometry.electronics_delay_s + path_m / C_M_PER_S)
                moments.append(when)
        return np.concatenate(times_s), np.concatenate(moments)

    def passing_the_gate_along(
        self,
        track: Track,
        detector_spot_m: Spot,
        geometry: BenchGeometry,
        pulses: float,
        rng: np.random.Generator,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw `passing_the_gate` while the laser spot goes its way, and when the pulses leave."""
        if not (self.failed_fraction or self.failed_radius_m):
            return np.empty(0), np.empty(0)
        failing = np.flatnonzero([self.fails(tuple(spot), detector_spot_m) for spot in track.spots_m[1:]])
        steps = len(track.spots_m) - 1
        number = rng.poisson(self.failed_per_pulse * pulses * len(failing) / steps)
        moments = (rng.choice(failing, number) + rng.random(number)) / steps if number else np.empty(0)
        return direct_along_s(track.at(moments), geometry), moments

    def fails(self, spot_m: Spot, detector_spot_m: Spot) -> bool:
        """Return whether the gate of a channel fails at this laser spot."""
        x_c, y_c, _ = detector_spot_m
        if hypot(spot_m[0] - x_c, spot_m[1] - y_c) <= self.failed_radius_m:
            return self.failed_radius_m > 0
        if not self.failed_fraction:
            return False
        cell = [round(spot_m[axis] / CELL_M + 0.25) for axis in (0, 1)]  # a grid is on no edge
        # a digest stands for a draw: a new generator for each cell takes as long as a hundred photons
        digest = blake2b(struct.pack("<3q", self.seed, *cell), digest_size=8).digest()
        return int.from_bytes(digest, "little") < self.failed_fraction * 2**64

    def rate_hz(
        self,
        spot_m: Spot,
        detector_spot_m: Spot,
        geometry: BenchGeometry,
        light: LightState,
        sensitivity: Sensitivity,
    ) -> float:
        """Return what a ready detector detects a second of all of it, through a gate of this sensitivity."""
        per_pulse = self.failed_per_pulse if self.fails(spot_m, detector_spot_m) else 0.0
        for arrival_s, strength in self._reflections(spot_m, geometry):
            per_pulse += strength * float(sensitivity(np.array(arrival_s), light))
        if self.memory:
            # as many waits as are fine enough to see the gate's edges
            waits_s = -self.memory_decay_s * np.log1p(-(np.arange(4000) + 0.5) / 4000)
            seen = sensitivity(direct_s(spot_m, geometry) + waits_s, light).mean()
            per_pulse += self.per_pulse * self.memory * float(seen)
        return per_pulse * light.repetition_hz * light.received

    def _reflections(self, spot_m: Spot, geometry: BenchGeometry) -> list[tuple[float, float]]:
        """Return arrival [s] and detections a pulse of each reflection, which fall with distance squared."""
        if not self.reflection_per_pulse:
            return []
        there_m = dist(geometry.galvo_m, spot_m)
        found = []
        for place_m in self.reflectors_m:
            from_spot_m = dist(spot_m, place_m)
            path_m = there_m + from_spot_m + dist(place_m, geometry.detector_head_m)
            arrival_s = geometry.electronics_delay_s + path_m / C_M_PER_S
            found.append((arrival_s, self._reflected(from_spot_m)))
        return found

    def _reflected(self, from_spot_m: float) -> float:
        """Return the detections a pulse of a reflection so far from the laser spot."""
        return self.reflection_per_pulse / max(from_spot_m, 0.1) ** 2


def direct_s(spot_m: Spot, geometry: BenchGeometry) -> float:
    """Return when light straight from the laser spot to the lens arrives [s after sync]."""
    path_m = dist(geometry.galvo_m, spot_m) + dist(spot_m, geometry.detector_head_m)
    return geometry.electronics_delay_s + path_m / C_M_PER_S


def direct_along_s(spots_m: NDArray[np.float64], geometry: BenchGeometry) -> NDArray[np.float64]:
    """Return `direct_s` (N,) of (N, 3) spots."""
    path_m = distance_m(spots_m, geometry.galvo_m) + distance_m(spots_m, geometry.detector_head_m)
    return np.asarray(geometry.electronics_delay_s + path_m / C_M_PER_S)
