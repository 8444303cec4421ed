"""Opening the right one of the instruments that are connected."""

from drivers.errors import DeviceNotFoundError
from drivers.hydraharp.constants import MAX_DEVICES
from drivers.hydraharp.errors import ErrorCode, HydraHarpError
from drivers.hydraharp.library import HHLib


def open_by_serial(library: HHLib, serial: str | None) -> tuple[int, str]:
    """Open the instrument with this serial number, or the first that opens if ``serial`` is None.

    All others that had to be opened to learn their serial numbers are closed again.

    Returns
    -------
    tuple of int and str
        The index of the open instrument, and its serial number.

    Raises
    ------
    HydraHarpError
        If it was not found but an instrument is there that could not be opened, e.g. because another
        program uses it: that may be the one.
    DeviceNotFoundError
        If it is not connected.
    """
    others: list[str] = []
    unopened: HydraHarpError | None = None
    for index in range(MAX_DEVICES):
        try:
            found = library.open_device(index)
        except HydraHarpError as error:
            if error.code != ErrorCode.DEVICE_OPEN_FAIL:
                unopened = unopened or error
            continue
        if serial is None or found == serial:
            return index, found
        others.append(found)
        library.close_device(index)
    if unopened is not None:
        raise unopened
    there = f"only {', '.join(others)} can be opened" if others else "no HydraHarp is there"
    raise DeviceNotFoundError(
        f"HydraHarp {serial}" if serial else "HydraHarp",
        f"open it through {library.name}",
        there,
        "Check serial number, power and USB cable; "
        "on Linux a missing udev permission for USB vendor 0e0d looks the same.",
    )
