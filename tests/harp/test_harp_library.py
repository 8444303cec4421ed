"""Each method of the library's wrapper makes its one call and returns what was written."""

import pytest

from drivers.harp.constants import Edge, Feature, Flag, MeasControl, Mode, Reference, Warn
from drivers.harp.errors import HydraHarpError
from drivers.harp.library import HHLib, fifo_buffer, histogram_buffers
from support.harp_wire import DECLARED, Returns, ScriptedLibrary

RISING, FALLING = Edge.RISING, Edge.FALLING

#: Method with its arguments, the C call, what the library writes, and the result.
CALLS = [
    ("get_library_version", (), "HH_GetLibraryVersion()", ["3.0"], "3.0"),
    ("get_error_string", (-2,), "HH_GetErrorString(-2)", ["HH_ERROR_DEVICE_BUSY"], "HH_ERROR_DEVICE_BUSY"),
    ("open_device", (3,), "HH_OpenDevice(3)", ["1000001"], "1000001"),
    ("close_device", (3,), "HH_CloseDevice(3)", [], None),
    ("initialize", (3, Mode.T3, Reference.EXTERNAL), "HH_Initialize(3, 3, 1)", [], None),
    ("get_hardware_info", (3,), "HH_GetHardwareInfo(3)", ["model", "part", "1.2"], ("model", "part", "1.2")),
    ("get_serial_number", (3,), "HH_GetSerialNumber(3)", ["1000001"], "1000001"),
    ("get_features", (3,), "HH_GetFeatures(3)", [6], Feature.TTTR | Feature.MARKERS),
    ("get_base_resolution", (3,), "HH_GetBaseResolution(3)", [1.0, 26], (1.0, 26)),
    ("get_hardware_debug_info", (3,), "HH_GetHardwareDebugInfo(3)", ["x" * 65535], "x" * 65535),
    ("get_num_of_input_channels", (3,), "HH_GetNumOfInputChannels(3)", [8], 8),
    ("get_num_of_modules", (3,), "HH_GetNumOfModules(3)", [5], 5),
    ("get_module_info", (3, 1), "HH_GetModuleInfo(3, 1)", [4010, 7], (4010, 7)),
    ("get_module_index", (3, 2), "HH_GetModuleIndex(3, 2)", [2], 2),
    ("calibrate", (3,), "HH_Calibrate(3)", [], None),
    ("set_sync_div", (3, 8), "HH_SetSyncDiv(3, 8)", [], None),
    ("set_sync_cfd", (3, 120, 10), "HH_SetSyncCFD(3, 120, 10)", [], None),
    ("set_sync_channel_offset", (3, -5), "HH_SetSyncChannelOffset(3, -5)", [], None),
    ("set_input_cfd", (3, 1, 120, 10), "HH_SetInputCFD(3, 1, 120, 10)", [], None),
    ("set_input_channel_offset", (3, 1, -5), "HH_SetInputChannelOffset(3, 1, -5)", [], None),
    ("set_input_channel_enable", (3, 1, True), "HH_SetInputChannelEnable(3, 1, 1)", [], None),
    ("set_stop_overflow", (3, True, 2**32 - 1), "HH_SetStopOverflow(3, 1, 4294967295)", [], None),
    ("set_binning", (3, 2), "HH_SetBinning(3, 2)", [], None),
    ("set_offset", (3, 20), "HH_SetOffset(3, 20)", [], None),
    ("set_histo_len", (3, 5), "HH_SetHistoLen(3, 5)", [32768], 32768),
    (
        "set_meas_control",
        (3, MeasControl.C1_START_CTC_STOP, RISING, FALLING),
        "HH_SetMeasControl(3, 2, 1, 0)",
        [],
        None,
    ),
    ("clear_hist_mem", (3,), "HH_ClearHistMem(3)", [], None),
    ("start_meas", (3, 10), "HH_StartMeas(3, 10)", [], None),
    ("stop_meas", (3,), "HH_StopMeas(3)", [], None),
    ("ctc_ended", (3,), "HH_CTCStatus(3)", [1], True),
    ("get_resolution", (3,), "HH_GetResolution(3)", [4.0], 4.0),
    ("get_sync_period", (3,), "HH_GetSyncPeriod(3)", [1e-7], 1e-7),
    ("get_sync_rate", (3,), "HH_GetSyncRate(3)", [10_000_000], 10_000_000),
    ("get_count_rate", (3, 1), "HH_GetCountRate(3, 1)", [205_000], 205_000),
    ("get_flags", (3,), "HH_GetFlags(3)", [0x24], Flag.SYNC_LOST | Flag.ACTIVE),
    ("get_elapsed_meas_time", (3,), "HH_GetElapsedMeasTime(3)", [9.5], 9.5),
    ("get_warnings", (3,), "HH_GetWarnings(3)", [0x11], Warn.SYNC_RATE_ZERO | Warn.INPT_RATE_ZERO),
    ("get_warnings_text", (3, 17), "HH_GetWarningsText(3, 17)", ["two\nlines\n"], "two\nlines"),
    ("set_marker_holdoff_time", (3, 800), "HH_SetMarkerHoldoffTime(3, 800)", [], None),
    (
        "set_marker_edges",
        (3, (RISING, FALLING, RISING, FALLING)),
        "HH_SetMarkerEdges(3, 1, 0, 1, 0)",
        [],
        None,
    ),
    ("set_marker_enable", (3, (True, True, False, True)), "HH_SetMarkerEnable(3, 1, 1, 0, 1)", [], None),
]


@pytest.mark.parametrize(("method", "arguments", "c_call", "written", "result"), CALLS)
def test_one_call(method, arguments, c_call, written, result):
    script = ScriptedLibrary([(c_call, *written)])
    answer = getattr(HHLib(script.functions), method)(*arguments)
    script.finish()
    assert answer == result
    assert type(answer) is type(result)


def test_histogram_goes_into_the_callers_buffer():
    script = ScriptedLibrary([("HH_GetHistogram(3, 1, 1)", [4, 0, 2**32 - 1])])
    _, buffer = rows = histogram_buffers(2)
    HHLib(script.functions).get_histogram(3, 1, buffer, clear=True)
    script.finish()
    assert len(buffer) == 65536
    assert buffer[:4] == [4, 0, 2**32 - 1, 0]
    assert rows[1][:4] == [4, 0, 2**32 - 1, 0]  # a row is a part of the block, not a copy
    assert sum(rows[0]) == 0


@pytest.mark.parametrize("records", [[], [1, 2**32 - 1]])
def test_fifo(records):
    script = ScriptedLibrary([("HH_ReadFiFo(3, 256)", records, len(records))])
    into = fifo_buffer(256)
    assert HHLib(script.functions).read_fifo(3, into) == len(records)
    script.finish()
    assert into[: len(records)] == records


@pytest.mark.parametrize("records", [0, 100, 131_200])
def test_fifo_takes_whole_chunks(records):
    with pytest.raises(ValueError, match="no multiple of 128"):
        fifo_buffer(records)


def test_continuous_block_may_hold_zeros():
    block = bytes([1, 0, 2, 0])
    script = ScriptedLibrary([("HH_GetContModeBlock(3)", block, len(block))])
    assert HHLib(script.functions).get_cont_mode_block(3) == block
    script.finish()


def test_every_function_is_wrapped_and_refusals_are_raised():
    wrapped = {c_call.split("(")[0] for _, _, c_call, _, _ in CALLS}
    wrapped |= {"HH_GetHistogram", "HH_ReadFiFo", "HH_GetContModeBlock"}
    assert wrapped == set(DECLARED)
    for method, arguments, c_call, _, _ in CALLS:
        library = HHLib(ScriptedLibrary([(c_call, Returns(-36))]).functions, name="script")
        with pytest.raises(HydraHarpError, match="-36") as caught:
            getattr(library, method)(*arguments)
        assert caught.value.function == c_call
        assert caught.value.device == "HydraHarp through script"
