"""How much faster than real time a stream of records is made, read and decoded; reported, never asserted.

Run with ``pytest tests/benchmarks/test_stream_speed.py -n 0 --benchmark-only -s``, on one core with
``taskset -c 0`` before it. Ratios are of bench time to processor time, which a busy machine changes little.
"""

from time import process_time

import numpy as np
import pytest

from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.records import T3, Decoder
from drivers.harp.settings import HarpSettings
from drivers.harp.stream import HarpStream
from simulators.bench import Bench, BenchGeometry, Channel, Detections
from simulators.wire.harp import HarpSimulator

pytestmark = pytest.mark.benchmark

RATE_HZ = 10e6
STRETCH_S = 0.5


class ReadyPhotons:
    """The same photons for each stretch of 10 ms, made beforehand: drawing them is another matter."""

    def __init__(self, rate_hz):
        rng = np.random.default_rng(3)
        number = round(rate_hz * 10e-3)
        pulse = np.sort(rng.integers(0, 100_000, number))
        self.ready = Detections(pulse, rng.uniform(0, 60e-9, number))

    def detections(self, laser_spot_m, light, duration_s, rng):
        return self.ready

    def rate_hz(self, laser_spot_m, light):
        return RATE_HZ


@pytest.mark.parametrize("channels", [1, 2, 8])
def test_ten_million_photons_a_second(benchmark, channels):
    photons = [ReadyPhotons(RATE_HZ / channels) for _ in range(channels)]
    bench = Bench(photons, BenchGeometry(channels=tuple(Channel(input=n) for n in range(channels))))
    bench.change_light(emitting=True)
    settings = HarpSettings(family=HYDRAHARP_400, inputs=tuple(range(channels)))
    with HarpStream(
        HarpLibrary(HarpSimulator(bench).functions, HYDRAHARP_400), clock=bench.clock, settings=settings
    ) as stream:
        seconds_of(stream, 10e-3)  # compiled
        pieces_s, taken_s = [], []

        def run():
            taken_s.append(seconds_of(stream, STRETCH_S, pieces_s))

        benchmark.pedantic(run, rounds=3)
    print(f"\n{channels} channels: {STRETCH_S / min(taken_s):.1f} times real time")
    print(f"of it, decoding alone {STRETCH_S / min(pieces_s):.0f} times real time")


def seconds_of(stream, duration_s, decoding_s=None):
    """Return processor seconds to measure and decode; add those of the decoder alone to a list."""
    begun_s, decoder, number = process_time(), Decoder(T3), 0
    stream.start(duration_s)
    pieces = []
    for piece in stream.pieces():
        pieces.append(piece.records)
        number += decoder.decode(piece.records).photons
    taken_s = process_time() - begun_s
    assert number == pytest.approx(RATE_HZ * duration_s, rel=1e-6)
    if decoding_s is not None:
        decoder, begun_s = Decoder(T3), process_time()
        for records in pieces:
            decoder.decode(records)
        decoding_s.append(process_time() - begun_s)
    return taken_s
