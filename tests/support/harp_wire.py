"""What the tests of the timing instruments share: a steady light source, a scripted library, and calls."""

from ctypes import (
    CFUNCTYPE,
    POINTER,
    c_char,
    c_double,
    c_int,
    c_uint,
    c_void_p,
    create_string_buffer,
    memmove,
)
from types import SimpleNamespace

import numpy as np

from simulators.bench import Bench, BenchGeometry, Channel, Detections, no_detections

#: The functions as the vendor's header declares them.
HEADER = """
int HH_GetLibraryVersion(char* vers)
int HH_GetErrorString(char* errstring, int errcode)
int HH_OpenDevice(int devidx, char* serial)
int HH_CloseDevice(int devidx)
int HH_Initialize(int devidx, int mode, int refsource)
int HH_GetHardwareInfo(int devidx, char* model, char* partno, char* version)
int HH_GetSerialNumber(int devidx, char* serial)
int HH_GetFeatures(int devidx, int* features)
int HH_GetBaseResolution(int devidx, double* resolution, int* binsteps)
int HH_GetHardwareDebugInfo(int devidx, char* debuginfo)
int HH_GetNumOfInputChannels(int devidx, int* nchannels)
int HH_GetNumOfModules(int devidx, int* nummod)
int HH_GetModuleInfo(int devidx, int modidx, int* modelcode, int* versioncode)
int HH_GetModuleIndex(int devidx, int channel, int* modidx)
int HH_Calibrate(int devidx)
int HH_SetSyncDiv(int devidx, int div)
int HH_SetSyncCFD(int devidx, int level, int zc)
int HH_SetSyncChannelOffset(int devidx, int value)
int HH_SetInputCFD(int devidx, int channel, int level, int zc)
int HH_SetInputChannelOffset(int devidx, int channel, int value)
int HH_SetInputChannelEnable(int devidx, int channel, int enable)
int HH_SetStopOverflow(int devidx, int stop_ovfl, unsigned int stopcount)
int HH_SetBinning(int devidx, int binning)
int HH_SetOffset(int devidx, int offset)
int HH_SetHistoLen(int devidx, int lencode, int* actuallen)
int HH_SetMeasControl(int devidx, int control, int startedge, int stopedge)
int HH_ClearHistMem(int devidx)
int HH_StartMeas(int devidx, int tacq)
int HH_StopMeas(int devidx)
int HH_CTCStatus(int devidx, int* ctcstatus)
int HH_GetHistogram(int devidx, unsigned int* chcount, int channel, int clear)
int HH_GetResolution(int devidx, double* resolution)
int HH_GetSyncPeriod(int devidx, double* period)
int HH_GetSyncRate(int devidx, int* syncrate)
int HH_GetCountRate(int devidx, int channel, int* cntrate)
int HH_GetFlags(int devidx, int* flags)
int HH_GetElapsedMeasTime(int devidx, double* elapsed)
int HH_GetWarnings(int devidx, int* warnings)
int HH_GetWarningsText(int devidx, char* text, int warnings)
int HH_SetMarkerHoldoffTime(int devidx, int holdofftime)
int HH_SetMarkerEdges(int devidx, int me1, int me2, int me3, int me4)
int HH_SetMarkerEnable(int devidx, int en1, int en2, int en3, int en4)
int HH_ReadFiFo(int devidx, unsigned int* buffer, int count, int* nactual)
int HH_GetContModeBlock(int devidx, void* buffer, int* nbytesreceived)
"""

#: The other families' functions that are used here, as their headers declare them (HH500: see below).
OTHERS = """
int MH_GetLibraryVersion(char* vers)
int MH_GetErrorString(char* errstring, int errcode)
int MH_OpenDevice(int devidx, char* serial)
int MH_CloseDevice(int devidx)
int MH_Initialize(int devidx, int mode, int refsource)
int MH_GetHardwareInfo(int devidx, char* model, char* partno, char* version)
int MH_GetSerialNumber(int devidx, char* serial)
int MH_GetFeatures(int devidx, int* features)
int MH_GetBaseResolution(int devidx, double* resolution, int* binsteps)
int MH_GetNumOfInputChannels(int devidx, int* nchannels)
int MH_SetSyncDiv(int devidx, int div)
int MH_SetSyncEdgeTrg(int devidx, int level, int edge)
int MH_SetSyncChannelOffset(int devidx, int value)
int MH_SetInputEdgeTrg(int devidx, int channel, int level, int edge)
int MH_SetInputChannelOffset(int devidx, int channel, int value)
int MH_SetInputChannelEnable(int devidx, int channel, int enable)
int MH_SetStopOverflow(int devidx, int stop_ovfl, unsigned int stopcount)
int MH_SetBinning(int devidx, int binning)
int MH_SetOffset(int devidx, int offset)
int MH_SetHistoLen(int devidx, int lencode, int* actuallen)
int MH_SetMeasControl(int devidx, int control, int startedge, int stopedge)
int MH_ClearHistMem(int devidx)
int MH_StartMeas(int devidx, int tacq)
int MH_StopMeas(int devidx)
int MH_CTCStatus(int devidx, int* ctcstatus)
int MH_GetHistogram(int devidx, unsigned int* chcount, int channel)
int MH_GetResolution(int devidx, double* resolution)
int MH_GetSyncPeriod(int devidx, double* period)
int MH_GetSyncRate(int devidx, int* syncrate)
int MH_GetCountRate(int devidx, int channel, int* cntrate)
int MH_GetFlags(int devidx, int* flags)
int MH_GetElapsedMeasTime(int devidx, double* elapsed)
int MH_GetWarnings(int devidx, int* warnings)
int MH_GetWarningsText(int devidx, char* text, int warnings)
int MH_SetMarkerHoldoffTime(int devidx, int holdofftime)
int MH_SetMarkerEdges(int devidx, int me1, int me2, int me3, int me4)
int MH_SetMarkerEnable(int devidx, int en1, int en2, int en3, int en4)
int MH_ReadFiFo(int devidx, unsigned int* buffer, int* nactual)
int MH_GetDebugInfo(int devidx, char* debuginfo)

int PH330_GetLibraryVersion(char* vers)
int PH330_GetErrorString(char* errstring, int errcode)
int PH330_OpenDevice(int devidx, char* serial)
int PH330_CloseDevice(int devidx)
int PH330_Initialize(int devidx, int mode, int refsource)
int PH330_GetHardwareInfo(int devidx, char* model, char* partno, char* version)
int PH330_GetSerialNumber(int devidx, char* serial)
int PH330_GetFeatures(int devidx, int* features)
int PH330_GetBaseResolution(int devidx, double* resolution, int* binsteps)
int PH330_GetNumOfInputChannels(int devidx, int* nchannels)
int PH330_SetSyncDiv(int devidx, int div)
int PH330_SetSyncTrgMode(int devidx, int mode)
int PH330_SetSyncEdgeTrg(int devidx, int level, int edge)
int PH330_SetSyncCFD(int devidx, int level, int zerocross)
int PH330_SetSyncChannelOffset(int devidx, int offset)
int PH330_SetInputTrgMode(int devidx, int channel, int mode)
int PH330_SetInputEdgeTrg(int devidx, int channel, int level, int edge)
int PH330_SetInputCFD(int devidx, int channel, int level, int zerocross)
int PH330_SetInputChannelOffset(int devidx, int channel, int offset)
int PH330_SetInputChannelEnable(int devidx, int channel, int enable)
int PH330_SetStopOverflow(int devidx, int stop_ovfl, unsigned int stopcount)
int PH330_SetBinning(int devidx, int binning)
int PH330_SetOffset(int devidx, int offset)
int PH330_SetHistoLen(int devidx, int lencode, int* actuallen)
int PH330_SetMeasControl(int devidx, int control, int startedge, int stopedge)
int PH330_ClearHistMem(int devidx)
int PH330_StartMeas(int devidx, int tacq)
int PH330_StopMeas(int devidx)
int PH330_CTCStatus(int devidx, int* ctcstatus)
int PH330_GetHistogram(int devidx, unsigned int* chcount, int channel)
int PH330_GetResolution(int devidx, double* resolution)
int PH330_GetSyncPeriod(int devidx, double* period)
int PH330_GetSyncRate(int devidx, int* syncrate)
int PH330_GetCountRate(int devidx, int channel, int* cntrate)
int PH330_GetFlags(int devidx, int* flags)
int PH330_GetElapsedMeasTime(int devidx, double* elapsed)
int PH330_GetWarnings(int devidx, int* warnings)
int PH330_GetWarningsText(int devidx, char* text, int warnings)
int PH330_SetMarkerHoldoffTime(int devidx, int holdofftime)
int PH330_SetMarkerEdges(int devidx, int me1, int me2, int me3, int me4)
int PH330_SetMarkerEnable(int devidx, int en1, int en2, int en3, int en4)
int PH330_ReadFiFo(int devidx, unsigned int* buffer, int* nactual)
int PH330_GetDebugInfo(int devidx, char* debuginfo)

int TH260_GetLibraryVersion(char* version)
int TH260_GetErrorString(char* errstring, int errcode)
int TH260_OpenDevice(int devidx, char* serial)
int TH260_CloseDevice(int devidx)
int TH260_Initialize(int devidx, int mode)
int TH260_GetHardwareInfo(int devidx, char* model, char* partno, char* version)
int TH260_GetSerialNumber(int devidx, char* serial)
int TH260_GetFeatures(int devidx, int* features)
int TH260_GetBaseResolution(int devidx, double* resolution, int* binsteps)
int TH260_GetNumOfInputChannels(int devidx, int* nchannels)
int TH260_SetSyncDiv(int devidx, int div)
int TH260_SetSyncCFD(int devidx, int level, int zc)
int TH260_SetSyncEdgeTrg(int devidx, int level, int edge)
int TH260_SetSyncChannelOffset(int devidx, int value)
int TH260_SetInputCFD(int devidx, int channel, int level, int zc)
int TH260_SetInputEdgeTrg(int devidx, int channel, int level, int edge)
int TH260_SetInputChannelOffset(int devidx, int channel, int value)
int TH260_SetInputChannelEnable(int devidx, int channel, int enable)
int TH260_SetStopOverflow(int devidx, int stop_ovfl, unsigned int stopcount)
int TH260_SetBinning(int devidx, int binning)
int TH260_SetOffset(int devidx, int offset)
int TH260_SetHistoLen(int devidx, int lencode, int* actuallen)
int TH260_SetMeasControl(int devidx, int control, int startedge, int stopedge)
int TH260_ClearHistMem(int devidx)
int TH260_StartMeas(int devidx, int tacq)
int TH260_StopMeas(int devidx)
int TH260_CTCStatus(int devidx, int* ctcstatus)
int TH260_GetHistogram(int devidx, unsigned int* chcount, int channel, int clear)
int TH260_GetResolution(int devidx, double* resolution)
int TH260_GetSyncRate(int devidx, int* syncrate)
int TH260_GetCountRate(int devidx, int channel, int* cntrate)
int TH260_GetFlags(int devidx, int* flags)
int TH260_GetElapsedMeasTime(int devidx, double* elapsed)
int TH260_GetSyncPeriod(int devidx, double* period)
int TH260_GetWarnings(int devidx, int* warnings)
int TH260_GetWarningsText(int devidx, char* text, int warnings)
int TH260_GetHardwareDebugInfo(int devidx, char* debuginfo)
int TH260_SetMarkerEdges(int devidx, int me1, int me2, int me3, int me4)
int TH260_SetMarkerEnable(int devidx, int en1, int en2, int en3, int en4)
int TH260_SetMarkerHoldoffTime(int devidx, int holdofftime)
int TH260_ReadFiFo(int devidx, unsigned int* buffer, int count, int* nactual)
"""

#: Of HH500Lib only the names are known: its functions are taken to be those of the PicoHarp 330.
OTHERS += "".join(f"{line}\n".replace("PH330_", "HH500_") for line in OTHERS.splitlines() if "PH330_" in line)

C_TYPES = {
    "int": c_int,
    "unsigned int": c_uint,
    "char*": POINTER(c_char),
    "int*": POINTER(c_int),
    "unsigned int*": POINTER(c_uint),
    "double*": POINTER(c_double),
    "void*": c_void_p,
}


def declared() -> dict[str, list[str]]:
    """Name of each function with the C types of its arguments."""
    functions = {}
    for line in filter(None, (HEADER + OTHERS).splitlines()):
        name, arguments = line.removeprefix("int ").rstrip(")").split("(")
        functions[name] = [argument.rsplit(" ", 1)[0] for argument in arguments.split(", ")]
    return functions


DECLARED = declared()


def declared_by(prefix: str) -> dict[str, list[str]]:
    """Those of `DECLARED` that belong to one library."""
    return {name: types for name, types in DECLARED.items() if name.startswith(f"{prefix}_")}


def call(functions, name, *plain):
    """Call a function with its int arguments; return its code and what it wrote, in the header's order."""
    rest, arguments, outputs = list(plain), [], []
    for c_type in DECLARED[name]:
        if not c_type.endswith("*"):
            arguments.append(rest.pop(0))
            continue
        buffer = {
            "char*": lambda: create_string_buffer(65536),
            "int*": c_int,
            "double*": c_double,
            "unsigned int*": lambda: (c_uint * 1048576)(),
            "void*": lambda: create_string_buffer(262272),
        }[c_type]()
        arguments.append(buffer)
        outputs.append(buffer)
    assert not rest, f"too many arguments for {name}"
    code = getattr(functions, name)(*arguments)
    return code, *(getattr(buffer, "value", buffer) for buffer in outputs)


class SteadyLight:
    """A source whose photons arrive at the given times in turn, ``rate_hz`` of them a second.

    They come only while the laser emits, unless ``ambient``.
    """

    def __init__(self, times_s, rate_hz, *, ambient=False):
        self.times_s, self.rate, self.ambient = np.asarray(times_s, float), rate_hz, ambient

    def detections(self, laser_spot_m, light, duration_s, rng):
        if not (light.emitting or self.ambient):
            return no_detections()
        times_s = np.resize(self.times_s, round(self.rate * duration_s))
        return Detections(np.arange(len(times_s)), times_s)

    def rate_hz(self, laser_spot_m, light):
        return self.rate if light.emitting or self.ambient else 0.0


def bench_with(times_s, rate_hz, *, emitting=True, ambient=False, repetition_hz=10e6, at_input=0):
    geometry = BenchGeometry(channels=(Channel(input=at_input),))
    bench = Bench([SteadyLight(times_s, rate_hz, ambient=ambient)], geometry)
    bench.change_light(emitting=emitting, repetition_hz=repetition_hz)
    return bench


class Returns(int):
    """The code that a scripted call returns instead of 0."""


class ScriptedLibrary:
    """A library and a clock that expect exact calls in exact order and answer as written.

    Each line is the call with its int arguments, then what it writes into its pointers; ``Returns(code)``
    makes it fail. The clock's waits are lines too: ``("sleep(0.4)",)``, or with Ctrl-C in the middle
    ``("sleep(0.4)", KeyboardInterrupt)``.
    """

    def __init__(self, lines):
        self.lines = list(lines)
        self.wrong = []
        self.time_s = 0.0
        self.functions = SimpleNamespace(
            **{
                name: CFUNCTYPE(c_int, *(C_TYPES[t] for t in types))(self._function(name))
                for name, types in DECLARED.items()
            }
        )

    def now_s(self):
        return self.time_s

    def sleep(self, duration_s):
        self.time_s = round(self.time_s + duration_s, 9)  # a sum of milliseconds stays one
        for interrupted in self._expect(f"sleep({duration_s:g})"):
            raise interrupted

    def finish(self):
        assert not self.wrong, "\n".join(self.wrong)
        assert not self.lines, f"never called: {self.lines}"

    def _expect(self, got):
        expected, *outputs = self.lines.pop(0) if self.lines else ("the end",)
        if got != expected:
            self.wrong.append(f"expected {expected}, got {got}")
        return outputs

    def _function(self, name):
        def function(*arguments):
            try:
                is_pointer = [c_type.endswith("*") for c_type in DECLARED[name]]  # void* comes as a number
                plain = [str(a) for a, out in zip(arguments, is_pointer, strict=True) if not out]
                outputs = self._expect(f"{name}({', '.join(plain)})")
                if outputs and isinstance(outputs[0], Returns):
                    return int(outputs[0])
                pointers = [a for a, out in zip(arguments, is_pointer, strict=True) if out]
                for pointer, value in zip(pointers, outputs, strict=True):
                    write(pointer, value)
            except Exception as error:
                self.wrong.append(f"{name}: {error!r}")
                return -99
            return 0

        return function


def write(pointer, value):
    if isinstance(value, str):
        memmove(pointer, value.encode() + b"\0", len(value) + 1)
    elif isinstance(value, bytes):
        memmove(pointer, value, len(value))
    elif isinstance(value, list):
        for i, number in enumerate(value):
            pointer[i] = number
    else:
        pointer[0] = value
