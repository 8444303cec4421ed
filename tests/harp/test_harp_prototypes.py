"""Prototypes and error names against the vendor's headers, transcribed apart from driver and simulator."""

from ctypes import c_int

import pytest

from drivers.harp.errors import HarpError
from drivers.harp.families import FAMILIES, HYDRAHARP_400
from drivers.harp.library import prototypes
from simulators.wire.harp import FAMILIES as SIMULATED
from simulators.wire.harp import HarpSimulator
from support.harp_wire import C_TYPES, bench_with, declared_by

#: Continuous mode and modules: simulated for whoever takes all 44, and not used by the driver.
HYDRAHARP_FUNCTIONS = 44


def expected(prefix):
    return {name: tuple(C_TYPES[t] for t in types) for name, types in declared_by(prefix).items()}


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_driver_declares_what_it_calls_as_the_header_does(family):
    header = expected(family.prefix)
    calls = {f"{family.prefix}_{name}": types for name, types in prototypes(family).items()}
    assert calls == {name: header.get(name) for name in calls}


@pytest.mark.parametrize("kind", SIMULATED)
def test_simulator_exports_the_header(kind):
    functions = vars(HarpSimulator(bench_with([], 0), SIMULATED[kind]).functions)
    assert {name: function.argtypes for name, function in functions.items()} == expected(
        SIMULATED[kind].prefix
    )
    assert {function.restype for function in functions.values()} == {c_int}


def test_the_hydraharp_has_all_its_functions():
    assert len(expected("HH")) == HYDRAHARP_FUNCTIONS


@pytest.mark.parametrize("kind", SIMULATED)
def test_driver_and_simulator_name_the_codes_alike(kind):
    """They were transcribed apart."""
    simulated = SIMULATED[kind]
    (family, *_) = (one for one in FAMILIES if one.prefix == simulated.prefix)
    assert dict(family.errors) == dict(simulated.errors)


@pytest.mark.parametrize("code", [1, 7, 2**31 - 1, -99, -12])
def test_a_code_outside_the_table_is_an_error_too(code):
    error = HarpError(HYDRAHARP_400, "HydraHarp", "HH_StopMeas(0)", code)
    assert error.code == code
    assert error.code_name == "UNKNOWN"
    assert str(code) in str(error)


def test_error_tells_function_code_and_remedy():
    error = HarpError(HYDRAHARP_400, "HydraHarp", "HH_OpenDevice(0)", -2)
    assert (error.function, error.code_name) == ("HH_OpenDevice(0)", "DEVICE_BUSY")
    assert "other program" in error.remedy


def test_no_code_is_left_without_a_name():
    assert [HYDRAHARP_400.error_name(c) for c in (0, -1, -11, -16, -59, -64, -74, -75)] == [
        "NONE",
        "DEVICE_OPEN_FAIL",
        "DEVICE_LOCKED",
        "INSTANCE_RUNNING",
        "MODFWVER_TOO_HIGH",
        "EEPROM_F01",
        "EEPROM_F11",
        "UNKNOWN",
    ]
    assert len(HYDRAHARP_400.errors) == 1 + 11 + 13 + 7 + 20 + 11


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_every_remedy_is_a_whole_sentence(family):
    for code in (*family.errors, 12345):
        remedy = HarpError(family, family.name, "X_StopMeas(0)", code).remedy
        assert remedy[0].isupper()
        assert remedy.endswith(".")
        assert "{" not in remedy
