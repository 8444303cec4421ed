"""What the driver refuses before anything is sent, and without an instrument or a library."""

import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LimitError
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.settings import HarpSettings
from drivers.harp.triggers import CfdTrigger

LIMITS = HYDRAHARP_400.limits


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"sync_divider": 3}, "divide the sync by 3"),
        ({"sync_trigger": CfdTrigger(1.001, 0.01)}, "sync CFD level to 1001 mV"),
        ({"sync_trigger": CfdTrigger(0.0504, 0.01)}, "nearest possible value is 50 mV"),
        ({"sync_trigger": CfdTrigger(0.05, 0.041)}, "sync CFD zero crossing"),
        ({"input_trigger": CfdTrigger(-0.1, 0.01)}, "input CFD level"),
        ({"inputs": (0, -1)}, "input channel"),
        ({"inputs": ()}, "one input or more"),
        ({"inputs": (1, 1)}, "inputs 1, 1"),
        ({"sync_offset_s": 100e-9}, "99999 ps"),
        ({"input_offsets_s": (0.5e-12,)}, "whole ps"),
        ({"inputs": (0, 1), "input_offsets_s": (1e-12,)}, "one offset for each input"),
        ({"bin_width_s": 5e-12}, "4 ps and 8 ps"),
        ({"offset_s": 1.4e-9}, "nearest possible value is 1 ns"),
        ({"offset_s": -1e-9}, "nearest possible value is 0 ns"),
        ({"offset_s": 500.001e-6}, "nearest possible value is 500000 ns"),
        ({"bins": 0}, "number of bins"),
        ({"bins": 65537}, "number of bins"),
    ],
)
def test_settings_outside_the_limits(settings, words):
    with pytest.raises(LimitError, match=words):
        HarpSettings(family=HYDRAHARP_400, **settings)


def test_limits_and_settings_import_neither_numpy_nor_a_wire():
    script = "import sys, drivers.harp.limits, drivers.harp.families, drivers.harp.settings; "
    script += "print([m for m in ('numpy', 'ctypes', 'serial', 'usb') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


@given(n=st.integers(0, 25), base_ps=st.sampled_from([1.0, 4.0, 0.5]))
def test_every_power_of_two_has_its_code(n, base_ps):
    assert replace(LIMITS, base_ps=base_ps).binning_code(base_ps * 2**n * 1e-12) == n


@given(st.floats(0.6, 3e7))
def test_other_widths_are_refused_with_their_neighbours(width_ps):
    lower = max(n for n in range(26) if n == 0 or 2.0**n <= width_ps)
    if abs(width_ps / 2.0**lower - 1) < 2e-6 or abs(width_ps / 2.0 ** (lower + 1) - 1) < 2e-6:
        return
    with pytest.raises(LimitError) as caught:
        LIMITS.check_histogram(1, width_ps * 1e-12)
    assert f"nearest are {2.0**lower:g} ps and {2.0 ** (lower + 1):g} ps" in str(caught.value)


@pytest.mark.parametrize("width_s", [0.0, -4e-12, 1.0, float("inf"), float("nan")])
def test_widths_beyond_all_codes(width_s):
    with pytest.raises(LimitError, match="nearest are"):
        LIMITS.binning_code(width_s)


@given(span_s=st.floats(1e-12, 2.0), finest_s=st.sampled_from([0.0, 64e-12]))
def test_the_finest_bins_that_cover_a_span(span_s, finest_s):
    width_s = LIMITS.bin_width_covering(span_s, finest_s=finest_s)
    LIMITS.check_histogram(65536, width_s)
    assert width_s * 65536 >= span_s * (1 - 1e-5)
    finer_s = width_s / 2
    assert finer_s < finest_s or width_s == pytest.approx(1e-12) or finer_s * 65536 < span_s


def test_a_span_that_no_bins_cover():
    assert LIMITS.bin_width_covering(2.1) * 65536 == pytest.approx(2.2, rel=1e-2)
    with pytest.raises(LimitError, match=r"cover 2\.3 s"):
        LIMITS.bin_width_covering(2.3)


@given(bins=st.integers(1, 65536))
def test_length_is_the_shortest_that_holds_the_bins(bins):
    lengths = [1024 * 2**n for n in range(7)]
    assert lengths[LIMITS.length_code(bins)] == min(n for n in lengths if n >= bins)


@given(st.integers(1, 360_000_000))
def test_whole_milliseconds_pass(ms):
    assert LIMITS.exposure_ms(ms * 1e-3) == ms
    assert LIMITS.exposure_ms(ms / 1000) == ms
    assert LIMITS.nearest_exposure_s(ms * 1e-3) == ms / 1000


@pytest.mark.parametrize(
    ("exposure_s", "nearest"),
    [(0.0, 1), (0.4e-3, 1), (1.4e-3, 1), (2.6e-3, 3), (-1.0, 1), (4e5, 360_000_000), (1e9, 360_000_000)],
)
def test_other_exposures_name_the_nearest(exposure_s, nearest):
    with pytest.raises(LimitError, match=f"nearest possible value is {nearest} ms"):
        LIMITS.check_exposure(exposure_s)
    assert LIMITS.nearest_exposure_s(exposure_s) == nearest / 1000


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(LimitError):
        LIMITS.check_exposure(value)
