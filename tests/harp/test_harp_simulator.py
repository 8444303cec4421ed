"""The simulated library by its C functions, without the driver."""

from ctypes import c_uint

import pytest

from simulators.wire.harp import Fifo, HarpSimulator
from support.harp_opened import HISTOGRAM, T3, Opened
from support.harp_wire import bench_with, call


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
    functions = HarpSimulator(bench_with([], 0)).functions
    assert call(functions, "HH_OpenDevice", 0) == (0, b"1000001")
    for name in ("HH_Calibrate", "HH_GetFeatures", "HH_GetSyncRate", "HH_StopMeas", "HH_GetFlags"):
        assert call(functions, name, 0)[0] == -22


def test_busy_elsewhere_or_open_already():
    simulator = HarpSimulator(bench_with([], 0))
    simulator.connection.busy = True
    assert call(simulator.functions, "HH_OpenDevice", 0) == (-2, b"")
    assert call(simulator.functions, "HH_GetFeatures", 0)[0] == -10
    simulator.connection.busy = False
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
    hh = Opened(bench_with([5e-9], 100_000, at_input=2), inputs=4)
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


def tagging(bench, **instrument):
    hh = Opened(bench, mode=T3, **instrument)
    hh("HH_SetBinning", 2)
    return hh


def read(hh, count=131_072):
    buffer, number = hh("HH_ReadFiFo", count)
    return buffer[:number]


def test_records_come_in_whole_blocks_while_there_are_some():
    hh = tagging(bench_with([4e-9], 100_000))
    hh("HH_StartMeas", 10)
    hh.bench.clock.sleep(0.01)
    assert hh("HH_CTCStatus") == 1
    assert len(read(hh, 256)) == 256
    assert [len(read(hh)) for _ in range(3)] == [640, 1001 - 896, 0]  # 97 overflows are one record
    assert read(hh) == []


def test_a_memory_that_nobody_reads_is_full():
    hh = tagging(bench_with([4e-9], 4_000_000))
    hh("HH_StartMeas", 2000)
    hh.bench.clock.sleep(0.4)
    assert hh("HH_GetFlags") == 0x20
    hh.bench.clock.sleep(0.6)
    assert hh("HH_GetFlags") == 0x22
    records = 0
    while piece := read(hh):
        records += len(piece)
    assert records == 1 << 21
    hh.bench.clock.sleep(0.5)
    assert read(hh) == []  # it takes no more
    hh("HH_StopMeas")
    assert hh("HH_GetFlags") == 0x02
    hh("HH_StartMeas", 10)
    assert hh("HH_GetFlags") == 0x20


def test_no_faster_than_the_link():
    hh = tagging(bench_with([4e-9], 4_000_000), fifo=Fifo(link_hz=1e6))
    hh("HH_StartMeas", 2000)
    got = 0
    for _ in range(20):
        hh.bench.clock.sleep(0.01)
        got += len(read(hh))
    assert 0.2e6 - 20 * 128 <= got <= 0.2e6


def test_records_not_read_are_lost_at_the_stop():
    hh = tagging(bench_with([4e-9], 100_000))
    hh("HH_StartMeas", 100)
    hh.bench.clock.sleep(0.05)
    hh("HH_StopMeas")
    assert read(hh) == []


def test_records_are_of_time_tagged_modes():
    assert Opened(bench_with([], 0)).code("HH_ReadFiFo", 128) == -18
    assert tagging(bench_with([], 0)).code("HH_ReadFiFo", 100) == -17
    assert tagging(bench_with([], 0)).code("HH_GetHistogram", 0, 0) == -18
    many = Opened(bench_with([], 0), inputs=64)
    assert many.code("HH_Initialize", T3, 0) == -18
