"""Taps: counters in the wires of a simulated rig that put a fault into one exchange, or into all after it."""

import errno
from array import array
from ctypes import c_int
from dataclasses import dataclass, field
from random import Random
from typing import Any

from usb.core import USBError, USBTimeoutError

from simulators.wire.usb import UsbBackend

#: Codes of HHLib (source: the vendor's errorcodes.h): a command that was not taken, a USB time-out, and one
#: that no release knows.
USB_FAIL, USB_TIMEOUT, UNKNOWN_CODE = -37, -41, 1234


@dataclass(frozen=True)
class Fault:
    """What goes wrong.

    Attributes
    ----------
    kind
        ``raise``: the operating system or the library reports a broken line. ``time out``. ``drop``: the
        command or its answer is lost, or a call answers that all is well and does nothing. ``flip``: a bit is
        flipped. ``empty``: an answer of no bytes. ``twice``: sent or received twice. ``interrupt``:
        `KeyboardInterrupt`.
    lasting
        Whether the device stays so.
    times
        At how many exchanges in a row.
    """

    kind: str
    lasting: bool = False
    times: int = 1


@dataclass
class Tap:
    """Counts the exchanges of all wires; from exchange ``first`` on, the fault.

    Attributes
    ----------
    seen
        Device and operation of each exchange.
    """

    fault: Fault | None = None
    first: int = 0
    seen: list[tuple[str, str]] = field(default_factory=list)
    _device: str = ""
    _random: Random = field(default_factory=lambda: Random(0))

    def at(self, device: str, operation: str) -> str:
        """Count an exchange; return what goes wrong with it, empty for nothing."""
        self.seen.append((device, operation))
        after, fault = len(self.seen) - 1 - self.first, self.fault
        if fault is None or after < 0:
            return ""
        if after == 0:
            self._device, self._random = device, Random(self.first)
        if fault.lasting:
            return fault.kind if device == self._device else ""
        if after >= fault.times:
            return ""
        if fault.kind == "interrupt":
            raise KeyboardInterrupt
        return fault.kind

    @property
    def struck(self) -> tuple[str, str] | None:
        """Device and operation of the first exchange that went wrong."""
        return self.seen[self.first] if self.fault and self.first < len(self.seen) else None

    def flipped(self, data: bytes) -> bytes:
        """Return data with one bit flipped."""
        if not data:
            return data
        flipped = bytearray(data)
        flipped[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        return bytes(flipped)


class TappedUsb(UsbBackend):
    """A USB bus with a tap in its transfers."""

    def __init__(self, instruments: Any, tap: Tap) -> None:
        super().__init__(instruments)
        self._tap = tap

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: "array[int]", timeout: int) -> int:
        """Write one transfer."""
        kind = self._kind("bulk_write")
        if kind in ("drop", "empty"):
            return len(data)
        if kind == "flip":
            data = array("B", self._tap.flipped(data.tobytes()))
        if kind == "twice":
            super().bulk_write(dev_handle, ep, intf, data, timeout)
        return super().bulk_write(dev_handle, ep, intf, data, timeout)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: "array[int]", timeout: int) -> int:
        """Read one transfer."""
        kind = self._kind("bulk_read")
        if kind == "empty":
            return 0
        size = super().bulk_read(dev_handle, ep, intf, buff, timeout)
        return self._spoiled(kind, buff, size)

    def ctrl_transfer(
        self,
        dev_handle: Any,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: "array[int]",
        timeout: int,
    ) -> int:
        """Answer a control request."""
        kind = self._kind("ctrl_transfer")
        if kind == "empty":
            return 0
        size = super().ctrl_transfer(dev_handle, bmRequestType, bRequest, wValue, wIndex, data, timeout)
        return self._spoiled(kind, data, size)

    def clear_halt(self, dev_handle: Any, ep: int) -> None:
        """End a stall."""
        if self._kind("clear_halt") not in ("drop", "empty"):
            super().clear_halt(dev_handle, ep)

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        """Claim the interface."""
        self._kind("claim_interface")
        super().claim_interface(dev_handle, intf)

    def open_device(self, dev: Any) -> Any:
        """Open a device."""
        self._kind("open_device")
        return super().open_device(dev)

    def _kind(self, operation: str) -> str:
        kind = self._tap.at("spad", operation)
        if kind == "raise":
            raise USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
        if kind == "time out":
            raise _late()
        return kind

    def _spoiled(self, kind: str, data: "array[int]", size: int) -> int:
        if kind == "drop":
            raise _late()
        if kind == "flip":
            data[:size] = array("B", self._tap.flipped(data[:size].tobytes()))
        return size


def _late() -> USBTimeoutError:
    return USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)


class TappedLibrary:
    """The functions of HHLib with a tap in each call."""

    def __init__(self, functions: object, tap: Tap) -> None:
        for name in vars(functions):
            setattr(self, name, _TappedFunction(name, getattr(functions, name), tap))


class _TappedFunction:
    """One function; its types can be set as those of a ctypes pointer."""

    def __init__(self, name: str, function: Any, tap: Tap) -> None:
        self._name, self._function, self._tap = name, function, tap
        self.argtypes: Any = None
        self.restype: Any = c_int

    def __call__(self, *arguments: Any) -> int:
        kind = self._tap.at("tcspc", self._name)
        refused = {"raise": USB_FAIL, "time out": USB_TIMEOUT, "empty": USB_FAIL, "drop": 0}
        if kind in refused:
            return refused[kind]
        code = int(self._function(*arguments))
        if kind == "flip":
            return UNKNOWN_CODE
        return int(self._function(*arguments)) if kind == "twice" else code
