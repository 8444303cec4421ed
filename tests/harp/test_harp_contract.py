"""What the libraries answer without an instrument: held against the simulators, and against the vendor's own.

The vendor's libraries are used only where ``$HHLIB_PATH``, ``$MHLIB_PATH``, ``$PH330LIB_PATH``,
``$TH260LIB_PATH`` or ``$HH500LIB_PATH`` names one, or an installation has it: they are licensed to owners of
an instrument. Nothing here opens an instrument that is connected, unless all but two of the indices are.

What may end a process is called in one of its own: an index out of range lets some of the libraries abort.
"""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.harp.families import FAMILIES
from drivers.harp.loading import candidates, load_library
from simulators.wire.harp import FAMILIES as SIMULATED
from simulators.wire.harp import HarpSimulator
from support.harp_wire import C_TYPES, bench_with, call, declared_by

KINDS = ("hydraharp", "multiharp", "picoharp330", "timeharp260p", "hydraharp500")
FAMILY = {kind: next(f for f in FAMILIES if f.prefix == SIMULATED[kind].prefix) for kind in KINDS}
VENDOR = {kind: next((p for p in candidates(FAMILY[kind]) if Path(p).is_file()), None) for kind in KINDS}

#: Where no instrument is. `CLOSED` is opened in vain before each test, `UNTOUCHED` never.
CLOSED, UNTOUCHED = 2, 3

NO_DEVICE_NEEDED = ("GetLibraryVersion", "GetErrorString", "OpenDevice", "CloseDevice")

#: Valid arguments after the index, where zeros are not.
VALID = {"SetSyncDiv": (1,), "SetStopOverflow": (0, 1), "StartMeas": (1,)}

#: Functions and arguments that are refused before the state is looked at, and the place of the wrong one.
ARGUMENT_FIRST = {
    "all": [
        ("SetSyncDiv", (0,), 2),
        ("SetSyncDiv", (32,), 2),
        ("SetSyncChannelOffset", (100_000,), 2),
        ("SetSyncChannelOffset", (-100_000,), 2),
        ("SetInputChannelOffset", (0, 100_000), 3),
        ("SetInputChannelOffset", (0, -100_000), 3),
        ("SetStopOverflow", (2, 0), 2),
        ("SetStopOverflow", (0, 0), 3),
        ("SetBinning", (-1,), 2),
        ("SetOffset", (-1,), 2),
        ("SetHistoLen", (10,), 2),
        ("SetHistoLen", (-1,), 2),
        ("SetMeasControl", (99, 0, 0), 2),
        ("SetMeasControl", (0, 2, 0), 3),
        ("SetMeasControl", (0, 0, 2), 4),
        ("StartMeas", (-1,), 2),
        ("StartMeas", (360_000_001,), 2),
        ("GetCountRate", (-1,), 2),
        ("GetWarningsText", (-1,), 3),
        ("SetMarkerHoldoffTime", (-1,), 2),
        ("SetMarkerHoldoffTime", (524_297,), 2),
        ("SetMarkerEdges", (2, 0, 0, 0), 2),
        ("SetMarkerEdges", (0, 0, 0, 2), 5),
        ("SetMarkerEnable", (2, 0, 0, 0), 2),
        ("SetMarkerEnable", (0, 0, 0, -1), 5),
    ],
    "hydraharp": [
        ("Initialize", (1, 0), 2),
        ("Initialize", (5, 0), 2),
        ("SetSyncCFD", (2000, 10), 2),
        ("SetInputCFD", (-1, 100, 10), 2),
        ("SetInputCFD", (0, 1001, 10), 3),
        ("SetInputCFD", (0, 100, 41), 4),
        ("SetInputCFD", (0, -1, 10), 3),
        ("SetInputChannelOffset", (-1, 0), 2),
        ("SetInputChannelEnable", (-1, 0), 2),
        ("SetOffset", (500_001,), 2),
        ("SetHistoLen", (7,), 2),
        ("SetMeasControl", (7, 0, 0), 2),
        ("GetHistogram", (-1, 0), 3),
        ("GetHistogram", (0, 2), 4),
        ("ReadFiFo", (0,), 3),
        ("ReadFiFo", (100,), 3),
        ("ReadFiFo", (262_144,), 3),
    ],
    "multiharp": [
        ("Initialize", (1, 0), 2),
        ("Initialize", (0, -1), 3),
        ("Initialize", (0, 10), 3),
        ("SetSyncEdgeTrg", (-1201, 0), 2),
        ("SetSyncEdgeTrg", (1201, 0), 2),
        ("SetSyncEdgeTrg", (0, 2), 3),
        ("SetInputEdgeTrg", (0, -1201, 0), 3),
        ("SetInputEdgeTrg", (0, 0, 2), 4),
        ("SetInputChannelEnable", (0, 2), 3),
        ("SetOffset", (100_000_001,), 2),
        ("SetHistoLen", (7,), 2),
        ("SetMeasControl", (7, 0, 0), 2),
        ("SetMarkerHoldoffTime", (25_501,), 2),
        ("GetHistogram", (-1,), 2),
    ],
    "picoharp330": [
        ("Initialize", (8, 0), 2),
        ("Initialize", (0, 4), 3),
        ("SetSyncDiv", (16,), 2),
        ("SetSyncTrgMode", (2,), 2),
        ("SetSyncEdgeTrg", (-1501, 0), 2),
        ("SetSyncEdgeTrg", (1501, 0), 2),
        ("SetSyncEdgeTrg", (0, -1), 3),
        ("SetSyncCFD", (1, 0), 2),
        ("SetSyncCFD", (-1501, 0), 2),
        ("SetSyncCFD", (-50, -101), 3),
        ("SetSyncCFD", (-50, 1), 3),
        ("SetInputTrgMode", (-1, 0), 2),
        ("SetInputTrgMode", (0, 2), 3),
        ("SetInputEdgeTrg", (-1, 0, 0), 2),
        ("SetInputEdgeTrg", (0, 1501, 0), 3),
        ("SetInputCFD", (-1, 0, 0), 2),
        ("SetInputCFD", (0, 1, 0), 3),
        ("SetInputCFD", (0, 0, -101), 4),
        ("SetInputChannelOffset", (-1, 0), 2),
        ("SetInputChannelEnable", (-1, 1), 2),
        ("SetInputChannelEnable", (0, 2), 3),
        ("SetOffset", (100_000_001,), 2),
        ("SetMarkerHoldoffTime", (25_501,), 2),
        ("GetHistogram", (-1,), 3),
    ],
    "timeharp260p": [
        ("Initialize", (1,), 2),
        ("SetSyncDiv", (16,), 2),
        ("SetSyncEdgeTrg", (-1201, 0), 2),
        ("SetSyncEdgeTrg", (1201, 0), 2),
        ("SetSyncCFD", (-1201, 0), 2),
        ("SetSyncCFD", (1, 0), 2),
        ("SetSyncCFD", (-50, -41), 3),
        ("SetSyncCFD", (-50, 1), 3),
        ("SetInputEdgeTrg", (-1, 0, 0), 2),
        ("SetInputEdgeTrg", (0, 0, 2), 4),
        ("SetInputCFD", (-1, 0, 0), 2),
        ("SetInputCFD", (0, 1, 0), 3),
        ("SetInputChannelOffset", (-1, 0), 2),
        ("SetInputChannelEnable", (-1, 1), 2),
        ("SetOffset", (100_000_001,), 2),
        ("SetHistoLen", (6,), 2),
        ("SetMarkerHoldoffTime", (25_501,), 2),
        ("GetHistogram", (-1, 0), 3),
        ("GetHistogram", (0, 2), 4),
        ("ReadFiFo", (100,), 3),
        ("ReadFiFo", (262_144,), 3),
    ],
    "hydraharp500": [
        ("Initialize", (1, 0), 2),
        ("Initialize", (0, 10), 3),
        ("SetSyncDiv", (17,), 2),
        ("SetSyncTrgMode", (2,), 2),
        ("SetSyncEdgeTrg", (-1201, 0), 2),
        ("SetSyncEdgeTrg", (1201, 0), 2),
        ("SetSyncCFD", (-1201, 0), 2),
        ("SetSyncCFD", (1, 0), 2),
        ("SetSyncCFD", (-50, -101), 3),
        ("SetInputTrgMode", (0, 2), 3),
        ("SetInputEdgeTrg", (0, 1201, 0), 3),
        ("SetInputCFD", (0, 0, 1), 4),
        ("SetInputChannelEnable", (0, 2), 3),
        ("SetOffset", (100_000_001,), 2),
        ("SetHistoLen", (8,), 2),
        ("SetMarkerHoldoffTime", (25_501,), 2),
        ("GetHistogram", (-1,), 2),
    ],
}

#: The other way round: the missing instrument is told first.
STATE_FIRST = {
    "all": [
        ("SetSyncDiv", (3,)),
        ("SetBinning", (99,)),
        ("StartMeas", (0,)),
        ("SetInputChannelEnable", (9, 1)),
        ("SetInputChannelOffset", (9, 0)),
        ("GetCountRate", (9,)),
    ],
    "hydraharp": [
        ("SetInputCFD", (9, 100, 10)),
        ("GetHistogram", (9, 0)),
        ("Initialize", (0, 2)),
        ("Initialize", (0, -1)),
        ("GetWarningsText", (0,)),
        ("SetInputChannelEnable", (0, 2)),
        ("GetModuleInfo", (-1,)),
        ("GetModuleIndex", (-1,)),
    ],
    "multiharp": [
        ("SetInputEdgeTrg", (-1, -50, 0)),
        ("SetInputChannelOffset", (-1, 0)),
        ("SetInputChannelEnable", (-1, 1)),
        ("GetHistogram", (9,)),
        ("Initialize", (8, 9)),
        ("GetWarningsText", (0,)),
    ],
    "picoharp330": [("SetInputEdgeTrg", (9, -50, 0)), ("GetHistogram", (9,)), ("Initialize", (0, 3))],
    "timeharp260p": [
        ("SetInputCFD", (9, -50, -10)),
        ("GetHistogram", (9, 0)),
        ("Initialize", (8,)),
        ("GetWarningsText", (0,)),
        ("SetInputChannelEnable", (0, 2)),
    ],
    "hydraharp500": [
        ("SetInputEdgeTrg", (-1, -50, 0)),
        ("SetInputCFD", (-1, -50, -10)),
        ("SetInputTrgMode", (-1, 0)),
        ("GetHistogram", (9,)),
    ],
}

#: Libraries answer these in another way than all other functions; nobody can need them there.
UNLIKE_OTHERS = {
    "HH_GetFeatures",
    "HH_GetHardwareDebugInfo",
    "MH_GetFeatures",
    "PH330_GetFeatures",
    "HH500_GetFeatures",
    "TH260_GetHardwareDebugInfo",
    "MH_GetDebugInfo",
    "PH330_GetDebugInfo",
    "HH500_GetDebugInfo",
    "MH_GetWarningsText",
    "PH330_GetWarningsText",
    "HH500_GetWarningsText",
}

#: With an index out of range these may end the process, or (HH_Calibrate) leave a library of which no
#: function can be looked up any more: only in a process of its own.
MAY_ABORT = ("OpenDevice", "Initialize", "Calibrate")
ABORTS = {("MH_OpenDevice", -1), ("MH_OpenDevice", 8), ("HH500_OpenDevice", -1), ("HH500_OpenDevice", 8)}
ABORTS |= {("TH260_Initialize", -1)}

SIDES = [(kind, "simulator") for kind in KINDS] + [(kind, "vendor") for kind in KINDS if VENDOR[kind]]


class Library:
    """The functions of one library, simulated or the vendor's, called without their prefix."""

    def __init__(self, kind, side):
        self.kind, self.is_vendors, self.prefix = kind, side == "vendor", FAMILY[kind].prefix
        self.declared = declared_by(self.prefix)
        self.simulator = None if self.is_vendors else HarpSimulator(bench_with([], 0), SIMULATED[kind])
        self.functions = ctypes.CDLL(VENDOR[kind]) if self.is_vendors else self.simulator.functions
        if self.is_vendors:
            for name, types in self.declared.items():
                getattr(self.functions, name).argtypes = [C_TYPES[t] for t in types]

    def __call__(self, name, *arguments):
        return call(self.functions, f"{self.prefix}_{name}", *arguments)

    def wrong(self, place):
        """The answer to a wrong argument at a place."""
        return -200 - place if self.prefix in ("MH", "PH330", "HH500") else -17

    def valid(self, name, index):
        """The index and valid further arguments."""
        if name == "ReadFiFo" and "int" in self.declared[f"{self.prefix}_ReadFiFo"][1:]:
            return index, 128
        types = self.declared[f"{self.prefix}_{name}"]
        return index, *VALID.get(name, [0] * (sum(not t.endswith("*") for t in types) - 1))


@pytest.fixture(params=SIDES, ids=lambda one: "-".join(one))
def library(request):
    loaded = Library(*request.param)
    loaded("OpenDevice", CLOSED)
    yield loaded
    if loaded.simulator is not None:
        loaded.simulator.raise_pending()


@pytest.mark.parametrize("kind", KINDS)
def test_vendor_library_is_found(kind):
    if VENDOR[kind] is None:
        pytest.skip(f"no vendor library: {FAMILY[kind].files.variable} is not set, none is installed")
    assert load_library(FAMILY[kind]).get_library_version() in FAMILY[kind].versions


def test_version(library):
    assert library("GetLibraryVersion") == (0, SIMULATED[library.kind].version.encode())


def test_error_strings_are_the_names(library):
    family = FAMILY[library.kind]
    for code in (*family.errors, 1, 12345, -13, -1000):
        name = f"{family.prefix}_ERROR_{family.error_name(code)}"
        if family.prefix == "TH260" and code not in family.errors:
            name = "Unknown Error"
        assert library("GetErrorString", code) == (0, name.encode())


def test_open_without_instrument(library):
    assert library("OpenDevice", CLOSED) == (-1, b"")


@pytest.mark.parametrize("index", [CLOSED, UNTOUCHED])
def test_close_is_never_an_error(library, index):
    assert library("CloseDevice", index) == (0,)
    assert library("CloseDevice", index) == (0,)


@pytest.mark.parametrize("index", [-1, 8])
def test_index_out_of_range(library, index):
    for name in (full.removeprefix(f"{library.prefix}_") for full in library.declared):
        if name in ("GetLibraryVersion", "GetErrorString"):
            continue
        if library.is_vendors and name in MAY_ABORT:
            expected = [] if (f"{library.prefix}_{name}", index) in ABORTS else [library.wrong(1)]
            assert answers_alone(library, [name], index) == expected, name
            continue
        if library.is_vendors and f"{library.prefix}_{name}" in UNLIKE_OTHERS:
            continue
        assert library(name, *library.valid(name, index))[0] == library.wrong(1), name


def answers_alone(library, names, index):
    """What functions of the vendor answer in a process of their own, until one ends it."""
    calls = []
    for name in names:
        plain = iter(library.valid(name, index))
        types = library.declared[f"{library.prefix}_{name}"]
        arguments = ", ".join("room" if t.endswith("*") else str(next(plain)) for t in types)
        calls.append(f"print(library.{library.prefix}_{name}({arguments}), flush=True)")
    program = "import ctypes; room = ctypes.create_string_buffer(1 << 22)\n"
    program += "\n".join([f"library = ctypes.CDLL({VENDOR[library.kind]!r})", *calls])
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    return [int(line) for line in ended.stdout.split()]


def test_after_an_open_in_vain(library):
    for full in library.declared:
        name = full.removeprefix(f"{library.prefix}_")
        if name not in NO_DEVICE_NEEDED and full not in UNLIKE_OTHERS:
            assert library(name, *library.valid(name, CLOSED))[0] == -10, name


def test_at_an_index_that_was_never_opened(library):
    for full in library.declared:
        name = full.removeprefix(f"{library.prefix}_")
        if name not in NO_DEVICE_NEEDED and full not in UNLIKE_OTHERS:
            assert library(name, *library.valid(name, UNTOUCHED))[0] == -10, name


@pytest.mark.parametrize(("kind", "side"), SIDES)
def test_before_anything_was_opened(kind, side):
    """Until the first OpenDevice, whatever its index, the libraries answer otherwise."""
    library = Library(kind, side)
    bare = [full.removeprefix(f"{library.prefix}_") for full in library.declared]
    names = [n for n in bare if n not in NO_DEVICE_NEEDED and f"{library.prefix}_{n}" not in UNLIKE_OTHERS]
    if library.is_vendors:
        answers = answers_alone(library, names, CLOSED)
    else:
        answers = [library(name, *library.valid(name, CLOSED))[0] for name in names]
    assert answers == [-20] * len(names)


def test_arguments_checked_before_the_state(library):
    for name, arguments, place in ARGUMENT_FIRST["all"] + ARGUMENT_FIRST[library.kind]:
        assert library(name, CLOSED, *arguments)[0] == library.wrong(place), (name, arguments)


def test_state_checked_before_the_arguments(library):
    for name, arguments in STATE_FIRST["all"] + STATE_FIRST[library.kind]:
        assert library(name, CLOSED, *arguments)[0] == -10, (name, arguments)
