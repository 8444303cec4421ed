"""The vendor's library HHLib 3.0 as Python methods, one for each C function and nothing more.

Each method allocates the out-parameters, calls, raises `HydraHarpError` unless the answer is zero, and
returns Python values in the vendor's own units, which its name or docstring tells.
"""

from ctypes import POINTER, Array, byref, c_char, c_double, c_int, c_uint, c_void_p, create_string_buffer
from threading import Lock
from typing import Any

from drivers.errors import DeviceNotFoundError, ProtocolError
from drivers.hydraharp.constants import (
    FIFO_RECORDS_STEP,
    MAX_CONTINUOUS_BLOCK_BYTES,
    MAX_FIFO_RECORDS,
    Edge,
    Feature,
    Flag,
    MeasControl,
    Mode,
    Reference,
    Warn,
)
from drivers.hydraharp.errors import HydraHarpError
from drivers.hydraharp.limits import MAX_BINS
from drivers.lines.listening import tapped_functions

#: What a histogram or records begin with until the library has written them. A bin that is full holds as
#: many: 4 billion photons in the first bin, which no exposure here comes near. No record has all bits set.
UNWRITTEN = 2**32 - 1

#: The library is not re-entrant, not even for two instruments: one thread at a time.
_ONE_THREAD = Lock()

# Text is POINTER(c_char) rather than c_char_p, because the library writes into it.
_TEXT = POINTER(c_char)
_INT_OUT = POINTER(c_int)
_UINT_OUT = POINTER(c_uint)
_DOUBLE_OUT = POINTER(c_double)

#: The 44 functions with the types of their arguments (source: the vendor's hhlib.h); all return int.
PROTOTYPES: dict[str, tuple[Any, ...]] = {
    "HH_GetLibraryVersion": (_TEXT,),
    "HH_GetErrorString": (_TEXT, c_int),
    "HH_OpenDevice": (c_int, _TEXT),
    "HH_CloseDevice": (c_int,),
    "HH_Initialize": (c_int, c_int, c_int),
    "HH_GetHardwareInfo": (c_int, _TEXT, _TEXT, _TEXT),
    "HH_GetSerialNumber": (c_int, _TEXT),
    "HH_GetFeatures": (c_int, _INT_OUT),
    "HH_GetBaseResolution": (c_int, _DOUBLE_OUT, _INT_OUT),
    "HH_GetHardwareDebugInfo": (c_int, _TEXT),
    "HH_GetNumOfInputChannels": (c_int, _INT_OUT),
    "HH_GetNumOfModules": (c_int, _INT_OUT),
    "HH_GetModuleInfo": (c_int, c_int, _INT_OUT, _INT_OUT),
    "HH_GetModuleIndex": (c_int, c_int, _INT_OUT),
    "HH_Calibrate": (c_int,),
    "HH_SetSyncDiv": (c_int, c_int),
    "HH_SetSyncCFD": (c_int, c_int, c_int),
    "HH_SetSyncChannelOffset": (c_int, c_int),
    "HH_SetInputCFD": (c_int, c_int, c_int, c_int),
    "HH_SetInputChannelOffset": (c_int, c_int, c_int),
    "HH_SetInputChannelEnable": (c_int, c_int, c_int),
    "HH_SetStopOverflow": (c_int, c_int, c_uint),
    "HH_SetBinning": (c_int, c_int),
    "HH_SetOffset": (c_int, c_int),
    "HH_SetHistoLen": (c_int, c_int, _INT_OUT),
    "HH_SetMeasControl": (c_int, c_int, c_int, c_int),
    "HH_ClearHistMem": (c_int,),
    "HH_StartMeas": (c_int, c_int),
    "HH_StopMeas": (c_int,),
    "HH_CTCStatus": (c_int, _INT_OUT),
    "HH_GetHistogram": (c_int, _UINT_OUT, c_int, c_int),
    "HH_GetResolution": (c_int, _DOUBLE_OUT),
    "HH_GetSyncPeriod": (c_int, _DOUBLE_OUT),
    "HH_GetSyncRate": (c_int, _INT_OUT),
    "HH_GetCountRate": (c_int, c_int, _INT_OUT),
    "HH_GetFlags": (c_int, _INT_OUT),
    "HH_GetElapsedMeasTime": (c_int, _DOUBLE_OUT),
    "HH_GetWarnings": (c_int, _INT_OUT),
    "HH_GetWarningsText": (c_int, _TEXT, c_int),
    "HH_SetMarkerHoldoffTime": (c_int, c_int),
    "HH_SetMarkerEdges": (c_int, c_int, c_int, c_int, c_int),
    "HH_SetMarkerEnable": (c_int, c_int, c_int, c_int, c_int),
    "HH_ReadFiFo": (c_int, _UINT_OUT, c_int, _INT_OUT),
    "HH_GetContModeBlock": (c_int, c_void_p, _INT_OUT),
}


def histogram_buffers(inputs: int) -> "Array[Array[c_uint]]":
    """Allocate one block of memory with a row for each input, each as long as the longest histogram."""
    return (c_uint * MAX_BINS * inputs)()


def fifo_buffer(records: int = MAX_FIFO_RECORDS) -> "Array[c_uint]":
    """Allocate memory for records; the library takes only whole multiples of 128, up to 131072."""
    if records % FIFO_RECORDS_STEP or not 0 < records <= MAX_FIFO_RECORDS:
        raise ValueError(f"{records} records are no multiple of {FIFO_RECORDS_STEP} up to {MAX_FIFO_RECORDS}")
    return (c_uint * records)()


class HHLib:
    """The 44 functions.

    Parameters
    ----------
    functions
        A loaded ``CDLL`` or ``WinDLL``, or any object with the functions as attributes that are ctypes
        function pointers.
    name
        Where the functions come from, for messages.

    Raises
    ------
    DeviceNotFoundError
        If a function is missing.
    """

    def __init__(self, functions: object, *, name: str = "HHLib") -> None:
        self.name = name
        functions = tapped_functions(functions)
        self._functions: dict[str, Any] = {}
        for function_name, argument_types in PROTOTYPES.items():
            try:
                function = getattr(functions, function_name)
            except AttributeError:
                raise DeviceNotFoundError(
                    f"HydraHarp through {name}",
                    f"look up {function_name}",
                    "the library has no such function",
                    "This is not HHLib 3.0: install that release of the vendor's library.",
                ) from None
            function.argtypes = argument_types
            function.restype = c_int
            self._functions[function_name] = function

    def _call(self, function_name: str, *arguments: Any) -> None:
        with _ONE_THREAD:
            code = self._functions[function_name](*arguments)
        if code != 0:
            plain = ", ".join(str(a) for a in arguments if isinstance(a, int))
            raise HydraHarpError(f"HydraHarp through {self.name}", f"{function_name}({plain})", code)

    def _int(self, function_name: str, *arguments: int) -> int:
        answer = c_int()
        self._call(function_name, *arguments, byref(answer))
        return answer.value

    def _double(self, function_name: str, *arguments: int) -> float:
        answer = c_double()
        self._call(function_name, *arguments, byref(answer))
        return answer.value

    # The library itself

    def get_library_version(self) -> str:
        """Return the version of the library, e.g. ``"3.0"``."""
        text = create_string_buffer(16)
        self._call("HH_GetLibraryVersion", text)
        return _plain(text)

    def get_error_string(self, code: int) -> str:
        """Return the library's own name for an error code."""
        text = create_string_buffer(64)
        self._call("HH_GetErrorString", text, code)
        return _plain(text)

    # Opening and identifying

    def open_device(self, index: int) -> str:
        """Open the instrument at an index from 0 to 7 and return its serial number."""
        serial = create_string_buffer(16)
        self._call("HH_OpenDevice", index, serial)
        return _plain(serial)

    def close_device(self, index: int) -> None:
        """Close the instrument; allowed at any time."""
        self._call("HH_CloseDevice", index)

    def initialize(self, index: int, mode: Mode, reference: Reference) -> None:
        """Set the mode and the source of the reference clock."""
        self._call("HH_Initialize", index, mode, reference)

    def get_hardware_info(self, index: int) -> tuple[str, str, str]:
        """Return model, part number and version."""
        model, part, version = (create_string_buffer(32) for _ in range(3))
        self._call("HH_GetHardwareInfo", index, model, part, version)
        return _plain(model), _plain(part), _plain(version)

    def get_serial_number(self, index: int) -> str:
        """Return the serial number."""
        serial = create_string_buffer(16)
        self._call("HH_GetSerialNumber", index, serial)
        return _plain(serial)

    def get_features(self, index: int) -> Feature:
        """Return what the instrument is able to do."""
        return Feature(self._int("HH_GetFeatures", index))

    def get_base_resolution(self, index: int) -> tuple[float, int]:
        """Return the finest bin width [ps] and the number of binning codes."""
        resolution_ps, steps = c_double(), c_int()
        self._call("HH_GetBaseResolution", index, byref(resolution_ps), byref(steps))
        return resolution_ps.value, steps.value

    def get_hardware_debug_info(self, index: int) -> str:
        """Return the instrument's own report after a system error."""
        text = create_string_buffer(65536)
        self._call("HH_GetHardwareDebugInfo", index, text)
        return _plain(text)

    def get_num_of_input_channels(self, index: int) -> int:
        """Return the number of inputs, the sync input not counted."""
        return self._int("HH_GetNumOfInputChannels", index)

    def get_num_of_modules(self, index: int) -> int:
        """Return the number of modules inside."""
        return self._int("HH_GetNumOfModules", index)

    def get_module_info(self, index: int, module: int) -> tuple[int, int]:
        """Return model code and version code of a module."""
        model, version = c_int(), c_int()
        self._call("HH_GetModuleInfo", index, module, byref(model), byref(version))
        return model.value, version.value

    def get_module_index(self, index: int, channel: int) -> int:
        """Return the module that an input channel belongs to."""
        return self._int("HH_GetModuleIndex", index, channel)

    # Settings

    def calibrate(self, index: int) -> None:
        """Calibrate the time-to-digital converters."""
        self._call("HH_Calibrate", index)

    def set_sync_div(self, index: int, divider: int) -> None:
        """Divide the sync rate by 1, 2, 4, 8 or 16."""
        self._call("HH_SetSyncDiv", index, divider)

    def set_sync_cfd(self, index: int, level_mv: int, zero_cross_mv: int) -> None:
        """Set the sync discriminator; both positive, though the signal is negative."""
        self._call("HH_SetSyncCFD", index, level_mv, zero_cross_mv)

    def set_sync_channel_offset(self, index: int, offset_ps: int) -> None:
        """Shift the sync input in time."""
        self._call("HH_SetSyncChannelOffset", index, offset_ps)

    def set_input_cfd(self, index: int, channel: int, level_mv: int, zero_cross_mv: int) -> None:
        """Set the discriminator of an input; both positive, though the signal is negative."""
        self._call("HH_SetInputCFD", index, channel, level_mv, zero_cross_mv)

    def set_input_channel_offset(self, index: int, channel: int, offset_ps: int) -> None:
        """Shift an input in time."""
        self._call("HH_SetInputChannelOffset", index, channel, offset_ps)

    def set_input_channel_enable(self, index: int, channel: int, enable: bool) -> None:
        """Switch an input on or off."""
        self._call("HH_SetInputChannelEnable", index, channel, int(enable))

    def set_stop_overflow(self, index: int, stop: bool, stop_count: int) -> None:
        """End a measurement when a bin reaches ``stop_count``, or do not."""
        self._call("HH_SetStopOverflow", index, int(stop), stop_count)

    def set_binning(self, index: int, code: int) -> None:
        """Set the bin width to the base resolution times two to the ``code``."""
        self._call("HH_SetBinning", index, code)

    def set_offset(self, index: int, offset_ns: int) -> None:
        """Subtract this time before histogramming."""
        self._call("HH_SetOffset", index, offset_ns)

    def set_histo_len(self, index: int, code: int) -> int:
        """Set the histogram length to 1024 times two to the ``code`` and return it in bins."""
        return self._int("HH_SetHistoLen", index, code)

    def set_meas_control(self, index: int, control: MeasControl, start: Edge, stop: Edge) -> None:
        """Choose what starts and stops a measurement."""
        self._call("HH_SetMeasControl", index, control, start, stop)

    def set_marker_holdoff_time(self, index: int, holdoff_ns: int) -> None:
        """Ignore further markers for this time after one."""
        self._call("HH_SetMarkerHoldoffTime", index, holdoff_ns)

    def set_marker_edges(self, index: int, edges: tuple[Edge, Edge, Edge, Edge]) -> None:
        """Choose the active edge of each of the four markers."""
        self._call("HH_SetMarkerEdges", index, *edges)

    def set_marker_enable(self, index: int, enable: tuple[bool, bool, bool, bool]) -> None:
        """Switch each of the four markers on or off."""
        self._call("HH_SetMarkerEnable", index, *(int(e) for e in enable))

    # Measuring

    def clear_hist_mem(self, index: int) -> None:
        """Set all histograms to zero."""
        self._call("HH_ClearHistMem", index)

    def start_meas(self, index: int, acquisition_ms: int) -> None:
        """Start a measurement."""
        self._call("HH_StartMeas", index, acquisition_ms)

    def stop_meas(self, index: int) -> None:
        """Stop a measurement; needed also after it ended by itself."""
        self._call("HH_StopMeas", index)

    def ctc_ended(self, index: int) -> bool:
        """Return whether the acquisition time has run out (HH_CTCStatus)."""
        return self._int("HH_CTCStatus", index) != 0

    def get_histogram(self, index: int, channel: int, into: "Array[c_uint]", *, clear: bool = False) -> None:
        """Copy an input's histogram into a row of `histogram_buffers`, as many bins as are set.

        Raises
        ------
        ProtocolError
            If the library says that all is well and wrote nothing, so that the row holds older counts.
        """
        into[0] = UNWRITTEN
        self._call("HH_GetHistogram", index, into, channel, int(clear))
        if into[0] == UNWRITTEN:
            raise ProtocolError(
                f"HydraHarp through {self.name}",
                f"give the histogram of input {channel}",
                "it said that all is well and wrote no counts",
                "Check the USB link, and switch the HydraHarp off and on.",
            )

    def get_resolution(self, index: int) -> float:
        """Return the bin width in force [ps]."""
        return self._double("HH_GetResolution", index)

    def get_sync_period(self, index: int) -> float:
        """Return the sync period; the manual says in ps, the vendor's C demo takes it as seconds."""
        return self._double("HH_GetSyncPeriod", index)

    def get_sync_rate(self, index: int) -> int:
        """Return the sync rate [Hz], the divider already accounted for."""
        return self._int("HH_GetSyncRate", index)

    def get_count_rate(self, index: int, channel: int) -> int:
        """Return an input's count rate [Hz]."""
        return self._int("HH_GetCountRate", index, channel)

    def get_flags(self, index: int) -> Flag:
        """Return the state flags."""
        return Flag(self._int("HH_GetFlags", index))

    def get_elapsed_meas_time(self, index: int) -> float:
        """Return how long the last measurement ran, or the running one has run [ms]."""
        return self._double("HH_GetElapsedMeasTime", index)

    def get_warnings(self, index: int) -> Warn:
        """Return the warnings; all rates must have been read before."""
        return Warn(self._int("HH_GetWarnings", index))

    def get_warnings_text(self, index: int, warnings: int) -> str:
        """Return the library's own text for these warnings."""
        text = create_string_buffer(16384)
        self._call("HH_GetWarningsText", index, text, warnings)
        return _plain(text)

    def read_fifo(self, index: int, into: "Array[c_uint]") -> int:
        """Copy the records at hand into a `fifo_buffer`, at most as many as it holds; return their number.

        Raises
        ------
        ProtocolError
            If that is more than there is room for, or if nothing was written, so that older ones are there.
        """
        received = c_int()
        into[0] = UNWRITTEN
        self._call("HH_ReadFiFo", index, into, len(into), byref(received))
        number = received.value
        possible = 0 <= number <= len(into)
        if possible and not (number and into[0] == UNWRITTEN):
            return number
        raise ProtocolError(
            f"HydraHarp through {self.name}",
            f"read {len(into)} records at most",
            f"it said that these are {number}, {'and wrote no records' if possible else 'which cannot be'}",
            "Check the USB link, and switch the HydraHarp off and on.",
        )

    def get_cont_mode_block(self, index: int) -> bytes:
        """Return the next block of continuous mode; empty where none is ready."""
        block = create_string_buffer(MAX_CONTINUOUS_BLOCK_BYTES)
        received = c_int()
        self._call("HH_GetContModeBlock", index, block, byref(received))
        return block.raw[: received.value]


def _plain(text: "Array[c_char]") -> str:
    return text.value.decode("latin-1").strip()
