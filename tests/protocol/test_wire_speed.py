"""What a simulated position costs in computer time; run with ``-n 0 --benchmark-only``."""

from itertools import count

import pytest

from support.simulated_rig import simulated_rig

pytest.importorskip("pytest_benchmark")


def test_one_position_of_the_mirror(benchmark):
    """A scan has 23,400 positions; steps of a centimetre on a wall 2.5 m away are 4 mrad."""
    numbers = count()
    with simulated_rig() as rig, rig.galvo() as mirror:

        def position():
            i = next(numbers)
            mirror.point(0.004 * (i % 150) - 0.3, 0.1)
            mirror.wait_settled(timeout_s=1.0)
            rig.bench.mirror.forget_before(rig.bench.clock.now_s())

        benchmark(position)
