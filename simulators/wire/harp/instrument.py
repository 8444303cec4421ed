"""The instrument behind the functions: its settings and what a measurement does. No C, no error codes."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulators.bench import Detections, Syncs
from simulators.wire.harp.codes import Mode, Warn
from simulators.wire.harp.discriminators import Discriminators, MeasuredBench
from simulators.wire.harp.families import SimulatedFamily
from simulators.wire.harp.fifo import Fifo
from simulators.wire.harp.histogram import HistogramMemory, after_edge, bins_of
from simulators.wire.harp.records import DTIME_BINS
from simulators.wire.harp.tagging import ROUNDING_S, MarkerSettings, TagStream
from simulators.wire.harp.timing import Timing

#: Rates are counted over this gate time [s]; there are none before it has passed (source: manual).
RATE_GATE_S = 0.1
#: Detections of a histogram are drawn in pieces of this much bench time [s] while it is measured. A real
#: instrument has its counts when it stops; drawing those of a long exposure takes seconds, and gigabytes.
PIECE_S = 1.0
#: Bins of a histogram after Initialize (manual); fewer where an instrument has fewer.
USUAL_HISTOGRAM = 65536


@dataclass
class Settings:
    """What the Set functions set, at its value after Initialize."""

    sync_divider: int = 1
    sync_offset_ps: int = 0
    input_offset_ps: list[int] = field(default_factory=list)
    input_enabled: list[bool] = field(default_factory=list)
    stop_overflow: bool = False
    stop_count: int = 2**32 - 1
    binning: int = 0
    offset_ns: int = 0
    length: int = USUAL_HISTOGRAM
    control: int = 0
    markers: MarkerSettings = field(default_factory=MarkerSettings)


@dataclass
class Measurement:
    """One run from StartMeas on."""

    start_s: float
    acquisition_s: float
    sync_hz: float
    triggered: bool
    stop_s: float | None = None
    pieces: int = 0

    @property
    def drawn_s(self) -> float:
        """Until when detections were drawn, of a histogram; by whole pieces, whoever asks when."""
        return self.start_s + self.pieces * PIECE_S

    @property
    def end_s(self) -> float:
        """When the acquisition time runs out."""
        return self.start_s + self.acquisition_s


class Instrument:
    """One instrument on the bench, each detector channel connected to its input.

    Parameters
    ----------
    family
        What it is.
    bench
        Gives time, sync pulses and detections, which the discriminators at the inputs see or do not see.
    inputs
        Number of inputs.
    count_depth
        Largest count of a bin.
    timing
        Faults of its clock.
    fifo
        Its memory for records.
    """

    def __init__(
        self,
        family: SimulatedFamily,
        bench: MeasuredBench,
        inputs: int,
        *,
        count_depth: int,
        timing: Timing,
        fifo: Fifo,
    ) -> None:
        self.family = family
        self.discriminators = Discriminators(bench, inputs, timing.pulses)
        self.bench = self.discriminators
        self.timing = timing
        self.inputs = inputs
        self.fifo = fifo
        self.memories = [HistogramMemory(family.longest, count_depth) for _ in range(inputs)]
        self._channel_at = {one.input: number for number, one in enumerate(bench.channels)}
        self.initialize(Mode.HISTOGRAM, external_reference=False)
        self.initialized = False

    def initialize(self, mode: Mode, *, external_reference: bool) -> None:
        """Take all settings back to their defaults."""
        self.initialized = True
        self.calibrated = not self.family.calibrates
        self.mode = mode
        self.external_reference = external_reference
        self.discriminators.reset()
        self.trigger_modes: dict[int | None, int] = {}  # of sync (None) and inputs, where there is a choice
        self.settings = Settings(
            input_offset_ps=[0] * self.inputs,
            input_enabled=[True] * self.inputs,
            length=min(USUAL_HISTOGRAM, self.family.longest),
        )
        self.sync_hz_read = 0
        self.input_hz_read = [0] * self.inputs
        self.running = False
        self.last: Measurement | None = None
        self.sync_lost = False
        self._stream: TagStream | None = None
        self.fifo.start(self.bench.clock.now_s())
        self.clear()
        self.restart_rates()

    def warm_up(self) -> None:
        """Count a few detections for nothing, so that what has to be compiled is before anybody waits."""
        few = Detections(np.arange(9), np.zeros(9))
        _, bins = self._timed(0, few, Syncs(0.0, 1.0, 1e6), 0)
        self.memories[0].add(bins, self.settings.length)
        self.clear()

    def clear(self) -> None:
        """Set the counts of all inputs to zero."""
        for memory in self.memories:
            memory.clear()

    @property
    def resolution_ps(self) -> float:
        """Width of a bin."""
        return self.family.base_ps * 2**self.settings.binning

    # Rates

    def restart_rates(self) -> None:
        """Begin a new rate gate."""
        self._rates_from_s = self.bench.clock.now_s() + RATE_GATE_S

    def read_sync_rate(self) -> int:
        """Return the sync rate [Hz] and remember it for the warnings."""
        self.ended()  # it is asked for in the middle of an exposure, too
        self.sync_hz_read = round(self.bench.sync_rate_hz()) if self._rates_valid() else 0
        return self.sync_hz_read

    def read_count_rate(self, at_input: int) -> int:
        """Return an input's rate [Hz] and remember it for the warnings."""
        channel = self._channel_at.get(at_input)
        rate_hz = 0
        if channel is not None and self.settings.input_enabled[at_input] and self._rates_valid():
            rate_hz = round(self.bench.count_rate_hz(channel))
        self.input_hz_read[at_input] = rate_hz
        return rate_hz

    def _rates_valid(self) -> bool:
        return self.bench.clock.now_s() >= self._rates_from_s

    def warnings(self) -> Warn:
        """Judge the rates that were read last; rates never read count as zero."""
        sync_hz, inputs_hz, settings, family = (
            self.sync_hz_read,
            self.input_hz_read,
            self.settings,
            self.family,
        )
        tagging, on_sync = self.mode in (Mode.T2, Mode.T3), self.mode is not Mode.T2
        span_bins = DTIME_BINS if self.mode is Mode.T3 else min(USUAL_HISTOGRAM, family.longest)
        period_s = 1 / sync_hz if sync_hz else 0.0
        too_short = period_s > span_bins * self.resolution_ps * 1e-12
        too_fast = sync_hz / settings.sync_divider > family.warns_sync_hz
        divided, needless = settings.sync_divider > 1, sync_hz <= family.warns_sync_hz
        holds = {
            Warn.SYNC_RATE_ZERO: on_sync and not sync_hz,
            Warn.SYNC_RATE_TOO_HIGH: too_fast,
            Warn.INPT_RATE_ZERO: not any(inputs_hz),
            Warn.INPT_RATE_TOO_HIGH: tagging and sum(inputs_hz) > family.warns_inputs_hz,
            Warn.INPT_RATE_RATIO: on_sync and sync_hz > 0 and max(inputs_hz) > 0.05 * sync_hz,
            Warn.DIVIDER_GREATER_ONE: divided and (not on_sync or (family.warns_divider and needless)),
            Warn.TIME_SPAN_TOO_SMALL: on_sync and too_short,
            Warn.OFFSET_UNNECESSARY: on_sync and sync_hz > 0 and settings.offset_ns > 0 and not too_short,
            Warn.DIVIDER_TOO_SMALL: on_sync and family.warns_divider and too_fast,
        }
        return Warn(sum(bit for bit, true in holds.items() if true))

    # Measuring

    def start(self, acquisition_s: float) -> None:
        """Begin a measurement; one that waits for a pulse at C1 waits for ever."""
        self.running = True
        self.sync_lost = False
        now_s = self.bench.clock.now_s()
        triggered = self.settings.control in (0, 6)
        self.last = Measurement(now_s, acquisition_s, self.bench.sync_rate_hz(), triggered)
        self._stream = self._tagging(now_s) if self.mode is Mode.T3 and triggered else None

    def _tagging(self, start_s: float) -> TagStream:
        return TagStream(
            self.bench,
            self._enabled(),
            self._timed,
            markers=self.settings.markers,
            fifo=self.fifo,
            start_s=start_s,
        )

    def _enabled(self) -> dict[int, int]:
        """Return the detector channel behind each input that is switched on."""
        return {i: number for i, number in self._channel_at.items() if self.settings.input_enabled[i]}

    def ended(self) -> bool:
        """Whether no acquisition time runs: never began, or is over."""
        run = self.last
        if run is None or not run.triggered or run.stop_s is not None:
            return True
        now_s = self.bench.clock.now_s()
        if now_s < run.end_s:
            self._advance(run, now_s)
            return False
        self._finish(run, run.end_s)
        return True

    def stop(self) -> None:
        """End the measurement; counts stay, records that were not read do not (unconfirmed)."""
        run, self.running = self.last, False
        if run is not None and not self.ended():
            self._finish(run, self.bench.clock.now_s())
        self.fifo.drop()

    def read_records(self, count: int) -> NDArray[np.uint32]:
        """Return the records at hand, at most ``count``; none unless a measurement runs."""
        self.ended()
        return self.fifo.take(count, self.bench.clock.now_s())

    def elapsed_s(self) -> float:
        """How long the last measurement ran, or the running one has run."""
        run = self.last
        if run is None or not run.triggered:
            return 0.0
        if not self.ended():
            return self.bench.clock.now_s() - run.start_s
        return (run.stop_s or run.start_s) - run.start_s

    def sync_period_s(self) -> float:
        """Return the sync period that the last measurement saw; 0 before it saw two periods."""
        run = self.last
        if run is None or not run.sync_hz or self.elapsed_s() * run.sync_hz < 2:
            return 0.0
        return 1 / run.sync_hz

    def flags(self) -> int:
        """Return the state flags; no clock is connected to the external reference input."""
        bits = self.family.flags
        synced = self._stream is None or not self._stream.sync_lost
        raised = {
            bits.active: self.running and not self.ended(),
            bits.overflow: any(memory.full for memory in self.memories),
            bits.fifo_full: self.fifo.full,
            bits.sync_lost: self.sync_lost or not synced,
            bits.reference_lost: self.external_reference,
        }
        return sum(bit for bit, holds in raised.items() if holds)

    def _advance(self, run: Measurement, now_s: float) -> None:
        """Draw what was detected until now, in whole pieces, of a measurement that goes on."""
        if self._stream is not None:
            self._stream.advance(now_s)
            return
        if self.settings.stop_overflow:  # where it stops is known only with all of it
            return
        while run.drawn_s + PIECE_S <= now_s and run.sync_hz:
            self._count(run, run.drawn_s, run.drawn_s + PIECE_S)
            run.pieces += 1

    def _finish(self, run: Measurement, stop_s: float) -> None:
        """Draw what was detected since the start, or what was drawn last, and count it."""
        if self._stream is not None:
            self._stream.finish(stop_s)
        else:
            self._advance(run, stop_s - ROUNDING_S)
        run.stop_s = stop_s
        sync_hz = self.bench.sync_rate_hz()
        self.sync_lost = not (run.sync_hz and sync_hz)
        run.sync_hz = run.sync_hz or sync_hz
        self._count(run, run.drawn_s, stop_s)

    def _count(self, run: Measurement, begin_s: float, end_s: float) -> None:
        """Draw what was detected between two times, and count it."""
        enabled = self._enabled()
        # without a sync there is nothing to time a stop against
        if self.mode is not Mode.HISTOGRAM or not enabled or not run.sync_hz:
            return
        seen, syncs = self.bench.detections(begin_s, end_s), Syncs(begin_s, end_s, run.sync_hz)
        bins = {i: self._timed(i, seen[number], syncs, 0)[1] for i, number in enabled.items()}
        if self.settings.stop_overflow:
            bins = self._stopped_by_overflow(run, bins)
        for at_input, binned in bins.items():
            if len(binned):
                self.memories[at_input].add(binned, self.settings.length)

    def _timed(
        self, at_input: int, arrived: Detections, syncs: Syncs, first_pulse: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return sync edge and bin of what an input registers; ``first_pulse`` is that of ``syncs``."""
        settings, period_s = self.settings, 1 / syncs.hz
        counted = self.timing.registered(arrived, period_s, syncs.begin_s)
        edge, times_s = after_edge(
            counted.time_s,
            counted.pulse + first_pulse,
            period_s=period_s,
            shift_s=(settings.input_offset_ps[at_input] - settings.sync_offset_ps) * 1e-12
            + self.discriminators.late_s(at_input),
        )
        bins = bins_of(
            times_s,
            offset_s=settings.offset_ns * 1e-9,
            bin_width_s=self.resolution_ps * 1e-12,
            length=DTIME_BINS if self.mode is Mode.T3 else settings.length,
            clock=self.timing.nonlinearity,
        )
        return edge, bins

    def _stopped_by_overflow(
        self, run: Measurement, bins: dict[int, NDArray[np.int64]]
    ) -> dict[int, NDArray[np.int64]]:
        """Cut the measurement off where a bin of any input reaches the stop count.

        The photons of each input count as evenly spread over the measurement.
        """
        settings, stops = self.settings, []
        for at_input, binned in bins.items():
            photons = self.memories[at_input].photons_until(binned, settings.length, settings.stop_count)
            if len(binned) and photons is not None:
                stops.append((photons / len(binned), photons, len(binned), at_input))
        if not stops:
            return bins
        assert run.stop_s is not None
        _, photons, out_of, first = min(stops)
        run.stop_s = run.start_s + (run.stop_s - run.start_s) * photons / out_of
        self.memories[first].full = True
        return {i: binned[: len(binned) * photons // out_of] for i, binned in bins.items()}
