"""Time-tagged mode (T3): what a measurement records while it runs. No C, no error codes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, floor, inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Detections, Mark, Syncs
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.records import DTIME_BINS, Events, encoded, no_events

#: Photons are drawn in pieces of this much bench time [s], whoever reads them when: the draw must not depend
#: on the reader. So records come up to this much late.
PIECE_S = 10e-3

#: Sums of bench times are not exact to so much [s], after the longest measurement too.
ROUNDING_S = 1e-9

#: By how much offsets of sync and input together (manual), and edges at two ends of pulses, can make a photon
#: earlier than it is.
MOST_EARLY_S = 2 * 99999e-12 + 100e-9

MARKERS = 4


class TaggedBench(Protocol):
    """What time-tagged mode needs of a bench."""

    def syncs_between(self, start_s: float, stop_s: float) -> Sequence[Syncs]:
        """Return how sync pulses came between two bench times."""
        ...

    def take_marks(self, before_s: float) -> Sequence[Mark]:
        """Take away the pulses at the marker inputs that begin before a time, in order."""
        ...

    def detections(self, start_s: float, stop_s: float) -> Sequence[Detections]:
        """Draw what each channel saw between two bench times."""
        ...


class Timed(Protocol):
    """The instrument's start-stop clocks."""

    def __call__(
        self, at_input: int, arrived: Detections, syncs: Syncs, first_pulse: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the sync edge, and the bin after it counted from 1, of what an input registers."""
        ...


@dataclass
class MarkerSettings:
    """Of the four marker inputs; that they are switched off after Initialize is unconfirmed.

    Attributes
    ----------
    rising, enabled
        Whether the rising edge counts, and whether any.
    hold_off_s
        Time after a marker in which its input takes no other (that it is its own input only is unconfirmed).
    """

    rising: list[bool] = field(default_factory=lambda: [True] * MARKERS)
    enabled: list[bool] = field(default_factory=lambda: [False] * MARKERS)
    hold_off_s: float = 0.0


class MarkerInputs:
    """Pulses in, edges out.

    Parameters
    ----------
    settings
        Which edges count.
    """

    def __init__(self, settings: MarkerSettings) -> None:
        self._settings = settings
        self._coming: list[tuple[float, int]] = []
        self._last_s = [-inf] * MARKERS

    def add(self, marks: Sequence[Mark]) -> None:
        """Take pulses at the inputs."""
        for mark in marks:
            for bit in range(MARKERS):
                if mark.mask >> bit & 1 and self._settings.enabled[bit]:
                    late_s = 0.0 if self._settings.rising[bit] else mark.width_s
                    self._coming.append((mark.at_s + late_s, bit))
        self._coming.sort()

    def before(self, stop_s: float) -> list[tuple[float, int]]:
        """Return time and input of the edges until ``stop_s`` that are not held off."""
        passed = []
        while self._coming and self._coming[0][0] < stop_s:
            at_s, bit = self._coming.pop(0)
            if at_s - self._last_s[bit] >= self._settings.hold_off_s:
                self._last_s[bit] = at_s
                passed.append((at_s, bit))
        return passed


class TagStream:
    """The records of one measurement.

    Photons and markers come with the number of the last sync edge before them, counted from the start. While
    no sync pulses come there is nothing to time photons against: they are not recorded, and the edges' number
    stands still.

    Parameters
    ----------
    bench
        Where photons, sync pulses and markers come from.
    channels
        The detector channel behind each input that is switched on.
    timed
        The clocks behind the inputs.
    markers
        Settings of the marker inputs.
    fifo
        Takes the records.
    start_s
        When the measurement begins.

    Attributes
    ----------
    sync_lost
        Whether sync pulses were missing at any time so far.
    """

    def __init__(
        self,
        bench: TaggedBench,
        channels: Mapping[int, int],
        timed: Timed,
        *,
        markers: MarkerSettings,
        fifo: Fifo,
        start_s: float,
    ) -> None:
        self.sync_lost = False
        self._bench, self._channels, self._timed = bench, channels, timed
        self._markers, self._fifo = MarkerInputs(markers), fifo
        self._start_s = self._drawn_s = start_s
        self._pieces = 0
        self._pulses = 0.0
        self._fastest_hz = 0.0
        self._told_edge = 0
        self._held = no_events()
        bench.take_marks(start_s)  # nobody listened to these
        fifo.start(start_s)

    def advance(self, until_s: float) -> None:
        """Record what happened until now, in whole pieces."""
        while (end_s := self._start_s + (self._pieces + 1) * PIECE_S) <= until_s + ROUNDING_S:
            self._record(min(end_s, until_s))
            self._pieces += 1

    def finish(self, stop_s: float) -> None:
        """Record the rest; photons on their way through the cables still come."""
        self.advance(stop_s)
        self._record(stop_s)
        self._tell(max(self._edge(), *(int(edge) + 1 for edge in self._held.edge[-1:]), 0))

    def _record(self, end_s: float) -> None:
        begin_s, self._drawn_s = self._drawn_s, max(end_s, self._drawn_s)
        if self._fifo.full or end_s <= begin_s:
            return
        self._markers.add(self._bench.take_marks(end_s))
        for syncs in self._bench.syncs_between(begin_s, end_s):
            self._held = Events.together([self._held, *self._events(syncs)])
            self._pulses += (syncs.end_s - syncs.begin_s) * syncs.hz
            self._fastest_hz = max(self._fastest_hz, syncs.hz)
            self.sync_lost = self.sync_lost or not syncs.hz
        # what is yet to be drawn may belong before this
        early = 2 + ceil(MOST_EARLY_S * self._fastest_hz)
        self._tell(self._edge() - early)

    def _edge(self) -> int:
        return round(self._pulses)

    def _events(self, syncs: Syncs) -> Iterator[Events]:
        yield self._marked(syncs)
        if not syncs.hz or not self._channels:
            return
        seen = self._bench.detections(syncs.begin_s, syncs.end_s)
        for at_input, number in self._channels.items():
            edge, bins = self._timed(at_input, seen[number], syncs, round(self._pulses))
            recorded = (bins >= 1) & (bins <= DTIME_BINS) & (edge >= 0)
            yield Events.photons(edge[recorded], bins[recorded] - 1, at_input)

    def _marked(self, syncs: Syncs) -> Events:
        """Return the markers of a stretch; those of one sync period are one record (format)."""
        masks: dict[int, int] = {}
        parts: dict[int, float] = {}
        for at_s, bit in self._markers.before(syncs.end_s):
            pulses = self._pulses + max(at_s - syncs.begin_s, 0.0) * syncs.hz
            edge = floor(pulses)
            masks[edge] = masks.get(edge, 0) | 1 << bit
            parts.setdefault(edge, pulses - edge)
        # a marker has no bin: among the photons of its sync period it is placed as well as need be
        return Events.markers(masks, (int(part * DTIME_BINS) for part in parts.values()), masks.values())

    def _tell(self, to_edge: int) -> None:
        """Put what happened before a sync edge into the memory, and keep the rest."""
        to_edge = max(to_edge, self._told_edge)
        number = int(np.searchsorted(self._held.edge, to_edge))
        told, self._held = self._held[:number], self._held[number:]
        self._fifo.put(encoded(told, self._told_edge, to_edge))
        self._told_edge = to_edge
