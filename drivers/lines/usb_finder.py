"""Finding one USB instrument by what it is, never by where it is plugged in."""

import errno
import importlib
from typing import Any

import usb.control
import usb.core
import usb.util

from drivers.errors import DeviceNotFoundError, LinkError
from drivers.lines.usbtmc import tmc_interface

USB488_PROTOCOL = 1


def find_instrument(
    name: str, *, vendor_product: tuple[int, int], serial: str | None, backend: Any = None
) -> usb.core.Device:
    """Return the USB device with these identifiers, or else one of the USB488 class.

    Only descriptors are read, and strings only of devices that fit.

    Parameters
    ----------
    name
        What is looked for, for messages.
    vendor_product
        USB vendor and product identifiers that are looked for first.
    serial
        Its USB serial number; None takes the only one there is.
    backend
        A pyusb backend; None takes the system's libusb, or the one that the ``usb`` extra brings.

    Raises
    ------
    DeviceNotFoundError
        None fits, or several do; the message lists what was seen.
    LinkError
        A device that fits may not be opened.
    """
    asked = f"be found by USB {vendor_product[0]:04x}:{vendor_product[1]:04x} or the USB488 class"
    if serial is not None:
        asked += f" and serial number {serial}"
    try:
        devices = listed(backend)
    except usb.core.NoBackendError as problem:
        raise DeviceNotFoundError(
            name,
            asked,
            "the library libusb is missing",
            "Install it (Debian: sudo apt install libusb-1.0-0), or: pip install libusb-package.",
        ) from problem
    fitting = [d for d in devices if (d.idVendor, d.idProduct) == vendor_product]
    fitting = fitting or [d for d in devices if _is_usb488(d)]
    others = [d for d in devices if d not in fitting]
    numbered = [(device, _serial_number(device, name)) for device in fitting]
    found = [device for device, number in numbered if serial in (None, number)]
    if len(found) == 1:
        return found[0]
    seen = [_describe(device, number) for device, number in [*numbered, *((d, None) for d in others)]]
    raise DeviceNotFoundError(
        name,
        asked,
        (f"{len(found)} match among" if found else "none matches among")
        + f" {', '.join(seen) or 'no devices'}",
        "Give the serial number of the one to use." if found else "Check its power, cable and serial number.",
    )


def listed(backend: Any = None) -> list[usb.core.Device]:
    """Return all USB devices; only descriptors are read, nothing is opened.

    Raises
    ------
    usb.core.NoBackendError
        If libusb is missing.
    """
    return list(usb.core.find(find_all=True, backend=backend or _libusb_of_the_extra()))


def _libusb_of_the_extra() -> Any:
    """Return the backend that the ``usb`` extra brings, or None where it is not installed."""
    try:
        return importlib.import_module("libusb_package").get_libusb1_backend()
    except ImportError:
        return None


def _is_usb488(device: usb.core.Device) -> bool:
    try:
        interface = tmc_interface(device)
    except usb.core.USBError:  # some devices keep their descriptors to themselves
        return False
    return interface is not None and interface.bInterfaceProtocol == USB488_PROTOCOL


def _serial_number(device: usb.core.Device, name: str) -> str | None:
    """Return the serial number, or None where the device tells none."""
    try:
        number = _string(device)
    except usb.core.USBError as problem:
        if problem.errno == errno.EACCES:
            raise LinkError(
                f"{name} {_describe(device, None)}",
                "report its serial number",
                "permission was denied",
                "On Linux, add a udev rule for its USB identifiers.",
            ) from problem
        return None
    finally:
        usb.util.dispose_resources(device)
    return None if number is None else str(number)


def _string(device: usb.core.Device) -> str | None:
    """Return what pyusb says of the serial number.

    Where the list of languages cannot be read, pyusb says that there are none; asked directly, the device
    tells why.
    """
    try:
        return device.serial_number
    except ValueError:
        usb.control.get_descriptor(device, 254, usb.util.DESC_TYPE_STRING, 0)
        return None


def _describe(device: usb.core.Device, serial: str | None) -> str:
    described = f"{device.idVendor:04x}:{device.idProduct:04x}"
    return described if serial is None else f"{described} (serial {serial})"
