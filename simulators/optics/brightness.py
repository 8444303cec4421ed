"""Light made brighter or weaker by one factor, so that a bench counts as many photons as a real one did."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from simulators.bench import Detections, LightState, Photons, Spot, moves
from simulators.track import Track

#: Steps towards the wanted rate, two or three of which are enough where the counted rate is nearly
#: proportional to the light; bright light, of which the hold-off hides much, takes more.
STEPS = 25


@dataclass(frozen=True)
class Brightened:
    """Photons of a bench whose laser, mirrors and lenses pass ``factor`` times the light."""

    photons: Photons
    factor: float

    def at(self, bench_s: float) -> Self:
        """Return what is detected from a bench time on, of a scene that moves."""
        photons = self.photons
        return replace(self, photons=photons.at(bench_s) if moves(photons) else photons)

    def detections(
        self, laser_spot_m: Spot, light: LightState, duration_s: float, rng: np.random.Generator
    ) -> Detections:
        """Draw the detections of ``duration_s``."""
        return self.photons.detections(laser_spot_m, self._scaled(light), duration_s, rng)

    def detections_along(self, track: Track, light: LightState, rng: np.random.Generator) -> Detections:
        """Draw the detections while the laser spot goes its way."""
        return self.photons.detections_along(track, self._scaled(light), rng)

    def rate_hz(self, laser_spot_m: Spot, light: LightState) -> float:
        """Return the expected detections a second."""
        return self.photons.rate_hz(laser_spot_m, self._scaled(light))

    def _scaled(self, light: LightState) -> LightState:
        return replace(light, power=light.power * self.factor)


def tuned(
    channels: Sequence[Photons], spots_m: Sequence[Spot], light: LightState, rate_hz: float
) -> tuple[Brightened, ...]:
    """Choose the factor with which the mean rate over some laser spots and all channels is ``rate_hz``.

    Raises
    ------
    ValueError
        If no factor does: nothing but background is counted, or the background alone, or the hold-off, is in
        the way.
    """
    factor = 1.0
    for _ in range(STEPS):
        bright = tuple(Brightened(photons, factor) for photons in channels)
        mean_hz = float(np.mean([one.rate_hz(spot, light) for one in bright for spot in spots_m]))
        dark_hz = float(np.mean([one.rate_hz(spots_m[0], replace(light, emitting=False)) for one in bright]))
        if mean_hz <= dark_hz * (1 + 1e-9) or rate_hz <= dark_hz:
            break
        if abs(mean_hz / rate_hz - 1) < 1e-3:
            return bright
        factor *= (rate_hz - dark_hz) / (mean_hz - dark_hz)
    raise ValueError(
        f"no brightness gives {rate_hz:g} counts a second: {mean_hz:g} are counted, {dark_hz:g} in the dark"
    )
