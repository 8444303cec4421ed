"""The functions that set something up.

Some check their arguments before they look at the instrument, others after, as the vendor's libraries were
observed to do; where it could not be observed the check comes after. None works while a measurement runs.
"""

from typing import Any

from simulators.wire.harp.codes import Code, Mode
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.discriminators import Threshold
from simulators.wire.harp.exports import INT, INT_OUT, UINT, Exports, require, take
from simulators.wire.harp.families import SimulatedFamily
from simulators.wire.harp.instrument import Instrument

EXPORTS = Exports()
_declare = EXPORTS.declare

LARGEST_CHANNEL_OFFSET_PS = 99999
LARGEST_CONTINUOUS_LENGTH_CODE = 3


def _has_cfd(family: SimulatedFamily) -> bool:
    return family.cfd_mv is not None


def _has_edges(family: SimulatedFamily) -> bool:
    return family.edge_mv is not None


def _has_both(family: SimulatedFamily) -> bool:
    return len(family.triggers) > 1


@_declare("Calibrate", INT, where=lambda family: family.calibrates)
def calibrate(connection: Connection, devidx: int) -> None:
    """Allow measurements."""
    connection.idle(devidx).calibrated = True


@_declare("SetSyncDiv", INT, INT)
def set_sync_div(connection: Connection, devidx: int, div: int) -> None:
    """Set the sync divider; the rates begin anew."""
    take(1 <= div <= connection.family.largest_divider, 2)
    instrument = connection.idle(devidx)
    take(div in (1, 2, 4, 8, 16), 2)
    instrument.settings.sync_divider = div
    instrument.restart_rates()


@_declare("SetSyncTrgMode", INT, INT, where=_has_both)
def set_sync_trg_mode(connection: Connection, devidx: int, mode: int) -> None:
    """Choose how the sync triggers: 0 by an edge, 1 by its discriminator."""
    take(mode in (0, 1), 2)
    connection.idle(devidx).trigger_modes[None] = mode


@_declare("SetInputTrgMode", INT, INT, INT, where=_has_both)
def set_input_trg_mode(connection: Connection, devidx: int, channel: int, mode: int) -> None:
    """Choose how an input triggers."""
    _look_at_channel(connection, channel)
    take(mode in (0, 1), 3)
    _with_channel(connection, devidx, channel).trigger_modes[channel] = mode


@_declare("SetSyncCFD", INT, INT, INT, where=_has_cfd)
def set_sync_cfd(connection: Connection, devidx: int, level: int, zerocross: int) -> None:
    """Set the sync's discriminator; its zero crossing is accepted, and changes nothing."""
    _take_cfd(connection, level, zerocross, 2)
    instrument = connection.idle(devidx)
    _require_trigger(instrument, None, 1)
    instrument.discriminators.sync = Threshold(abs(level) * 1e-3)


@_declare("SetSyncEdgeTrg", INT, INT, INT, where=_has_edges)
def set_sync_edge_trg(connection: Connection, devidx: int, level: int, edge: int) -> None:
    """Set the sync's comparator."""
    _take_edge(connection, level, edge, 2)
    instrument = connection.idle(devidx)
    _require_trigger(instrument, None, 0)
    instrument.discriminators.sync = Threshold(-level * 1e-3, at_end=edge == 1)


@_declare("SetSyncChannelOffset", INT, INT)
def set_sync_channel_offset(connection: Connection, devidx: int, value: int) -> None:
    """Delay the sync input; that a positive value delays is unconfirmed."""
    take(abs(value) <= LARGEST_CHANNEL_OFFSET_PS, 2)
    connection.idle(devidx).settings.sync_offset_ps = value


@_declare("SetInputCFD", INT, INT, INT, INT, where=_has_cfd)
def set_input_cfd(connection: Connection, devidx: int, channel: int, level: int, zerocross: int) -> None:
    """Set an input's discriminator; its zero crossing is accepted, and changes nothing."""
    _look_at_channel(connection, channel)
    _take_cfd(connection, level, zerocross, 3)
    instrument = _with_channel(connection, devidx, channel)
    _require_trigger(instrument, channel, 1)
    instrument.discriminators.inputs[channel] = Threshold(abs(level) * 1e-3)


@_declare("SetInputEdgeTrg", INT, INT, INT, INT, where=_has_edges)
def set_input_edge_trg(connection: Connection, devidx: int, channel: int, level: int, edge: int) -> None:
    """Set an input's comparator."""
    _look_at_channel(connection, channel)
    _take_edge(connection, level, edge, 3)
    instrument = _with_channel(connection, devidx, channel)
    _require_trigger(instrument, channel, 0)
    instrument.discriminators.inputs[channel] = Threshold(-level * 1e-3, at_end=edge == 1)


@_declare("SetInputChannelOffset", INT, INT, INT)
def set_input_channel_offset(connection: Connection, devidx: int, channel: int, value: int) -> None:
    """Delay an input; that a positive value delays is unconfirmed."""
    _look_at_channel(connection, channel)
    take(abs(value) <= LARGEST_CHANNEL_OFFSET_PS, 3)
    _with_channel(connection, devidx, channel).settings.input_offset_ps[channel] = value


@_declare("SetInputChannelEnable", INT, INT, INT)
def set_input_channel_enable(connection: Connection, devidx: int, channel: int, enable: int) -> None:
    """Switch an input on or off."""
    _look_at_channel(connection, channel)
    if connection.family.looks_at_enable:
        take(enable in (0, 1), 3)
    instrument = _with_channel(connection, devidx, channel)
    take(enable in (0, 1), 3)
    instrument.settings.input_enabled[channel] = enable == 1


@_declare("SetStopOverflow", INT, INT, UINT)
def set_stop_overflow(connection: Connection, devidx: int, stop_ovfl: int, stopcount: int) -> None:
    """Choose whether a full bin stops the measurement."""
    take(stop_ovfl in (0, 1), 2)
    take(stopcount >= 1, 3)
    settings = connection.idle(devidx).settings
    settings.stop_overflow = stop_ovfl == 1
    settings.stop_count = stopcount


@_declare("SetBinning", INT, INT)
def set_binning(connection: Connection, devidx: int, binning: int) -> None:
    """Set the bin width."""
    take(binning >= 0, 2)
    instrument = _not_t2(connection, devidx)
    take(binning < connection.family.binnings, 2)
    instrument.settings.binning = binning


@_declare("SetOffset", INT, INT)
def set_offset(connection: Connection, devidx: int, offset: int) -> None:
    """Set the time that is subtracted before histogramming."""
    take(0 <= offset <= connection.family.offset_ns, 2)
    _not_t2(connection, devidx).settings.offset_ns = offset


@_declare("SetHistoLen", INT, INT, INT_OUT)
def set_histo_len(connection: Connection, devidx: int, lencode: int, actuallen: Any) -> None:
    """Set the histogram length and tell it in bins."""
    take(0 <= lencode <= connection.family.longest_code, 2)
    instrument = connection.idle(devidx)
    require(instrument.mode in (Mode.HISTOGRAM, Mode.CONTINUOUS), Code.INVALID_MODE)
    take(instrument.mode is Mode.HISTOGRAM or lencode <= LARGEST_CONTINUOUS_LENGTH_CODE, 2)
    instrument.settings.length = actuallen[0] = 1024 << lencode


@_declare("SetMeasControl", INT, INT, INT, INT)
def set_meas_control(
    connection: Connection, devidx: int, control: int, startedge: int, stopedge: int
) -> None:
    """Choose what starts a measurement; of those above 3, a HydraHarp 400's continuous mode has some."""
    take(0 <= control <= connection.family.control, 2)
    take(startedge in (0, 1), 3)
    take(stopedge in (0, 1), 4)
    instrument = connection.idle(devidx)
    require(control <= 3 or instrument.mode is Mode.CONTINUOUS, Code.INVALID_MODE)
    instrument.settings.control = control


@_declare("SetMarkerHoldoffTime", INT, INT)
def set_marker_holdoff_time(connection: Connection, devidx: int, holdofftime: int) -> None:
    """Set the time after a marker in which its input takes no other."""
    take(0 <= holdofftime <= connection.family.hold_off_ns, 2)
    connection.idle(devidx).settings.markers.hold_off_s = holdofftime * 1e-9


@_declare("SetMarkerEdges", INT, INT, INT, INT, INT)
def set_marker_edges(connection: Connection, devidx: int, *edges: int) -> None:
    """Choose the edge of each marker input that counts."""
    _take_switches(edges)
    connection.idle(devidx).settings.markers.rising = [edge == 1 for edge in edges]


@_declare("SetMarkerEnable", INT, INT, INT, INT, INT)
def set_marker_enable(connection: Connection, devidx: int, *enable: int) -> None:
    """Switch the marker inputs on or off."""
    _take_switches(enable)
    connection.idle(devidx).settings.markers.enabled = [switch == 1 for switch in enable]


def _take_switches(values: tuple[int, ...]) -> None:
    for place, value in enumerate(values, start=2):
        take(value in (0, 1), place)


def _take_cfd(connection: Connection, level: int, zerocross: int, place: int) -> None:
    family = connection.family
    assert family.cfd_mv is not None
    assert family.zero_cross_mv is not None
    take(level in family.cfd_mv, place)
    take(zerocross in family.zero_cross_mv, place + 1)


def _take_edge(connection: Connection, level: int, edge: int, place: int) -> None:
    assert connection.family.edge_mv is not None
    take(level in connection.family.edge_mv, place)
    take(edge in (0, 1), place + 1)


def _require_trigger(instrument: Instrument, channel: int | None, mode: int) -> None:
    """Refuse a trigger that the board has not, or that is not chosen; which codes is unconfirmed."""
    require(mode in instrument.family.triggers, Code.UNSUPPORTED_FUNCTION)
    require(instrument.trigger_modes.get(channel, mode) == mode, Code.WRONG_TRGMODE)


def _look_at_channel(connection: Connection, channel: int) -> None:
    if connection.family.looks_at_channel:
        take(channel >= 0, 2)


def _with_channel(connection: Connection, devidx: int, channel: int) -> Instrument:
    instrument = connection.idle(devidx)
    take(0 <= channel < instrument.inputs, 2)
    return instrument


def _not_t2(connection: Connection, devidx: int) -> Instrument:
    """T2 mode has no bins; the code for that is unconfirmed."""
    instrument = connection.idle(devidx)
    require(instrument.mode is not Mode.T2, Code.INVALID_MODE)
    return instrument
