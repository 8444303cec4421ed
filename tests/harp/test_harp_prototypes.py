"""Prototypes and error names against the vendor's header, transcribed apart from driver and simulator."""

from ctypes import c_int

import pytest

from drivers.harp.errors import ErrorCode, HydraHarpError, code_name
from drivers.harp.library import PROTOTYPES
from simulators.wire.harp import HydraHarpSimulator
from support.harp_wire import C_TYPES, DECLARED, bench_with

EXPECTED = {name: tuple(C_TYPES[t] for t in types) for name, types in DECLARED.items()}


def test_driver_declares_the_header():
    assert len(EXPECTED) == 44
    assert PROTOTYPES == EXPECTED


def test_simulator_exports_the_header():
    functions = vars(HydraHarpSimulator(bench_with([], 0)).functions)
    assert {name: function.argtypes for name, function in functions.items()} == EXPECTED
    assert {function.restype for function in functions.values()} == {c_int}


@pytest.mark.parametrize("code", [1, 7, 2**31 - 1, -99, -12])
def test_a_code_outside_the_table_is_an_error_too(code):
    error = HydraHarpError("HydraHarp", "HH_StopMeas(0)", code)
    assert error.code == code
    assert error.code_name == "UNKNOWN"
    assert str(code) in str(error)


def test_error_tells_function_code_and_remedy():
    error = HydraHarpError("HydraHarp", "HH_OpenDevice(0)", -2)
    assert (error.function, error.code_name) == ("HH_OpenDevice(0)", "DEVICE_BUSY")
    assert "other program" in error.remedy


def test_no_code_is_left_without_a_name():
    assert [code_name(c) for c in (0, -1, -11, -16, -59, -64, -74)] == [
        "NONE",
        "DEVICE_OPEN_FAIL",
        "DEVICE_LOCKED",
        "INSTANCE_RUNNING",
        "MODFWVER_TOO_HIGH",
        "EEPROM_F01",
        "EEPROM_F11",
    ]
    assert len(ErrorCode) == 1 + 11 + 13 + 7 + 20 + 11
