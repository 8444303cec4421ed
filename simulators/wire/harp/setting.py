"""The functions that set something up.

Some check their arguments before they look at the instrument, others after, as the vendor's library was
observed to do; where it could not be observed the check comes after. None works while a measurement runs.
"""

from typing import Any

from simulators.wire.harp.codes import BINNING_STEPS, Code, Mode
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.exports import INT, INT_OUT, UINT, Exports, require
from simulators.wire.harp.instrument import Instrument

EXPORTS = Exports()
_declare = EXPORTS.declare

LARGEST_CHANNEL_OFFSET_PS = 99999
LARGEST_OFFSET_NS = 500_000
LARGEST_HOLDOFF_NS = 524_296
LARGEST_LENGTH_CODE = 6
LARGEST_CONTINUOUS_LENGTH_CODE = 3


@_declare("HH_Calibrate", INT)
def calibrate(connection: Connection, devidx: int) -> None:
    """Allow measurements."""
    connection.idle(devidx).calibrated = True


@_declare("HH_SetSyncDiv", INT, INT)
def set_sync_div(connection: Connection, devidx: int, div: int) -> None:
    """Set the sync divider; the rates begin anew."""
    require(1 <= div <= 16)
    instrument = connection.idle(devidx)
    require(div in (1, 2, 4, 8, 16))
    instrument.settings.sync_divider = div
    instrument.restart_rates()


@_declare("HH_SetSyncCFD", INT, INT, INT)
def set_sync_cfd(connection: Connection, devidx: int, level: int, zerocross: int) -> None:
    """Set the sync's discriminator; its zero crossing is accepted, and changes nothing."""
    _require_cfd(level, zerocross)
    connection.idle(devidx).discriminators.sync_level_v = level * 1e-3


@_declare("HH_SetSyncChannelOffset", INT, INT)
def set_sync_channel_offset(connection: Connection, devidx: int, value: int) -> None:
    """Delay the sync input; that a positive value delays is unconfirmed."""
    require(abs(value) <= LARGEST_CHANNEL_OFFSET_PS)
    connection.idle(devidx).settings.sync_offset_ps = value


@_declare("HH_SetInputCFD", INT, INT, INT, INT)
def set_input_cfd(connection: Connection, devidx: int, channel: int, level: int, zerocross: int) -> None:
    """Set an input's discriminator; its zero crossing is accepted, and changes nothing."""
    require(channel >= 0)
    _require_cfd(level, zerocross)
    _with_channel(connection, devidx, channel).discriminators.input_level_v[channel] = level * 1e-3


@_declare("HH_SetInputChannelOffset", INT, INT, INT)
def set_input_channel_offset(connection: Connection, devidx: int, channel: int, value: int) -> None:
    """Delay an input; that a positive value delays is unconfirmed."""
    require(channel >= 0 and abs(value) <= LARGEST_CHANNEL_OFFSET_PS)
    _with_channel(connection, devidx, channel).settings.input_offset_ps[channel] = value


@_declare("HH_SetInputChannelEnable", INT, INT, INT)
def set_input_channel_enable(connection: Connection, devidx: int, channel: int, enable: int) -> None:
    """Switch an input on or off."""
    require(channel >= 0)
    instrument = _with_channel(connection, devidx, channel)
    require(enable in (0, 1))
    instrument.settings.input_enabled[channel] = enable == 1


@_declare("HH_SetStopOverflow", INT, INT, UINT)
def set_stop_overflow(connection: Connection, devidx: int, stop_ovfl: int, stopcount: int) -> None:
    """Choose whether a full bin stops the measurement."""
    require(stop_ovfl in (0, 1) and stopcount >= 1)
    settings = connection.idle(devidx).settings
    settings.stop_overflow = stop_ovfl == 1
    settings.stop_count = stopcount


@_declare("HH_SetBinning", INT, INT)
def set_binning(connection: Connection, devidx: int, binning: int) -> None:
    """Set the bin width."""
    require(binning >= 0)
    instrument = _not_t2(connection, devidx)
    require(binning < BINNING_STEPS)
    instrument.settings.binning = binning


@_declare("HH_SetOffset", INT, INT)
def set_offset(connection: Connection, devidx: int, offset: int) -> None:
    """Set the time that is subtracted before histogramming."""
    require(0 <= offset <= LARGEST_OFFSET_NS)
    _not_t2(connection, devidx).settings.offset_ns = offset


@_declare("HH_SetHistoLen", INT, INT, INT_OUT)
def set_histo_len(connection: Connection, devidx: int, lencode: int, actuallen: Any) -> None:
    """Set the histogram length and tell it in bins."""
    require(0 <= lencode <= LARGEST_LENGTH_CODE)
    instrument = connection.idle(devidx)
    require(instrument.mode in (Mode.HISTOGRAM, Mode.CONTINUOUS), Code.INVALID_MODE)
    require(instrument.mode is Mode.HISTOGRAM or lencode <= LARGEST_CONTINUOUS_LENGTH_CODE)
    instrument.settings.length = actuallen[0] = 1024 << lencode


@_declare("HH_SetMeasControl", INT, INT, INT, INT)
def set_meas_control(
    connection: Connection, devidx: int, control: int, startedge: int, stopedge: int
) -> None:
    """Choose what starts a measurement; 4 to 6 are for continuous mode only."""
    require(0 <= control <= 6 and startedge in (0, 1) and stopedge in (0, 1))
    instrument = connection.idle(devidx)
    require(control <= 3 or instrument.mode is Mode.CONTINUOUS, Code.INVALID_MODE)
    instrument.settings.control = control


@_declare("HH_SetMarkerHoldoffTime", INT, INT)
def set_marker_holdoff_time(connection: Connection, devidx: int, holdofftime: int) -> None:
    """Set the time after a marker in which its input takes no other."""
    require(0 <= holdofftime <= LARGEST_HOLDOFF_NS)
    connection.idle(devidx).settings.markers.hold_off_s = holdofftime * 1e-9


@_declare("HH_SetMarkerEdges", INT, INT, INT, INT, INT)
def set_marker_edges(connection: Connection, devidx: int, *edges: int) -> None:
    """Choose the edge of each marker input that counts."""
    require(all(edge in (0, 1) for edge in edges))
    connection.idle(devidx).settings.markers.rising = [edge == 1 for edge in edges]


@_declare("HH_SetMarkerEnable", INT, INT, INT, INT, INT)
def set_marker_enable(connection: Connection, devidx: int, *enable: int) -> None:
    """Switch the marker inputs on or off."""
    require(all(switch in (0, 1) for switch in enable))
    connection.idle(devidx).settings.markers.enabled = [switch == 1 for switch in enable]


def _require_cfd(level: int, zerocross: int) -> None:
    require(0 <= level <= 1000 and 0 <= zerocross <= 40)


def _with_channel(connection: Connection, devidx: int, channel: int) -> Instrument:
    instrument = connection.idle(devidx)
    require(channel < instrument.inputs)
    return instrument


def _not_t2(connection: Connection, devidx: int) -> Instrument:
    """T2 mode has no bins; the code for that is unconfirmed."""
    instrument = connection.idle(devidx)
    require(instrument.mode is not Mode.T2, Code.INVALID_MODE)
    return instrument
