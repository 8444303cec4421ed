"""Each method of the library's wrapper makes its one call and returns what was written."""

import pytest

from drivers.harp.constants import Edge, Feature, MeasControl, Mode, Reference
from drivers.harp.errors import HarpError
from drivers.harp.families import FAMILIES, HYDRAHARP_400, MULTIHARP, PICOHARP_330, TIMEHARP_260_N
from drivers.harp.library import HarpLibrary, histogram_buffers, prototypes
from drivers.harp.triggers import TriggerMode
from support.harp_wire import Returns, ScriptedLibrary

RISING, FALLING = Edge.RISING, Edge.FALLING

#: Method with its arguments, the C call, what the library writes, and the result.
CALLS = [
    ("get_library_version", (), "HH_GetLibraryVersion()", ["3.0"], "3.0"),
    ("open_device", (3,), "HH_OpenDevice(3)", ["1000001"], "1000001"),
    ("close_device", (3,), "HH_CloseDevice(3)", [], None),
    ("initialize", (3, Mode.T3, Reference.EXTERNAL), "HH_Initialize(3, 3, 1)", [], None),
    ("get_hardware_info", (3,), "HH_GetHardwareInfo(3)", ["model", "part", "1.2"], ("model", "part", "1.2")),
    ("get_features", (3,), "HH_GetFeatures(3)", [6], Feature.TTTR | Feature.MARKERS),
    ("get_base_resolution", (3,), "HH_GetBaseResolution(3)", [1.0, 26], (1.0, 26)),
    ("get_debug_info", (3,), "HH_GetHardwareDebugInfo(3)", ["x" * 65535], "x" * 65535),
    ("get_num_of_input_channels", (3,), "HH_GetNumOfInputChannels(3)", [8], 8),
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
        (3, MeasControl.SINGLESHOT_CTC, RISING, FALLING),
        "HH_SetMeasControl(3, 0, 1, 0)",
        [],
        None,
    ),
    ("clear_hist_mem", (3,), "HH_ClearHistMem(3)", [], None),
    ("start_meas", (3, 10), "HH_StartMeas(3, 10)", [], None),
    ("stop_meas", (3,), "HH_StopMeas(3)", [], None),
    ("ctc_ended", (3,), "HH_CTCStatus(3)", [1], True),
    ("get_resolution", (3,), "HH_GetResolution(3)", [4.0], 4.0),
    ("get_sync_rate", (3,), "HH_GetSyncRate(3)", [10_000_000], 10_000_000),
    ("get_count_rate", (3, 1), "HH_GetCountRate(3, 1)", [205_000], 205_000),
    ("get_flags", (3,), "HH_GetFlags(3)", [0x24], 0x24),
    ("get_elapsed_meas_time", (3,), "HH_GetElapsedMeasTime(3)", [9.5], 9.5),
    ("get_warnings", (3,), "HH_GetWarnings(3)", [0x11], 0x11),
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
    answer = getattr(HarpLibrary(script.functions, HYDRAHARP_400), method)(*arguments)
    script.finish()
    assert answer == result
    assert type(answer) is type(result)


#: What the histogram and the records of each library are read with, and how many records at once.
READS = {
    "HH": ("HH_GetHistogram(3, 1, 0)", "HH_ReadFiFo(3, 131072)", 131_072),
    "MH": ("MH_GetHistogram(3, 1)", "MH_ReadFiFo(3)", 1_048_576),
    "PH330": ("PH330_GetHistogram(3, 1)", "PH330_ReadFiFo(3)", 1_048_576),
    "TH260": ("TH260_GetHistogram(3, 1, 0)", "TH260_ReadFiFo(3, 131072)", 131_072),
    "HH500": ("HH500_GetHistogram(3, 1)", "HH500_ReadFiFo(3)", 1_048_576),
}


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_histogram_goes_into_the_callers_buffer(family):
    script = ScriptedLibrary([(READS[family.prefix][0], [4, 0, 2**32 - 1])])
    _, buffer = rows = histogram_buffers(2, 1024)
    HarpLibrary(script.functions, family).get_histogram(3, 1, buffer)
    script.finish()
    assert len(buffer) == 1024
    assert buffer[:4] == [4, 0, 2**32 - 1, 0]
    assert rows[1][:4] == [4, 0, 2**32 - 1, 0]  # a row is a part of the block, not a copy
    assert sum(rows[0]) == 0


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
@pytest.mark.parametrize("records", [[], [1, 2**32 - 1]])
def test_fifo(family, records):
    _, read, room = READS[family.prefix]
    script = ScriptedLibrary([(read, records, len(records))])
    library = HarpLibrary(script.functions, family)
    into = library.fifo_buffer()
    assert len(into) == room
    assert library.read_fifo(3, into) == len(records)
    script.finish()
    assert into[: len(records)] == records


def test_what_only_some_families_have():
    """A TimeHarp is told no reference clock; a PicoHarp has two triggers; levels have their signs."""
    script = ScriptedLibrary(
        [
            ("TH260_Initialize(3, 3)",),
            ("TH260_SetInputEdgeTrg(3, 1, -50, 1)",),
            ("MH_Initialize(3, 0, 1)",),
            ("PH330_SetSyncTrgMode(3, 1)",),
            ("PH330_SetSyncCFD(3, -100, -20)",),
            ("PH330_SetInputTrgMode(3, 1, 0)",),
            ("PH330_SetInputEdgeTrg(3, 1, 200, 1)",),
            ("PH330_GetDebugInfo(3)", "fine"),
        ]
    )
    timeharp = HarpLibrary(script.functions, TIMEHARP_260_N)
    timeharp.initialize(3, Mode.T3, Reference.INTERNAL)
    timeharp.set_input_edge_trg(3, 1, -50, 1)
    HarpLibrary(script.functions, MULTIHARP).initialize(3, Mode.HISTOGRAM, Reference.EXTERNAL)
    picoharp = HarpLibrary(script.functions, PICOHARP_330)
    picoharp.set_sync_trg_mode(3, TriggerMode.CFD)
    picoharp.set_sync_cfd(3, -100, -20)
    picoharp.set_input_trg_mode(3, 1, TriggerMode.EDGE)
    picoharp.set_input_edge_trg(3, 1, 200, 1)
    assert picoharp.get_debug_info(3) == "fine"
    script.finish()


def test_every_function_is_wrapped_and_refusals_are_raised():
    wrapped = {c_call.split("(")[0] for _, _, c_call, _, _ in CALLS} | {"HH_GetHistogram", "HH_ReadFiFo"}
    assert wrapped == {f"HH_{name}" for name in prototypes(HYDRAHARP_400)}
    for method, arguments, c_call, _, _ in CALLS:
        script = ScriptedLibrary([(c_call, Returns(-36))])
        library = HarpLibrary(script.functions, HYDRAHARP_400, name="script")
        with pytest.raises(HarpError, match="-36") as caught:
            getattr(library, method)(*arguments)
        assert caught.value.function == c_call
        assert caught.value.device == "HydraHarp through script"


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
@pytest.mark.parametrize("beyond", [-1, 0])
def test_no_index_out_of_range_reaches_a_library(family, beyond):
    """MHLib and HH500Lib end the whole process when asked to open it, TH260Lib when told to initialise it."""
    index = beyond if beyond < 0 else family.devices
    script = ScriptedLibrary([])
    library = HarpLibrary(script.functions, family)
    for call in (library.open_device, library.close_device, library.stop_meas, library.get_flags):
        with pytest.raises(ValueError, match=f"index {index} is outside"):
            call(index)
    with pytest.raises(ValueError, match=f"index {index} is outside"):
        library.initialize(index, Mode.T3, Reference.INTERNAL)
    script.finish()
