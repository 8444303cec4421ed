"""Dead time, unequal bins, drift and full counters of the timing instrument, through its functions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.harp.device import Harp
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings
from simulators.bench import Bench, Detections
from simulators.wire.harp import HarpSimulator, Nonlinearity, Timing
from support.harp_wire import SteadyLight

PERIOD_S = 100e-9


def measured(source, timing, *, exposure_s=1e-3, waits_s=0.0, **options):
    bench = Bench([source])
    bench.change_light(emitting=True, biased=True)
    simulator = HarpSimulator(bench, timing=timing, **options)
    settings = HarpSettings(family=HYDRAHARP_400, bin_width_s=4e-12, bins=25_000)
    with Harp(HarpLibrary(simulator.functions, HYDRAHARP_400), clock=bench.clock, settings=settings) as harp:
        bench.clock.sleep(waits_s)
        counts = harp.measure(exposure_s).counts[0].copy()
    simulator.raise_pending()
    return counts


class Given:
    """A source that gives the same detections at each exposure."""

    def __init__(self, pulse, time_s):
        self.seen = Detections(np.asarray(pulse, np.int64), np.asarray(time_s, float))

    def detections(self, *_):
        return self.seen

    def rate_hz(self, *_):
        return 0.0


@given(
    gaps_ps=st.lists(st.integers(0, 400_000), min_size=1, max_size=40),
    dead_ps=st.integers(1, 200_000),
)
def test_dead_time_leaves_the_gap_and_not_a_count_more_is_lost(gaps_ps, dead_ps):
    """Against the definition in whole picoseconds: counted if the last counted is long enough ago."""
    at_ps = np.cumsum(gaps_ps) + 500
    counted, last = [], None
    for i, t in enumerate(at_ps):
        if last is None or t - last >= dead_ps:
            counted.append(i)
            last = t
    pulse, inside_ps = at_ps // 100_000, at_ps % 100_000
    arrived = Detections(pulse, inside_ps * 1e-12)
    # half a picosecond less: on no edge
    kept = Timing(dead_time_s=(dead_ps - 0.5) * 1e-12).registered(arrived, PERIOD_S, 0.0)
    assert kept.pulse.tolist() == pulse[counted].tolist()
    assert kept.time_s.tolist() == (inside_ps * 1e-12)[counted].tolist()


def test_dead_time_in_the_histogram():
    """Every pulse a photon, and a second one 30 ns later, which an input dead for 80 ns never counts."""
    pulse = np.repeat(np.arange(10_000), 2)
    source = Given(pulse, np.tile([10.002e-9, 40.002e-9], 10_000))
    both = measured(source, Timing())
    first = measured(source, Timing(dead_time_s=80e-9))
    assert (both[2500], both[10_000]) == (10_000, 10_000)
    assert (first[2500], first[10_000]) == (10_000, 0)


def test_unequal_bins_show_in_even_light_as_they_are():
    """Ten million photons, 400 a bin: the pattern is found to within counting noise.

    Slope of counts over widths 1, with a standard error of noise / (spread of widths x sqrt(bins)).
    """
    timing = Timing(nonlinearity=Nonlinearity(rms=0.01, peak=0.05, seed=4))
    rng = np.random.default_rng(1)
    light = Given(np.zeros(10_000_000), PERIOD_S * rng.random(10_000_000))
    counts = measured(light, timing) / 400
    widths = timing.nonlinearity.widths()[:25_000]
    inside = slice(0, 24_900)  # bins are displaced: the last few may lie beyond the period
    counts, widths = counts[inside] - 1, widths[inside] - 1
    slope = (counts * widths).sum() / (widths**2).sum()
    assert slope == pytest.approx(1, abs=5 * 0.05 / (0.01 * np.sqrt(24_900)))
    left = counts - widths
    assert left.std() == pytest.approx(1 / np.sqrt(400), rel=5 / np.sqrt(2 * 24_900))


def test_the_usual_pattern_has_its_spread_and_loses_no_photon():
    clock = Nonlinearity(rms=0.002)
    widths = clock.widths()
    assert widths.std() == pytest.approx(0.002, rel=0.02)  # 65 536 draws of a distribution with long tails
    assert 0.01 < np.abs(widths - 1).max() <= 0.0201
    assert widths.sum() == pytest.approx(65_536)
    at = 1 + 65_536 * np.random.default_rng(0).random(10_000)
    moved = clock.counted(at)
    assert ((moved >= 1) & (moved <= 65_537)).all()
    assert np.abs(moved - at).max() < 5  # the widths add up to a displacement, too
    outside = np.array([0.2, 65_537.5])
    assert clock.counted(outside).tolist() == outside.tolist()


def test_drift_moves_all_counts_with_the_bench_s_time():
    """600 ps a minute; a minute later the same light is 600 ps, 150 bins, later."""
    source = Given(np.arange(100), np.full(100, 10.002e-9))
    timing = Timing(drift_s_per_s=10e-12)
    at = [int(measured(source, timing, waits_s=waits_s).argmax()) for waits_s in (0.0, 60.0, 120.0)]
    assert np.diff(at).tolist() == [150, 150]


def test_a_16_bit_counter_is_full_at_65535():
    source = SteadyLight([10.002e-9], 1e8)
    counts = measured(source, Timing(), count_depth=65_535)
    assert counts[2500] == 65_535
    assert measured(source, Timing())[2500] == 100_000


def test_an_instrument_without_faults_is_the_default():
    light = Given(np.arange(1000), PERIOD_S * np.random.default_rng(0).random(1000))
    assert np.array_equal(measured(light, None), measured(light, Timing(nonlinearity=Nonlinearity(seed=9))))
