"""Driver and simulator together: photons at known times must come out in the right bins."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest

from drivers.errors import DeviceNotFoundError, LimitError
from drivers.harp.device import Harp, Rates
from drivers.harp.errors import HarpError
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings
from drivers.harp.triggers import CfdTrigger
from simulators.bench import Bench
from simulators.clock import BenchClock
from simulators.wire.harp import HarpSimulator
from simulators.wire.harp.codes import Slot
from support.harp_wire import SteadyLight, bench_with

PAPER_BIN_S = 4e-12


def rig(bench, *, instrument=None, serial=None, **settings):
    simulator = HarpSimulator(bench, **(instrument or {}))
    library, asked = (
        HarpLibrary(simulator.functions, HYDRAHARP_400),
        HarpSettings(family=HYDRAHARP_400, **settings),
    )
    return simulator, Harp(library, clock=bench.clock, serial=serial, settings=asked)


def filled(exposure, channel=0):
    counts = exposure.counts[channel]
    return {int(i): int(counts[i]) for i in np.flatnonzero(counts)}


def test_photons_land_in_their_bins():
    bins = [0, 1, 7, 9999, 14999]
    bench = bench_with([(b + 0.5) * PAPER_BIN_S for b in bins] + [15000.5 * PAPER_BIN_S], 6000)
    simulator, harp = rig(bench)
    with harp:
        exposure = harp.measure(10e-3)
        assert filled(exposure) == dict.fromkeys(bins, 10)
        assert exposure.counts.shape == (1, 15000)
        assert exposure.photons == 50
        assert exposure.live_time_s == 0.01
        assert exposure.warnings == ()
        assert filled(harp.measure(1e-3)) == dict.fromkeys(bins, 1)  # cleared in between
    simulator.raise_pending()


def test_a_long_exposure_is_drawn_while_it_lasts():
    """Of a long exposure hardly anything is left to be drawn at its end, when somebody waits for darkness."""
    bench = bench_with([4e-9 + 1e-12], 100_000)
    spans_s, draw = [], bench.detections
    bench.detections = lambda start_s, stop_s: spans_s.append(stop_s - start_s) or draw(start_s, stop_s)
    simulator, harp = rig(bench)

    def asked_to_stop():
        harp.rates()  # as a scan looks at them
        return bench.clock.now_s() >= stop_s

    with harp:
        stop_s = bench.clock.now_s() + 7.4
        cut = harp.measure(100.0, asked_to_stop)
        drawn_s = sum(spans_s)
        assert max(spans_s) <= 1.0 + 1e-9
        assert drawn_s == pytest.approx(cut.live_time_s)
        assert cut.live_time_s == pytest.approx(7.4, abs=0.06)  # somebody is asked each 50 ms
        spans_s.clear()
        whole = harp.measure(3.0)
        assert spans_s == pytest.approx([1.0, 1.0, 1.0])
        # steady light: what comes at the seams between pieces is neither lost nor counted twice
        assert whole.photons == 3 * harp.measure(1.0).photons
    simulator.raise_pending()


@pytest.mark.parametrize(
    ("settings", "time_s", "bin_index"),
    [
        ({"offset_s": 20e-9}, 24e-9, 1000),
        ({"offset_s": 20e-9}, 19e-9, None),
        ({"input_offsets_s": (1e-9,)}, 3e-9, 1000),
        ({"sync_offset_s": 1e-9}, 5e-9, 1000),
        ({"sync_offset_s": 5e-9}, 1e-9, None),  # 96 ns after the sync before: beyond 60 ns
        ({}, 104e-9, 1000),  # belongs to the next pulse
        ({}, 1004e-9, 1000),
        ({"bin_width_s": 16e-12}, 4e-9, 250),
        ({"inputs": (1,)}, 4e-9, None),
    ],
)
def test_offsets_and_periods(settings, time_s, bin_index):
    bench = bench_with([time_s + 1e-12], 1000)
    simulator, harp = rig(bench, **settings)
    with harp:
        assert filled(harp.measure(10e-3)) == ({} if bin_index is None else {bin_index: 10})
        assert harp.first_bin_s == pytest.approx(settings.get("offset_s", 0.0))
    simulator.raise_pending()


@pytest.mark.parametrize("divider", [1, 2, 16])
def test_a_divider_loses_no_photon(divider):
    """20 MHz need a divider: each photon is timed against its own pulse, those after skipped pulses too."""
    bench = bench_with([4e-9 + 1e-12, 54e-9 + 1e-12], 1000, repetition_hz=20e6)
    _, harp = rig(bench, sync_divider=divider)
    with harp:
        assert filled(harp.measure(20e-3)) == {1000: 20}
        assert harp.rates().sync_hz == 20e6
        told = [sentence for sentence in harp.warnings() if f"divider is {divider}" in sentence]
        assert len(told) == (divider > 1)


def test_of_several_instruments_one_has_to_be_named():
    bench = bench_with([2e-12], 1000)
    with pytest.raises(
        DeviceNotFoundError, match=r"several were found: 1000001, 1000002, 1000003\..*tcspc\.serial"
    ):
        rig(bench, instrument={"others": ("1000002", "1000003")})[1].__enter__()
    simulator, harp = rig(bench, instrument={"others": ("1000002", "1000003")}, serial="1000002")
    with harp:
        assert "serial 1000002" in harp.identity
        assert simulator.connection.slots.count(Slot.OPEN) == 1
        assert harp.measure(10e-3).photons == 10
    assert Slot.OPEN not in simulator.connection.slots


def test_an_instrument_that_goes_in_the_middle_is_said_to_be_gone():
    simulator, harp = rig(bench_with([2e-12], 1000))
    with harp:
        harp.measure(10e-3)
        simulator.connection.connected = False
        with pytest.raises(
            HarpError, match=r"-10 .*The instrument is no longer connected: check the USB cable"
        ):
            harp.measure(10e-3)


@pytest.mark.parametrize(
    ("levels", "sync_hz", "input_hz"),
    [
        ({}, (10e6, 10e6), (1000, 1000)),
        ({"sync_trigger": CfdTrigger(0.3, 0.01)}, (0, 0), (1000, 1000)),  # the pulses are 300 mV high
        ({"input_trigger": CfdTrigger(0.301, 0.01)}, (10e6, 10e6), (0, 0)),
        ({"input_trigger": CfdTrigger(0.299, 0.01)}, (10e6, 10e6), (1000, 1000)),
        (
            {"input_trigger": CfdTrigger(10e-3, 0.01)},
            (10e6, 10e6),
            (2000, 3000),
        ),  # 300 MHz exp(-25 / 2) of noise: 1118 Hz
        (
            {"sync_trigger": CfdTrigger(5e-3, 0.01)},
            (20e6, 24e6),
            (1000, 1000),
        ),  # 13.2 MHz of noise, cut at 12.5 MHz
        ({"input_trigger": CfdTrigger(0.0, 0.01)}, (10e6, 10e6), (12.5e6, 12.6e6)),
    ],
)
def test_levels_decide_what_is_seen(levels, sync_hz, input_hz):
    simulator, harp = rig(bench_with([2e-12], 1000), **levels)
    with harp:
        rates = harp.rates()
        assert sync_hz[0] <= rates.sync_hz <= sync_hz[1]
        assert input_hz[0] <= rates.input_hz <= input_hz[1]
        photons = harp.measure(1.0).photons
    # noise falls anywhere in the period of 100 ns, of which 60 ns are counted; 5 sigma of Poisson counts
    noise = 0.6 * (rates.input_hz - 1000) if rates.input_hz > 1000 else 0.0
    expected = 0 if not rates.sync_hz or not rates.input_hz else 1000 + noise
    if sync_hz == (10e6, 10e6):
        assert abs(photons - expected) <= 5 * noise**0.5
    if not rates.sync_hz:
        assert photons == 0
    simulator.raise_pending()


def test_each_input_has_its_row():
    simulator, harp = rig(
        bench_with([4e-9 + 1e-12], 1000), instrument={"inputs": 3}, inputs=(2, 0), input_offsets_s=(0.0, 1e-9)
    )
    with harp:
        exposure = harp.measure(10e-3)
        assert (filled(exposure, 0), filled(exposure, 1)) == ({}, {1250: 10})
        assert exposure.counts.shape == (2, 15000)
        assert exposure.photons == 10
        assert harp.rates() == Rates(10e6, (0.0, 1000.0))
        assert harp.rates().input_hz == 1000.0
        again = harp.measure(1e-3)
        assert again.counts.base is exposure.counts.base  # the same memory: nothing was copied
    simulator.raise_pending()


def test_the_open_instrument_knows_its_own_limits():
    _, harp = rig(bench_with([], 0), instrument={"inputs": 4})
    assert HYDRAHARP_400.limits.inputs is harp.limits.inputs is None
    with harp:
        assert harp.limits.inputs == 4
        with pytest.raises(LimitError, match="HydraHarp 1000001"):
            harp.limits.check_exposure(1.5e-3)
    assert HYDRAHARP_400.limits.inputs is None


def test_ready_for_rates_and_settings_on_entry():
    _, harp = rig(bench_with([1e-9], 205e3), serial="1000001")
    with harp:
        assert harp.rates() == Rates(10e6, (205e3,))
        assert harp.warnings() == ()
        assert harp.bin_width_s == PAPER_BIN_S
        assert "1000001" in harp.identity


def test_pile_up_is_warned_of():
    _, harp = rig(bench_with([1e-9], 600e3))
    with harp:
        (sentence,) = harp.warnings()
    assert "5 %" in sentence


def test_laser_off_is_a_warning():
    bench = bench_with([1e-9], 1000, emitting=False, ambient=True)
    _, harp = rig(bench)
    with harp:
        exposure = harp.measure(10e-3)
        assert exposure.counts.sum() == 0
        assert "sync was lost" in exposure.warnings[0]
        assert "No sync pulses" in harp.warnings()[0]
        bench.change_light(emitting=True)
        assert harp.measure(10e-3).warnings == ()


def test_saturation():
    _, harp = rig(bench_with([2e-12], 1e6), instrument={"count_depth": 65535})
    with harp:
        assert harp.measure(65e-3).warnings == ()
        exposure = harp.measure(70e-3)
        assert exposure.counts[0, 0] == 65535
        assert exposure.live_time_s == 0.07
        assert "full" in exposure.warnings[0]


def test_bench_time_passes_by_the_exposure_and_no_more():
    bench = bench_with([], 0)
    _, harp = rig(bench)
    with harp:
        start_s = bench.clock.now_s()
        for _ in range(1000):
            harp.measure(1e-3)
        assert bench.clock.now_s() - start_s == pytest.approx(1.0)


def test_real_time_clock():
    bench = Bench([SteadyLight([2e-12], 10_000)], clock=BenchClock(real_time=True))
    bench.change_light(emitting=True)
    simulator, harp = rig(bench)
    with harp:
        assert harp.measure(5e-3).counts.sum() == 50
    simulator.raise_pending()


def test_exposure_must_be_whole_milliseconds():
    _, harp = rig(bench_with([], 0))
    with harp, pytest.raises(LimitError, match="nearest possible value is 2 ms"):
        harp.measure(1.7e-3)


def test_input_must_exist():
    simulator, harp = rig(bench_with([], 0), inputs=(3,))
    with pytest.raises(LimitError, match="from 0 to 1"), harp:
        pass
    with rig_again(simulator):
        pass


def rig_again(simulator):
    """A second driver on the same library, which opens only if the first has closed."""
    return Harp(HarpLibrary(simulator.functions, HYDRAHARP_400), clock=simulator.instrument.bench.clock)


def test_absent_busy_and_wrong_serial():
    simulator, _ = rig(bench_with([], 0))
    with pytest.raises(DeviceNotFoundError, match="only 1000001"), named(simulator, "1000002"):
        pass
    simulator.connection.busy = True
    with pytest.raises(HarpError, match="DEVICE_BUSY"), named(simulator, "1000001"):
        pass
    simulator.connection.connected = False
    with pytest.raises(DeviceNotFoundError, match="no HydraHarp was found"), named(simulator, "1000001"):
        pass
    simulator.connection.connected, simulator.connection.busy = True, False
    with named(simulator, "1000001"):
        pass


def named(simulator, serial):
    return Harp(
        HarpLibrary(simulator.functions, HYDRAHARP_400), clock=simulator.instrument.bench.clock, serial=serial
    )


def test_closed_after_an_error():
    simulator, harp = rig(bench_with([2e-12], 1000))
    with pytest.raises(LimitError), harp:
        harp.measure(1.5e-3)
    with rig_again(simulator) as again:
        assert again.measure(1e-3).counts.sum() == 1


def test_exceptions_in_the_simulator_are_never_counts():
    bench = bench_with([2e-12], 1000)
    simulator, harp = rig(bench)
    with harp:
        harp.measure(1e-3)
        light, bench.photons = bench.photons, (None,)
        with pytest.raises(HarpError) as caught:
            harp.measure(1e-3)
        assert caught.value.code == -99
        with pytest.raises(AttributeError, match="detections"):
            simulator.raise_pending()
        bench.photons = light
        assert harp.measure(1e-3).counts.sum() == 1  # stopped and usable
    simulator.raise_pending()


def test_one_thread_at_a_time():
    """The vendor's library is not re-entrant: no call may begin inside another's."""
    calls, second_inside = [], Event()

    class Slow(SteadyLight):
        def rate_hz(self, *arguments):
            calls.append(None)
            if len(calls) > 1:
                second_inside.set()
            elif second_inside.wait(0.2):  # as long as a second thread gets to come in
                raise AssertionError("two threads inside")
            return 1.0

    bench = Bench([Slow([], 0)])
    bench.change_light(emitting=True)
    simulator, harp = rig(bench)
    with harp, ThreadPoolExecutor(2) as pool:
        for rates in [pool.submit(harp.rates), pool.submit(harp.rates)]:
            assert rates.result().input_hz == 1.0
    simulator.raise_pending()
