"""The bench follows its mirror and its switches, and repeats itself from its seed."""

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from simulators.bench import MARK_S, Bench, BenchGeometry, Mark, Syncs, no_detections
from simulators.detector import Detector
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport

QUIET = Detector(dark_hz=0, ambient_hz=0)

#: Photons, sum of their sync pulses, sum of their times [s].
ALWAYS = [
    (1590, 15691787, 5.089246072090926e-05),
    (1381, 14016512, 4.379208925725041e-05),
    (1617, 16399871, 5.156198218963208e-05),
]


def lit_bench(seed=0, **optics):
    photons = HiddenScenePhotons(
        Transport.of_scene(scene("letters")), BenchGeometry(), Optics(**optics), QUIET
    )
    bench = Bench([photons], seed=seed)
    bench.change_light(emitting=True, biased=True)
    return bench


def expose(bench, duration_s):
    start_s = bench.clock.now_s()
    bench.clock.sleep(duration_s)
    return bench.detections(start_s, start_s + duration_s)[0].time_s


def test_a_standing_mirror_draws_the_photons_it_always_has():
    """Numbers and sums of what was drawn since the first version, so that old scans can be made again."""
    bench, seen = lit_bench(seed=5), []
    bench.change_light(gated=True, gate_delay_s=20e-9)
    for x, y in [(0.05, -0.02), (-0.1, 0.07), (0.05, -0.02)]:
        point_and_settle(bench, x, y)
        start_s = bench.clock.now_s()
        bench.clock.sleep(2e-3)
        (one,) = bench.detections(start_s, start_s + 2e-3)
        seen.append((len(one), int(one.pulse.sum()), one.time_s.sum()))
    assert [number[:2] for number in seen] == [number[:2] for number in ALWAYS]
    assert [number[2] for number in seen] == pytest.approx([number[2] for number in ALWAYS], rel=1e-9)


def point_and_settle(bench, x, y):
    bench.steer(x, y)
    bench.clock.sleep(20e-3)


def test_nothing_is_compiled_once_the_bench_is_warm():
    """In a program of its own, since other tests have compiled what they draw."""
    code = """if True:
        import sys

        import numpy as np

        from rig.bench.simulated import simulated_bench
        from rig.model.config import built_in

        def compiled():
            modules = [one for name, one in sys.modules.items() if name.startswith("simulators.")]
            known = {one for module in modules for one in vars(module).values() if hasattr(one, "py_func")}
            return {(one.__name__, *one.signatures) for one in known if one.signatures}

        bench = simulated_bench(built_in(), real_time=False)
        bench.change_light(emitting=True, biased=True, gated=True, gate_delay_s=31.5e-9)
        bench.warm_up()
        warm = compiled()
        bench.steer(0.1, 0.05)
        for wait_s in (0.1, 0.0):
            bench.clock.sleep(wait_s)
            start_s = bench.clock.now_s()
            bench.clock.sleep(0.02)
            assert sum(map(len, bench.detections(start_s, start_s + 0.02)))
            bench.follow(start_s + 0.02 + np.array([0.0, 5e-3]), np.array([(0.0, 0.1), (0.1, 0.1)]))
        assert warm
        print(compiled() - warm)"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_a_laser_switched_off_half_way_gives_half_the_photons():
    bench = lit_bench()
    expected = bench.count_rate_hz(0) * 25e-3
    start_s = bench.clock.now_s()
    bench.clock.sleep(25e-3)
    bench.change_light(emitting=False)
    bench.clock.sleep(25e-3)
    (seen,) = bench.detections(start_s, start_s + 50e-3)
    assert len(seen) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert bench.sync_rate_hz() == 0
    assert bench.count_rate_hz(0) == 0
    assert len(expose(bench, 50e-3)) == 0


def test_a_detector_biased_late_sees_the_rest():
    bench = lit_bench()
    bench.change_light(biased=False)
    start_s = bench.clock.now_s()
    bench.clock.sleep(30e-3)
    bench.change_light(biased=True)
    bench.clock.sleep(10e-3)
    expected = bench.count_rate_hz(0) * 10e-3
    assert len(bench.detections(start_s, start_s + 40e-3)[0]) == pytest.approx(
        expected, abs=5 * np.sqrt(expected)
    )


def test_a_moving_mirror_is_followed():
    """Counts equal the integral of the rate along the way, within 5 sigma, which neither end would give."""
    bench = lit_bench(stray_per_pulse=0, power_w=20.0)
    point_and_settle(bench, -0.29, 0.0)
    start_s = bench.clock.now_s()
    bench.steer(0.34, 0.23)
    times_s = expose(bench, 2e-3)
    middles_s = start_s + (np.arange(400) + 0.5) / 400 * 2e-3
    spots = [bench.geometry.laser_spot_m(bench.mirror.position(t)) for t in middles_s]
    rates_hz = np.array([bench.photons[0].rate_hz(spot, bench.light) for spot in spots])
    expected = rates_hz.mean() * 2e-3
    tolerance = 5 * np.sqrt(expected)
    assert len(times_s) == pytest.approx(expected, abs=tolerance)
    assert abs(rates_hz[0] * 2e-3 - expected) > 2 * tolerance
    assert abs(rates_hz[-1] * 2e-3 - expected) > 2 * tolerance


def test_a_way_is_cut_where_the_mirror_begins_to_move_and_where_it_stands():
    asked = []

    class Listening:
        def detections(self, spot, light, duration_s, rng):
            asked.append((spot, duration_s))
            return no_detections()

        def detections_along(self, track, light, rng):
            asked.append((track, track.duration_s))
            return no_detections()

        def rate_hz(self, spot, light):
            return 0.0

    bench = Bench([Listening()])
    bench.clock.sleep(1.0)
    bench.steer(0.05, 0.0)
    bench.clock.sleep(31e-3)
    bench.detections(0.9, 1.03)
    (before, before_s), (track, track_s), (after, after_s) = asked
    assert before == bench.geometry.laser_spot_m((0.0, 0.0))
    assert after == bench.geometry.laser_spot_m((0.05, 0.0))
    assert (before_s, before_s + track_s + after_s) == pytest.approx((0.1, 0.13))
    assert 7e-3 < track_s <= 10e-3  # a critically damped step of 400 Hz
    times_s = np.linspace(1.0, 1.0 + track_s, len(track.spots_m))
    spots = [bench.geometry.laser_spot_m(bench.mirror.position(t)) for t in times_s]
    assert track.spots_m == pytest.approx(np.array(spots), abs=1e-12)
    assert np.diff(times_s).max() <= 20e-6 * (1 + 1e-9)


def test_the_bench_repeats_itself_in_any_order_of_positions():
    places = [(0.05, -0.02), (-0.1, 0.07), (0.0, 0.1)]

    def scan(order, seed):
        bench = lit_bench(seed)
        seen = {}
        for index in order:
            point_and_settle(bench, *places[index])
            seen[index] = expose(bench, 1e-3)
        return seen

    forward, backward, other = scan([0, 1, 2], 7), scan([2, 0, 1], 7), scan([0, 1, 2], 8)
    for index in range(3):
        assert np.array_equal(forward[index], backward[index])
        assert not np.array_equal(forward[index], other[index])


def test_a_second_look_at_a_position_gives_new_photons():
    bench = lit_bench()
    point_and_settle(bench, 0.05, 0.05)
    assert not np.array_equal(expose(bench, 1e-3), expose(bench, 1e-3))


def test_the_beam_meets_the_wall_where_the_mirror_points():
    """The mirror stands 2.5 m away."""
    geometry = BenchGeometry()
    x_m, y_m, z_m = geometry.laser_spot_m((0.1, -0.2))
    assert (x_m, y_m, z_m) == pytest.approx((-0.2 + 2.5 * np.tan(0.1), -2.5 * np.tan(0.2), 0.0))


def test_marks_come_once_and_in_order():
    bench = Bench()
    bench.clock.sleep(1.0)
    bench.mark(8, 3.0)
    bench.mark(1)
    bench.mark(2, 2.0, width_s=1e-3)
    assert bench.take_marks(1.0) == []
    assert bench.take_marks(3.0) == [Mark(1.0, 1, MARK_S), Mark(2.0, 2, 1e-3)]
    bench.forget_before(4.0)  # nobody will ask
    assert bench.take_marks(5.0) == []


@pytest.mark.parametrize("mask", [0, 16, -1])
def test_there_are_four_marker_inputs(mask):
    with pytest.raises(ValueError, match="four marker inputs"):
        Bench().mark(mask)


def test_sync_pulses_are_cut_only_where_their_rate_changes():
    bench = Bench()
    for after_s, change in ((1.0, {"emitting": True}), (1.0, {"power": 0.5}), (1.0, {"repetition_hz": 5e6})):
        bench.clock.sleep(after_s)
        bench.change_light(**change)
    bench.clock.sleep(1.0)
    assert bench.syncs_between(0.5, 4.0) == [
        Syncs(0.5, 1.0, 0.0),
        Syncs(1.0, 3.0, 10e6),
        Syncs(3.0, 4.0, 5e6),
    ]
    assert bench.syncs_between(1.5, 1.6) == [Syncs(1.5, 1.6, 10e6)]


def ticking(marks, tick_s=1e-3, **when):
    """A bench at 1 s whose listeners have noted what they were told."""
    bench, told = Bench(), []
    bench.clock.sleep(1.0)
    bench.tick_listeners.append(lambda times_s: told.append(("ticks", *times_s)))
    bench.stop_listeners.append(lambda now_s: told.append(("stop", now_s)))
    bench.start_ticks(np.array(marks, np.uint8), tick_s, **when)
    return bench, told


def test_ticks_are_told_at_once_and_mark_in_time():
    bench, told = ticking([0, 3, 1, 0, 7], start_s=2.0)
    times_s = [2.0 + k * 1e-3 for k in range(5)]
    assert told == [("ticks", *times_s)]
    assert bench.ticks_end_s == times_s[4]
    bench.mark(8, 2.0015)
    assert bench.take_marks(times_s[2]) == [Mark(times_s[1], 3, MARK_S), Mark(2.0015, 8, MARK_S)]
    assert bench.take_marks(9.0) == [Mark(times_s[2], 1, MARK_S), Mark(times_s[4], 7, MARK_S)]
    assert bench.take_marks(9.0) == []


def test_ticks_that_are_stopped_do_not_come():
    bench, told = ticking([1] * 10)
    bench.clock.sleep(4.5e-3)
    bench.stop_ticks()
    assert told[1:] == [("stop", pytest.approx(1.0045))]
    assert bench.ticks_end_s == pytest.approx(1.0045)
    assert [mark.at_s for mark in bench.take_marks(9.0)] == [1.0 + k * 1e-3 for k in range(5)]


def test_new_ticks_end_those_before_and_keep_their_marks():
    bench, told = ticking([1] * 10)
    bench.clock.sleep(1.5e-3)
    bench.start_ticks(np.array([2], np.uint8), 1e-6)
    assert [one[0] for one in told] == ["ticks", "stop", "ticks"]
    marks = bench.take_marks(9.0)
    assert [mark.mask for mark in marks] == [1, 1, 2]
    assert marks[2].width_s < 1e-6  # the next tick would be a pulse of its own


def test_no_ticks_are_refused():
    for marks, tick_s in (([], 1e-3), ([1], 0.0), ([16], 1e-3)):
        with pytest.raises(ValueError, match=r"both numbers must be above 0|four marker inputs"):
            ticking(marks, tick_s)
    assert Bench().ticks_end_s == 0.0


def test_a_mirror_follows_until_it_is_steered_or_stopped():
    bench = Bench()
    times_s = np.array([1.0, 2.0, 3.0])
    angles = np.array([(0.1, 0.0), (0.2, 0.0), (0.3, 0.0)])
    bench.follow(times_s, angles)
    assert bench.target_rad == (0.0, 0.0)
    assert bench.settled
    bench.clock.sleep(1.5)
    assert bench.target_rad == bench.position_rad == (0.1, 0.0)
    bench.stop_following(1.5)
    bench.clock.sleep(1.0)
    assert bench.target_rad == (0.1, 0.0)
    bench.follow(times_s + 2, angles)
    bench.steer(-0.1, 0.0)
    bench.clock.sleep(9.0)
    assert bench.target_rad == (-0.1, 0.0)


@pytest.fixture
def eager_threads():
    """Threads take turns a thousand times as often as usual."""
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(usual_s)


class Blind:
    """A detector that sees nothing."""

    def detections(self, spot, light, duration_s, rng):
        return no_detections()

    def detections_along(self, track, light, rng):
        return no_detections()


def test_two_threads_may_use_the_bench(eager_threads):
    """One follows what happens, one commands: no tick's mark is lost or comes twice, time never goes back."""
    bench, over, ticks, stops = Bench([Blind()]), threading.Event(), [], []
    bench.tick_listeners.append(ticks.append)
    bench.stop_listeners.append(stops.append)

    def follow():
        taken, reached_s, last = [], 0.0, False
        while not last:
            last = over.is_set()
            bench.clock.sleep(0.05e-3)
            now_s = bench.clock.now_s()
            assert now_s > reached_s
            taken += bench.take_marks(now_s)
            assert bench.syncs_between(reached_s, now_s)[-1].end_s == now_s
            bench.detections(reached_s, now_s)
            reached_s = now_s
        return taken

    def command():
        for k in range(1000):
            before_s = bench.clock.now_s()
            bench.steer(0.001 * (k % 100), -0.05)
            assert bench.target_rad == (0.001 * (k % 100), -0.05)
            bench.follow(bench.clock.now_s() + 1e-5 * np.arange(50), np.full((50, 2), 0.01))
            bench.change_light(lamp_hz=float(k))
            assert bench.light.lamp_hz == k
            bench.start_ticks(np.full(40, 1 + k % 15, np.uint8), 1e-5)
            bench.clock.sleep(0.2e-3)
            bench.stop_ticks()
            assert bench.known_from_s <= bench.clock.now_s()
            assert bench.clock.now_s() > before_s
        over.set()

    with ThreadPoolExecutor(2) as pool:
        following, commanding = pool.submit(follow), pool.submit(command)
        commanding.result()
        taken = following.result()
    came = [times_s[times_s <= stop_s] for times_s, stop_s in zip(ticks, stops, strict=True)]
    assert [mark.at_s for mark in taken] == np.concatenate(came).tolist()
    assert len(taken) > 20_000
