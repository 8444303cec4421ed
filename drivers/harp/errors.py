"""The exception that carries an error code of the vendor's library."""

from drivers.errors import DeviceError
from drivers.harp.family import Family

DEVICE_OPEN_FAIL = -1

_DEFECT = "This is a mistake in the calling program, not of the instrument; please report it."

#: What to do about an error, by its name; ``{...}`` are of the family.
_REMEDIES = {
    "DEVICE_OPEN_FAIL": "{absent}",
    "DEVICE_BUSY": (
        "Close the other program that uses it; after a crash, end the process that is left over, "
        "or {restart}."
    ),
    "DEVICE_LOCKED": "Another program uses the {name}: close it, or {restart}.",
    "DEVICE_VERSION_MISMATCH": "Install the firmware and library release that belong together.",
    "DEVICE_DRIVERVER_MISMATCH": "Install the driver and library release that belong together.",
    # the driver calls no index that it has not opened: an instrument that was open is gone
    "DEVICE_NOT_OPEN": "The instrument is no longer connected: {again}",
    "INSTANCE_RUNNING": "Stop the running measurement first.",
    "INVALID_ARGUMENT": _DEFECT,
    "INVALID_MODE": _DEFECT,
    "INVALID_MEMORY": _DEFECT,
    "NOT_INITIALIZED": _DEFECT,
    "NOT_CALIBRATED": _DEFECT,
    "WRONG_TRGMODE": _DEFECT,
    **{f"INVALID_ARGUMENT_{n}": _DEFECT for n in range(1, 10)},
    "UNSUPPORTED_FUNCTION": "This instrument cannot do that: check that its kind is the configured one.",
    "USB_HISPEED_FAIL": "Connect it to a USB 2.0 or faster port, without a slow hub in between.",
    "CALIB_FAIL": "Let the {name} warm up, then connect again.",
    "REFSEL_FAIL": "Check the 10 MHz signal at the reference input, or use the internal one.",
}


class HarpError(DeviceError):
    """Raised when a function of the library returns anything but zero.

    Parameters
    ----------
    family : Family
        Whose library it is.
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

    def __init__(self, family: Family, device: str, function: str, code: int) -> None:
        name, link = family.error_name(code), family.link
        again = f"{link.check}, {link.restart}, and connect again."
        remedy = _REMEDIES.get(name, "{Again}").format(
            absent=link.absent,
            restart=link.restart,
            name=family.name,
            again=again[0].lower() + again[1:],
            Again=again,
        )
        super().__init__(device, f"run {function}", f"it returned {code} ({name})", remedy)
        self.function = function
        self.code = code
        self.code_name = name
