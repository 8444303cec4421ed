"""What HHLib 3.0 answers without an instrument: held against the simulator, and against the vendor's library.

The vendor's library is used only where ``$HHLIB_PATH`` names it or an installation has it: it is licensed to
owners of the instrument. Nothing here opens an instrument that is connected, unless seven are.
"""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.harp.errors import ErrorCode, code_name
from drivers.harp.loading import PATH_VARIABLE, candidates, load_library
from simulators.wire.harp import HydraHarpSimulator
from support.harp_wire import C_TYPES, DECLARED, bench_with, call

#: No instrument is here. `CLOSED` is opened in vain before each test, `UNTOUCHED` never.
CLOSED, UNTOUCHED = 6, 7

NO_DEVICE_NEEDED = {"HH_GetLibraryVersion", "HH_GetErrorString", "HH_OpenDevice", "HH_CloseDevice"}

#: Valid arguments after the index, where zeros are not.
VALID = {
    "HH_SetSyncDiv": (1,),
    "HH_SetStopOverflow": (0, 1),
    "HH_StartMeas": (1,),
    "HH_ReadFiFo": (128,),
}

ARGUMENT_FIRST = [
    ("HH_Initialize", 1, 0),
    ("HH_Initialize", 5, 0),
    ("HH_SetSyncDiv", 32),
    ("HH_SetSyncCFD", 2000, 10),
    ("HH_SetHistoLen", 9),
    ("HH_SetOffset", -1),
    ("HH_ReadFiFo", 100),
    ("HH_ReadFiFo", 262144),
    ("HH_SetMeasControl", 99, 0, 0),
    ("HH_SetStopOverflow", 2, 0),
    ("HH_SetMarkerHoldoffTime", -1),
    ("HH_SetMarkerEdges", 2, 2, 2, 2),
    ("HH_SetInputCFD", -1, 100, 10),
    ("HH_SetInputCFD", 0, 1001, 10),
    ("HH_SetInputCFD", 0, 100, 41),
    ("HH_SetInputCFD", 0, -1, 10),
    ("HH_SetInputChannelOffset", -1, 0),
    ("HH_SetInputChannelOffset", 0, 100_000),
    ("HH_SetInputChannelOffset", 0, -100_000),
    ("HH_SetInputChannelEnable", -1, 0),
    ("HH_SetSyncChannelOffset", 100_000),
    ("HH_SetSyncChannelOffset", -100_000),
    ("HH_SetMarkerEnable", 2, 0, 0, 0),
    ("HH_SetMarkerEnable", 0, 0, 0, -1),
    ("HH_GetHistogram", -1, 0),
    ("HH_GetHistogram", 0, 2),
    ("HH_StartMeas", -1),
    ("HH_StartMeas", 360_000_001),
    ("HH_SetBinning", -1),
    ("HH_GetCountRate", -1),
    ("HH_GetWarningsText", -1),
]

STATE_FIRST = [
    ("HH_SetSyncDiv", 3),
    ("HH_SetInputCFD", 9, 100, 10),
    ("HH_SetBinning", 99),
    ("HH_StartMeas", 0),
    ("HH_GetHistogram", 9, 0),
    ("HH_Initialize", 0, 2),
    ("HH_Initialize", 0, -1),
    ("HH_GetWarningsText", 0),
    ("HH_SetInputChannelEnable", 0, 2),
    ("HH_SetInputChannelEnable", 9, 1),
    ("HH_SetInputChannelOffset", 9, 0),
    ("HH_GetCountRate", 9),
    ("HH_GetModuleInfo", -1),
    ("HH_GetModuleIndex", -1),
]

#: With the index 8 the vendor's library answers as it should, and from then on none of its functions can be
#: looked up (every later one is an undefined symbol): only in a process of its own.
DAMAGES = ("HH_Calibrate", 8)


VENDOR = next((path for path in candidates() if Path(path).is_file()), None)


@pytest.fixture(params=["simulator", "vendor"] if VENDOR else ["simulator"])
def functions(request):
    if request.param == "simulator":
        simulator = HydraHarpSimulator(bench_with([], 0))
        loaded = simulator.functions
    else:
        loaded = ctypes.CDLL(VENDOR)
        for name, types in DECLARED.items():
            getattr(loaded, name).argtypes = [C_TYPES[t] for t in types]
    call(loaded, "HH_OpenDevice", CLOSED)
    yield loaded
    if request.param == "simulator":
        simulator.raise_pending()


def arguments_for(name, index):
    """The index and valid further arguments."""
    zeros = [0] * (sum(not t.endswith("*") for t in DECLARED[name]) - 1)
    return index, *VALID.get(name, zeros)


@pytest.mark.skipif(
    VENDOR is None, reason=f"no vendor library: {PATH_VARIABLE} is not set, none is installed"
)
def test_vendor_library_is_found():
    assert load_library().get_library_version() == "3.0"


def test_version(functions):
    assert call(functions, "HH_GetLibraryVersion") == (0, b"3.0")


@pytest.mark.parametrize("code", [*ErrorCode, 1, 12345, -12, -75, -1000])
def test_error_string_is_the_name(functions, code):
    assert call(functions, "HH_GetErrorString", int(code)) == (0, f"HH_ERROR_{code_name(code)}".encode())


def test_open_without_instrument(functions):
    assert call(functions, "HH_OpenDevice", CLOSED) == (-1, b"")


@pytest.mark.parametrize("index", [CLOSED, UNTOUCHED])
def test_close_is_never_an_error(functions, index):
    assert call(functions, "HH_CloseDevice", index) == (0,)
    assert call(functions, "HH_CloseDevice", index) == (0,)


@pytest.mark.parametrize("name", [n for n, types in DECLARED.items() if types[0] == "int"])
@pytest.mark.parametrize("index", [-1, 8])
def test_index_out_of_range(functions, name, index):
    if (name, index) == DAMAGES and isinstance(functions, ctypes.CDLL):
        program = f"import ctypes; print(ctypes.CDLL({VENDOR!r}).{name}({index}))"
        ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
        assert ended.stdout.strip() == "-17"
        return
    assert call(functions, name, *arguments_for(name, index))[0] == -17


@pytest.mark.parametrize("name", sorted(set(DECLARED) - NO_DEVICE_NEEDED))
def test_after_an_open_in_vain(functions, name):
    assert call(functions, name, *arguments_for(name, CLOSED))[0] == -10


@pytest.mark.parametrize("name", sorted(set(DECLARED) - NO_DEVICE_NEEDED))
def test_before_any_open(functions, name):
    assert call(functions, name, *arguments_for(name, UNTOUCHED))[0] == -10


@pytest.mark.parametrize(("name", "arguments"), [(n, a) for n, *a in ARGUMENT_FIRST])
def test_arguments_checked_before_the_state(functions, name, arguments):
    assert call(functions, name, CLOSED, *arguments)[0] == -17


@pytest.mark.parametrize(("name", "arguments"), [(n, a) for n, *a in STATE_FIRST])
def test_state_checked_before_the_arguments(functions, name, arguments):
    assert call(functions, name, CLOSED, *arguments)[0] == -10
