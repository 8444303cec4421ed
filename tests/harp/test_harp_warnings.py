"""The simulated library: its rates, warnings and flags, and what other modes refuse."""

from dataclasses import replace

import pytest

from simulators.wire.harp.families import HYDRAHARP
from support.harp_opened import CONTINUOUS, HISTOGRAM, T2, T3, Opened
from support.harp_wire import bench_with


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
    hh = Opened(bench_with([], 0), family=replace(HYDRAHARP, sync_period_unit_s=unit_s))
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
