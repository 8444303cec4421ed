"""The simulated library by its C functions, without the driver."""

from ctypes import c_uint

import numpy as np
import pytest
from hydraharp_wire import DECLARED, bench_with, call
from hypothesis import given
from hypothesis import strategies as st

from simulators.wire.hydraharp import HydraHarpSimulator
from simulators.wire.hydraharp.histogram import HistogramMemory, bins_of
from simulators.wire.hydraharp.timing import Nonlinearity

HISTOGRAM, T2, T3, CONTINUOUS = 0, 2, 3, 8


class Opened:
    """The functions at index 0, opened and initialised; calls must succeed, but for `code`."""

    def __init__(self, bench, *, mode=HISTOGRAM, **instrument):
        self.bench = bench
        self.simulator = HydraHarpSimulator(bench, **instrument)
        self("HH_OpenDevice")
        self("HH_Initialize", mode, 0)
        self("HH_Calibrate")

    def __call__(self, name, *arguments):
        code, *outputs = call(self.simulator.functions, name, 0, *arguments)
        self.simulator.raise_pending()
        assert code == 0, f"{name} returned {code}"
        return outputs[0] if len(outputs) == 1 else outputs

    def code(self, name, *arguments):
        return call(self.simulator.functions, name, 0, *arguments)[0]

    def run(self, tacq_ms, *, for_s=None):
        self("HH_StartMeas", tacq_ms)
        self.bench.clock.sleep(tacq_ms / 1000 if for_s is None else for_s)
        ended = self("HH_CTCStatus")
        self("HH_StopMeas")
        return ended

    def counts(self, channel=0, length=65536, clear=0):
        return np.array(self("HH_GetHistogram", channel, clear)[:length])


def test_identity():
    hh = Opened(bench_with([], 0), serial="7654321", inputs=5)
    assert hh("HH_GetSerialNumber") == b"7654321"
    assert hh("HH_GetHardwareInfo") == [b"HydraHarp 400", b"SIM", b"SIM"]
    assert hh("HH_GetNumOfInputChannels") == 5
    assert hh("HH_GetBaseResolution") == [1.0, 26]
    assert hh("HH_GetNumOfModules") == 4
    assert [hh("HH_GetModuleIndex", channel) for channel in range(5)] == [1, 1, 2, 2, 3]
    assert hh.code("HH_GetModuleInfo", 4) == -17


def test_nothing_works_between_open_and_initialize():
    functions = HydraHarpSimulator(bench_with([], 0)).functions
    assert call(functions, "HH_OpenDevice", 0) == (0, b"1000001")
    for name in ("HH_Calibrate", "HH_GetFeatures", "HH_GetSyncRate", "HH_StopMeas", "HH_GetFlags"):
        assert call(functions, name, 0)[0] == -22


def test_busy_elsewhere_or_open_already():
    simulator = HydraHarpSimulator(bench_with([], 0))
    simulator.busy = True
    assert call(simulator.functions, "HH_OpenDevice", 0) == (-2, b"")
    assert call(simulator.functions, "HH_GetFeatures", 0)[0] == -10
    simulator.busy = False
    assert call(simulator.functions, "HH_OpenDevice", 0)[0] == 0
    assert call(simulator.functions, "HH_OpenDevice", 0)[0] == -2
    assert call(simulator.functions, "HH_CloseDevice", 0)[0] == 0
    assert call(simulator.functions, "HH_GetFeatures", 0)[0] == -10


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("HH_Initialize", (0, 2)),
        ("HH_SetSyncDiv", (3,)),
        ("HH_SetSyncCFD", (0, 41)),
        ("HH_SetSyncChannelOffset", (100_000,)),
        ("HH_SetInputCFD", (2, 100, 10)),
        ("HH_SetInputCFD", (0, 1001, 10)),
        ("HH_SetInputChannelOffset", (0, -100_000)),
        ("HH_SetInputChannelEnable", (0, 2)),
        ("HH_SetBinning", (26,)),
        ("HH_SetOffset", (500_001,)),
        ("HH_SetHistoLen", (7,)),
        ("HH_SetMarkerEnable", (0, 0, 0, 2)),
        ("HH_SetMarkerHoldoffTime", (524_297,)),
        ("HH_StartMeas", (0,)),
        ("HH_StartMeas", (360_000_001,)),
        ("HH_GetHistogram", (2, 0)),
        ("HH_GetCountRate", (2,)),
    ],
)
def test_arguments_outside_the_limits(name, arguments):
    assert Opened(bench_with([], 0)).code(name, *arguments) == -17


def test_running_until_stopped():
    hh = Opened(bench_with([], 0))
    hh("HH_StartMeas", 10)
    hh.bench.clock.sleep(0.02)
    assert hh("HH_CTCStatus") == 1
    for name, *arguments in (
        ("HH_StartMeas", 10),
        ("HH_ClearHistMem",),
        ("HH_SetBinning", 2),
        ("HH_Calibrate",),
        ("HH_Initialize", 0, 0),
        ("HH_GetHistogram", 0, 0),
    ):
        assert hh.code(name, *arguments) == -16
    hh("HH_StopMeas")
    hh("HH_SetBinning", 2)


def test_calibration_comes_first():
    hh = Opened(bench_with([], 0))
    hh("HH_Initialize", HISTOGRAM, 0)
    assert hh.code("HH_StartMeas", 1) == -23


@pytest.mark.parametrize("code", range(26))
def test_bin_width_doubles(code):
    hh = Opened(bench_with([], 0))
    hh("HH_SetBinning", code)
    assert hh("HH_GetResolution") == 2.0**code


def test_counts_add_up_until_cleared():
    hh = Opened(bench_with([10.5e-12, 20.5e-12], 2000))
    hh.run(10)
    hh.run(10)
    assert {i: n for i, n in enumerate(hh.counts()) if n} == {10: 20, 20: 20}
    assert hh.counts(clear=1).sum() == 40
    assert hh.counts().sum() == 0
    hh.run(10)
    hh("HH_ClearHistMem")
    assert hh.counts().sum() == 0


def test_elapsed_time_and_early_stop():
    hh = Opened(bench_with([5e-9], 100_000))
    hh("HH_StartMeas", 100)
    hh.bench.clock.sleep(0.03)
    assert hh("HH_CTCStatus") == 0
    assert hh("HH_GetFlags") == 0x20
    assert hh("HH_GetElapsedMeasTime") == pytest.approx(30)
    hh("HH_StopMeas")
    assert hh("HH_CTCStatus") == 1
    hh.bench.clock.sleep(1)
    assert hh("HH_GetElapsedMeasTime") == pytest.approx(30)
    assert hh.counts().sum() == 3000  # 100 kHz for 30 of 100 ms
    assert hh("HH_GetFlags") == 0


def test_natural_end_counts_no_longer_than_asked():
    hh = Opened(bench_with([5e-9], 100_000))
    assert hh.run(10, for_s=3.0) == 1
    assert hh("HH_GetElapsedMeasTime") == pytest.approx(10)
    assert hh.counts().sum() == 1000


def test_other_inputs_stay_dark():
    hh = Opened(bench_with([5e-9], 100_000), inputs=4, photon_input=2)
    hh.run(10)
    assert [hh.counts(channel).sum() for channel in range(4)] == [0, 0, 1000, 0]


def test_input_switched_off():
    hh = Opened(bench_with([5e-9], 100_000))
    hh("HH_SetInputChannelEnable", 0, 0)
    hh.run(10)
    assert hh.counts().sum() == 0
    assert hh("HH_GetCountRate", 0) == 0


def test_histogram_length_is_all_that_is_written():
    hh = Opened(bench_with([100.5e-12, 5000.5e-12], 2000))
    assert hh("HH_SetHistoLen", 0) == 1024
    hh.run(10)
    buffer = (c_uint * 65536)(*[77] * 65536)
    assert hh.simulator.functions.HH_GetHistogram(0, buffer, 0, 0) == 0
    assert buffer[100] == sum(buffer[:1024]) == 10
    assert buffer[1024] == 77


def test_counts_clip_at_the_count_depth():
    hh = Opened(bench_with([3.5e-12, 3.5e-12, 9.5e-12], 30_000), count_depth=150)
    hh.run(10)
    assert hh("HH_GetFlags") == 0x01
    hh.run(10)
    counts = hh.counts()
    assert (counts[3], counts[9]) == (150, 150)
    hh("HH_ClearHistMem")
    assert hh("HH_GetFlags") == 0


def test_stop_at_a_count():
    """Of 10 kHz in one bin and 10 kHz in another: 100 counts in either come after about 10 of 50 ms."""
    hh = Opened(bench_with([3.5e-12, 9.5e-12], 20_000))
    hh("HH_SetStopOverflow", 1, 100)
    assert hh.run(50) == 1
    counts = hh.counts()
    assert max(counts[3], counts[9]) == 100
    # the loser of two equal Poisson races to 100 is behind by about sqrt(2 * 100); 5 sigma
    assert 100 - 71 < min(counts[3], counts[9]) < 100 or counts[3] == counts[9]
    # photons until the stop over photons in all, times 50 ms
    assert hh("HH_GetElapsedMeasTime") == pytest.approx(50 * (counts[3] + counts[9]) / 1000)
    assert hh("HH_GetFlags") == 0x01
    hh.run(50)
    assert max(hh.counts()) == 100  # full at the start: stops at once
    assert hh("HH_GetElapsedMeasTime") == 0


def test_measurement_that_waits_for_c1_never_begins():
    hh = Opened(bench_with([3.5e-12], 20_000))
    hh("HH_SetMeasControl", 2, 1, 0)
    assert hh.run(10) == 1
    assert hh("HH_GetElapsedMeasTime") == 0
    assert hh.counts().sum() == 0
    assert hh.code("HH_SetMeasControl", 4, 1, 0) == -18


# Rates, warnings, flags


@pytest.mark.parametrize("renew", [("HH_Initialize", 0, 0), ("HH_SetSyncDiv", 2)])
def test_rates_need_a_tenth_of_a_second(renew):
    hh = Opened(bench_with([3.5e-12], 20_000))
    hh.bench.clock.sleep(1)
    assert (hh("HH_GetSyncRate"), hh("HH_GetCountRate", 0)) == (10_000_000, 20_000)
    hh(*renew)
    hh.bench.clock.sleep(0.099)
    assert (hh("HH_GetSyncRate"), hh("HH_GetCountRate", 0)) == (0, 0)
    hh.bench.clock.sleep(0.002)
    assert (hh("HH_GetSyncRate"), hh("HH_GetCountRate", 0)) == (10_000_000, 20_000)
    assert hh("HH_GetCountRate", 1) == 0


@pytest.mark.parametrize(
    ("mode", "sync_hz", "input_hz", "setting", "bits"),
    [
        (HISTOGRAM, 10e6, 205e3, (), 0),
        (HISTOGRAM, 0, 205e3, (), 0x0001),
        (HISTOGRAM, 13e6, 205e3, (), 0x0004),
        (HISTOGRAM, 13e6, 205e3, ("HH_SetSyncDiv", 2), 0),
        (HISTOGRAM, 10e6, 0, (), 0x0010),
        (HISTOGRAM, 10e6, 501e3, (), 0x0100),
        (HISTOGRAM, 10e6, 499e3, (), 0),
        (HISTOGRAM, 20e3, 100, (), 0x0400),  # 50 us against 65.5 ns
        (HISTOGRAM, 20e3, 100, ("HH_SetBinning", 10), 0),  # against 67 us
        (HISTOGRAM, 10e6, 205e3, ("HH_SetOffset", 10), 0x0800),
        (T3, 10e6, 205e3, ("HH_SetBinning", 1), 0x0400),  # 65.5 ns of 100 ns
        (T3, 10e6, 205e3, ("HH_SetBinning", 2), 0),
        (T3, 50e6, 9.1e6, ("HH_SetSyncDiv", 4), 0x0040 | 0x0100),
        (T2, 10e6, 205e3, ("HH_SetSyncDiv", 4), 0x0200),
        (T2, 0, 205e3, (), 0),
    ],
)
def test_warnings(mode, sync_hz, input_hz, setting, bits):
    bench = bench_with([1e-9], input_hz, emitting=sync_hz > 0, ambient=True, repetition_hz=sync_hz)
    hh = Opened(bench, mode=mode)
    if mode == HISTOGRAM and sync_hz >= 1e6:
        hh("HH_SetBinning", 1)
    if setting:
        hh(*setting)
    bench.clock.sleep(0.1)
    hh("HH_GetSyncRate")
    for channel in range(2):
        hh("HH_GetCountRate", channel)
    assert hh("HH_GetWarnings") == bits
    assert len(hh("HH_GetWarningsText", bits).splitlines()) == bits.bit_count()


def test_warnings_see_the_rates_read_last():
    hh = Opened(bench_with([1e-9], 205e3))
    hh.bench.clock.sleep(1)
    assert hh("HH_GetWarnings") == 0x0001 | 0x0010
    hh("HH_GetSyncRate")
    hh("HH_GetCountRate", 0)
    assert hh("HH_GetWarnings") == 0x0400  # 65.5 ns at 1 ps


def test_laser_that_goes_dark_loses_the_sync():
    hh = Opened(bench_with([5e-9], 100_000))
    hh("HH_StartMeas", 10)
    hh.bench.clock.sleep(0.004)
    hh.bench.change_light(emitting=False)
    hh.bench.clock.sleep(0.006)
    assert hh("HH_CTCStatus") == 1
    assert hh("HH_GetFlags") == 0x04
    hh("HH_StopMeas")
    assert hh.counts().sum() == 400  # what came before


def test_without_sync_nothing_is_timed():
    hh = Opened(bench_with([5e-9], 100_000, emitting=False, ambient=True))
    hh.run(10)
    assert hh.counts().sum() == 0
    assert hh("HH_GetFlags") == 0x04


def test_external_reference_is_not_connected():
    hh = Opened(bench_with([], 0))
    hh("HH_Initialize", HISTOGRAM, 1)
    assert hh("HH_GetFlags") == 0x08


@pytest.mark.parametrize("unit_s", [1.0, 1e-12])
def test_sync_period(unit_s):
    hh = Opened(bench_with([], 0), sync_period_unit_s=unit_s)
    assert hh("HH_GetSyncPeriod") == 0
    hh.run(1)
    assert hh("HH_GetSyncPeriod") * unit_s == pytest.approx(100e-9)


@pytest.mark.parametrize(
    ("mode", "refused"),
    [
        (HISTOGRAM, ["HH_ReadFiFo", "HH_GetContModeBlock"]),
        (T2, ["HH_SetBinning", "HH_SetOffset", "HH_SetHistoLen", "HH_GetHistogram", "HH_GetContModeBlock"]),
        (T3, ["HH_SetHistoLen", "HH_GetHistogram", "HH_GetContModeBlock"]),
        (CONTINUOUS, ["HH_GetHistogram", "HH_ReadFiFo"]),
    ],
)
def test_functions_of_other_modes(mode, refused):
    hh = Opened(bench_with([5e-9], 1000), mode=mode)
    arguments = {
        "HH_ReadFiFo": (128,),
        "HH_GetContModeBlock": (),
        "HH_SetBinning": (2,),
        "HH_SetOffset": (0,),
        "HH_SetHistoLen": (3,),
        "HH_GetHistogram": (0, 0),
    }
    assert [name for name, a in arguments.items() if hh.code(name, *a) == -18] == [
        name for name in arguments if name in refused
    ]


def test_time_tagging_delivers_nothing():
    hh = Opened(bench_with([5e-9], 1000), mode=T3)
    hh("HH_StartMeas", 10)
    assert hh("HH_ReadFiFo", 131072)[1] == 0


# Exceptions


class BrokenError(Exception):
    pass


class BrokenLight:
    def detections(self, *arguments):
        raise BrokenError("no photons today")

    def rate_hz(self, *arguments):
        raise BrokenError("no rate today")


def test_an_exception_is_a_negative_code_and_comes_out_later():
    bench = bench_with([], 0)
    bench.photons = BrokenLight()
    hh = Opened(bench)
    hh("HH_StartMeas", 10)
    bench.clock.sleep(0.005)
    assert hh.code("HH_StopMeas") == -99
    with pytest.raises(BrokenError, match="no photons today"):
        hh.simulator.raise_pending()
    hh.simulator.raise_pending()  # once


def test_even_ctrl_c_is_kept():
    hh = Opened(bench_with([], 0))

    def interrupted():
        raise KeyboardInterrupt

    hh.bench.clock.now_s = interrupted
    assert hh.code("HH_GetSyncRate") == -99
    with pytest.raises(KeyboardInterrupt):
        hh.simulator.raise_pending()


def test_a_null_pointer_is_an_exception_and_no_crash():
    hh = Opened(bench_with([], 0))
    assert hh.simulator.functions.HH_GetFeatures(0, None) == -99
    with pytest.raises(ValueError, match="NULL"):
        hh.simulator.raise_pending()


def test_functions_outlive_the_simulator():
    functions = HydraHarpSimulator(bench_with([], 0)).functions
    assert call(functions, "HH_GetLibraryVersion") == (0, b"3.0")
    assert set(vars(functions)) == set(DECLARED)


@pytest.mark.parametrize("wrong", [{"serial": "12345678"}, {"inputs": 9}, {"photon_input": 2}])
def test_impossible_instruments(wrong):
    with pytest.raises(ValueError, match=r"7 characters|of which 8"):
        HydraHarpSimulator(bench_with([], 0), **wrong)


# The histogram, against photon-by-photon arithmetic in whole femtoseconds


@given(
    times_fs=st.lists(st.integers(-150_000_000, 450_000_000), min_size=1, max_size=30),
    divider=st.sampled_from([1, 2, 16]),
    shift_ps=st.integers(-199_998, 199_998),
    offset_ns=st.integers(0, 200),
    width_ps=st.sampled_from([1, 4, 1024]),
    length=st.sampled_from([1024, 65536]),
)
def test_bins_of(times_fs, divider, shift_ps, offset_ns, width_ps, length):
    period_fs = 100_000_000
    expected = []
    for i, time_fs in enumerate(times_fs):
        time_fs = 2 * time_fs + 1 + 2000 * shift_ps + 2 * period_fs * (i % divider)  # odd: on no edge
        time_fs = time_fs % (2 * period_fs * divider) - 2_000_000 * offset_ns
        expected.append(min(max(time_fs // (2000 * width_ps) + 1, 0), length + 1))
    got = bins_of(
        (2 * np.array(times_fs) + 1) * 0.5e-15,
        np.arange(len(times_fs)),
        period_s=100e-9,
        divider=divider,
        shift_s=shift_ps * 1e-12,
        offset_s=offset_ns * 1e-9,
        bin_width_s=width_ps * 1e-12,
        length=length,
        clock=Nonlinearity(),
    )
    assert got.tolist() == expected


@given(
    bins=st.lists(st.integers(0, 9), min_size=1, max_size=60),
    before=st.lists(st.integers(1, 8), max_size=20),
    stop=st.integers(1, 12),
)
def test_photons_until(bins, before, stop):
    memory = HistogramMemory(2**32 - 1)
    memory.add(np.array(before, np.int64), 8)
    counts = np.bincount(np.array(before, np.int64), minlength=10)
    expected = 0 if counts[1:9].max() >= stop else None
    for i, b in enumerate(bins if expected is None else []):
        counts[b] += 1
        if 1 <= b <= 8 and counts[b] >= stop:
            expected = i + 1
            break
    assert memory.photons_until(np.array(bins), 8, stop) == expected
