"""A pyusb backend with one device whose transfers are a transcript.

Its endpoints and interface number are none of the usual ones, so that only a driver that reads the
descriptors finds them.
"""

import errno
import struct
from array import array
from types import SimpleNamespace

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from support.wire_script import Step

INTERFACE, OUT, IN = 1, 0x03, 0x85
#: The same, as a transcript of bulk transfers names them.
USB_WORDS = {"INTERFACE": f"{INTERFACE:04X}", "OUT": f"{OUT:04X}", "IN": f"{IN:04X}"}

_DEVICE = {
    "bLength": 18,
    "bDescriptorType": 1,
    "bcdUSB": 0x0200,
    "bDeviceClass": 0,
    "bDeviceSubClass": 0,
    "bDeviceProtocol": 0,
    "bMaxPacketSize0": 64,
    "bcdDevice": 0,
    "iManufacturer": 0,
    "iProduct": 0,
    "iSerialNumber": 0,
    "bNumConfigurations": 1,
    "address": 1,
    "bus": 1,
    "port_number": 1,
    "port_numbers": (1,),
    "speed": 3,
}


class ScriptedUsb(IBackend):
    """Plays ``steps``; a bulk-in step without data and a step ``late`` are timeouts."""

    def __init__(self, steps, *, vendor=0x1DDC, product=0x0330, tmc=True, packet=64):
        super().__init__()
        self.steps, self.wrong, self.tmc, self.packet = list(steps), "", tmc, packet
        self.vendor, self.product = vendor, product
        self.kernel_driver, self.claims, self.halts_cleared = True, 0, []

    def finish(self):
        assert not self.wrong, self.wrong
        assert not self.steps, f"never asked for: {self.steps[0]}"

    def _next(self, kind, **came):
        step = self.steps.pop(0) if self.steps else Step("end")
        if step.kind != kind or any(getattr(step, name) != value for name, value in came.items()):
            self.wrong = self.wrong or f"{kind} {came} came instead of {step}"
            raise AssertionError(self.wrong)
        return step.data

    def enumerate_devices(self):
        return iter(["the device"])

    def get_device_descriptor(self, dev):
        return SimpleNamespace(**_DEVICE, idVendor=self.vendor, idProduct=self.product)

    def get_configuration_descriptor(self, dev, config):
        if config:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=0, bNumInterfaces=2, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0x80, bMaxPower=50, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev, intf, alt, config):
        if intf > 1 or alt:
            raise IndexError
        tmc = self.tmc and intf == INTERFACE
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=intf, bAlternateSetting=0,
            bNumEndpoints=3 if tmc else 2,
            bInterfaceClass=0xFE if tmc else 0xFF, bInterfaceSubClass=3 if tmc else 0,
            bInterfaceProtocol=1 if tmc else 0, iInterface=0, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev, ep, intf, alt, config):
        addresses = [(IN, 2), (0x86, 3), (OUT, 2)] if intf == INTERFACE else [(0x01, 2), (0x82, 2)]
        address, kind = addresses[ep]
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address, bmAttributes=kind,
            wMaxPacketSize=self.packet, bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev):
        return dev

    def close_device(self, handle):
        pass

    def get_configuration(self, handle):
        return 1

    def claim_interface(self, handle, intf):
        if self.kernel_driver:
            raise USBError("Resource busy", -6, errno.EBUSY)
        assert intf == INTERFACE
        self.claims += 1

    def release_interface(self, handle, intf):
        self.claims -= 1

    def is_kernel_driver_active(self, handle, intf):
        return self.kernel_driver

    def detach_kernel_driver(self, handle, intf):
        self.kernel_driver = False

    def clear_halt(self, handle, ep):
        self.halts_cleared.append(ep)

    def bulk_write(self, handle, ep, intf, data, timeout):
        assert (ep, intf) == (OUT, INTERFACE)
        if self.steps and self.steps[0].kind == "late":
            self._next("late")
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        self._next(">", data=data.tobytes())
        return len(data)

    def bulk_read(self, handle, ep, intf, buff, timeout):
        assert (ep, intf) == (IN, INTERFACE)
        data = self._next("<")
        if not data:
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        buff[: len(data)] = array("B", data)
        return len(data)

    def ctrl_transfer(self, handle, kind, request, value, index, data, timeout):
        answer = self._next("control", control=(kind, request, value, index, len(data)))
        data[: len(answer)] = array("B", answer)
        return len(answer)


def framed(steps):
    """Wrap a transcript of text lines into bulk transfers, tags counted from 1."""
    transfers = []
    for tag, step in enumerate(steps, 1):
        head = bytes([2 if step.kind == "<" else 1, tag, 255 - tag, 0])
        if step.kind == ">":
            padding = bytes(-len(step.data) % 4)
            body = struct.pack("<IB3x", len(step.data), 1) + step.data + padding
            transfers.append(Step(">", head + body))
        else:
            transfers.append(Step(">", head + struct.pack("<IB3x", 4096, 0)))
            transfers.append(Step("<", head + struct.pack("<IB3x", len(step.data), 1) + step.data))
    return transfers
