"""The triggers at sync and inputs: which pulses of the bench the instrument sees at all. No C.

A pulse lower than the level is not seen. A level near zero sees the noise of the line too, as often as
Gaussian noise crosses it: ``f exp(-level**2 / (2 noise**2))`` for a line that lets frequencies about ``f``
through (S. O. Rice, Bell System Technical Journal 24, 46, 1945).

The pulses are negative. Levels here are magnitudes, as the commands of a HydraHarp 400 have them; a negative
one is a positive level of an instrument with signs, which no pulse passes. Of all numbers only the range of
the levels is the instrument's; heights, noise and width are a choice.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from typing import Protocol

import numpy as np

from simulators.bench import Channel, Detections, Mark, Syncs, no_detections
from simulators.wire.harp.tagging import TaggedBench

#: The levels after Initialize (unconfirmed).
USUAL_LEVEL_V = 0.05
#: How often noise crosses a level of zero [Hz]: the bandwidth of the line (unconfirmed).
NOISE_BAND_HZ = 300e6
#: The input takes no more [Hz]: its dead time is 80 ns.
MOST_NOISE_HZ = 12.5e6
#: Noise that comes more rarely than this [Hz] is none.
FEWEST_NOISE_HZ = 1e-3


class Time(Protocol):
    """The time of a bench."""

    def now_s(self) -> float:
        """Return the bench time in seconds."""
        ...


class MeasuredBench(TaggedBench, Protocol):
    """What the instrument needs of a bench, here or in another process; see `simulators.bench.Bench`."""

    @property
    def channels(self) -> Sequence[Channel]:
        """The detector's channels."""
        ...

    @property
    def clock(self) -> Time:
        """The bench's clock."""
        ...

    def sync_rate_hz(self) -> float:
        """Return the sync pulses a second, now."""
        ...

    def count_rate_hz(self, channel: int) -> float:
        """Return the expected detections a second of a channel, by its number, now."""
        ...


@dataclass(frozen=True)
class Threshold:
    """Where an input makes an event.

    Attributes
    ----------
    level_v
        Depth that a pulse must reach [V].
    at_end
        Whether the event is where the pulse rises again, and not where it falls.
    """

    level_v: float = USUAL_LEVEL_V
    at_end: bool = False

    def is_passed_by(self, pulse_v: float) -> bool:
        """Tell whether pulses of this depth pass it."""
        return 0 <= self.level_v < pulse_v


@dataclass(frozen=True)
class Pulses:
    """How high the pulses at the instrument's inputs are.

    Attributes
    ----------
    sync_v, input_v
        Heights of the laser's sync pulses, and of the detector's [V].
    noise_v
        Noise of both lines, root mean square [V].
    width_s
        Their width [s], from the falling edge to the rising one; far below any sync period.
    """

    sync_v: float = 0.3
    input_v: float = 0.3
    noise_v: float = 2e-3
    width_s: float = 10e-9

    def noise_hz(self, level_v: float) -> float:
        """Return how often noise alone is taken for a pulse [Hz]."""
        rate_hz = NOISE_BAND_HZ * exp(-((level_v / self.noise_v) ** 2) / 2) if self.noise_v else 0.0
        return min(rate_hz, MOST_NOISE_HZ) if rate_hz > FEWEST_NOISE_HZ else 0.0


class Discriminators:
    """A bench as the instrument sees it through its discriminators; satisfies `MeasuredBench`.

    Noise at the sync raises its rate, and so shortens the period that the instrument knows.

    Parameters
    ----------
    bench
        The bench itself.
    inputs
        Number of inputs.
    pulses
        What comes to them.

    Attributes
    ----------
    sync, inputs
        Thresholds of sync and inputs.
    """

    def __init__(self, bench: MeasuredBench, inputs: int, pulses: Pulses) -> None:
        self._bench = bench
        self._inputs = inputs
        self._pulses = pulses
        self.reset()

    def reset(self) -> None:
        """Set the usual levels."""
        self.sync = Threshold()
        self.inputs = [Threshold()] * self._inputs

    @property
    def channels(self) -> Sequence[Channel]:
        """The detector's channels."""
        return self._bench.channels

    @property
    def clock(self) -> Time:
        """The bench's clock."""
        return self._bench.clock

    def sync_rate_hz(self) -> float:
        """Return the sync pulses a second that are seen, now."""
        return self._seen_sync_hz(self._bench.sync_rate_hz())

    def syncs_between(self, start_s: float, stop_s: float) -> Sequence[Syncs]:
        """Return how sync pulses were seen between two bench times."""
        return [
            Syncs(one.begin_s, one.end_s, self._seen_sync_hz(one.hz))
            for one in self._bench.syncs_between(start_s, stop_s)
        ]

    def count_rate_hz(self, channel: int) -> float:
        """Return the pulses a second that are seen of a channel, by its number, now."""
        threshold = self._threshold(channel)
        passed = threshold.is_passed_by(self._pulses.input_v)
        seen_hz = self._bench.count_rate_hz(channel) if passed else 0.0
        return seen_hz + self._pulses.noise_hz(threshold.level_v)

    def late_s(self, at_input: int) -> float:
        """Return by how much later than the sync's an input's events come, for where on a pulse they lie."""
        return (self.inputs[at_input].at_end - self.sync.at_end) * self._pulses.width_s

    def detections(self, start_s: float, stop_s: float) -> Sequence[Detections]:
        """Draw what is seen of each channel between two bench times."""
        period_s = 1 / (self._bench.sync_rate_hz() or self.sync_rate_hz() or 1.0)
        drawn = self._bench.detections(start_s, stop_s)
        return [self._seen(one, number, (start_s, stop_s), period_s) for number, one in enumerate(drawn)]

    def take_marks(self, before_s: float) -> Sequence[Mark]:
        """Take away the pulses at the marker inputs, which have no discriminators to set."""
        return self._bench.take_marks(before_s)

    def _threshold(self, channel: int) -> Threshold:
        return self.inputs[self._bench.channels[channel].input]

    def _seen_sync_hz(self, hz: float) -> float:
        through_hz = hz if self.sync.is_passed_by(self._pulses.sync_v) else 0.0
        return through_hz + self._pulses.noise_hz(self.sync.level_v)

    def _seen(
        self, drawn: Detections, channel: int, between_s: tuple[float, float], period_s: float
    ) -> Detections:
        threshold = self._threshold(channel)
        seen = drawn if threshold.is_passed_by(self._pulses.input_v) else no_detections()
        noise_hz = self._pulses.noise_hz(threshold.level_v)
        if not noise_hz:
            return seen
        start_s, stop_s = between_s
        rng = np.random.default_rng([round(start_s * 1e9), channel])
        at_s = rng.uniform(0, stop_s - start_s, rng.poisson(noise_hz * (stop_s - start_s)))
        pulse = np.concatenate([seen.pulse, (at_s // period_s).astype(np.int64)])
        time_s = np.concatenate([seen.time_s, at_s % period_s])
        order = np.argsort(pulse * period_s + time_s, kind="stable")
        return Detections(pulse[order], time_s[order])
