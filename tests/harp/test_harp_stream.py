"""Time-tagged mode, driver and simulator together: what the bench does comes out as records, once each."""

import threading
import time
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest

from drivers.clock import SystemClock, wait_until
from drivers.errors import DeviceError, LimitError, LinkError
from drivers.harp.device import Harp
from drivers.harp.errors import HarpError
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.records import T3, Decoder
from drivers.harp.settings import HarpSettings, Markers
from drivers.harp.stream import HarpStream
from simulators.bench import Bench, BenchGeometry, Channel, Detections
from simulators.clock import BenchClock
from simulators.wire.harp import Fifo, HarpSimulator, Nonlinearity, Timing
from simulators.wire.harp.codes import Slot
from simulators.wire.served.timing import ServedBench, TimingFaults
from support.harp_wire import bench_with

FLAGS = HYDRAHARP_400.flags

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
    simulator = HarpSimulator(bench, **(instrument or {}))
    asked = HarpSettings(family=HYDRAHARP_400, **settings)
    stream = HarpStream(
        HarpLibrary(simulator.functions, HYDRAHARP_400),
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
    simulator = HarpSimulator(random_bench(2e6, 3e5), timing=timing)
    library, asked = (
        HarpLibrary(simulator.functions, HYDRAHARP_400),
        HarpSettings(family=HYDRAHARP_400, **settings),
    )
    with Harp(library, clock=simulator.instrument.bench.clock, settings=asked) as harp:
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
    simulator = HarpSimulator(random_bench(1e6))
    with Harp(
        HarpLibrary(simulator.functions, HYDRAHARP_400), clock=simulator.instrument.bench.clock
    ) as harp:
        expected = harp.measure(0.2).photons
    _, stream = tagged(random_bench(1e6))
    with stream:
        stream.start(0.2)
        number = Taken(stream).counts().sum()
    assert abs(number - expected) < 5 * np.sqrt(number + expected)


@pytest.mark.parametrize("poll_s", [1e-3, 7e-3, 40e-3])
def test_records_do_not_depend_on_who_reads_when(poll_s, monkeypatch):
    monkeypatch.setattr("drivers.harp.reader.POLL_S", poll_s)
    taken = []
    for polled_s in (10e-3, poll_s):
        monkeypatch.setattr("drivers.harp.reader.POLL_S", polled_s)
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


def test_inputs_that_are_shifted_in_time_stay_in_order():
    """A photon may come to lie before one that was drawn in the piece before."""
    taken = []
    for offsets_s, sync_offset_s in (((0.0, 0.0), 0.0), ((-99e-9, 99e-9), 99e-9)):
        _, stream = tagged(
            random_bench(5e6, 5e6), inputs=(0, 1), input_offsets_s=offsets_s, sync_offset_s=sync_offset_s
        )
        with stream:
            stream.start(0.05)
            taken.append(Taken(stream))
    for one in taken:
        bins = one.edge * 25_000 + one.dtime
        assert (np.diff(bins) >= 0).all()
        assert (one.dtime < 25_000).all()
    plain, shifted = taken
    # the first input is 198 ns early: 1 photon, by expectation, is before the first pulse and not recorded
    assert 0 <= len(plain.edge) - len(shifted.edge) < 10
    early_bins = np.sort((plain.edge * 25_000 + plain.dtime)[plain.channel == 0]) - 49_500
    found_bins = np.sort((shifted.edge * 25_000 + shifted.dtime)[shifted.channel == 0])
    assert np.abs(found_bins - early_bins[early_bins >= 0][-len(found_bins) :]).max() <= 1  # rounding


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


def test_a_link_slower_than_the_photons_fills_the_memory():
    """What is read before is all that happened until then; it must not end as if all were well."""
    whole = records_of(random_bench(4e6))
    _, stream = tagged(random_bench(4e6), instrument={"fifo": Fifo(1 << 15, link_hz=1e6)})
    with stream:
        stream.start(0.2)
        read, problem = until_it_fails(stream)
        assert "memory was full" in str(problem)
        (fault,) = [fault for piece in read for fault in piece.faults]
        assert fault.flag == FLAGS.fifo_full
        records = joined(read)
        assert 1 << 15 <= len(records) < len(whole)
        assert np.array_equal(records, whole[: len(records)])
        assert fault.record <= len(records)
        stream.start(1e-3)  # the next measurement begins with an empty memory
        assert not any(piece.faults for piece in stream.pieces())


def records_of(bench):
    _, stream = tagged(bench)
    with stream:
        stream.start(0.2)
        return joined(list(stream.pieces()))


def joined(pieces):
    assert all(one.first + len(one.records) == two.first for one, two in pairwise(pieces))
    return np.concatenate([piece.records for piece in pieces])


def until_it_fails(stream, error=DeviceError):
    read = []
    with pytest.raises(error) as caught:
        read.extend(stream.pieces())  # keeps those before the failure
    return read, caught.value


class Timetable(BenchClock):
    """A clock during whose waits things happen: (seconds after `begin`, what)."""

    def __init__(self):
        super().__init__()
        self.due = []

    def begin(self, *due):
        self.due = [(self.now_s() + after_s, what) for after_s, what in due]

    def sleep(self, duration_s):
        super().sleep(duration_s)
        while self.due and self.now_s() >= self.due[0][0]:
            self.due.pop(0)[1]()


def test_a_dark_laser_is_a_fault_at_its_place_and_the_count_of_pulses_stands_still():
    clock = Timetable()
    bench = random_bench(1e6, clock=clock)
    _, stream = tagged(bench)
    with stream:
        clock.begin(
            (0.095, lambda: bench.change_light(emitting=False)),
            (0.195, lambda: bench.change_light(emitting=True)),
        )
        stream.start(0.4)
        taken = Taken(stream)
    (fault,) = taken.faults
    assert fault.flag == FLAGS.sync_lost
    assert "laser" in fault.sentence
    # waits are of 10 ms, so it is dark from 0.10 to 0.20 s; beside the photons, each 1024th pulse is told
    assert abs(fault.record - 100_000 - 1_000_000 // 1024) < 5 * np.sqrt(1e5)
    assert taken.edge.max() < 3_000_010  # 0.3 s of pulses, and the latest photons
    assert abs(len(taken.edge) - 300_000) < 5 * np.sqrt(3e5)
    before = np.count_nonzero(taken.edge < 1_000_000)
    assert abs(before - 100_000) < 5 * np.sqrt(1e5)


def test_a_reference_that_is_missing_is_a_fault():
    _, stream = tagged(random_bench(1e5), external_reference=True)
    with stream:
        stream.start(0.02)
        taken = Taken(stream)
    assert [(fault.flag, fault.record) for fault in taken.faults] == [(FLAGS.reference_lost, 0)]
    assert all(piece.flags == FLAGS.reference_lost for piece in taken.pieces)


def test_an_instrument_that_is_unplugged_ends_the_stream_after_what_was_read():
    clock = Timetable()
    simulator, stream = tagged(random_bench(1e6, clock=clock))
    with stream:
        clock.begin((0.095, lambda: simulator.connection.slots.__setitem__(0, Slot.CLOSED)))
        stream.start(1.0)
        read, problem = until_it_fails(stream, HarpError)
    assert problem.code == -10
    # 1 MHz for 90 ms, overflows beside
    assert abs(len(joined(read)) - 90_000 * 1.01) < 5 * np.sqrt(9e4)


def test_a_failure_inside_the_library_reaches_who_takes_the_pieces():
    bench = random_bench(1e6)
    simulator, stream = tagged(bench)
    with stream:
        bench.photons = (None,)
        stream.start(1.0)
        read, problem = until_it_fails(stream, HarpError)
        assert (read, problem.code) == ([], -99)
        with pytest.raises(AttributeError, match="detections"):
            simulator.raise_pending()
        bench.photons = (EvenLight(1e6),)
        stream.start(0.01)
        assert len(Taken(stream).edge) > 9000


def test_a_caller_who_takes_nothing_ends_the_stream(monkeypatch):
    """No photon is dropped silently: what was read is whole, and then comes the error."""
    monkeypatch.setattr("drivers.harp.reader.PATIENCE_S", 0.05)
    bench = random_bench(1e6, clock=BenchClock(real_time=True))
    simulator, stream = tagged(bench, queue_pieces=3)
    with stream:
        stream.start(10.0)
        assert wait_until(
            SystemClock(), lambda: not simulator.instrument.running, timeout_s=10.0, every_s=0.01
        )
        read, problem = until_it_fails(stream)
    assert "wait to be processed" in str(problem)
    assert len(read) == 3
    assert [piece.first for piece in read] == np.cumsum(
        [0, *(len(piece.records) for piece in read[:-1])]
    ).tolist()


def test_as_many_records_wait_as_there_is_memory_for(monkeypatch):
    """One read of a MultiHarp can bring a million: it is not the number of pieces that fills the computer."""
    monkeypatch.setattr("drivers.harp.reader.QUEUE_RECORDS", 25_000)
    whole = records_of(random_bench(1e6))
    _, stream = tagged(random_bench(1e6))
    with stream:
        stream.start(0.2)
        time.sleep(0.3)
        waiting = stream._reader._pieces.qsize()
        assert 2 <= waiting <= 4  # pieces of some 10,000, and of overflows
        assert np.array_equal(joined(list(stream.pieces())), whole)


def test_a_clock_that_stands_still_waits_for_its_caller(monkeypatch):
    monkeypatch.setattr("drivers.harp.reader.PATIENCE_S", 0.05)
    whole = records_of(random_bench(1e6))
    _, stream = tagged(random_bench(1e6), queue_pieces=2)
    with stream:
        stream.start(0.2)
        time.sleep(0.3)  # six times its patience
        assert np.array_equal(joined(list(stream.pieces())), whole)


def test_rates_and_warnings_while_it_measures():
    """The library takes one call at a time: the thread that reads makes them, also while it waits."""
    _, stream = tagged(random_bench(1e6), queue_pieces=2)
    with stream:
        before = stream.rates()
        stream.start(0.5)
        during = [(stream.rates(), stream.warnings()) for _ in stream.pieces()]
        assert len(during) > 10
        assert stream.rates().sync_hz == before.sync_hz
    assert {rates.sync_hz for rates, _ in during} == {before.sync_hz}
    ((sentence,),) = {warnings for _, warnings in during}
    assert "above 5 % of the sync rate" in sentence


def test_records_come_decoded_and_tell_how_far_they_are():
    whole = records_of(random_bench(1e6))
    _, stream = tagged(random_bench(1e6))
    with stream:
        stream.start(0.2)
        words, tags, known_to = [], [], 0
        for some in stream.records():
            assert not len(some.batch.tag) or some.batch.tag.min() >= known_to
            known_to = some.complete_to
            words.append(some.words.copy())
            tags.append(some.batch.tag.copy())
    assert np.array_equal(np.concatenate(words), whole)
    assert known_to > 1_990_000
    assert np.all(np.diff(np.concatenate(tags)) >= 0)


def test_who_waits_for_records_is_asked_while_none_come():
    bench = Bench(clock=BenchClock(real_time=True))
    _, stream = tagged(bench)
    with stream:
        stream.start(0.3)  # the laser is dark: neither photons nor sync pulses
        assert sum(not len(some.words) for some in stream.records()) >= 3


def test_a_slow_caller_loses_nothing():
    whole = records_of(random_bench(1e6))
    _, stream = tagged(random_bench(1e6), queue_pieces=2)
    with stream:
        stream.start(0.2)
        read = []
        for piece in stream.pieces():
            time.sleep(0.01)
            read.append(piece)
    assert np.array_equal(joined(read), whole)


def test_until_stopped():
    bench = random_bench(1e6)
    simulator, stream = tagged(bench)
    with stream:
        stream.start()
        with pytest.raises(DeviceError, match="another one still runs"):
            stream.start()
        taken = Taken(stream, until=lambda taken: len(taken.pieces) == 10)
        assert not simulator.instrument.running
        assert len(taken.pieces) >= 10
        assert len(taken.edge) >= 80_000
        assert list(stream.pieces()) == []
        stream.start(0.01)
        assert Taken(stream).edge.max() < 100_010  # counted anew
    simulator.raise_pending()


@pytest.mark.parametrize("error", [None, ValueError])
def test_leaving_in_the_middle(error):
    simulator, stream = tagged(random_bench(1e6))
    left = pytest.raises(ValueError, match="mine") if error else nullcontext()
    with left, stream:
        stream.start()
        next(stream.pieces())
        if error:
            raise error("mine")
    assert simulator.connection.slots[0] is Slot.CLOSED
    simulator.raise_pending()


def test_a_call_that_does_not_return(monkeypatch):
    """The caller gets an error in time, also on leaving; the library with a thread inside is left alone."""
    monkeypatch.setattr("drivers.harp.reader.SILENT_S", 0.3)
    go_on, bench = threading.Event(), random_bench(1e6)

    class Stuck(EvenLight):
        def detections(self, *arguments):
            go_on.wait(10.0)
            return super().detections(*arguments)

    bench.photons = (Stuck(1e6),)
    _, stream = tagged(bench)
    with pytest.raises(LinkError, match="did not return") as caught, stream:  # noqa: PT012
        stream.start(0.01)
        next(stream.pieces())
    assert "while leaving" in caught.value.__notes__[0]
    go_on.set()
    for thread in threading.enumerate():
        if thread.name.startswith("records of"):
            thread.join(10.0)


def test_in_real_time():
    """Pieces come while it runs, not after it."""
    bench = random_bench(1e5, clock=BenchClock(real_time=True))
    simulator, stream = tagged(bench)
    with stream:
        begun_s = time.monotonic()
        stream.start(5.0)
        piece = next(stream.pieces())
        assert len(piece.records) > 500  # of 10 ms
        stream.stop()
        assert time.monotonic() - begun_s < 4.0
    simulator.raise_pending()


def test_over_a_served_bench():
    """The bench behind a socket, with a clock that runs."""
    server_of = pytest.importorskip("simulators.wire.served.server", reason="pseudo-terminals are POSIX")
    bench = random_bench(1e5, clock=BenchClock(real_time=True))
    with server_of.BenchServer(bench, TimingFaults(Timing(), 2**32 - 1)) as server:
        serving = threading.Thread(target=server.run)
        serving.start()
        try:
            with ServedBench(server.addresses.timing) as served:
                library = HarpLibrary(HarpSimulator(served).functions, HYDRAHARP_400)
                with HarpStream(library, clock=SystemClock()) as stream:
                    stream.start()
                    bench.mark(1)
                    taken = Taken(stream, until=lambda taken: taken.batches[-1].markers)
        finally:
            server.stop()
            serving.join()
    expected = 1e5 * PERIOD_S * taken.edge[-1]
    assert abs(len(taken.edge) - expected) < 5 * np.sqrt(expected) + 1
    assert taken.marker_mask.tolist() == [1]


def test_rates_and_warnings_before_the_start():
    _, stream = tagged(random_bench(1e6), offset_s=20e-9)
    with stream:
        assert stream.rates().sync_hz == 10e6
        (sentence,) = stream.warnings()  # none on the offset: without it the bins asked for end too early
        assert "above 5 % of the sync rate" in sentence
        assert stream.settings()["mode"] == "time-tagged"
        assert stream.settings()["markers"] == "M1, M2, M3, M4"


@pytest.mark.parametrize(
    ("settings", "message"), [({"bins": 32769}, "32768 bins"), ({"inputs": (63,)}, "inputs up to 62")]
)
def test_more_than_records_can_tell(settings, message):
    with pytest.raises(LimitError, match=message):
        tagged(bench_with([], 0), **settings)


def test_durations_and_hold_offs_must_be_possible():
    with pytest.raises(LimitError, match=r"hold-off to 1000000 ns.*to 524296"):
        tagged(bench_with([], 0), markers=Markers(hold_off_s=1e-3))
    simulator, stream = tagged(bench_with([], 0))
    with stream, pytest.raises(LimitError, match="nearest possible value is 2 ms"):
        stream.start(1.7e-3)
    assert not simulator.instrument.running
