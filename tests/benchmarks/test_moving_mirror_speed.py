"""How much faster than real time photons are drawn while the mirror moves on; reported, never asserted.

Run with ``pytest tests/benchmarks/test_moving_mirror_speed.py -n 0 --benchmark-only -s``. Ratios are of bench
time to processor time, which a busy machine changes little. The mirror goes 1 cm further each millisecond, as
in a continuous scan, with the built-in rig's physics, and photons are drawn in pieces of 10 ms.
"""

from time import process_time

import numpy as np
import pytest

from rig.bench.simulated import simulated_bench
from rig.model.config import RigConfig, SimulationConfig

pytestmark = pytest.mark.benchmark

TICK_S, PIECE_S, DURATION_S = 1e-3, 10e-3, 0.4


def lines(bench, ticks):
    """Angles that lead along lines of 180 points, 1 cm apart, to and fro."""
    far_m = -bench.geometry.galvo_m[2]
    k = np.arange(ticks)
    line, column = np.divmod(k, 180)
    x_m = (np.where(line % 2, 179 - column, column) - 89.5) * 0.01 - bench.geometry.galvo_m[0]
    y_m = (line % 130 - 64.5) * 0.01 - bench.geometry.galvo_m[1]
    return np.arctan(np.column_stack([x_m, y_m]) / -far_m)


@pytest.mark.parametrize("scene", ["letters", "office"])
def test_a_continuous_scan(benchmark, scene):
    bench = simulated_bench(RigConfig(simulation=SimulationConfig(scene=scene)), real_time=False)
    bench.change_light(emitting=True, biased=True, gated=True, gate_delay_s=20e-9)
    taken_s, photons = [], []

    def run():
        begun_s, bench_s = process_time(), bench.clock.now_s()
        ticks = round(DURATION_S / TICK_S)
        bench.follow(bench_s + TICK_S * np.arange(ticks), lines(bench, ticks))
        bench.clock.sleep(DURATION_S)
        for piece in range(round(DURATION_S / PIECE_S)):
            start_s = bench_s + piece * PIECE_S
            photons.append(len(bench.detections(start_s, start_s + PIECE_S)[0]))
        taken_s.append(process_time() - begun_s)

    run()  # compiled
    benchmark.pedantic(run, rounds=3)
    rate_hz = np.mean(photons) / PIECE_S
    print(f"\n{scene}: {DURATION_S / min(taken_s):.2f} times real time, {rate_hz:.3g} photons a second")
