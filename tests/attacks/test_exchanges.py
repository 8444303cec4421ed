"""A short pass of faults at exchanges with devices: at the end it is dark, closed, told and right."""

from collections import Counter

import pytest

from attacks.exchanges import FAULTS, Attacked, Outcome
from attacks.taps import Fault

#: Each fault at five exchanges of a scan, at others than the fault before: together at seventy.
EVERY, NEXT = 199, 11

#: Calls that say that all is well and do nothing, and leave no trace: a clock's or an offset's setting that
#: cannot be read back.
WITHOUT_A_TRACE = {"HH_SetOffset", "HH_StopMeas"}


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    return Attacked(tmp_path_factory.mktemp("exchanges"))


def lies(one: Outcome) -> bool:
    """Return whether an instrument lied without a trace."""
    return one.struck[1] in WITHOUT_A_TRACE


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_at_any_exchange(attacked, name):
    fault = FAULTS[name]
    silent = fault.kind in ("drop", "flip")
    for one in attacked.outcomes(fault, EVERY, NEXT * list(FAULTS).index(name)):
        assert one.told, one
        if not fault.lasting:
            assert not one.end.emitting, one
            assert not one.end.sensitive, one
        assert one.end.code in ((130,) if fault.kind == "interrupt" else (0, 3, 4)), one
        assert one.file != "unreadable", one
        if not (silent and lies(one)):
            assert one.wrong == 0, one
            assert one.resumed == "equal", one


@pytest.fixture(scope="module", params=["katana-08hp", "nkt"])
def other_laser(request, tmp_path_factory):
    return Attacked(tmp_path_factory.mktemp("lasers"), request.param)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_at_any_exchange_with_another_laser(other_laser, name):
    at = [number for number, (device, _) in enumerate(other_laser.exchanges) if device == "laser"]
    for number in at[NEXT * list(FAULTS).index(name) :: EVERY]:
        one = other_laser.outcome(FAULTS[name], number)
        assert one.told, one
        assert FAULTS[name].lasting or not one.end.emitting, one
        assert one.end.code in ((130,) if FAULTS[name].kind == "interrupt" else (0, 3, 4)), one
        assert one.wrong == 0, one
        assert one.resumed == "equal", one


def test_faults_reach_all_wires(attacked):
    devices = Counter(device for device, _ in attacked.exchanges)
    assert set(devices) == {"galvo", "laser", "spad", "delayer", "tcspc"}
    assert min(devices.values()) > 50


@pytest.mark.parametrize("operation", ["HH_GetHistogram", "HH_StartMeas"])
def test_a_library_that_says_all_is_well_and_does_nothing_is_found_out(attacked, operation):
    at = [number for number, (_, name) in enumerate(attacked.exchanges) if name == operation]
    one = attacked.outcome(Fault("drop"), at[5])
    assert one.end.code in (3, 4), one
    assert one.wrong == 0
    assert one.resumed == "equal"


def test_a_histogram_that_was_not_cleared_has_no_older_counts(attacked):
    """It was cleared when it was read."""
    at = [number for number, (_, name) in enumerate(attacked.exchanges) if name == "HH_ClearHistMem"]
    for number in at[2:5]:
        one = attacked.outcome(Fault("drop"), number)
        assert (one.end.code, one.wrong, one.resumed) == (0, 0, "equal"), one


@pytest.mark.parametrize("device", ["spad", "delayer"])
def test_a_garbled_command_does_not_leave_the_gate_open(attacked, device):
    writes = [number for number, seen in enumerate(attacked.exchanges) if seen == (device, "write")]
    for at in writes[-4:]:  # the last of them close it
        one = attacked.outcome(Fault("flip"), at)
        assert not one.end.sensitive, one


@pytest.fixture(scope="module")
def on_usb(tmp_path_factory):
    return Attacked(tmp_path_factory.mktemp("id120"), detector="id120")


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_at_any_exchange_with_a_detector_on_usb(on_usb, name):
    at = [number for number, (device, _) in enumerate(on_usb.exchanges) if device == "spad"]
    for number in at[NEXT * list(FAULTS).index(name) :: EVERY]:
        one = on_usb.outcome(FAULTS[name], number)
        assert one.told, one
        assert FAULTS[name].lasting or not one.end.sensitive, one
        assert one.end.code in ((130,) if FAULTS[name].kind == "interrupt" else (0, 3, 4)), one
        assert one.wrong == 0, one
        assert one.resumed == "equal", one


def test_a_garbled_transfer_does_not_leave_the_bias_on(on_usb):
    writes = [number for number, (_, name) in enumerate(on_usb.exchanges) if name == "bulk_write"]
    for at in writes[-4:]:  # the last of them take the bias away
        one = on_usb.outcome(Fault("flip"), at)
        assert not one.end.sensitive, one


@pytest.mark.parametrize(
    ("kind", "operation", "code"),
    [("drop", "HH_StartMeas", 3), ("drop", "HH_ClearHistMem", 0), ("twice", "HH_GetHistogram", 0)],
)
def test_no_position_is_wrong_in_low_light(on_usb, kind, operation, code):
    """Where a position without counts is no reason for doubt."""
    at = [number for number, (_, name) in enumerate(on_usb.exchanges) if name == operation]
    for number in (at[2], at[-2]):
        one = on_usb.outcome(Fault(kind), number)
        assert (one.end.code, one.wrong, one.resumed) == (code, 0, "equal"), one
