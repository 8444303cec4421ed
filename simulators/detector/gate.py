"""When the gate lets the detector detect: linear edges, and the ringing of the excess bias after opening."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.bench import LightState

#: A linear edge takes this many times as long from 0 to 1 as from 0.2 to 0.8.
FULL_EDGE = 1 / 0.6

#: After so many decays ringing is taken to be no less.
DECAYS = 40


@dataclass(frozen=True)
class Ringing:
    """Sensitivity 1 + a exp(-t/d) sin(2 pi f t), a time t after the gate is fully open.

    Attributes
    ----------
    overshoot
        a: envelope of the ringing where the gate is fully open (0.07; 0.05 to 0.10, unconfirmed). 0 is off.
    decay_s
        d: time constant [s] (1.5 ns; 1 to 2 ns, unconfirmed).
    frequency_hz
        f [Hz] (500 MHz, unconfirmed).
    """

    overshoot: float = 0.0
    decay_s: float = 1.5e-9
    frequency_hz: float = 500e6

    @property
    def swing(self) -> tuple[float, float, float]:
        """a, d [s] and 2 pi f [1/s], for compiled code."""
        return self.overshoot, self.decay_s, 2 * np.pi * self.frequency_hz

    @property
    def peak(self) -> float:
        """No sensitivity is above this."""
        return 1 + self.overshoot

    def factor(self, open_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sensitivity at times after the gate is fully open [s]; 1 before."""
        if not self.overshoot:
            return np.ones_like(open_s)
        since_s = np.maximum(open_s, 0.0)
        swing = np.sin(2 * np.pi * self.frequency_hz * since_s) * np.exp(-since_s / self.decay_s)
        return 1 + self.overshoot * swing

    @property
    def added_s(self) -> float:
        """What the ringing adds to the gate's width, for a gate much longer than it [s]."""
        turns = 2 * np.pi * self.frequency_hz * self.decay_s
        return float(self.overshoot * self.decay_s * turns / (1 + turns**2))


def gates(light: LightState) -> bool:
    """Return whether there is a gate that is ever closed."""
    return light.gated and light.gate_width_s * light.repetition_hz < 1


def opening_s(light: LightState, edge_s: float) -> float:
    """Return when the gate begins to open after the sync pulse [s]."""
    return light.gate_delay_s - edge_s * FULL_EDGE / 2


def sensitivity(
    arrival_s: NDArray[np.float64], light: LightState, edge_s: float, ringing: Ringing
) -> NDArray[np.float64]:
    """Return what part of the photons arriving at these times after sync may be detected; see `Detector`."""
    if not light.sensitive:
        return np.zeros_like(arrival_s)
    if not gates(light):
        return np.ones_like(arrival_s)
    full_s, period_s = edge_s * FULL_EDGE, 1 / light.repetition_hz
    into = (arrival_s - opening_s(light, edge_s)) % period_s  # since the edge began to open
    beyond = into + period_s - light.gate_width_s  # since it began to close, one period before
    opening, closing = into / full_s, (into - light.gate_width_s) / full_s
    shape = np.clip(opening, 0, 1) - np.clip(closing, 0, 1) + 1 - np.clip(beyond / full_s, 0, 1)
    return shape * ringing.factor(into - full_s) if ringing.overshoot else shape


def ever_open(first_s: float, last_s: float, light: LightState, edge_s: float) -> bool:
    """Return whether any light that arrives between two times after sync [s] may be detected."""
    if not light.sensitive or not gates(light):
        return light.sensitive
    into_s = (first_s - opening_s(light, edge_s)) % (1 / light.repetition_hz)
    open_s = light.gate_width_s + edge_s * FULL_EDGE
    return into_s < open_s or into_s + last_s - first_s > 1 / light.repetition_hz


def passing(
    arrival_s: NDArray[np.float64],
    light: LightState,
    edge_s: float,
    ringing: Ringing,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Draw which photons arriving at these times after sync may be detected: each with `sensitivity`.

    That is as seen through ``ringing.peak``: so many times more photons must arrive as the peak is above 1.
    """
    if not (light.sensitive and len(arrival_s)):  # handing the generator over takes as long as 2000 draws
        return np.empty(0, np.int64)
    gate_s, swing = (0.0, 0.0, np.inf), (0.0, 1.0, 0.0)
    if gates(light):
        gate_s = (opening_s(light, edge_s), edge_s * FULL_EDGE, light.gate_width_s)
        swing = ringing.swing
    most = ringing.peak if light.gated else 1.0
    return np.asarray(_passing(arrival_s, gate_s, 1 / light.repetition_hz, swing, most, rng))


@njit(cache=True, error_model="numpy", nogil=True)
def _passing(arrival, gate, period, swing, most, rng):  # type: ignore[no-untyped-def]
    """Compare a uniform draw with the sensitivity, and return who passes.

    The ringing is worked out only where it decides: after so many decays it is at most ``left``.
    """
    (opening, full, width), (overshoot, decay, _) = gate, swing
    left = overshoot * np.exp(-np.arange(DECAYS))
    passing, kept, per_s = np.empty(len(arrival), np.int64), 0, 1.0 / period
    for i in range(len(arrival)):
        into = arrival[i] - opening
        into -= np.floor(into * per_s) * period
        level = rng.random() * most
        edges = 1.0
        if not full <= into <= min(width, period - full):  # else the quotients below all say the same
            edges = min(into / full, 1.0) - min(max((into - width) / full, 0.0), 1.0)
            edges += 1.0 - min((into + period - width) / full, 1.0)
        since = into - full
        if since > 0.0:
            at_most = left[min(int(since / decay), DECAYS - 1)]
            if edges * (1.0 - at_most) < level < edges * (1.0 + at_most):
                edges *= _factor(since, swing)
        passing[kept] = i
        kept += level < edges
    return passing[:kept]


@njit(cache=True, error_model="numpy", nogil=True)
def _factor(since, swing):  # type: ignore[no-untyped-def]
    """Return the sensitivity a time after the gate is fully open."""
    overshoot, decay, turn = swing
    return 1.0 + overshoot * np.sin(turn * since) * np.exp(-since / decay)


def times_inside(
    expected: float, light: LightState, edge_s: float, ringing: Ringing, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw times after the sync [s] with the shape of the sensitivity, or evenly over the period.

    So many are expected, ringing left out. Without laser pulses the gate runs on at the laser's repetition
    rate.
    """
    if not gates(light):
        return rng.random(rng.poisson(expected)) / light.repetition_hz
    number = rng.poisson(expected * ringing.peak)
    if not number:
        return np.empty(0)
    full_s = edge_s * FULL_EDGE
    return np.asarray(_inside(number, light.gate_delay_s, light.gate_width_s, full_s, ringing.swing, rng))


@njit(cache=True, error_model="numpy", nogil=True)
def _inside(number, delay, width, full, swing, rng):  # type: ignore[no-untyped-def]
    """Draw from two boxes convolved, the gate's trapezium, and leave out what ringing keeps out."""
    times, kept = np.empty(number), 0
    for i in range(number):
        times[i] = delay + rng.random() * width
    for i in range(number):
        times[i] += (rng.random() - 0.5) * full
    if swing[0] == 0.0:
        return times
    for i in range(number):
        level = rng.random() * (1.0 + swing[0])
        times[kept] = times[i]
        kept += level < _factor(max(times[i] - delay - full / 2, 0.0), swing)
    return times[:kept]
