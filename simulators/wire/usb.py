"""A pyusb backend on whose bus only simulated instruments are plugged in.

Pass it as ``usb.core.find(backend=...)``; libusb is not needed. Only what pyusb asks of a backend for bulk
instruments is there.
"""

import errno
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from simulators.wire.tmc import BULK_IN, BULK_OUT, Identity, Interface, StallError, TmcInterface

#: USB class of test and measurement, and its USB488 protocol.
INTERFACE_CLASS = (0xFE, 0x03, 0x01)
PACKET = 512
US_ENGLISH = 0x0409

GET_DESCRIPTOR, STRING = 0x06, 0x03


class _Plug:
    """One instrument on the bus, and what the computer has done to it."""

    def __init__(self, instrument: Identity, tmc: Interface, address: int) -> None:
        self.instrument = instrument
        self.address = address
        self.tmc = tmc
        self.plugged = True
        self.kernel_driver = True  # as on Linux, where the module usbtmc takes such devices
        self.configured = 1
        self.claimed = False
        self.strings = (instrument.manufacturer, instrument.product, instrument.serial_number)


def _only(*indices: int) -> None:
    """Raise what pyusb takes for the end of a list, unless all ``indices`` are the first."""
    if any(indices):
        raise IndexError


def _there(plug: _Plug) -> _Plug:
    if not plug.plugged:
        raise USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
    return plug


def _string_descriptor(plug: _Plug, index: int) -> bytes:
    text = struct.pack("<H", US_ENGLISH) if index == 0 else plug.strings[index - 1].encode("utf-16-le")
    return bytes([2 + len(text), STRING]) + text


@contextmanager
def _stalls() -> Iterator[None]:
    try:
        yield
    except StallError:
        raise USBError("Pipe error", -9, errno.EPIPE) from None


class UsbBackend(IBackend):
    """The bus.

    Parameters
    ----------
    instruments
        What is plugged in.
    interface
        Makes the USBTMC interface in front of an instrument.
    """

    def __init__(
        self, instruments: Sequence[Identity], interface: Callable[[Any], Interface] = TmcInterface
    ) -> None:
        super().__init__()
        self._plugs = [_Plug(one, interface(one), 1 + i) for i, one in enumerate(instruments)]

    def unplug(self, instrument: Identity) -> None:
        """Pull an instrument's plug, also in the middle of a conversation."""
        for plug in self._plugs:
            if plug.instrument is instrument:
                plug.plugged = False

    def enumerate_devices(self) -> Iterator[_Plug]:
        """List what is plugged in."""
        return iter([plug for plug in self._plugs if plug.plugged])

    def get_device_descriptor(self, dev: _Plug) -> SimpleNamespace:
        """Describe a device."""
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=dev.instrument.vendor_id,
            idProduct=dev.instrument.product_id,
            bcdDevice=0x0100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3,
            bNumConfigurations=1,
            address=dev.address,
            bus=1,
            port_number=dev.address,
            port_numbers=(dev.address,),
            speed=3,
        )

    def get_configuration_descriptor(self, dev: _Plug, config: int) -> SimpleNamespace:
        """Describe the one configuration."""
        _only(config)
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=32,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=50,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: _Plug, intf: int, alt: int, config: int) -> SimpleNamespace:
        """Describe the one interface."""
        _only(intf, alt, config)
        interface_class, subclass, protocol = INTERFACE_CLASS
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=2,
            bInterfaceClass=interface_class,
            bInterfaceSubClass=subclass,
            bInterfaceProtocol=protocol,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, dev: _Plug, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """Describe one of the two bulk endpoints."""
        _only(intf, alt, config)
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=(BULK_OUT, BULK_IN)[ep],
            bmAttributes=2,
            wMaxPacketSize=PACKET,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: _Plug) -> _Plug:
        """Open a device; it is its own handle."""
        return _there(dev)

    def close_device(self, dev_handle: _Plug) -> None:
        """Close a device, which lets go of its interface."""
        dev_handle.claimed = False

    def set_configuration(self, dev_handle: _Plug, config_value: int) -> None:
        """Choose a configuration."""
        _there(dev_handle).configured = config_value

    def get_configuration(self, dev_handle: _Plug) -> int:
        """Return the configuration in force."""
        return _there(dev_handle).configured

    def claim_interface(self, dev_handle: _Plug, intf: int) -> None:
        """Claim the interface; refused while the kernel's own driver has it."""
        if _there(dev_handle).kernel_driver:
            raise USBError("Resource busy", -6, errno.EBUSY)
        dev_handle.claimed = True

    def release_interface(self, dev_handle: _Plug, intf: int) -> None:
        """Let go of the interface."""
        _there(dev_handle).claimed = False

    def is_kernel_driver_active(self, dev_handle: _Plug, intf: int) -> bool:
        """Tell whether the kernel's own driver has the interface."""
        return _there(dev_handle).kernel_driver

    def detach_kernel_driver(self, dev_handle: _Plug, intf: int) -> None:
        """Take the interface from the kernel's own driver."""
        _there(dev_handle).kernel_driver = False

    def clear_halt(self, dev_handle: _Plug, ep: int) -> None:
        """End a stall."""
        _there(dev_handle).tmc.clear_halt()

    def bulk_write(self, dev_handle: _Plug, ep: int, intf: int, data: "array[int]", timeout: int) -> int:
        """Write one transfer."""
        with _stalls():
            _there(dev_handle).tmc.bulk_out(data.tobytes())
        return len(data)

    def bulk_read(self, dev_handle: _Plug, ep: int, intf: int, buff: "array[int]", timeout: int) -> int:
        """Read one transfer; with nothing to say, the timeout passes on the instrument's clock."""
        piece = _there(dev_handle).tmc.bulk_in(len(buff))
        if piece is None:
            dev_handle.instrument.clock.sleep(timeout / 1e3)
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        buff[: len(piece)] = array("B", piece)
        return len(piece)

    def ctrl_transfer(
        self,
        dev_handle: _Plug,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: "array[int]",
        timeout: int,
    ) -> int:
        """Answer string descriptors and class requests."""
        _there(dev_handle)
        if (bmRequestType, bRequest, wValue >> 8) == (0x80, GET_DESCRIPTOR, STRING):
            answer = _string_descriptor(dev_handle, wValue & 0xFF)
        else:
            with _stalls():
                answer = dev_handle.tmc.control(bmRequestType, bRequest, wValue, wIndex, len(data))
        answer = answer[: len(data)]
        data[: len(answer)] = array("B", answer)
        return len(answer)
