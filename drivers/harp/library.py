"""The vendor's library as Python methods, one for each C function that is used and nothing more.

Each method allocates the out-parameters, calls, raises `HarpError` unless the answer is zero, and
returns Python values in the vendor's own units, which its name or docstring tells.
"""

from ctypes import POINTER, Array, byref, c_char, c_double, c_int, c_uint, create_string_buffer
from threading import Lock
from typing import Any

from drivers.errors import DeviceNotFoundError, ProtocolError
from drivers.harp.constants import Edge, Feature, MeasControl, Mode, Reference
from drivers.harp.errors import HarpError
from drivers.harp.family import Family
from drivers.harp.triggers import TriggerMode
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

#: Functions that all families have alike, without their prefix; all return int.
_COMMON: dict[str, tuple[Any, ...]] = {
    "GetLibraryVersion": (_TEXT,),
    "OpenDevice": (c_int, _TEXT),
    "CloseDevice": (c_int,),
    "GetHardwareInfo": (c_int, _TEXT, _TEXT, _TEXT),
    "GetFeatures": (c_int, _INT_OUT),
    "GetBaseResolution": (c_int, _DOUBLE_OUT, _INT_OUT),
    "GetNumOfInputChannels": (c_int, _INT_OUT),
    "SetSyncDiv": (c_int, c_int),
    "SetSyncChannelOffset": (c_int, c_int),
    "SetInputChannelOffset": (c_int, c_int, c_int),
    "SetInputChannelEnable": (c_int, c_int, c_int),
    "SetStopOverflow": (c_int, c_int, c_uint),
    "SetBinning": (c_int, c_int),
    "SetOffset": (c_int, c_int),
    "SetHistoLen": (c_int, c_int, _INT_OUT),
    "SetMeasControl": (c_int, c_int, c_int, c_int),
    "ClearHistMem": (c_int,),
    "StartMeas": (c_int, c_int),
    "StopMeas": (c_int,),
    "CTCStatus": (c_int, _INT_OUT),
    "GetResolution": (c_int, _DOUBLE_OUT),
    "GetSyncRate": (c_int, _INT_OUT),
    "GetCountRate": (c_int, c_int, _INT_OUT),
    "GetFlags": (c_int, _INT_OUT),
    "GetElapsedMeasTime": (c_int, _DOUBLE_OUT),
    "GetWarnings": (c_int, _INT_OUT),
    "GetWarningsText": (c_int, _TEXT, c_int),
    "SetMarkerHoldoffTime": (c_int, c_int),
    "SetMarkerEdges": (c_int, c_int, c_int, c_int, c_int),
    "SetMarkerEnable": (c_int, c_int, c_int, c_int, c_int),
}


def prototypes(family: Family) -> dict[str, tuple[Any, ...]]:
    """Return the functions that this driver calls, without their prefix, with the types of arguments."""
    own: dict[str, tuple[Any, ...]] = {
        "Initialize": (c_int, c_int, *[c_int] * family.takes_reference),
        "GetHistogram": (c_int, _UINT_OUT, c_int, *[c_int] * family.clears_with_histogram),
        "ReadFiFo": (c_int, _UINT_OUT, *[c_int] * bool(family.fifo_step), _INT_OUT),
        family.debug: (c_int, _TEXT),
    }
    if family.calibrates:
        own["Calibrate"] = (c_int,)
    if family.limits.cfd_level is not None:
        own |= {"SetSyncCFD": (c_int, c_int, c_int), "SetInputCFD": (c_int, c_int, c_int, c_int)}
    if family.limits.edge_level is not None:
        own |= {"SetSyncEdgeTrg": (c_int, c_int, c_int), "SetInputEdgeTrg": (c_int, c_int, c_int, c_int)}
    if family.limits.has_both_triggers:
        own |= {"SetSyncTrgMode": (c_int, c_int), "SetInputTrgMode": (c_int, c_int, c_int)}
    return _COMMON | own


def histogram_buffers(inputs: int, bins: int) -> "Array[Array[c_uint]]":
    """Allocate one block of memory with a row for each input, each of so many bins."""
    return (c_uint * bins * inputs)()


class HarpLibrary:
    """The functions of one family.

    Parameters
    ----------
    functions
        A loaded ``CDLL`` or ``WinDLL``, or any object with the functions as attributes that are ctypes
        function pointers.
    family
        Whose functions they are.
    name
        Where the functions come from, for messages.

    Raises
    ------
    DeviceNotFoundError
        If a function is missing.
    """

    def __init__(self, functions: object, family: Family, *, name: str = "") -> None:
        self.family = family
        self.name = name or family.library
        self._device = f"{family.name} through {self.name}"
        functions = tapped_functions(functions)
        self._functions: dict[str, Any] = {}
        for bare_name, argument_types in prototypes(family).items():
            function_name = f"{family.prefix}_{bare_name}"
            try:
                function = getattr(functions, function_name)
            except AttributeError:
                raise DeviceNotFoundError(
                    self._device,
                    f"look up {function_name}",
                    "the library has no such function",
                    f"This is not {family.library} {family.versions[-1]}: install that release of the "
                    "vendor's library.",
                ) from None
            function.argtypes = argument_types
            function.restype = c_int
            self._functions[bare_name] = function

    def _call(self, function: str, index: int, *arguments: Any) -> None:
        """Call a function of an instrument.

        Raises
        ------
        ValueError
            If no instrument can be at ``index``: some of the libraries end the whole process then.
        """
        if not 0 <= index < self.family.devices:
            raise ValueError(f"index {index} is outside 0 to {self.family.devices - 1}")
        self._run(function, index, *arguments)

    def _run(self, function: str, *arguments: Any) -> None:
        with _ONE_THREAD:
            code = self._functions[function](*arguments)
        if code != 0:
            plain = ", ".join(str(a) for a in arguments if isinstance(a, int))
            raise HarpError(self.family, self._device, f"{self.family.prefix}_{function}({plain})", code)

    def _int(self, function: str, index: int, *arguments: int) -> int:
        answer = c_int()
        self._call(function, index, *arguments, byref(answer))
        return answer.value

    def _double(self, function: str, index: int) -> float:
        answer = c_double()
        self._call(function, index, byref(answer))
        return answer.value

    # The library itself

    def get_library_version(self) -> str:
        """Return the version of the library, e.g. ``"3.0"``."""
        text = create_string_buffer(16)
        self._run("GetLibraryVersion", text)
        return _plain(text)

    # Opening and identifying

    def open_device(self, index: int) -> str:
        """Open the instrument at an index and return its serial number."""
        serial = create_string_buffer(32)
        self._call("OpenDevice", index, serial)
        return _plain(serial)

    def close_device(self, index: int) -> None:
        """Close the instrument; allowed at any time."""
        self._call("CloseDevice", index)

    def initialize(self, index: int, mode: Mode, reference: Reference) -> None:
        """Set the mode, and the source of the reference clock where there can be another."""
        self._call("Initialize", index, mode, *[reference] * self.family.takes_reference)

    def get_hardware_info(self, index: int) -> tuple[str, str, str]:
        """Return model, part number and version."""
        model, part, version = (create_string_buffer(32) for _ in range(3))
        self._call("GetHardwareInfo", index, model, part, version)
        return _plain(model), _plain(part), _plain(version)

    def get_features(self, index: int) -> Feature:
        """Return what the instrument is able to do."""
        return Feature(self._int("GetFeatures", index))

    def get_base_resolution(self, index: int) -> tuple[float, int]:
        """Return the finest bin width [ps] and the number of binning codes."""
        resolution_ps, steps = c_double(), c_int()
        self._call("GetBaseResolution", index, byref(resolution_ps), byref(steps))
        return resolution_ps.value, steps.value

    def get_debug_info(self, index: int) -> str:
        """Return the instrument's own report after a system error."""
        text = create_string_buffer(65536)
        self._call(self.family.debug, index, text)
        return _plain(text)

    def get_num_of_input_channels(self, index: int) -> int:
        """Return the number of inputs, the sync input not counted."""
        return self._int("GetNumOfInputChannels", index)

    # Settings

    def calibrate(self, index: int) -> None:
        """Calibrate the time-to-digital converters."""
        self._call("Calibrate", index)

    def set_sync_div(self, index: int, divider: int) -> None:
        """Divide the sync rate by 1, 2, 4 and so on."""
        self._call("SetSyncDiv", index, divider)

    def set_sync_trg_mode(self, index: int, mode: TriggerMode) -> None:
        """Choose which of its triggers the sync input uses."""
        self._call("SetSyncTrgMode", index, mode)

    def set_sync_cfd(self, index: int, level_mv: int, zero_cross_mv: int) -> None:
        """Set the sync's discriminator."""
        self._call("SetSyncCFD", index, level_mv, zero_cross_mv)

    def set_sync_edge_trg(self, index: int, level_mv: int, edge: int) -> None:
        """Set the sync's edge trigger."""
        self._call("SetSyncEdgeTrg", index, level_mv, edge)

    def set_sync_channel_offset(self, index: int, offset_ps: int) -> None:
        """Shift the sync input in time."""
        self._call("SetSyncChannelOffset", index, offset_ps)

    def set_input_trg_mode(self, index: int, channel: int, mode: TriggerMode) -> None:
        """Choose which of its triggers an input uses."""
        self._call("SetInputTrgMode", index, channel, mode)

    def set_input_cfd(self, index: int, channel: int, level_mv: int, zero_cross_mv: int) -> None:
        """Set an input's discriminator."""
        self._call("SetInputCFD", index, channel, level_mv, zero_cross_mv)

    def set_input_edge_trg(self, index: int, channel: int, level_mv: int, edge: int) -> None:
        """Set an input's edge trigger."""
        self._call("SetInputEdgeTrg", index, channel, level_mv, edge)

    def set_input_channel_offset(self, index: int, channel: int, offset_ps: int) -> None:
        """Shift an input in time."""
        self._call("SetInputChannelOffset", index, channel, offset_ps)

    def set_input_channel_enable(self, index: int, channel: int, enable: bool) -> None:
        """Switch an input on or off."""
        self._call("SetInputChannelEnable", index, channel, int(enable))

    def set_stop_overflow(self, index: int, stop: bool, stop_count: int) -> None:
        """End a measurement when a bin reaches ``stop_count``, or do not."""
        self._call("SetStopOverflow", index, int(stop), stop_count)

    def set_binning(self, index: int, code: int) -> None:
        """Set the bin width to the base resolution times two to the ``code``."""
        self._call("SetBinning", index, code)

    def set_offset(self, index: int, offset_ns: int) -> None:
        """Subtract this time before histogramming."""
        self._call("SetOffset", index, offset_ns)

    def set_histo_len(self, index: int, code: int) -> int:
        """Set the histogram length to 1024 times two to the ``code`` and return it in bins."""
        return self._int("SetHistoLen", index, code)

    def set_meas_control(self, index: int, control: MeasControl, start: Edge, stop: Edge) -> None:
        """Choose what starts and stops a measurement."""
        self._call("SetMeasControl", index, control, start, stop)

    def set_marker_holdoff_time(self, index: int, holdoff_ns: int) -> None:
        """Ignore further markers for this time after one."""
        self._call("SetMarkerHoldoffTime", index, holdoff_ns)

    def set_marker_edges(self, index: int, edges: tuple[Edge, Edge, Edge, Edge]) -> None:
        """Choose the active edge of each of the four markers."""
        self._call("SetMarkerEdges", index, *edges)

    def set_marker_enable(self, index: int, enable: tuple[bool, bool, bool, bool]) -> None:
        """Switch each of the four markers on or off."""
        self._call("SetMarkerEnable", index, *(int(e) for e in enable))

    # Measuring

    def clear_hist_mem(self, index: int) -> None:
        """Set all histograms to zero."""
        self._call("ClearHistMem", index)

    def start_meas(self, index: int, acquisition_ms: int) -> None:
        """Start a measurement."""
        self._call("StartMeas", index, acquisition_ms)

    def stop_meas(self, index: int) -> None:
        """Stop a measurement; needed also after it ended by itself."""
        self._call("StopMeas", index)

    def ctc_ended(self, index: int) -> bool:
        """Return whether the acquisition time has run out (CTCStatus)."""
        return self._int("CTCStatus", index) != 0

    def get_histogram(self, index: int, channel: int, into: "Array[c_uint]") -> None:
        """Copy an input's histogram into a row of `histogram_buffers`, as many bins as are set.

        Families whose function can clear are told not to: what is read again is then the same.

        Raises
        ------
        ProtocolError
            If the library says that all is well and wrote nothing, so that the row holds older counts.
        """
        into[0] = UNWRITTEN
        self._call("GetHistogram", index, into, channel, *[0] * self.family.clears_with_histogram)
        if into[0] == UNWRITTEN:
            raise self._untrue(
                f"give the histogram of input {channel}", "there was no error, but wrote no counts"
            )

    def get_resolution(self, index: int) -> float:
        """Return the bin width in force [ps]."""
        return self._double("GetResolution", index)

    def get_sync_rate(self, index: int) -> int:
        """Return the sync rate [Hz], the divider already accounted for."""
        return self._int("GetSyncRate", index)

    def get_count_rate(self, index: int, channel: int) -> int:
        """Return an input's count rate [Hz]."""
        return self._int("GetCountRate", index, channel)

    def get_flags(self, index: int) -> int:
        """Return the state flags, see `Flags`."""
        return self._int("GetFlags", index)

    def get_elapsed_meas_time(self, index: int) -> float:
        """Return how long the last measurement ran, or the running one has run [ms]."""
        return self._double("GetElapsedMeasTime", index)

    def get_warnings(self, index: int) -> int:
        """Return the warnings, see `Family`; all rates must have been read before."""
        return self._int("GetWarnings", index)

    def get_warnings_text(self, index: int, warnings: int) -> str:
        """Return the library's own text for these warnings."""
        text = create_string_buffer(16384)
        self._call("GetWarningsText", index, text, warnings)
        return _plain(text)

    def fifo_buffer(self) -> "Array[c_uint]":
        """Allocate memory for as many records as one read can bring."""
        return (c_uint * self.family.fifo_records)()

    def read_fifo(self, index: int, into: "Array[c_uint]") -> int:
        """Copy the records at hand into a `fifo_buffer`, at most as many as it holds; return their number.

        Raises
        ------
        ProtocolError
            If that is more than there is room for, or if nothing was written, so that older ones are there.
        """
        received = c_int()
        into[0] = UNWRITTEN
        self._call("ReadFiFo", index, into, *[len(into)] * bool(self.family.fifo_step), byref(received))
        number = received.value
        possible = 0 <= number <= len(into)
        if possible and not (number and into[0] == UNWRITTEN):
            return number
        said = "but wrote no records" if possible else "which is not possible"
        raise self._untrue(f"read {len(into)} records at most", f"it read {number}, {said}")

    def _untrue(self, asked: str, said: str) -> ProtocolError:
        link = self.family.link
        return ProtocolError(
            self._device, asked, f"it reported that {said}", f"{link.check}, and {link.restart}."
        )


def _plain(text: "Array[c_char]") -> str:
    return text.value.decode("latin-1").strip()
