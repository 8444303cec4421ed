"""How many photons a second go from records to a scan file and to spectra; reported, never asserted.

A thread hands over pieces as large as the instrument's, at the pace of 40 million photons a second (the
HydraHarp's USB gives no more), for ten seconds. One thread decodes them, puts them together to lines and
adds each line to the spectra of a virtual pulse, as the live image does. A second thread stores the lines:
crash-safely, in memory (``/dev/shm``) where there is such a disk, so that the real disk is not what is
measured: 80 MB/s go to the journal and as much, packed, to the file.

Run with ``pytest tests/benchmarks/test_pipeline_speed.py -n 0 --benchmark-only -s``.
"""

import tempfile
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from time import perf_counter, sleep, thread_time

import numpy as np
import pytest

from drivers.harp.reader import QUEUE_PIECES
from drivers.harp.records import T3, Batch, Decoder, Encoder
from drivers.harp.stream import TaggedRecords
from recon.accumulate import Accumulator
from recon.capture import ArrayHistograms, Capture
from recon.grid import VoxelGrid
from recon.wave import VirtualPulse
from recon.window import Window
from rig.acquire.assembly import Assembler, LineRead, Timing
from rig.files import ScanDescription, ScanWriter
from rig.model.config import built_in
from rig.model.plan import ScanPlan
from rig.model.pointing import Pointing
from rig.model.sweep import Trajectories

pytestmark = pytest.mark.benchmark

SYNC_HZ, TICK_S, RATE_HZ = 40e6, 1e-3, 40e6
BINS, BIN_S = 6250, 4e-12
#: Sync pulses in a tick; in so many ticks the records' counter wraps a whole number of times.
TICK, GROUP = 40_000, 16
COLUMNS, ROWS = 100, 95
TICKS_A_PIECE = 3  # 120,000 records


class Light:
    """Records of an even light, tick by tick: one group of ticks is made, and comes again and again."""

    def __init__(self):
        rng = np.random.default_rng(0)
        pulse = np.sort(rng.integers(0, GROUP * TICK, round(RATE_HZ * GROUP * TICK_S)))
        dtime, channel = (
            rng.integers(0, BINS, len(pulse)).astype("u2"),
            rng.integers(0, 2, len(pulse)).astype("i1"),
        )
        encoder, self._ticks = Encoder(T3), []
        for tick in range(2 * GROUP):
            part = slice(*np.searchsorted(pulse, [tick % GROUP * TICK, (tick % GROUP + 1) * TICK]))
            at = tick // GROUP * GROUP * TICK
            mark = np.array([tick * TICK]), np.ones(1, "u1"), np.zeros(1, np.int64)
            self._ticks.append(encoder.encode(Batch(pulse[part] + at, dtime[part], channel[part], *mark)))

    def tick(self, number, mark):
        """Return the records of a tick that begins with a marker, or without one."""
        words = self._ticks[number if number < GROUP else GROUP + number % GROUP]
        marker = int(np.flatnonzero((words[:4] >> 25) == (1 << 6 | 1))[0])
        if not mark:
            return np.delete(words, marker)
        words = words.copy()
        words[marker] += np.uint32(int(mark) - 1 << 25)
        return words


@pytest.fixture(scope="module")
def stage():
    """Plan, sweep, and the pieces of records that measure it."""
    plan = ScanPlan.grid(
        built_in(),
        columns=COLUMNS,
        rows=ROWS,
        skip_m=0.0,
        motion="continuous",
        exposure_s=TICK_S,
        order="snake",
    )
    angles = Pointing((0.0, 0.0, 2.0)).angles_rad(plan.spots_m)
    (sweep,) = Trajectories(plan, angles, 4e-3).sweeps(range(len(plan)))
    light = Light()
    ticks = [
        light.tick(number, mark) for number, mark in enumerate(np.append(sweep.marks, np.zeros(5, "u1")))
    ]
    return (
        plan,
        sweep,
        [np.concatenate(ticks[n : n + TICKS_A_PIECE]) for n in range(0, len(ticks), TICKS_A_PIECE)],
    )


class Pipeline:
    """What becomes of pieces, and how much processor time each part of it takes."""

    def __init__(self, plan, sweep, folder):
        self.cost_s = dict.fromkeys(("decode", "put together", "count", "spectra", "store"), 0.0)
        self._decoder = Decoder(T3)
        self._assembler = Assembler(sweep, Timing((0, 1), BINS, SYNC_HZ, 0.0))
        laser_m = plan.spots_m
        detector_m = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]])
        described = ScanDescription(laser_m, detector_m, BINS, BIN_S, 0.0, tagged=True)
        self._writer = ScanWriter.create(folder / "a.h5", described)
        pairs = 2 * len(laser_m)
        capture = Capture(
            ArrayHistograms(np.zeros((pairs, BINS), np.uint32)),
            BIN_S,
            np.zeros(1),
            np.repeat(laser_m, 2, axis=0),
            np.tile(detector_m[0], (len(laser_m), 1)),
        )
        x_m = np.linspace(-0.5, 0.5, 33)
        self._live = Accumulator(
            capture, VirtualPulse(0.04, 2.0), VoxelGrid(x_m, x_m, np.linspace(1.0, 1.6, 31)), Window()
        )
        self._lines = SimpleQueue()
        self._storing = Thread(target=self._store)
        self._storing.start()
        self.photons = 0
        #: Processor time of each piece in the first thread, of each line in the second; after which piece.
        self.piece_s, self.line_s, self.line_after = [], [], []

    def take(self, words):
        began = thread_time()
        batch = self._decoder.decode(words)
        decoded = thread_time()
        lines = list(self._assembler.add(TaggedRecords(words, batch, self._decoder.base, ())))
        self.cost_s["decode"] += decoded - began
        self.cost_s["put together"] += thread_time() - decoded
        for line in lines:
            assert isinstance(line, LineRead), line
            self.line_after.append(len(self.piece_s))
            self._lines.put(line)
            self._see(line)
        self.piece_s.append(thread_time() - began)

    def _see(self, line):
        began = thread_time()
        counts = np.concatenate([exposure.counts for exposure in line.exposures])
        counted = thread_time()
        first = 2 * line.line.steps.start
        self._live.add(slice(first, first + len(counts)), counts)
        self.cost_s["count"] += counted - began
        self.cost_s["spectra"] += thread_time() - counted

    def _store(self):
        while (line := self._lines.get()) is not None:
            began = thread_time()
            for exposure in line.exposures:
                self._writer.append_photons(exposure.photon_bins, exposure.of_channel, exposure.live_time_s)
                self.photons += exposure.photons
            self._writer.checkpoint()
            self.line_s.append(thread_time() - began)
            self.cost_s["store"] += self.line_s[-1]

    def end(self):
        self._lines.put(None)
        self._storing.join()
        self._writer.close("complete")


def late_with_a_core_each(pipeline, pace_s):
    """Return by how much pieces and lines would be late at most if each thread had a core to itself [s].

    Each is begun when it is there and the one before is done, and takes the processor time that it took here.
    """
    done_s, late_s, pieces_s = 0.0, 0.0, []
    for number, cost_s in enumerate(pipeline.piece_s):
        done_s = max(done_s, (number + 1) * pace_s) + cost_s
        pieces_s.append(done_s)
        late_s = max(late_s, done_s - (number + 1) * pace_s)
    stored_s, late_lines_s = 0.0, 0.0
    for after, cost_s in zip(pipeline.line_after, pipeline.line_s, strict=True):
        stored_s = max(stored_s, pieces_s[after]) + cost_s
        late_lines_s = max(late_lines_s, stored_s - pieces_s[after])
    return late_s, late_lines_s


def folder():
    memory = Path("/dev/shm")
    return tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)


def at_pace(pieces, pace_s, queue):
    """Hand over pieces when they are due, and never later than that by itself."""
    began = perf_counter()
    for number, words in enumerate(pieces):
        sleep(max(0.0, began + (number + 1) * pace_s - perf_counter()))
        queue.put((words, perf_counter()))
    queue.put(None)


def test_forty_million_photons_a_second(benchmark, stage):
    plan, sweep, pieces = stage
    warm = SimpleQueue()
    at_pace(pieces[:1], 0.0, warm)
    with folder() as name:
        pipeline = Pipeline(plan, sweep, Path(name))
        queue, late_s = SimpleQueue(), [0.0]
        source = Thread(target=at_pace, args=(pieces, TICKS_A_PIECE * TICK_S, queue))
        waited = []

        def run():
            source.start()
            while (item := queue.get()) is not None:
                waited.append(queue.qsize())
                late_s[0] = max(late_s[0], perf_counter() - item[1])
                pipeline.take(item[0])
            pipeline.end()

        benchmark.pedantic(run, rounds=1)
        size = (Path(name) / "a.h5").stat().st_size
    records = sum(len(words) for words in pieces)
    seconds = len(pieces) * TICKS_A_PIECE * TICK_S
    took = benchmark.stats.stats.max
    print(f"\n{records / seconds / 1e6:.1f} million records a second for {seconds:.1f} s, in {took:.1f} s")
    print(f"at most {max(waited)} pieces waited (the driver keeps {QUEUE_PIECES}), {late_s[0] * 1e3:.0f} ms")
    pieces_s, lines_s = late_with_a_core_each(pipeline, TICKS_A_PIECE * TICK_S)
    print(
        f"a core for each thread: pieces {pieces_s * 1e3:.0f} ms late at most, lines {lines_s * 1e3:.0f} ms"
    )
    print(f"{size / pipeline.photons:.2f} bytes a photon in the file")
    for what, cost_s in pipeline.cost_s.items():
        print(f"{what:>14}: {cost_s / records * 1e9:5.1f} ns a photon, {cost_s / seconds:.0%} of a core")
