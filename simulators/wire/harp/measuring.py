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
    take,
    write_text,
)
from simulators.wire.harp.histogram import HistogramMemory

EXPORTS = Exports()
_declare = EXPORTS.declare

LONGEST_ACQUISITION_MS = 360_000_000
FIFO_RECORDS_STEP = 128


@_declare("ClearHistMem", INT)
def clear_hist_mem(connection: Connection, devidx: int) -> None:
    """Set all counts to zero."""
    connection.idle(devidx).clear()


@_declare("StartMeas", INT, INT)
def start_meas(connection: Connection, devidx: int, tacq: int) -> None:
    """Start; that an instrument never calibrated refuses is unconfirmed."""
    take(0 <= tacq <= LONGEST_ACQUISITION_MS, 2)
    instrument = connection.idle(devidx)
    take(tacq >= 1, 2)
    require(instrument.calibrated, Code.NOT_CALIBRATED)
    instrument.start(tacq / 1000)


@_declare("StopMeas", INT)
def stop_meas(connection: Connection, devidx: int) -> None:
    """Stop; no error where nothing runs."""
    connection.initialized(devidx).stop()


@_declare("CTCStatus", INT, INT_OUT)
def ctc_status(connection: Connection, devidx: int, ctcstatus: Any) -> None:
    """Tell whether the acquisition time has run out."""
    ctcstatus[0] = int(connection.initialized(devidx).ended())


@_declare("GetHistogram", INT, UINT_OUT, INT, INT, where=lambda family: family.clears)
def get_histogram(connection: Connection, devidx: int, chcount: Any, channel: int, clear: int) -> None:
    """Copy out the counts, and clear them."""
    take(channel >= 0, 3)
    take(clear in (0, 1), 4)
    memory = _copied(connection, devidx, chcount, channel)
    if clear:
        memory.clear()


@_declare("GetHistogram", INT, UINT_OUT, INT, where=lambda family: not family.clears)
def get_histogram_only(connection: Connection, devidx: int, chcount: Any, channel: int) -> None:
    """Copy out the counts."""
    take(channel >= 0, 3 if connection.family.looks_at_channel else 2)  # libraries, observed
    _copied(connection, devidx, chcount, channel)


def _copied(connection: Connection, devidx: int, chcount: Any, channel: int) -> HistogramMemory:
    """Copy out the counts; that this is refused before StopMeas is unconfirmed."""
    instrument = connection.idle(devidx)
    take(channel < instrument.inputs, 3)
    require(instrument.mode is Mode.HISTOGRAM, Code.INVALID_MODE)
    # too short for this function (header); with which code it says so is unconfirmed
    require(instrument.settings.length >= 1024 << connection.family.shortest_code, Code.INVALID_MODE)
    memory = instrument.memories[channel]
    memmove(chcount, memory.address, 4 * instrument.settings.length)
    return memory


@_declare("GetResolution", INT, DOUBLE_OUT)
def get_resolution(connection: Connection, devidx: int, resolution: Any) -> None:
    """Tell the bin width [ps]."""
    resolution[0] = connection.initialized(devidx).resolution_ps


@_declare("GetSyncPeriod", INT, DOUBLE_OUT)
def get_sync_period(connection: Connection, devidx: int, period: Any) -> None:
    """Tell the sync period that the last measurement saw."""
    period[0] = connection.initialized(devidx).sync_period_s() / connection.family.sync_period_unit_s


@_declare("GetSyncRate", INT, INT_OUT)
def get_sync_rate(connection: Connection, devidx: int, syncrate: Any) -> None:
    """Tell the sync rate."""
    syncrate[0] = connection.initialized(devidx).read_sync_rate()


@_declare("GetCountRate", INT, INT, INT_OUT)
def get_count_rate(connection: Connection, devidx: int, channel: int, cntrate: Any) -> None:
    """Tell an input's rate."""
    take(channel >= 0, 2)
    instrument = connection.initialized(devidx)
    take(channel < instrument.inputs, 2)
    cntrate[0] = instrument.read_count_rate(channel)


@_declare("GetFlags", INT, INT_OUT)
def get_flags(connection: Connection, devidx: int, flags: Any) -> None:
    """Tell the state flags."""
    flags[0] = connection.initialized(devidx).flags()


@_declare("GetElapsedMeasTime", INT, DOUBLE_OUT)
def get_elapsed_meas_time(connection: Connection, devidx: int, elapsed: Any) -> None:
    """Tell how long the measurement ran [ms]."""
    elapsed[0] = connection.initialized(devidx).elapsed_s() * 1000


@_declare("GetWarnings", INT, INT_OUT)
def get_warnings(connection: Connection, devidx: int, warnings: Any) -> None:
    """Judge the rates that were read last."""
    warnings[0] = int(connection.initialized(devidx).warnings())


@_declare("GetWarningsText", INT, TEXT_OUT, INT)
def get_warnings_text(connection: Connection, devidx: int, text: Any, warnings: int) -> None:
    """Name the warnings, one a line."""
    take(warnings >= 0, 3)
    connection.opened(devidx)
    write_text(text, "\n".join(f"WARNING: {bit.name}" for bit in Warn if warnings & bit))


@_declare("ReadFiFo", INT, UINT_OUT, INT, INT_OUT, where=lambda family: family.counted_reads)
def read_fifo(connection: Connection, devidx: int, buffer: Any, count: int, nactual: Any) -> None:
    """Deliver the records at hand, at most ``count``."""
    take(0 < count <= connection.family.fifo_records and count % FIFO_RECORDS_STEP == 0, 3)
    _read(connection, devidx, buffer, count, nactual)


@_declare("ReadFiFo", INT, UINT_OUT, INT_OUT, where=lambda family: not family.counted_reads)
def read_fifo_uncounted(connection: Connection, devidx: int, buffer: Any, nactual: Any) -> None:
    """Deliver the records at hand, into memory that has room for the most there can be."""
    _read(connection, devidx, buffer, connection.family.fifo_records, nactual)


def _read(connection: Connection, devidx: int, buffer: Any, count: int, nactual: Any) -> None:
    """Deliver records; in T2 mode there are none."""
    instrument = connection.initialized(devidx)
    require(instrument.mode in (Mode.T2, Mode.T3), Code.INVALID_MODE)
    words = instrument.read_records(count)
    memmove(buffer, words.ctypes.data, words.nbytes)
    nactual[0] = len(words)


@_declare("GetContModeBlock", INT, BUFFER, INT_OUT, where=lambda family: family.calibrates)
def get_cont_mode_block(connection: Connection, devidx: int, buffer: Any, nbytesreceived: Any) -> None:
    """Deliver no block."""
    instrument = connection.initialized(devidx)
    require(instrument.mode is Mode.CONTINUOUS, Code.INVALID_MODE)
    nbytesreceived[0] = 0
