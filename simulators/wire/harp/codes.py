"""Error codes, limits and bits of HHLib 3.0 (source: the vendor's header files, v3.0)."""

from enum import Enum, IntEnum, IntFlag

#: Names of the codes, without their prefix.
_NAMES = {
    0: "NONE",
    -1: "DEVICE_OPEN_FAIL",
    -2: "DEVICE_BUSY",
    -3: "DEVICE_HEVENT_FAIL",
    -4: "DEVICE_CALLBSET_FAIL",
    -5: "DEVICE_BARMAP_FAIL",
    -6: "DEVICE_CLOSE_FAIL",
    -7: "DEVICE_RESET_FAIL",
    -8: "DEVICE_GETVERSION_FAIL",
    -9: "DEVICE_VERSION_MISMATCH",
    -10: "DEVICE_NOT_OPEN",
    -11: "DEVICE_LOCKED",
    -16: "INSTANCE_RUNNING",
    -17: "INVALID_ARGUMENT",
    -18: "INVALID_MODE",
    -19: "INVALID_OPTION",
    -20: "INVALID_MEMORY",
    -21: "INVALID_RDATA",
    -22: "NOT_INITIALIZED",
    -23: "NOT_CALIBRATED",
    -24: "DMA_FAIL",
    -25: "XTDEVICE_FAIL",
    -26: "FPGACONF_FAIL",
    -27: "IFCONF_FAIL",
    -28: "FIFORESET_FAIL",
    -32: "USB_GETDRIVERVER_FAIL",
    -33: "USB_DRIVERVER_MISMATCH",
    -34: "USB_GETIFINFO_FAIL",
    -35: "USB_HISPEED_FAIL",
    -36: "USB_VCMD_FAIL",
    -37: "USB_BULKRD_FAIL",
    -38: "USB_RESET_FAIL",
    -40: "LANEUP_TIMEOUT",
    -41: "DONEALL_TIMEOUT",
    -42: "MODACK_TIMEOUT",
    -43: "MACTIVE_TIMEOUT",
    -44: "MEMCLEAR_FAIL",
    -45: "MEMTEST_FAIL",
    -46: "CALIB_FAIL",
    -47: "REFSEL_FAIL",
    -48: "STATUS_FAIL",
    -49: "MODNUM_FAIL",
    -50: "DIGMUX_FAIL",
    -51: "MODMUX_FAIL",
    -52: "MODFWPCB_MISMATCH",
    -53: "MODFWVER_MISMATCH",
    -54: "MODPROPERTY_MISMATCH",
    -55: "INVALID_MAGIC",
    -56: "INVALID_LENGTH",
    -57: "RATE_FAIL",
    -58: "MODFWVER_TOO_LOW",
    -59: "MODFWVER_TOO_HIGH",
    -64: "EEPROM_F01",
    -65: "EEPROM_F02",
    -66: "EEPROM_F03",
    -67: "EEPROM_F04",
    -68: "EEPROM_F05",
    -69: "EEPROM_F06",
    -70: "EEPROM_F07",
    -71: "EEPROM_F08",
    -72: "EEPROM_F09",
    -73: "EEPROM_F10",
    -74: "EEPROM_F11",
}


def error_string(code: int) -> str:
    """Return the text of `HH_GetErrorString`; codes that do not exist have one too."""
    return f"HH_ERROR_{_NAMES.get(code, 'UNKNOWN')}"


class Code(IntEnum):
    """The codes that the simulator answers with."""

    DEVICE_OPEN_FAIL = -1
    DEVICE_BUSY = -2
    DEVICE_NOT_OPEN = -10
    INSTANCE_RUNNING = -16
    INVALID_ARGUMENT = -17
    INVALID_MODE = -18
    NOT_INITIALIZED = -22
    NOT_CALIBRATED = -23
    USB_VCMD_FAIL = -36
    #: Not a code of the vendor: a Python exception was remembered, see `HydraHarpSimulator.raise_pending`.
    EXCEPTION = -99


class Mode(IntEnum):
    """Measurement modes."""

    HISTOGRAM = 0
    T2 = 2
    T3 = 3
    CONTINUOUS = 8


class Flag(IntFlag):
    """Bits of `HH_GetFlags` that are simulated."""

    OVERFLOW = 0x01
    FIFOFULL = 0x02
    SYNC_LOST = 0x04
    REF_LOST = 0x08
    ACTIVE = 0x20


class Warn(IntFlag):
    """Bits of `HH_GetWarnings`."""

    SYNC_RATE_ZERO = 0x0001
    SYNC_RATE_TOO_HIGH = 0x0004
    INPT_RATE_ZERO = 0x0010
    INPT_RATE_TOO_HIGH = 0x0040
    INPT_RATE_RATIO = 0x0100
    DIVIDER_GREATER_ONE = 0x0200
    TIME_SPAN_TOO_SMALL = 0x0400
    OFFSET_UNNECESSARY = 0x0800


class Slot(Enum):
    """State of a device index."""

    CLOSED = "never opened, closed, or could not be opened"
    OPEN = "open"


DEVICES = 8
LONGEST_HISTOGRAM = 65536
BINNING_STEPS = 26
BASE_RESOLUTION_PS = 1.0
