"""Quantities at the border: read with a unit or refused, and written back readably."""

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.errors import UsageError
from rig.model.quantities import KINDS, USUAL, _in_any_unit, parse, show, show_duration, show_length


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("10ms", "time", 0.01),
        ("10 us", "time", 1e-5),
        ("10µs", "time", 1e-5),
        ("4ps", "time", 4e-12),
        ("1e-3s", "time", 1e-3),
        (".5 m", "length", 0.5),
        ("-4cm", "length", -0.04),
        ("10MHz", "frequency", 1e7),
        ("180deg", "angle", 3.14159265358979),
        ("50mV", "voltage", 0.05),
        ("2GB", "memory", 2e9),
    ],
)
def test_reads_a_number_with_its_unit(text, kind, value):
    assert parse(text, kind) == value


@pytest.mark.parametrize(("kind", "symbol"), [(kind, symbol) for kind in USUAL for symbol in USUAL[kind]])
@given(st.decimals(-9999, 9999, places=3))
def test_usual_units_are_those_of_the_library_of_units(kind, symbol, number):
    text = f"{number}{symbol}"
    by_library = _in_any_unit(text, float(number), symbol, kind)
    assert parse(text, kind) == float(f"{by_library:.15g}")


def test_usual_quantities_do_not_wait_for_the_library_of_units():
    script = "import sys; from rig.model.config import built_in; built_in(); print('pint' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("False\n", "")


@pytest.mark.parametrize(
    ("text", "kind", "told"),
    [
        ("10", "time", "10ms"),
        ("10mm", "time", "not a time"),
        ("4", "length", "4cm"),
        ("fast", "time", "10ms"),
        ("10 parsnips", "length", "unknown unit 'parsnips'"),
        ("0:", "angle", "unknown unit ':'"),
        ("", "time", "10ms"),
        ("10ms extra", "time", "unit"),
        ("nan s", "time", "10ms"),
        ("10ms*2", "time", "unit"),
    ],
)
def test_refuses_and_shows_the_right_spelling(text, kind, told):
    with pytest.raises(UsageError, match=told.replace("(", r"\(")):
        parse(text, kind)


@given(st.text(max_size=20), st.sampled_from(sorted(KINDS)))
def test_any_text_is_read_or_refused_in_words(text, kind):
    told = ""
    try:
        value = parse(text, kind)
    except UsageError as error:
        told = str(error)
    assert "write" in told if told else isinstance(value, float)


@given(st.floats(1e-12, 1e9), st.sampled_from(["s", "m", "Hz"]))
def test_what_is_shown_reads_back(value, unit):
    kind = {"s": "time", "m": "length", "Hz": "frequency"}[unit]
    # three digits are shown: half a unit of the third digit is at most 0.5 percent
    assert parse(show(value, unit), kind) == pytest.approx(value, rel=5.01e-3)


def test_writes_as_a_person_would():
    assert show(0.01, "s") == "10 ms"
    assert show(0.99999, "s") == "1 s"
    assert show(205_000, "photons/s") == "205 kphotons/s"
    assert show_length(0.04) == "4 cm"
    assert show_length(1.3) == "1.3 m"
    assert show_length(999.9) == "1 km"
    assert show_length(-0.009999) == "-1 cm"
    assert show_length(1.5e7) == "15,000 km"
    assert show_length(0.0) == "0 mm"
    assert show_duration(252) == "4 min 12 s"
    assert show_duration(3700) == "1 h 01 min"
    assert show_duration(1e300) == "1e+300 s"
    assert show_duration(float("inf")) == "inf s"
