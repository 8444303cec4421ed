"""What the driver refuses before anything is sent."""

import pytest
from hydraharp_wire import Script
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LimitError
from drivers.hydraharp import HHLib, HydraHarp
from drivers.hydraharp.limits import binning_code, length_code, whole


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"sync_divider": 3}, "divide the sync by 3"),
        ({"sync_cfd_mv": (1001, 10)}, "sync CFD level"),
        ({"sync_cfd_mv": (100, 41)}, "sync CFD zero crossing"),
        ({"input_cfd_mv": (-100, 10)}, "input CFD level"),
        ({"input_channel": 8}, "input channel"),
        ({"sync_offset_s": 100e-9}, "99999 ps"),
        ({"input_offset_s": 0.5e-12}, "whole ps"),
        ({"offset_s": 1.4e-9}, "nearest possible value is 1 ns"),
        ({"offset_s": -1e-9}, "nearest possible value is 0 ns"),
        ({"offset_s": 500.001e-6}, "nearest possible value is 500000 ns"),
        ({"bins": 0}, "number of bins"),
        ({"bins": 65537}, "number of bins"),
        ({"stop_overflow": 0}, "stops a measurement"),
        ({"stop_overflow": 2**32}, "stops a measurement"),
    ],
)
def test_settings_outside_the_limits(settings, words):
    script = Script([])
    with pytest.raises(LimitError, match=words):
        HydraHarp(HHLib(script.functions), clock=script, **settings)
    script.finish()


@given(n=st.integers(0, 25), base_ps=st.sampled_from([1.0, 4.0, 0.5]))
def test_every_power_of_two_has_its_code(n, base_ps):
    assert binning_code("it", base_ps * 2**n * 1e-12, base_ps, 26) == n


@given(st.floats(0.6, 3e7))
def test_other_widths_are_refused_with_their_neighbours(width_ps):
    lower = max(n for n in range(26) if n == 0 or 2.0**n <= width_ps)
    if abs(width_ps / 2.0**lower - 1) < 2e-6 or abs(width_ps / 2.0 ** (lower + 1) - 1) < 2e-6:
        return
    with pytest.raises(LimitError) as caught:
        binning_code("it", width_ps * 1e-12, 1.0, 26)
    assert f"nearest are {2.0**lower:g} ps and {2.0 ** (lower + 1):g} ps" in str(caught.value)


@pytest.mark.parametrize("width_s", [0.0, -4e-12, 1.0, float("inf"), float("nan")])
def test_widths_beyond_all_codes(width_s):
    with pytest.raises(LimitError, match="nearest are"):
        binning_code("it", width_s, 1.0, 26)


@given(bins=st.integers(1, 65536), span_bins=st.integers(0, 200_000))
def test_length_is_the_shortest_that_holds_bins_and_span(bins, span_bins):
    code = length_code(bins, span_bins * 4e-12, 4e-12)
    lengths = [1024 * 2**n for n in range(7)]
    assert lengths[code] == min(n for n in lengths if n >= max(bins, min(span_bins, 65536)))


@given(st.integers(1, 360_000_000))
def test_whole_milliseconds_pass(ms):
    assert whole("it", "exposure", ms * 1e-3, 1e-3, "ms", (1, 360_000_000)) == ms
    assert whole("it", "exposure", ms / 1000, 1e-3, "ms", (1, 360_000_000)) == ms


@pytest.mark.parametrize(
    ("exposure_s", "nearest"),
    [(0.0, 1), (0.4e-3, 1), (1.4e-3, 1), (2.6e-3, 3), (-1.0, 1), (4e5, 360_000_000), (1e9, 360_000_000)],
)
def test_other_exposures_name_the_nearest(exposure_s, nearest):
    with pytest.raises(LimitError, match=f"nearest possible value is {nearest} ms"):
        whole("it", "exposure", exposure_s, 1e-3, "ms", (1, 360_000_000))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(LimitError):
        whole("it", "exposure", value, 1e-3, "ms", (1, 10))
