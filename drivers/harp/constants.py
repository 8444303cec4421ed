"""Modes, flags, warnings and sizes of HHLib 3.0 (source of every value: the vendor's hhdefin.h, v3.0)."""

from enum import IntEnum, IntFlag

LIBRARY_VERSION = "3.0"
MAX_DEVICES = 8

MAX_CONTINUOUS_BLOCK_BYTES = 262272
MAX_FIFO_RECORDS = 131072
FIFO_RECORDS_STEP = 128

#: The count that ends a measurement where that is switched on; the largest that the function takes.
MAX_STOP_COUNT = 4294967295

#: Rates are valid this long after Initialize or SetSyncDiv; the manual asks for 100 ms, the vendor's
#: histogram demos wait 400 ms.
RATE_WAIT_S = 0.4


class Mode(IntEnum):
    """What the instrument does with a photon."""

    HISTOGRAM = 0
    T2 = 2
    T3 = 3
    CONTINUOUS = 8


class Reference(IntEnum):
    """Source of the 10 MHz reference clock."""

    INTERNAL = 0
    EXTERNAL = 1


class MeasControl(IntEnum):
    """What starts and stops a measurement; 4 to 6 exist in continuous mode only."""

    SINGLESHOT_CTC = 0
    C1_GATED = 1
    C1_START_CTC_STOP = 2
    C1_START_C2_STOP = 3
    CONT_C1_GATED = 4
    CONT_C1_START_CTC_STOP = 5
    CONT_CTC_RESTART = 6


class Edge(IntEnum):
    """The active edge of a TTL input."""

    FALLING = 0
    RISING = 1


class Feature(IntFlag):
    """What the instrument is able to do."""

    DLL = 0x01
    TTTR = 0x02
    MARKERS = 0x04
    LOWRES = 0x08
    TRIGOUT = 0x10


class Flag(IntFlag):
    """State of the instrument during and after a measurement."""

    OVERFLOW = 0x01
    FIFOFULL = 0x02
    SYNC_LOST = 0x04
    REF_LOST = 0x08
    SYSERROR = 0x10
    ACTIVE = 0x20


class Warn(IntFlag):
    """What is questionable about the present rates and settings."""

    SYNC_RATE_ZERO = 0x0001
    SYNC_RATE_TOO_LOW = 0x0002
    SYNC_RATE_TOO_HIGH = 0x0004
    INPT_RATE_ZERO = 0x0010
    INPT_RATE_TOO_HIGH = 0x0040
    INPT_RATE_RATIO = 0x0100
    DIVIDER_GREATER_ONE = 0x0200
    TIME_SPAN_TOO_SMALL = 0x0400
    OFFSET_UNNECESSARY = 0x0800


WARNING_SENTENCES = {
    Warn.SYNC_RATE_ZERO: "No sync pulses arrive: check that the laser emits, its cable, and the sync CFD.",
    Warn.SYNC_RATE_TOO_LOW: "The sync rate is too low for a meaningful measurement.",
    Warn.SYNC_RATE_TOO_HIGH: "The divided sync rate is too high: use a larger sync divider.",
    Warn.INPT_RATE_ZERO: "No photons arrive: check the detector, its cable, and the input CFD.",
    Warn.INPT_RATE_TOO_HIGH: "The input rates together are too high for the USB link: attenuate.",
    Warn.INPT_RATE_RATIO: "The input rate is above 5 % of the sync rate, so pile-up distorts: attenuate.",
    Warn.DIVIDER_GREATER_ONE: "The sync divider is above one, which loses sync events in T2 mode.",
    Warn.TIME_SPAN_TOO_SMALL: "The longest histogram is shorter than the sync period: use wider bins.",
    Warn.OFFSET_UNNECESSARY: "The offset is not needed: the histogram spans the sync period without it.",
}

#: What a flag says about a measurement; SYSERROR is no sentence but an error, ACTIVE says nothing of counts.
FLAG_SENTENCES = {
    Flag.OVERFLOW: "A bin of the histogram is full: expose shorter, attenuate, or move the gate.",
    Flag.FIFOFULL: "The instrument's buffer was full, so photons are missing: attenuate.",
    Flag.SYNC_LOST: "The sync was lost, so photons are missing: check laser and sync cable.",
    Flag.REF_LOST: "The external reference clock was lost, so times may be wrong: check its source.",
}
