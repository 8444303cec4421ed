"""The calls of time-tagged mode, in order, against a scripted library (order: manual, vendor demos)."""

import numpy as np
import pytest

from drivers.errors import DeviceError, LimitError, LinkError, ProtocolError
from drivers.harp.errors import HarpError
from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary
from drivers.harp.settings import HarpSettings, Markers
from drivers.harp.stream import HarpStream
from support.harp_wire import Returns, ScriptedLibrary

FLAGS = HYDRAHARP_400.flags

FEATURES = ("HH_GetFeatures(0)", 0x07)
BEFORE = [
    ("HH_GetLibraryVersion()", "3.0"),
    ("HH_OpenDevice(0)", "1000001"),
    *(
        (f"HH_OpenDevice({other})", Returns(-1)) for other in range(1, 8)
    ),  # none is named: is it the only one?
    ("HH_Initialize(0, 3, 0)",),
    ("HH_GetHardwareInfo(0)", "HydraHarp 400", "930004", "2.0"),
    ("HH_GetNumOfInputChannels(0)", 1),
    ("HH_GetBaseResolution(0)", 1.0, 26),
    ("HH_Calibrate(0)",),
    ("HH_SetSyncDiv(0, 1)",),
    ("HH_SetSyncCFD(0, 50, 10)",),
    ("HH_SetSyncChannelOffset(0, 0)",),
    ("HH_SetInputCFD(0, 0, 50, 10)",),
    ("HH_SetInputChannelOffset(0, 0, 0)",),
    ("HH_SetInputChannelEnable(0, 0, 1)",),
]
SET_UP = [
    FEATURES,
    ("HH_SetBinning(0, 2)",),
    ("HH_SetOffset(0, 0)",),
    ("HH_GetResolution(0)", 4.0),
    ("HH_SetMarkerEdges(0, 1, 0, 1, 1)",),
    ("HH_SetMarkerEnable(0, 1, 1, 0, 0)",),
    ("HH_SetMarkerHoldoffTime(0, 500)",),
    ("sleep(0.4)",),
]
OPEN = [*BEFORE, *SET_UP]
CLOSE = [("HH_StopMeas(0)",), ("HH_CloseDevice(0)",)]
START = [("HH_StartMeas(0, 20)",)]
STOP = [("HH_StopMeas(0)",)]
READ = "HH_ReadFiFo(0, 131072)"


def read(*records, flags=0x20):
    return [(READ, list(records), len(records)), ("HH_GetFlags(0)", flags)]


RUNS = [("HH_CTCStatus(0)", 0), ("sleep(0.01)",)]
ENDED = [("HH_CTCStatus(0)", 1), ("sleep(0.001)",)]
LAST = [*read(flags=0), *ENDED] * 6


def play(lines, *, start_s=0.02, markers=None):
    """Measure on an open driver; whatever is raised, the script must come out exactly."""
    script = ScriptedLibrary(lines)
    chosen = markers or Markers((True, True, False, False), (True, False, True, True), 500e-9)
    library = HarpLibrary(script.functions, HYDRAHARP_400, name="script")
    settings = HarpSettings(family=HYDRAHARP_400, bins=3)
    pieces = []
    try:
        with HarpStream(library, clock=script, settings=settings, markers=chosen) as stream:
            if start_s is not None:
                stream.start(start_s)
                pieces.extend(stream.pieces())  # keeps those before a failure
    except DeviceError as error:
        return pieces, error
    finally:
        script.finish()
    return pieces, None


def test_open_set_up_close():
    assert play([*OPEN, *CLOSE], start_s=None) == ([], None)


def test_an_instrument_that_was_bought_without_is_refused():
    lines = [*BEFORE, ("HH_GetFeatures(0)", 0x01), *CLOSE]
    _, error = play(lines, start_s=None)
    assert isinstance(error, LimitError)
    assert "does not have the option TTTR|MARKERS" in str(error)


def test_read_until_several_reads_are_empty():
    """What comes late after the end is not lost, and begins the count anew."""
    pieces, error = play(
        [
            *(*OPEN, *START),
            *(*read(1, 2), *RUNS),
            *(*read(), *RUNS),
            *(*read(flags=0), *ENDED),
            *(*read(3, flags=0), *ENDED),
            *(*LAST, *STOP, *CLOSE),
        ]
    )
    assert error is None
    assert [piece.records.tolist() for piece in pieces] == [[1, 2], [3]]
    assert [piece.first for piece in pieces] == [0, 2]


def test_a_measurement_that_did_not_start_is_found_out():
    pieces, error = play([*OPEN, *START, *LAST, *STOP, *CLOSE])
    assert isinstance(error, ProtocolError)
    assert "measure for 0.02 s, but it was over after 0.006 s" in str(error)
    assert pieces == []


def test_a_full_buffer_is_followed_by_the_next_read_at_once():
    many = list(range(131072))
    lines = [*OPEN, *START, *read(*many), *read(7), *RUNS, *read(), *RUNS, *LAST, *STOP, *CLOSE]
    pieces, error = play(lines)
    assert error is None
    assert np.array_equal(pieces[0].records, many)
    assert pieces[1].records.tolist() == [7]  # a copy: the buffer was used again


def test_faults_are_told_once_and_flags_while_they_hold():
    pieces, error = play(
        [
            *(*OPEN, *START),
            *(*read(1), *RUNS),
            *(*read(2, flags=0x24), *RUNS),
            *(*read(3, flags=0x2C), *RUNS),
            *(*read(4), *RUNS),
            *(*read(flags=0x24), *ENDED),
            *([*read(flags=0x04), *ENDED] * 5),
            *(*STOP, *CLOSE),
        ]
    )
    assert error is None
    told = [[(fault.flag, fault.record) for fault in piece.faults] for piece in pieces]
    lost, reference = FLAGS.sync_lost, FLAGS.reference_lost
    assert told == [[], [(lost, 2)], [(reference, 3)], [], [(lost, 4)]]
    assert [piece.flags for piece in pieces] == [0, lost, lost | reference, 0, lost]
    assert len(pieces[-1].records) == 0


def test_a_full_memory_is_read_to_its_end():
    rest = [("sleep(0.001)",), *read(flags=0x02)] * 6
    pieces, error = play(
        [*OPEN, *START, *read(1, flags=0x22), ("sleep(0.001)",), *read(2, flags=0x22), *rest, *STOP, *CLOSE]
    )
    assert "memory was full after 2 records" in str(error)
    assert [piece.records.tolist() for piece in pieces] == [[1], [2]]


def test_a_system_error_brings_the_instruments_report():
    rest = [("sleep(0.001)",), *read(flags=0x10)] * 6
    report = ("HH_GetHardwareDebugInfo(0)", "board 3 is hot")
    pieces, error = play([*OPEN, *START, *read(1, flags=0x30), *rest, report, *STOP, *CLOSE])
    assert "board 3 is hot" in str(error)
    assert [piece.flags for piece in pieces] == [FLAGS.system_error]


def test_a_flag_that_nobody_knows_is_a_fault():
    shown = [*read(1, flags=0x60), *RUNS, *read(flags=0x60), *RUNS]
    pieces, error = play([*OPEN, *START, *shown, *LAST, *STOP, *CLOSE])
    assert error is None
    (fault,) = pieces[0].faults
    assert fault.flag == 0x40
    assert "0x40" in fault.sentence


def test_a_read_that_wrote_nothing_does_not_bring_the_last_records_again():
    lines = [*OPEN, *START, *read(1, 2), *RUNS, (READ, [], 2), *STOP, *CLOSE]
    pieces, error = play(lines)
    assert isinstance(error, ProtocolError)
    assert "wrote no records" in str(error)
    assert [piece.records.tolist() for piece in pieces] == [[1, 2]]


@pytest.mark.parametrize("number", [-1, 131073])
def test_a_number_of_records_that_cannot_be(number):
    _, error = play([*OPEN, *START, (READ, [], number), *STOP, *CLOSE])
    assert isinstance(error, ProtocolError)


def test_a_refused_read_stops_the_measurement():
    pieces, error = play(
        [*OPEN, *START, *read(1), *RUNS, (READ, Returns(-37)), ("HH_StopMeas(0)", Returns(-36)), *CLOSE]
    )
    assert isinstance(error, HarpError)
    assert error.code == -37  # the first failure, not that of stopping
    assert [piece.records.tolist() for piece in pieces] == [[1]]


def test_a_measurement_that_does_not_end():
    """20 ms and one second more, in waits of 10 ms, are over before the 104th read; 32 more are allowed."""
    _, error = play([*OPEN, *START, *([*read(), *RUNS] * 135), *read(), *STOP, *CLOSE])
    assert isinstance(error, LinkError)
    assert "still runs" in str(error)


def test_a_library_that_always_has_more():
    """The wire may lie about how much there is: that ends too, though each read is followed by the next."""
    many = [(READ, [5], 131072), ("HH_GetFlags(0)", 0)]
    pieces, error = play(
        [*OPEN, *START, *([*read(), *RUNS] * 103), *(many * 33), *STOP, *CLOSE],
    )
    assert isinstance(error, LinkError)
    assert len(pieces) == 33
