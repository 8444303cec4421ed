"""A listener at the wire: hears the bytes and calls that pass between the drivers and their devices.

Lines that are opened inside `listening` tell what passes. The tap is in the library's own objects: pyserial's
port, pyusb's device, the vendor's functions. No driver knows of it, and without a listener there is none.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol

import serial


class Listener(Protocol):
    """Who hears; called at once, in the thread that sends or receives."""

    def serial(self, sent: bool, data: bytes) -> None:
        """Hear bytes that were written to a serial port or read from it."""
        ...

    def usb(self, sent: bool, data: bytes, request: tuple[int, ...] = ()) -> None:
        """Hear a bulk transfer, or what a control request (type, request, value, index, length) gave."""
        ...

    def call(self, name: str, arguments: tuple[Any, ...], answer: object) -> None:
        """Hear a call of a vendor's library: its name, its arguments after it, and what it returned."""
        ...


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let a listener hear all that passes on lines that are opened inside the block."""
    before = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(before)


def tapped_port(port: serial.SerialBase) -> serial.SerialBase:
    """Return the port, with a tap where somebody listens."""
    listener = _listener.get()
    return port if listener is None else _TappedPort(port, listener)


def tapped_usb(device: Any) -> Any:
    """Return the pyusb device, with a tap where somebody listens."""
    listener = _listener.get()
    return device if listener is None else _TappedUsb(device, listener)


def tapped_functions(functions: Any) -> Any:
    """Return the vendor's functions, with a tap where somebody listens."""
    listener = _listener.get()
    return functions if listener is None else _TappedFunctions(functions, listener)


class _Tapped:
    """Does what the tapped object does."""

    def __init__(self, tapped: Any, listener: Listener) -> None:
        self._tapped = tapped
        self._listener = listener

    def __getattr__(self, name: str) -> Any:
        return getattr(self._tapped, name)


class _TappedPort(_Tapped):
    """A port of pyserial."""

    def read(self, size: int = 1) -> bytes:
        """Read as the port does."""
        data = bytes(self._tapped.read(size))
        if data:
            self._listener.serial(False, data)
        return data

    def write(self, data: bytes) -> int | None:
        """Write as the port does."""
        self._listener.serial(True, bytes(data))
        written: int | None = self._tapped.write(data)
        return written


class _TappedUsb(_Tapped):
    """A device of pyusb."""

    def __iter__(self) -> Iterator[Any]:
        return iter(self._tapped)

    def write(self, endpoint: int, data: bytes, timeout: int | None = None) -> int:
        """Write as the device does."""
        self._listener.usb(True, bytes(data))
        return int(self._tapped.write(endpoint, data, timeout))

    def read(self, endpoint: int, size: int, timeout: int | None = None) -> Any:
        """Read as the device does."""
        data = self._tapped.read(endpoint, size, timeout)
        self._listener.usb(False, bytes(data))
        return data

    def ctrl_transfer(self, *request: Any) -> Any:
        """Ask as the device is asked; the last of ``request`` is the longest wait."""
        data = self._tapped.ctrl_transfer(*request)
        self._listener.usb(False, bytes(data), request[:5])
        return data


class _TappedFunctions:
    """The functions of a vendor's library."""

    def __init__(self, functions: Any, listener: Listener) -> None:
        self._functions = functions
        self._listener = listener

    def __getattr__(self, name: str) -> Any:
        return _TappedFunction(name, getattr(self._functions, name), self._listener)


class _TappedFunction:
    """One function of ctypes; its types are set as of the function itself."""

    def __init__(self, name: str, function: Any, listener: Listener) -> None:
        self.__dict__.update(_name=name, _function=function, _listener=listener)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.__dict__["_function"], name, value)

    def __call__(self, *arguments: Any) -> Any:
        answer = self.__dict__["_function"](*arguments)
        self.__dict__["_listener"].call(self.__dict__["_name"], arguments, answer)
        return answer
