"""The driver's calls, in order, against a scripted library (order, waits: HHLib manual, vendor demos)."""

import re

import pytest

from drivers.errors import DeviceError, DeviceNotFoundError, LimitError, LinkError, ProtocolError
from drivers.harp.device import Harp
from drivers.harp.errors import HarpError
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings
from drivers.harp.triggers import CfdTrigger
from support.harp_wire import Returns, ScriptedLibrary

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
CLEAR = ("HH_ClearHistMem(1)",)
STARTED = [CLEAR, ("HH_StartMeas(1, 10)",), ("HH_CTCStatus(1)", 0)]
START = [*STARTED, ("sleep(0.01)",)]
ENDED = [("HH_CTCStatus(1)", 1), ("HH_StopMeas(1)",)]


def play(lines, work=lambda harp: None, script=ScriptedLibrary, **settings):
    """Run ``work`` on an open driver; whatever it raises, the script must come out exactly."""
    script = script(lines)
    asked = HarpSettings(family=HYDRAHARP_400, **{"bins": 3, **settings})
    harp = Harp(
        HarpLibrary(script.functions, HYDRAHARP_400, name="script"),
        clock=script,
        serial="1000001",
        settings=asked,
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
    }
    harp = play(
        [changed.get(line[0], line) for line in OPEN] + CLOSE,
        lambda harp: harp,
        sync_divider=8,
        sync_trigger=CfdTrigger(0.12, 0.015),
        inputs=(1,),
        input_trigger=CfdTrigger(0.08, 0.005),
        sync_offset_s=-1.5e-9,
        input_offsets_s=(99.999e-9,),
        bin_width_s=16e-12,
        bins=1025,
        offset_s=20e-9,
        external_reference=True,
    )
    assert harp.identity == "PicoQuant HydraHarp 400, part 930004, version 2.0, serial 1000001, HHLib 3.0"
    assert harp.first_bin_s == pytest.approx(20e-9)
    assert harp.bin_width_s == pytest.approx(16e-12)
    assert harp.settings() == {
        "mode": "histogram",
        "reference": "external",
        "sync_divider": 8,
        "sync_level_v": 0.12,
        "sync_zero_cross_v": 0.015,
        "sync_offset_s": pytest.approx(-1.5e-9),
        "inputs": "1",
        "input_level_v": 0.08,
        "input_zero_cross_v": 0.005,
        "input_1_offset_s": pytest.approx(99.999e-9),
        "bin_width_s": pytest.approx(16e-12),
        "bins": 1025,
        "histogram_bins": 2048,
        "offset_s": pytest.approx(20e-9),
    }


def test_measure():
    lines = [*START, *ENDED, ("HH_GetFlags(1)", 0), ("HH_GetHistogram(1, 0, 0)", [5, 0, 7, 9]), CLEAR]
    exposure = play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))
    assert exposure.counts.tolist() == [[5, 0, 7]]
    assert exposure.counts.dtype == "uint32"
    assert exposure.live_time_s == 0.01
    assert exposure.warnings == ()


def test_two_inputs():
    """Both are set and switched on; each is read into its row, in the order asked for; both are cleared."""
    second = {
        "HH_SetInputCFD(1, 0, 50, 10)": [("HH_SetInputCFD(1, 0, 50, 10)",)],
        "HH_SetInputChannelOffset(1, 0, 0)": [("HH_SetInputChannelOffset(1, 0, -300)",)],
        "HH_SetInputChannelEnable(1, 1, 0)": [
            ("HH_SetInputCFD(1, 1, 50, 10)",),
            ("HH_SetInputChannelOffset(1, 1, 200)",),
            ("HH_SetInputChannelEnable(1, 1, 1)",),
        ],
    }
    opening = [call for line in OPEN for call in second.get(line[0], [line])]
    lines = [
        *START,
        *ENDED,
        ("HH_GetFlags(1)", 0),
        ("HH_GetHistogram(1, 1, 0)", [1, 2, 3, 4]),
        ("HH_GetHistogram(1, 0, 0)", [5, 6, 7, 8]),
        CLEAR,
        ("HH_GetSyncRate(1)", 10_000_000),
        ("HH_GetCountRate(1, 1)", 300),
        ("HH_GetCountRate(1, 0)", 50),
    ]
    exposure, rates, settings = play(
        [*opening, *lines, *CLOSE],
        lambda harp: (harp.measure(10e-3), harp.rates(), harp.settings()),
        inputs=(1, 0),
        input_offsets_s=(200e-12, -300e-12),
    )
    assert exposure.counts.tolist() == [[1, 2, 3], [5, 6, 7]]
    assert exposure.photons == 24
    assert rates.inputs_hz == (300.0, 50.0)
    assert rates.input_hz == 350.0
    assert settings["inputs"] == "1, 0"
    assert (settings["input_1_offset_s"], settings["input_0_offset_s"]) == (200e-12, -300e-12)


@pytest.mark.parametrize(
    ("call", "answer", "words"),
    [
        ("HH_GetNumOfInputChannels(1)", (1,), "input channel to 1, but it accepts whole numbers from 0 to 0"),
        ("HH_GetBaseResolution(1)", (8.0, 20), "8 ps times a power of two.*nearest are 8 ps and 16 ps"),
    ],
)
def test_an_instrument_that_can_do_less_is_asked_and_closed(call, answer, words):
    """What only the instrument tells is refused before any setting is sent."""
    lines = [(call, *answer) if line[0] == call else line for line in [*OPEN[:3], *INITIALIZE]]
    with pytest.raises(LimitError, match=f"HydraHarp 1000001.*{words}"):
        play([*lines, *CLOSE], inputs=(0, 1))


def test_a_measurement_that_did_not_start_is_found_out():
    lines = [*STARTED[:2], ("HH_CTCStatus(1)", 1), ("HH_StopMeas(1)",)]
    with pytest.raises(ProtocolError, match="start to measure for 10 ms, but none runs"):
        play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))


class SlowLibrary(ScriptedLibrary):
    """As on a busy computer: it is later whenever it is asked."""

    def now_s(self):
        self.time_s += 0.006
        return self.time_s


def test_a_measurement_that_may_be_over_is_not_said_not_to_have_started():
    asked = [*STARTED[:2], ("HH_CTCStatus(1)", 1), ("sleep(0)",)]
    lines = [*asked, *ENDED, ("HH_GetFlags(1)", 0), ("HH_GetHistogram(1, 0, 0)", [7]), CLEAR]
    exposure = play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3), SlowLibrary)
    assert exposure.photons == 7


def test_measure_polls_each_millisecond_until_the_end():
    late = [("HH_CTCStatus(1)", 0), ("sleep(0.001)",)] * 3
    lines = [*START, *late, *ENDED, ("HH_GetFlags(1)", 0), ("HH_GetHistogram(1, 0, 0)", [1]), CLEAR]
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
    with pytest.raises(HarpError, match="HH_CTCStatus") as caught:
        play([*OPEN, *lines, *closing], lambda harp: harp.measure(10e-3))
    assert caught.value.code == code
    (note,) = caught.value.__notes__
    assert "CLOSE_FAIL" in note


def test_stopped_when_interrupted():
    lines = [*STARTED, ("sleep(0.01)", KeyboardInterrupt), ("HH_StopMeas(1)",)]
    with pytest.raises(KeyboardInterrupt):
        play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3))


@pytest.mark.parametrize(
    ("flags", "word"), [(0x01, "full"), (0x04, "sync was lost"), (0x08, "reference clock was lost")]
)
def test_flags_become_sentences(flags, word):
    lines = [*START, *ENDED, ("HH_GetFlags(1)", flags), ("HH_GetHistogram(1, 0, 0)", [1]), CLEAR]
    (sentence,) = play([*OPEN, *lines, *CLOSE], lambda harp: harp.measure(10e-3)).warnings
    assert word in sentence


def test_system_error_is_raised_with_the_instruments_report():
    lines = [*START, *ENDED, ("HH_GetFlags(1)", 0x10)]
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


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (
            [("HH_OpenDevice(1)", "1000007"), ("HH_CloseDevice(1)",)],
            "several were found: 1000001, 1000007. Give",
        ),
        (
            [("HH_OpenDevice(1)", Returns(-2))],
            "several were found: 1000001, and one that cannot be opened (DEVICE_BUSY)",
        ),
    ],
)
def test_of_several_none_is_taken_unless_it_is_named(second, words):
    lines = [VERSION, ("HH_OpenDevice(0)", "1000001"), *second]
    lines += [(f"HH_OpenDevice({i})", Returns(-1)) for i in range(2, 8)] + [("HH_CloseDevice(0)",)]
    script = ScriptedLibrary(lines)
    with (
        pytest.raises(DeviceNotFoundError, match=re.escape(words)),
        Harp(HarpLibrary(script.functions, HYDRAHARP_400, name="script"), clock=script),
    ):
        pass
    script.finish()


def test_wrong_serial_names_what_is_there():
    lines = [VERSION, ("HH_OpenDevice(0)", "1000007"), ("HH_CloseDevice(0)",)]
    lines += [(f"HH_OpenDevice({i})", Returns(-1)) for i in range(1, 8)]
    with pytest.raises(DeviceNotFoundError, match="only 1000007 can be opened"):
        play(lines)


@pytest.mark.parametrize(("code", "word"), [(-2, "DEVICE_BUSY"), (-11, "DEVICE_LOCKED")])
def test_one_that_cannot_be_opened_may_be_the_one(code, word):
    lines = [VERSION, ("HH_OpenDevice(0)", Returns(-1)), ("HH_OpenDevice(1)", Returns(code))]
    lines += [(f"HH_OpenDevice({i})", Returns(-1)) for i in range(2, 8)]
    with pytest.raises(HarpError, match=word):
        play(lines)


def test_closed_where_setting_up_fails():
    with pytest.raises(HarpError, match="CALIB_FAIL"):
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
    with pytest.raises(HarpError, match="CLOSE_FAIL"):
        play([*OPEN, CLOSE[0], ("HH_CloseDevice(1)", Returns(-6))])


def test_not_open():
    harp = play([*OPEN, *CLOSE], lambda harp: harp)
    with pytest.raises(DeviceError, match="not open"):
        harp.measure(1e-3)
