"""The error codes of HHLib and the one exception that carries them."""

from enum import IntEnum

from drivers.errors import DeviceError


class ErrorCode(IntEnum):
    """Error codes (source: HHLib 3.0 header; DEVICE_LOCKED is in the library but missing from the header)."""

    NONE = 0
    DEVICE_OPEN_FAIL = -1
    DEVICE_BUSY = -2
    DEVICE_HEVENT_FAIL = -3
    DEVICE_CALLBSET_FAIL = -4
    DEVICE_BARMAP_FAIL = -5
    DEVICE_CLOSE_FAIL = -6
    DEVICE_RESET_FAIL = -7
    DEVICE_GETVERSION_FAIL = -8
    DEVICE_VERSION_MISMATCH = -9
    DEVICE_NOT_OPEN = -10
    DEVICE_LOCKED = -11
    INSTANCE_RUNNING = -16
    INVALID_ARGUMENT = -17
    INVALID_MODE = -18
    INVALID_OPTION = -19
    INVALID_MEMORY = -20
    INVALID_RDATA = -21
    NOT_INITIALIZED = -22
    NOT_CALIBRATED = -23
    DMA_FAIL = -24
    XTDEVICE_FAIL = -25
    FPGACONF_FAIL = -26
    IFCONF_FAIL = -27
    FIFORESET_FAIL = -28
    USB_GETDRIVERVER_FAIL = -32
    USB_DRIVERVER_MISMATCH = -33
    USB_GETIFINFO_FAIL = -34
    USB_HISPEED_FAIL = -35
    USB_VCMD_FAIL = -36
    USB_BULKRD_FAIL = -37
    USB_RESET_FAIL = -38
    LANEUP_TIMEOUT = -40
    DONEALL_TIMEOUT = -41
    MODACK_TIMEOUT = -42
    MACTIVE_TIMEOUT = -43
    MEMCLEAR_FAIL = -44
    MEMTEST_FAIL = -45
    CALIB_FAIL = -46
    REFSEL_FAIL = -47
    STATUS_FAIL = -48
    MODNUM_FAIL = -49
    DIGMUX_FAIL = -50
    MODMUX_FAIL = -51
    MODFWPCB_MISMATCH = -52
    MODFWVER_MISMATCH = -53
    MODPROPERTY_MISMATCH = -54
    INVALID_MAGIC = -55
    INVALID_LENGTH = -56
    RATE_FAIL = -57
    MODFWVER_TOO_LOW = -58
    MODFWVER_TOO_HIGH = -59
    EEPROM_F01 = -64
    EEPROM_F02 = -65
    EEPROM_F03 = -66
    EEPROM_F04 = -67
    EEPROM_F05 = -68
    EEPROM_F06 = -69
    EEPROM_F07 = -70
    EEPROM_F08 = -71
    EEPROM_F09 = -72
    EEPROM_F10 = -73
    EEPROM_F11 = -74


_RECONNECT = "Check the USB cable and port, switch the HydraHarp off and on, and connect again."
_DEFECT = "This is a mistake in the calling program, not of the instrument; please report it."

REMEDIES = {
    ErrorCode.DEVICE_OPEN_FAIL: (
        "Switch the HydraHarp on and connect it; "
        "on Linux a missing udev permission for USB vendor 0e0d looks the same."
    ),
    ErrorCode.DEVICE_BUSY: (
        "Close the other program that uses it; after a crash, end the process that is left over, "
        "or switch the instrument off and on."
    ),
    ErrorCode.DEVICE_LOCKED: (
        "Another program holds the HydraHarp: close it, or switch the instrument off and on."
    ),
    ErrorCode.DEVICE_VERSION_MISMATCH: "Install the firmware and library release that belong together.",
    # the driver calls no index that it has not opened: an instrument that was open is gone
    ErrorCode.DEVICE_NOT_OPEN: "The instrument is gone: " + _RECONNECT[0].lower() + _RECONNECT[1:],
    ErrorCode.INSTANCE_RUNNING: "Stop the running measurement first.",
    ErrorCode.INVALID_ARGUMENT: _DEFECT,
    ErrorCode.INVALID_MODE: _DEFECT,
    ErrorCode.INVALID_MEMORY: _DEFECT,
    ErrorCode.NOT_INITIALIZED: _DEFECT,
    ErrorCode.NOT_CALIBRATED: _DEFECT,
    ErrorCode.USB_HISPEED_FAIL: "Connect it to a USB 2.0 or faster port, without a slow hub in between.",
    ErrorCode.CALIB_FAIL: "Let the HydraHarp warm up, then connect again.",
    ErrorCode.REFSEL_FAIL: "Check the 10 MHz signal at the reference input, or use the internal one.",
}


def code_name(code: int) -> str:
    """Return the vendor's name of an error code without its ``HH_ERROR_`` prefix, or ``UNKNOWN``."""
    try:
        return ErrorCode(code).name
    except ValueError:
        return "UNKNOWN"


class HydraHarpError(DeviceError):
    """Raised when a function of the library returns anything but zero.

    Parameters
    ----------
    device : str
        The instrument and the library that it is reached through.
    function : str
        The C function and its arguments, e.g. ``"HH_SetBinning(0, 2)"``.
    code : int
        What it returned. A positive number is an error too: the documented codes are zero or negative.

    Attributes
    ----------
    function, code
        As given.
    code_name : str
        The vendor's name of the code.
    """

    def __init__(self, device: str, function: str, code: int) -> None:
        name = code_name(code)
        remedy = REMEDIES.get(ErrorCode(code), _RECONNECT) if name != "UNKNOWN" else _RECONNECT
        super().__init__(device, f"run {function}", f"it returned {code} ({name})", remedy)
        self.function = function
        self.code = code
        self.code_name = name
