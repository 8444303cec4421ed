"""The simulated library: an exception behind a C function is a negative code, and is not lost."""

import pytest

from simulators.wire.harp import HarpSimulator
from support.harp_opened import Opened
from support.harp_wire import bench_with, call, declared_by


class BrokenError(Exception):
    pass


class BrokenLight:
    def detections(self, *arguments):
        raise BrokenError("no photons today")

    def rate_hz(self, *arguments):
        raise BrokenError("no rate today")


def test_an_exception_is_a_negative_code_and_comes_out_later():
    bench = bench_with([], 0)
    bench.photons = (BrokenLight(),)
    hh = Opened(bench)
    hh("HH_StartMeas", 10)
    bench.clock.sleep(0.005)
    assert hh.code("HH_StopMeas") == -99
    with pytest.raises(BrokenError, match="no photons today"):
        hh.simulator.raise_pending()
    hh.simulator.raise_pending()  # once


def test_even_ctrl_c_is_kept():
    hh = Opened(bench_with([], 0))

    def interrupted():
        raise KeyboardInterrupt

    hh.bench.clock.now_s = interrupted
    assert hh.code("HH_GetSyncRate") == -99
    with pytest.raises(KeyboardInterrupt):
        hh.simulator.raise_pending()


def test_a_null_pointer_is_an_exception_and_no_crash():
    hh = Opened(bench_with([], 0))
    assert hh.simulator.functions.HH_GetFeatures(0, None) == -99
    with pytest.raises(ValueError, match="NULL"):
        hh.simulator.raise_pending()


def test_functions_outlive_the_simulator():
    functions = HarpSimulator(bench_with([], 0)).functions
    assert call(functions, "HH_GetLibraryVersion") == (0, b"3.0")
    assert set(vars(functions)) == set(declared_by("HH"))


@pytest.mark.parametrize("wrong", [{"serial": "12345678"}, {"inputs": 2}])
def test_impossible_instruments(wrong):
    with pytest.raises(ValueError, match=r"7 characters|connected to input 2"):
        HarpSimulator(bench_with([], 0, at_input=2), **wrong)
