"""Time-tagged mode, driver and simulator together: what the bench does must come out as records, once each."""

import threading
import time
from itertools import pairwise

import numpy as np
import pytest

from drivers.errors import DeviceError, LimitError
from drivers.hydraharp.constants import Flag
from drivers.hydraharp.device import HydraHarp
from drivers.hydraharp.errors import HydraHarpError
from drivers.hydraharp.library import HHLib
from drivers.hydraharp.records import T3, Decoder
from drivers.hydraharp.settings import HydraHarpSettings, Markers
from drivers.hydraharp.stream import HydraHarpStream
from simulators.bench import Bench, BenchGeometry, Channel, Detections
from simulators.clock import BenchClock
from simulators.wire.hydraharp import Fifo, HydraHarpSimulator, Nonlinearity, Timing
from support.hydraharp_wire import bench_with

BIN_S = 4e-12
PERIOD_S = 100e-9


class EvenLight:
    """Photons at random times, a Poisson number of them, in the order in which they come."""

    def __init__(self, rate_hz, latest_s=250e-9):
        self.rate, self.latest_s = rate_hz, latest_s

    def detections(self, laser_spot_m, light, duration_s, rng):
        pulses = round(duration_s * light.repetition_hz)
        number = rng.poisson(self.rate * duration_s)
        pulse = rng.integers(0, pulses, number)
        time_s = rng.uniform(0, self.latest_s, number)
        order = np.argsort(pulse / light.repetition_hz + time_s)
        return Detections(pulse[order], time_s[order])

    def rate_hz(self, laser_spot_m, light):
        return self.rate


def random_bench(*rates_hz, seed=7, clock=None, repetition_hz=10e6):
    geometry = BenchGeometry(channels=tuple(Channel(input=n) for n in range(len(rates_hz))))
    bench = Bench([EvenLight(rate) for rate in rates_hz], geometry, seed=seed, clock=clock)
    bench.change_light(emitting=True, repetition_hz=repetition_hz)
    return bench


def tagged(bench, *, instrument=None, markers=None, queue_pieces=256, **settings):
    simulator = HydraHarpSimulator(bench, **(instrument or {}))
    asked = HydraHarpSettings(**settings)
    stream = HydraHarpStream(
        HHLib(simulator.functions),
        clock=bench.clock,
        settings=asked,
        markers=markers,
        queue_pieces=queue_pieces,
    )
    return simulator, stream


class Taken:
    """All that a stream gave."""

    def __init__(self, stream, *, until=lambda taken: False):
        decoder = Decoder(T3)
        self.batches, self.pieces = [], []
        for piece in stream.pieces():
            self.pieces.append(piece)
            self.batches.append(decoder.decode(piece.records).copy())
            if until(self):
                stream.stop()
        self.edge = self.joined("tag")
        self.dtime = self.joined("dtime")
        self.channel = self.joined("channel")
        self.marker_edge, self.marker_mask = self.joined("marker_tag"), self.joined("marker_mask")
        self.faults = [fault for piece in self.pieces for fault in piece.faults]

    def joined(self, name):
        return np.concatenate([getattr(batch, name) for batch in self.batches] or [np.empty(0, int)])

    def counts(self, bins=15000):
        channels = range(int(self.channel.max(initial=0)) + 1)
        return np.array(
            [np.bincount(self.dtime[self.channel == n], minlength=32768)[:bins] for n in channels]
        )


@pytest.fixture(autouse=True)
def no_thread_is_left():
    before = threading.active_count()
    yield
    assert threading.active_count() == before


FAULTY = Timing(dead_time_s=80e-9, nonlinearity=Nonlinearity(rms=0.01), drift_s_per_s=1e-9)


@pytest.mark.parametrize(
    ("timing", "settings"),
    [
        (Timing(), {}),
        (FAULTY, {}),
        (Timing(), {"offset_s": 20e-9}),
        (Timing(), {"input_offsets_s": (3e-9, 7e-9)}),
        (Timing(), {"sync_divider": 2}),
        (Timing(), {"inputs": (1,)}),
    ],
)
def test_the_same_draw_gives_the_same_counts_as_a_histogram(timing, settings):
    """10 ms are drawn in one piece: each photon of the histogram must be one record, at the same time."""
    settings = {"inputs": (0, 1), **settings}
    simulator = HydraHarpSimulator(random_bench(2e6, 3e5), timing=timing)
    library, asked = HHLib(simulator.functions), HydraHarpSettings(**settings)
    with HydraHarp(library, clock=simulator.instrument.bench.clock, settings=asked) as harp:
        expected = harp.measure(10e-3).counts
    _, stream = tagged(random_bench(2e6, 3e5), instrument={"timing": timing}, **settings)
    with stream:
        stream.start(10e-3)
        counts = Taken(stream).counts()
    for row, at_input in enumerate(settings["inputs"]):
        assert counts[at_input].tolist() == expected[row].tolist()
    assert expected.sum() > 1000


def test_a_long_stretch_counts_as_much_as_a_histogram():
    """Drawn in 20 pieces here, in one there: the numbers agree within 5 sigma of two Poisson draws."""
    simulator = HydraHarpSimulator(random_bench(1e6))
    with HydraHarp(HHLib(simulator.functions), clock=simulator.instrument.bench.clock) as harp:
        expected = harp.measure(0.2).photons
    _, stream = tagged(random_bench(1e6))
    with stream:
        stream.start(0.2)
        number = Taken(stream).counts().sum()
    assert abs(number - expected) < 5 * np.sqrt(number + expected)


@pytest.mark.parametrize("poll_s", [1e-3, 7e-3, 40e-3])
def test_records_do_not_depend_on_who_reads_when(poll_s, monkeypatch):
    monkeypatch.setattr("drivers.hydraharp.reader.POLL_S", poll_s)
    taken = []
    for polled_s in (10e-3, poll_s):
        monkeypatch.setattr("drivers.hydraharp.reader.POLL_S", polled_s)
        _, stream = tagged(random_bench(1e6))
        with stream:
            stream.start(0.1)
            taken.append(Taken(stream))
    one, other = taken
    assert len(one.edge) > 50_000
    assert np.array_equal(one.edge, other.edge)
    assert np.array_equal(one.dtime, other.dtime)


def test_sync_index_and_bin_give_back_the_arrival_times():
    """Sync index times period plus bin is when the photon came, to half a bin."""
    bench = random_bench(2e5, 1e5)
    light = [EvenLight(2e5), EvenLight(1e5)]
    drawn = [[], []]

    class Told:
        def __init__(self, number):
            self.number = number

        def detections(self, spot, state, duration_s, rng):
            seen = light[self.number].detections(spot, state, duration_s, rng)
            begin_s = len(drawn[self.number]) * 10e-3
            drawn[self.number].append(begin_s + seen.pulse * PERIOD_S + seen.time_s)
            return seen

        def rate_hz(self, spot, state):
            return 1.0

    bench.photons = (Told(0), Told(1))
    _, stream = tagged(bench, inputs=(0, 1))
    with stream:
        stream.start(0.1)
        taken = Taken(stream)
    assert (np.diff(taken.edge) >= 0).all()
    at_s = taken.edge * PERIOD_S + (taken.dtime + 0.5) * BIN_S
    assert (np.diff(at_s) >= 0).all()
    for number in (0, 1):
        came_s = np.sort(np.concatenate(drawn[number]))
        found_s = at_s[taken.channel == number]
        assert len(found_s) == len(came_s)
        # half a bin, and the rounding of times of 0.1 s
        assert np.abs(found_s - came_s).max() < 0.5 * BIN_S + 1e-16 * 100


def test_long_darkness_is_told_by_few_overflows():
    _, stream = tagged(bench_with([], 0))
    with stream:
        stream.start(2.0)
        taken = Taken(stream)
    assert sum(batch.overflows for batch in taken.batches) == 2.0 / PERIOD_S // 1024
    assert sum(len(piece.records) for piece in taken.pieces) <= 200  # one a piece of 10 ms
    assert len(taken.edge) == 0


def test_markers_come_at_their_time_and_in_order():
    bench = bench_with([4e-9], 10_000)
    simulator, stream = tagged(bench, markers=Markers(enabled=(True, True, True, False)))
    with stream:
        begin_s = bench.clock.now_s()
        bench.mark(1, begin_s - 1e-3)  # before the measurement
        for step in range(100):
            bench.mark(1, begin_s + step * 1e-3 + 50e-9)
        bench.mark(2, begin_s + 50e-9)  # with the first
        bench.mark(4, begin_s + 31.0e-3 + 50e-9)
        bench.mark(8, begin_s + 5e-3)  # switched off
        stream.start(0.1)
        taken = Taken(stream)
    assert taken.marker_edge.tolist() == [step * 10_000 for step in range(100)]
    expected = [1] * 100
    expected[0], expected[31] = 3, 5
    assert taken.marker_mask.tolist() == expected
    assert [len(batch.tag) for batch in taken.batches if batch.markers]  # between the photons
    simulator.raise_pending()


def test_falling_edges_and_hold_off():
    bench = bench_with([], 0)
    markers = Markers(rising=(False, True, True, True), hold_off_s=100e-6)
    _, stream = tagged(bench, markers=markers)
    with stream:
        begin_s = bench.clock.now_s()
        bench.mark(1, begin_s + 1e-3 + 50e-9, width_s=20e-6)
        for glitch_s in (0, 30e-6, 99e-6, 101e-6):
            bench.mark(2, begin_s + 5e-3 + 50e-9 + glitch_s)
        stream.start(0.02)
        taken = Taken(stream)
    assert taken.marker_edge.tolist() == [10_200, 50_000, 51_010]
    assert taken.marker_mask.tolist() == [1, 2, 2]


def test_photons_stand_on_the_right_side_of_a_marker():
    """A mirror's point clock: photons of a step must be those between two markers."""
    bench = bench_with([4e-9], 100_000)
    _, stream = tagged(bench)
    with stream:
        begin_s = bench.clock.now_s()
        bench.mark(1, begin_s + 5e-3 + 50e-9)
        stream.start(0.01)
        taken = Taken(stream)
    (batch,) = [one for one in taken.batches if one.markers]
    (place,) = batch.marker_photon
    assert (batch.tag[:place] <= 50_000).all()
    assert (batch.tag[place:] >= 50_000).all()


def test_a_memory_that_nobody_reads_is_full():
    """2 MHz for 1.5 s into a memory of 2 097 152 records, in real time: it must say so, and lose the rest."""
    simulator = HydraHarpSimulator(random_bench(4e6), fifo=Fifo(1 << 15))
    library = HHLib(simulator.functions)
    with HydraHarpStream(library, clock=simulator.instrument.bench.clock) as stream:
        simulator.instrument.fifo.link_hz = 1e6  # a quarter of what comes
        stream.start(1.0)
        pieces = []
        with pytest.raises(DeviceError, match="memory was full"):
            pieces.extend(stream.pieces())
            for piece in stream.pieces():
                pieces.append(piece)
    simulator.raise_pending()
