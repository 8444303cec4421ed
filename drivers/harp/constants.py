"""Modes and codes that all families share (source: the vendor's headers, see `drivers.harp.families`)."""

from enum import IntEnum, IntFlag

#: The count that ends a measurement where that is switched on; the largest that the function takes.
MAX_STOP_COUNT = 4294967295

#: Rates are valid this long after Initialize or SetSyncDiv; the manual asks for 100 ms, the vendor's
#: histogram demos wait 400 ms.
RATE_WAIT_S = 0.4


class Mode(IntEnum):
    """What the instrument does with a photon; T2 and continuous mode are not used."""

    HISTOGRAM = 0
    T3 = 3


class Reference(IntEnum):
    """Source of the 10 MHz reference clock."""

    INTERNAL = 0
    EXTERNAL = 1


class MeasControl(IntEnum):
    """What starts and stops a measurement; only that without signals at the control inputs is used."""

    SINGLESHOT_CTC = 0


class Edge(IntEnum):
    """The active edge of a TTL input."""

    FALLING = 0
    RISING = 1


class Feature(IntFlag):
    """What the instrument is able to do, as far as this driver asks."""

    DLL = 0x01
    TTTR = 0x02
    MARKERS = 0x04
