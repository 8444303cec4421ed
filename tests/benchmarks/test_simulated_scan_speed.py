"""What the simulator takes for a position of the default scan, beside its random numbers: reported only.

Run with ``pytest tests/benchmarks/test_simulated_scan_speed.py -n 0 --benchmark-only -s``. The floor is what
numpy takes, in the same run, for the random numbers of as many photons and nothing else: four uniform ones
(two for the place on a surface, gate, moment), two normal ones (pulse, response), one exponential one (which
surface) and two more uniform ones (afterpulse, tail of the response).
"""

from itertools import product
from time import process_time

import numpy as np
import pytest

from rig.bench.simulated import simulated_bench
from rig.model.config import built_in

pytestmark = pytest.mark.benchmark


def positions(number):
    """Spread over the wall, each of them new."""
    side = int(np.ceil(np.sqrt(number)))
    return [(x, y) for x, y in product(np.linspace(-0.3, 0.3, side), np.linspace(-0.25, 0.25, side))][:number]


def floor_s(photons):
    """Processor time of the random numbers alone."""
    draw, begun_s = np.random.default_rng(1), process_time()
    draw.random((6, photons))
    draw.standard_normal((2, photons))
    draw.standard_exponential(photons)
    return process_time() - begun_s


@pytest.mark.parametrize(("exposure_s", "number"), [(10e-3, 400), (1.0, 9)])
def test_drawing_a_position(benchmark, exposure_s, number):
    bench = simulated_bench(built_in(), real_time=False)
    bench.change_light(emitting=True, biased=True, gated=True, gate_delay_s=31.5e-9)
    taken_s, floors_s, photons = [], [], []

    def run():
        begun_s, seen = process_time(), []
        for angles_rad in positions(number):
            bench.steer(*angles_rad)
            bench.clock.sleep(0.1)
            start_s = bench.clock.now_s()
            bench.clock.sleep(exposure_s)
            seen.append(len(bench.detections(start_s, start_s + exposure_s)[0]))
        taken_s.append(process_time() - begun_s)
        floors_s.append(sum(map(floor_s, seen)))
        photons.append(sum(seen))

    bench.warm_up()
    run()
    benchmark.pedantic(run, rounds=3)
    best_s, least_s, mean = min(taken_s), min(floors_s), np.mean(photons) / number
    print(
        f"\n{exposure_s:g} s, {mean:.0f} photons: {best_s / number * 1e3:.2f} ms a position, "
        f"{best_s / number / mean * 1e9:.0f} ns a photon, {best_s / least_s:.1f} times the random numbers"
    )
