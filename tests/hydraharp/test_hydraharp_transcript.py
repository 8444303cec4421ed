"""The driver's calls, in order, against a scripted library (order, waits: HHLib manual, vendor demos)."""

import pytest
from hydraharp_wire import Returns, Script

from drivers.errors import DeviceError, DeviceNotFoundError, LinkError, ProtocolError
from drivers.hydraharp import HHLib, HydraHarp, HydraHarpError

VERSION = ("HH_GetLibraryVersion()", "3.0")
INITIALIZE = [
    ("HH_Initialize(1, 0, 0)",),
    ("HH_GetHardwareInfo(1)", "HydraHarp 400", "930004", "2.0"),
    ("HH_GetNumOfInputChannels(1)", 2),
    ("HH_GetBaseResolution(1)", 1.0, 26),
]
SET_UP = [
    ("HH_Calibrate(1)",),
    ("HH_SetSyncDiv(1, 1)",),
    ("HH_SetSyncCFD(1, 50, 10)",),
    ("HH_SetSyncChannelOffset(1, 0)",),
    ("HH_SetInputCFD(1, 0, 50, 10)",),
    ("HH_SetInputChannelOffset(1, 0, 0)",),
    ("HH_SetInputChannelEnable(1, 0, 1)",),
    ("HH_SetInputChannelEnable(1, 1, 0)",),
    ("HH_SetHistoLen(1, 0)", 1024),
    ("HH_SetBinning(1, 2)",),
    ("HH_SetOffset(1, 0)",),
    ("HH_GetResolution(1)", 4.0),
    ("HH_SetStopOverflow(1, 0, 4294967295)",),
    ("HH_SetMeasControl(1, 0, 1, 0)",),
    ("sleep(0.4)",),
]
OPEN = [VERSION, ("HH_OpenDevice(0)", Returns(-1)), ("HH_OpenDevice(1)", "1000001"), *INITIALIZE, *SET_UP]
CLOSE = [("HH_StopMeas(1)",), ("HH_CloseDevice(1)",)]
START = [("HH_ClearHistMem(1)",), ("HH_StartMeas(1, 10)",), ("sleep(0.01)",)]
ENDED = [("HH_CTCStatus(1)", 1), ("HH_StopMeas(1)",)]


def play(lines, work=lambda harp: None, **settings):
    """Run ``work`` on an open driver; whatever it raises, the script must come out exactly."""
    script = Script(lines)
    harp = HydraHarp(
        HHLib(script.functions, name="script"), clock=script, serial="1000001", **{"bins": 3, **settings}
    )
    try:
        with harp:
            return work(harp)
    finally:
        script.finish()


def test_open_set_up_close():
    play([*OPEN, *CLOSE])


def test_all_settings_reach_the_instrument():
    changed = {
        "HH_Initialize(1, 0, 0)": ("HH_Initialize(1, 0, 1)",),
        "HH_SetSyncDiv(1, 1)": ("HH_SetSyncDiv(1, 8)",),
        "HH_SetSyncCFD(1, 50, 10)": ("HH_SetSyncCFD(1, 120, 15)",),
        "HH_SetSyncChannelOffset(1, 0)": ("HH_SetSyncChannelOffset(1, -1500)",),
        "HH_SetInputCFD(1, 0, 50, 10)": ("HH_SetInputChannelEnable(1, 0, 0)",),
        "HH_SetInputChannelOffset(1, 0, 0)": ("HH_SetInputCFD(1, 1, 80, 5)",),
        "HH_SetInputChannelEnable(1, 0, 1)": ("HH_SetInputChannelOffset(1, 1, 99999)",),
        "HH_SetInputChannelEnable(1, 1, 0)": ("HH_SetInputChannelEnable(1, 1, 1)",),
        "HH_SetHistoLen(1, 0)": ("HH_SetHistoLen(1, 1)", 2048),
        "HH_SetBinning(1, 2)": ("HH_SetBinning(1, 4)",),
        "HH_SetOffset(1, 0)": ("HH_SetOffset(1, 20)",),
        "HH_GetResolution(1)": ("HH_GetResolution(1)", 16.0),
        "HH_SetStopOverflow(1, 0, 4294967295)": ("HH_SetStopOverflow(1, 1, 65535)",),
    }
    harp = play(
        [changed.get(line[0], line) for line in OPEN] + CLOSE,
        lambda harp: harp,
        sync_divider=8,
        sync_cfd_mv=(120, 15),
        input_channel=1,
        input_cfd_mv=(80, 5),
        sync_offset_s=-1.5e-9,
        input_offset_s=99.999e-9,
        bin_width_s=16e-12,
        bins=1025,
        offset_s=20e-9,
        stop_overflow=65535,
        external_reference=True,
    )
    assert harp.identity == "PicoQuant HydraHarp 400, part 930004, version 2.0, serial 1000001, HHLib 3.0"
    assert harp.first_bin_s == pytest.approx(20e-9)
    assert harp.bin_width_s == pytest.approx(16e-12)
    assert harp.settings() == {
        "mode": "histogram",
        "reference": "external",
        "sync_divider": 8,
        "sync_cfd_level_mv": 120,
        "sync_cfd_zero_cross_mv": 15,
        "sync_offset_s": pytest.approx(-1.5e-9),
        "input_channel": 1,
        "input_cfd_level_mv": 80,
        "input_cfd_zero_cross_mv": 5,
        "input_offset_s": pytest.approx(99.999e-9),
        "bin_width_s": pytest.approx(16e-12),
        "bins": 1025,
        "histogram_bins": 2048,
        "offset_s": pytest.approx(20e-9),
        "stop_overflow": True,
        "stop_count": 65535,
    }


def test_measure():
    lines = [*START, *ENDED, ("HH_GetHistogram(1, 0, 0)", [5, 0, 7, 9]), ("HH_GetFlags(1)", 0)]
    exposure = play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))
    assert exposure.counts.tolist() == [5, 0, 7]
    assert exposure.counts.dtype == "uint32"
    assert exposure.live_time_s == 0.01
    assert exposure.warnings == ()


def test_measure_polls_each_millisecond_until_the_end():
    late = [("HH_CTCStatus(1)", 0), ("sleep(0.001)",)] * 3
    lines = [*START, *late, *ENDED, ("HH_GetHistogram(1, 0, 0)", [1]), ("HH_GetFlags(1)", 0)]
    play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))


def test_measure_gives_up_and_stops():
    never = [("HH_CTCStatus(1)", 0), ("sleep(0.001)",)] * 1001  # 1 s, and 1/1000 of 10 ms
    lines = [*START, *never, ("HH_CTCStatus(1)", 0), ("HH_StopMeas(1)",)]
    with pytest.raises(LinkError, match="still runs 1 s after"):
        play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))


@pytest.mark.parametrize("code", [-37, 1, 123456])
def test_stopped_after_an_error_which_stays_the_one_raised(code):
    """A positive number passes a test for ``< 0``; it is an error all the same."""
    lines = [*START, ("HH_CTCStatus(1)", Returns(code)), ("HH_StopMeas(1)", Returns(-36))]
    closing = [("HH_StopMeas(1)", Returns(-36)), ("HH_CloseDevice(1)", Returns(-6))]
    with pytest.raises(HydraHarpError, match="HH_CTCStatus") as caught:
        play([*OPEN, *lines, *closing], lambda harp: harp.measure(10e-3))
    assert caught.value.code == code


def test_stopped_when_interrupted():
    def interrupt(harp):
        harp._clock.sleep = interrupted
        harp.measure(10e-3)

    def interrupted(duration_s):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play([*OPEN, *START[:2], ("HH_StopMeas(1)",), *CLOSE], interrupt)


@pytest.mark.parametrize(
    ("flags", "word"), [(0x01, "full"), (0x04, "sync was lost"), (0x08, "reference clock was lost")]
)
def test_flags_become_sentences(flags, word):
    lines = [*START, *ENDED, ("HH_GetHistogram(1, 0, 0)", [1]), ("HH_GetFlags(1)", flags)]
    (sentence,) = play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3)).warnings
    assert word in sentence


def test_overflow_that_stops_asks_how_long_it_ran():
    opening = [("HH_SetStopOverflow(1, 1, 100)",) if "StopOver" in line[0] else line for line in OPEN]
    lines = [*START, *ENDED, ("HH_GetHistogram(1, 0, 0)", [100]), ("HH_GetFlags(1)", 1)]
    lines.append(("HH_GetElapsedMeasTime(1)", 2.5))
    exposure = play([*opening, *lines, *CLOSE], lambda harp: harp.measure(10e-3), stop_overflow=100)
    assert exposure.live_time_s == 0.0025


def test_system_error_is_raised_with_the_instruments_report():
    lines = [*START, *ENDED, ("HH_GetHistogram(1, 0, 0)", [1]), ("HH_GetFlags(1)", 0x10)]
    lines.append(("HH_GetHardwareDebugInfo(1)", "module 2\nover temperature\n"))
    with pytest.raises(DeviceError, match="module 2 over temperature"):
        play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))


def test_warnings_read_all_rates_first():
    rates = [("HH_GetSyncRate(1)", 10_000_000), ("HH_GetCountRate(1, 0)", 0), ("HH_GetCountRate(1, 1)", 0)]
    lines = [*rates, ("HH_GetWarnings(1)", 0x10 | 0x400)]
    first, second = play([*OPEN, *lines, *CLOSE], lambda harp: harp.warnings())
    assert "No photons" in first
    assert "wider bins" in second


def test_a_warning_of_a_later_library_comes_in_its_own_words():
    rates = [("HH_GetSyncRate(1)", 1), ("HH_GetCountRate(1, 0)", 1), ("HH_GetCountRate(1, 1)", 1)]
    lines = [*rates, ("HH_GetWarnings(1)", 0x10000), ("HH_GetWarningsText(1, 65536)", "too\n  hot\n")]
    assert play([*OPEN, *lines, *CLOSE], lambda harp: harp.warnings()) == ("too hot",)


@pytest.mark.parametrize("raw", [1.25e-8, 1.25e4])
def test_sync_period_in_either_unit(raw):
    lines = [("HH_GetSyncPeriod(1)", raw), ("HH_GetSyncRate(1)", 80_000_000)]
    assert play([*OPEN, *lines, *CLOSE], lambda harp: harp.sync_period_s()) == pytest.approx(12.5e-9)


@pytest.mark.parametrize(("raw", "rate"), [(12.5, 80_000_000), (0.0, 80_000_000), (1.25e4, 0)])
def test_sync_period_that_fits_neither_unit(raw, rate):
    lines = [("HH_GetSyncPeriod(1)", raw), ("HH_GetSyncRate(1)", rate)]
    with pytest.raises(ProtocolError, match="neither in s nor in ps"):
        play([*OPEN, *lines, *CLOSE], lambda harp: harp.sync_period_s())


def test_others_are_closed_again():
    lines = [
        VERSION,
        ("HH_OpenDevice(0)", "1000007"),
        ("HH_CloseDevice(0)",),
        ("HH_OpenDevice(1)", "1000001"),
        *INITIALIZE,
        *SET_UP,
        *CLOSE,
    ]
    play(lines)


def test_wrong_serial_names_what_is_there():
    lines = [VERSION, ("HH_OpenDevice(0)", "1000007"), ("HH_CloseDevice(0)",)]
    lines += [(f"HH_OpenDevice({i})", Returns(-1)) for i in range(1, 8)]
    with pytest.raises(DeviceNotFoundError, match="only 1000007 can be opened"):
        play(lines)


@pytest.mark.parametrize(("code", "word"), [(-2, "DEVICE_BUSY"), (-11, "DEVICE_LOCKED")])
def test_one_that_cannot_be_opened_may_be_the_one(code, word):
    lines = [VERSION, ("HH_OpenDevice(0)", Returns(-1)), ("HH_OpenDevice(1)", Returns(code))]
    lines += [(f"HH_OpenDevice({i})", Returns(-1)) for i in range(2, 8)]
    with pytest.raises(HydraHarpError, match=word):
        play(lines)


def test_closed_where_setting_up_fails():
    with pytest.raises(HydraHarpError, match="CALIB_FAIL"):
        play([*OPEN[:3], *INITIALIZE, ("HH_Calibrate(1)", Returns(-46)), *CLOSE])


@pytest.mark.parametrize(
    ("call", "value", "words"),
    [("HH_GetResolution(1)", 8.0, "1024 bins of 8e-12 s"), ("HH_SetHistoLen(1, 0)", 2, "2 bins of 4e-12 s")],
)
def test_closed_where_a_setting_reads_back_wrong(call, value, words):
    lines = [(call, value) if line[0] == call else line for line in OPEN[:-1]]
    with pytest.raises(ProtocolError, match=words):
        play([*lines, *CLOSE])


def test_another_release_of_the_library_is_refused():
    with pytest.raises(DeviceNotFoundError, match=r"version is 2\.1"):
        play([("HH_GetLibraryVersion()", "2.1")])


def test_an_error_in_the_users_block_closes():
    def fail(harp):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        play([*OPEN, *CLOSE], fail)


def test_a_failure_to_close_is_told():
    with pytest.raises(HydraHarpError, match="CLOSE_FAIL"):
        play([*OPEN, CLOSE[0], ("HH_CloseDevice(1)", Returns(-6))])


def test_not_open():
    harp = play([*OPEN, *CLOSE], lambda harp: harp)
    with pytest.raises(DeviceError, match="not open"):
        harp.measure(1e-3)
