"""Error codes, modes and warnings that all families share (source: the vendor's header files)."""

from enum import Enum, IntEnum, IntFlag


class Code(IntEnum):
    """The codes that the simulator answers with."""

    DEVICE_OPEN_FAIL = -1
    DEVICE_BUSY = -2
    DEVICE_NOT_OPEN = -10
    INSTANCE_RUNNING = -16
    INVALID_ARGUMENT = -17
    INVALID_MODE = -18
    INVALID_MEMORY = -20
    NOT_INITIALIZED = -22
    NOT_CALIBRATED = -23
    USB_VCMD_FAIL = -36
    UNSUPPORTED_FUNCTION = -80
    WRONG_TRGMODE = -81
    #: Not a code of the vendor: a Python exception was remembered, see `HarpSimulator.raise_pending`.
    EXCEPTION = -99


class Mode(IntEnum):
    """Measurement modes."""

    HISTOGRAM = 0
    T2 = 2
    T3 = 3
    CONTINUOUS = 8


class Warn(IntFlag):
    """Bits of GetWarnings."""

    SYNC_RATE_ZERO = 0x0001
    SYNC_RATE_TOO_HIGH = 0x0004
    INPT_RATE_ZERO = 0x0010
    INPT_RATE_TOO_HIGH = 0x0040
    INPT_RATE_RATIO = 0x0100
    DIVIDER_GREATER_ONE = 0x0200
    TIME_SPAN_TOO_SMALL = 0x0400
    OFFSET_UNNECESSARY = 0x0800
    DIVIDER_TOO_SMALL = 0x1000


class Slot(Enum):
    """State of a device index."""

    CLOSED = "never opened, closed, or could not be opened"
    OPEN = "open"
