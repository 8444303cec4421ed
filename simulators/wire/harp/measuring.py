"""The functions that measure and read out."""

from ctypes import memmove
from typing import Any

from simulators.wire.harp.codes import Code, Mode, Warn
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.exports import (
    BUFFER,
    DOUBLE_OUT,
    INT,
    INT_OUT,
    TEXT_OUT,
    UINT_OUT,
    Exports,
    require,
    write_text,
)

EXPORTS = Exports()
_declare = EXPORTS.declare

LONGEST_ACQUISITION_MS = 360_000_000
FIFO_RECORDS_STEP = 128
LONGEST_FIFO_READ = 131_072


@_declare("HH_ClearHistMem", INT)
def clear_hist_mem(connection: Connection, devidx: int) -> None:
    """Set all counts to zero."""
    connection.idle(devidx).clear()


@_declare("HH_StartMeas", INT, INT)
def start_meas(connection: Connection, devidx: int, tacq: int) -> None:
    """Start; that an instrument never calibrated refuses is unconfirmed."""
    require(0 <= tacq <= LONGEST_ACQUISITION_MS)
    instrument = connection.idle(devidx)
    require(tacq >= 1)
    require(instrument.calibrated, Code.NOT_CALIBRATED)
    instrument.start(tacq / 1000)


@_declare("HH_StopMeas", INT)
def stop_meas(connection: Connection, devidx: int) -> None:
    """Stop; no error where nothing runs."""
    connection.initialized(devidx).stop()


@_declare("HH_CTCStatus", INT, INT_OUT)
def ctc_status(connection: Connection, devidx: int, ctcstatus: Any) -> None:
    """Tell whether the acquisition time has run out."""
    ctcstatus[0] = int(connection.initialized(devidx).ended())


@_declare("HH_GetHistogram", INT, UINT_OUT, INT, INT)
def get_histogram(connection: Connection, devidx: int, chcount: Any, channel: int, clear: int) -> None:
    """Copy out the counts; that this is refused before StopMeas is unconfirmed."""
    require(channel >= 0 and clear in (0, 1))
    instrument = connection.idle(devidx)
    require(channel < instrument.inputs)
    require(instrument.mode is Mode.HISTOGRAM, Code.INVALID_MODE)
    memory = instrument.memories[channel]
    memmove(chcount, memory.address, 4 * instrument.settings.length)
    if clear:
        memory.clear()


@_declare("HH_GetResolution", INT, DOUBLE_OUT)
def get_resolution(connection: Connection, devidx: int, resolution: Any) -> None:
    """Tell the bin width [ps]."""
    resolution[0] = connection.initialized(devidx).settings.resolution_ps


@_declare("HH_GetSyncPeriod", INT, DOUBLE_OUT)
def get_sync_period(connection: Connection, devidx: int, period: Any) -> None:
    """Tell the sync period that the last measurement saw."""
    period[0] = connection.initialized(devidx).sync_period_s() / connection.sync_period_unit_s


@_declare("HH_GetSyncRate", INT, INT_OUT)
def get_sync_rate(connection: Connection, devidx: int, syncrate: Any) -> None:
    """Tell the sync rate."""
    syncrate[0] = connection.initialized(devidx).read_sync_rate()


@_declare("HH_GetCountRate", INT, INT, INT_OUT)
def get_count_rate(connection: Connection, devidx: int, channel: int, cntrate: Any) -> None:
    """Tell an input's rate."""
    require(channel >= 0)
    instrument = connection.initialized(devidx)
    require(channel < instrument.inputs)
    cntrate[0] = instrument.read_count_rate(channel)


@_declare("HH_GetFlags", INT, INT_OUT)
def get_flags(connection: Connection, devidx: int, flags: Any) -> None:
    """Tell the state flags."""
    flags[0] = int(connection.initialized(devidx).flags())


@_declare("HH_GetElapsedMeasTime", INT, DOUBLE_OUT)
def get_elapsed_meas_time(connection: Connection, devidx: int, elapsed: Any) -> None:
    """Tell how long the measurement ran [ms]."""
    elapsed[0] = connection.initialized(devidx).elapsed_s() * 1000


@_declare("HH_GetWarnings", INT, INT_OUT)
def get_warnings(connection: Connection, devidx: int, warnings: Any) -> None:
    """Judge the rates that were read last."""
    warnings[0] = int(connection.initialized(devidx).warnings())


@_declare("HH_GetWarningsText", INT, TEXT_OUT, INT)
def get_warnings_text(connection: Connection, devidx: int, text: Any, warnings: int) -> None:
    """Name the warnings, one a line."""
    require(warnings >= 0)
    connection.opened(devidx)
    write_text(text, "\n".join(f"WARNING: {bit.name}" for bit in Warn if warnings & bit))


@_declare("HH_ReadFiFo", INT, UINT_OUT, INT, INT_OUT)
def read_fifo(connection: Connection, devidx: int, buffer: Any, count: int, nactual: Any) -> None:
    """Deliver the records at hand; in T2 mode there are none."""
    require(0 < count <= LONGEST_FIFO_READ and count % FIFO_RECORDS_STEP == 0)
    instrument = connection.initialized(devidx)
    require(instrument.mode in (Mode.T2, Mode.T3), Code.INVALID_MODE)
    words = instrument.read_records(count)
    memmove(buffer, words.ctypes.data, words.nbytes)
    nactual[0] = len(words)


@_declare("HH_GetContModeBlock", INT, BUFFER, INT_OUT)
def get_cont_mode_block(connection: Connection, devidx: int, buffer: Any, nbytesreceived: Any) -> None:
    """Deliver no block."""
    instrument = connection.initialized(devidx)
    require(instrument.mode is Mode.CONTINUOUS, Code.INVALID_MODE)
    nbytesreceived[0] = 0
