"""Messages to and from an instrument of the USB Test and Measurement Class, over pyusb.

Source: USBTMC specification 1.0 and its USB488 subclass 1.0.
"""

import errno
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import TypeVar

import usb.core
import usb.util

from drivers.clock import Clock
from drivers.errors import DeviceError, LinkError, ProtocolError
from drivers.lines.listening import tapped_usb

APPLICATION_CLASS = 0xFE
TMC_SUBCLASS = 0x03

INITIATE_ABORT_BULK_OUT = 1
CHECK_ABORT_BULK_OUT_STATUS = 2
INITIATE_ABORT_BULK_IN = 3
CHECK_ABORT_BULK_IN_STATUS = 4
INITIATE_CLEAR = 5
CHECK_CLEAR_STATUS = 6
GET_CAPABILITIES = 7

STATUS_SUCCESS = 1
STATUS_PENDING = 2

TO_INTERFACE = 0xA1
TO_ENDPOINT = 0xA2

# Frames: 12-byte headers, tags, and padding to four bytes.
HEADER_SIZE = 12

DEV_DEP_MSG_OUT = 1
DEV_DEP_MSG_IN = 2

END_OF_MESSAGE = 0x01

_HEADER = struct.Struct("<BBBxIB3x")

Transferred = TypeVar("Transferred")

#: Asked for in one request; a longer answer comes in several frames.
MAX_BYTES = 4096
#: No instrument here says more in one message; one that goes on is talking nonsense.
MAX_MESSAGE = 1 << 20

#: How often a pending clear or abort is asked about, and how long between.
MAX_CHECKS = 50
CHECK_EVERY_S = 0.01


class FrameError(ValueError):
    """Raised when bytes are not the frame they should be; the text says what is wrong."""


@dataclass(frozen=True)
class Answer:
    """One bulk-in frame: its payload, and whether the message ends with it."""

    payload: bytes
    end_of_message: bool


def next_tag(tag: int) -> int:
    """Return the tag after ``tag``: 1 to 255, then 1 again."""
    return tag % 255 + 1


def message_out(tag: int, payload: bytes, *, end_of_message: bool = True) -> bytes:
    """Frame ``payload`` for the bulk-out endpoint."""
    attributes = END_OF_MESSAGE if end_of_message else 0
    header = _HEADER.pack(DEV_DEP_MSG_OUT, tag, ~tag & 0xFF, len(payload), attributes)
    return header + payload + bytes(-len(payload) % 4)


def request_in(tag: int, most: int) -> bytes:
    """Frame the request for at most ``most`` bytes of answer."""
    return _HEADER.pack(DEV_DEP_MSG_IN, tag, ~tag & 0xFF, most, 0)


def announced_size(frame: bytes) -> int:
    """Return the payload size that the header of a bulk-in frame announces.

    Raises
    ------
    FrameError
        The bytes are too few for a header.
    """
    if len(frame) < HEADER_SIZE:
        raise FrameError(f"{len(frame)} bytes are too few for a header")
    return int(_HEADER.unpack_from(frame)[3])


def parse_answer(frame: bytes, tag: int) -> Answer:
    """Take a whole bulk-in frame apart.

    Parameters
    ----------
    frame
        Header, payload and any padding.
    tag
        Tag of the request that it answers.

    Raises
    ------
    FrameError
        It is cut short, or it answers another request.
    """
    size = announced_size(frame)
    kind, came, inverted, _, attributes = _HEADER.unpack_from(frame)
    if kind != DEV_DEP_MSG_IN:
        raise FrameError(f"message type {kind} came instead of {DEV_DEP_MSG_IN}")
    if inverted != ~came & 0xFF:
        raise FrameError(f"tag {came} came with the inverse {inverted}")
    if came != tag:
        raise FrameError(f"it answers request {came} instead of {tag}")
    if len(frame) < HEADER_SIZE + size:
        raise FrameError(f"it announces {size} bytes and has {len(frame) - HEADER_SIZE}")
    return Answer(frame[HEADER_SIZE : HEADER_SIZE + size], bool(attributes & END_OF_MESSAGE))


def tmc_interface(device: usb.core.Device) -> usb.core.Interface | None:
    """Return the device's USBTMC interface, or None; reads descriptors only."""
    for configuration in device:
        found = usb.util.find_descriptor(
            configuration, bInterfaceClass=APPLICATION_CLASS, bInterfaceSubClass=TMC_SUBCLASS
        )
        if found is not None:
            return found
    return None


class UsbTmc:
    """Whole messages over one USBTMC interface.

    Parameters
    ----------
    device
        A pyusb device that has such an interface.
    name
        The instrument and where it is, for messages.
    clock
        The time to wait by.
    timeout_s
        Longest wait for one transfer.

    Attributes
    ----------
    usb488
        Whether the interface says that it follows USB488.
    """

    def __init__(self, device: usb.core.Device, *, name: str, clock: Clock, timeout_s: float) -> None:
        self.name = name
        self.usb488 = False
        self._device = tapped_usb(device)
        self._clock = clock
        self._timeout_ms = ceil(timeout_s * 1e3)
        self._tag = 0

    def open(self) -> None:
        """Claim the interface, take it from the kernel's own driver if need be, and clear it.

        Raises
        ------
        LinkError
            It cannot be claimed, or does not answer.
        ProtocolError
            It has no USBTMC interface, or does not complete a clear.
        """
        with self._mapped("open"):
            interface = tmc_interface(self._device)
            if interface is None:
                raise self._nonsense("open", "it has no USBTMC interface")
            self._interface = interface.bInterfaceNumber
            with suppress(NotImplementedError):  # only Linux has such drivers
                if self._device.is_kernel_driver_active(self._interface):
                    self._device.detach_kernel_driver(self._interface)
            self._configure()
            usb.util.claim_interface(self._device, self._interface)
            self._out = self._endpoint(interface, usb.util.ENDPOINT_OUT)
            self._in = self._endpoint(interface, usb.util.ENDPOINT_IN)
            capabilities = self._control(TO_INTERFACE, GET_CAPABILITIES, 0, self._interface, 24)
            # Bytes 14 and 15 belong to USB488; another subclass leaves them zero.
            self.usb488 = interface.bInterfaceProtocol == 1 and len(capabilities) >= 16
            self.clear()

    def close(self) -> None:
        """Release the device; safe to call at any time."""
        with self._mapped("close"):
            usb.util.dispose_resources(self._device)

    def write(self, message: bytes) -> None:
        """Send one message.

        Raises
        ------
        LinkError
            The instrument does not take it in time, or is gone.
        """
        self._tag = next_tag(self._tag)
        with self._mapped(f"take {message!r}", abort=self._abort_out):
            frame = message_out(self._tag, message)
            self._unstalled(lambda: self._device.write(self._out, frame, self._timeout_ms))

    def read(self, asked: str) -> bytes:
        """Return one whole message, however many frames it takes.

        Parameters
        ----------
        asked
            The question, for messages.

        Raises
        ------
        LinkError
            Nothing came in time, or the instrument is gone.
        ProtocolError
            What came is no USBTMC frame.
        """
        message = b""
        with self._mapped(asked, abort=self._abort_in):
            while True:
                self._tag = next_tag(self._tag)
                request = request_in(self._tag, MAX_BYTES)
                self._unstalled(partial(self._device.write, self._out, request, self._timeout_ms))
                try:
                    answer = parse_answer(self._read_frame(), self._tag)
                    if not answer.payload and not answer.end_of_message:
                        raise FrameError("an empty frame came that ends no message")
                    if len(message) + len(answer.payload) > MAX_MESSAGE:
                        raise FrameError(f"a message of more than {MAX_MESSAGE} bytes came")
                except FrameError as problem:
                    self.clear()
                    raise self._nonsense(asked, str(problem)) from problem
                message += answer.payload
                if answer.end_of_message:
                    return message

    def clear(self) -> None:
        """Throw away all that is under way on both sides.

        Raises
        ------
        LinkError, ProtocolError
            The instrument does not answer, or does not complete the clear.
        """
        asked = "clear its buffers"
        with self._mapped(asked):
            status = self._control(TO_INTERFACE, INITIATE_CLEAR, 0, self._interface, 1)
            if status[0] != STATUS_SUCCESS:
                raise self._nonsense(asked, f"status 0x{status[0]:02X} came")
            for _ in range(MAX_CHECKS):
                status = self._control(TO_INTERFACE, CHECK_CLEAR_STATUS, 0, self._interface, 2)
                if status[0] != STATUS_PENDING:
                    break
                if status[1] & 1:
                    self._empty_in()
                self._clock.sleep(CHECK_EVERY_S)
            if status[0] != STATUS_SUCCESS:
                raise self._nonsense(asked, f"status 0x{status[0]:02X} came")
            self._device.clear_halt(self._out)

    def _configure(self) -> None:
        """Set the first configuration unless one is set: setting it again would reset the device."""
        try:
            self._device.get_active_configuration()
        except usb.core.USBError:
            self._device.set_configuration()

    def _endpoint(self, interface: usb.core.Interface, direction: int) -> int:
        endpoint = usb.util.find_descriptor(
            interface,
            custom_match=lambda e: (
                usb.util.endpoint_direction(e.bEndpointAddress) == direction
                and usb.util.endpoint_type(e.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
            ),
        )
        if endpoint is None:
            raise self._nonsense("open", "a bulk endpoint is missing")
        if direction == usb.util.ENDPOINT_IN:
            self._packet = int(endpoint.wMaxPacketSize)
            if self._packet < 1:
                raise self._nonsense("open", f"its packets have {self._packet} bytes")
        return int(endpoint.bEndpointAddress)

    def _read_frame(self) -> bytes:
        """Read transfers until the frame is as long as its header says."""
        # A whole number of packets, so that no packet can overflow the buffer.
        most = ceil((HEADER_SIZE + MAX_BYTES + 3) / self._packet) * self._packet
        frame = bytes(self._unstalled(lambda: self._device.read(self._in, most, self._timeout_ms)))
        if announced_size(frame) > MAX_BYTES:
            raise FrameError(f"it announces {announced_size(frame)} bytes where {MAX_BYTES} were asked for")
        while len(frame) < HEADER_SIZE + announced_size(frame):
            piece = bytes(self._device.read(self._in, most, self._timeout_ms))
            if not piece:
                break
            frame += piece
        return frame

    def _unstalled(self, transfer: Callable[[], Transferred]) -> Transferred:
        """Do a transfer; one that stalled is done once more, after the halt was cleared.

        An instrument halts an endpoint when what came was garbled on the way (USBTMC 1.0, 3.2.2.3), and takes
        nothing more until the halt is cleared. What stalled was not taken, so that nothing is done twice.
        """
        try:
            return transfer()
        except usb.core.USBError as stalled:
            if stalled.errno != errno.EPIPE:
                raise
            self._device.clear_halt(self._out)
            self._device.clear_halt(self._in)
            return transfer()

    def _control(self, to: int, request: int, value: int, index: int, size: int) -> bytes:
        answer = bytes(self._device.ctrl_transfer(to, request, value, index, size, self._timeout_ms))
        if not answer or (len(answer) < size and request != GET_CAPABILITIES):
            raise self._nonsense(f"answer class request {request}", f"{len(answer)} of {size} bytes came")
        return answer

    def _abort_out(self) -> None:
        if self._control(TO_ENDPOINT, INITIATE_ABORT_BULK_OUT, self._tag, self._out, 2)[0] != STATUS_SUCCESS:
            return
        for _ in range(MAX_CHECKS):
            status = self._control(TO_ENDPOINT, CHECK_ABORT_BULK_OUT_STATUS, 0, self._out, 8)[0]
            if status != STATUS_PENDING:
                break
            self._clock.sleep(CHECK_EVERY_S)
        self._device.clear_halt(self._out)

    def _abort_in(self) -> None:
        if self._control(TO_ENDPOINT, INITIATE_ABORT_BULK_IN, self._tag, self._in, 2)[0] != STATUS_SUCCESS:
            return
        self._empty_in()
        for _ in range(MAX_CHECKS):
            status = self._control(TO_ENDPOINT, CHECK_ABORT_BULK_IN_STATUS, 0, self._in, 8)
            if status[0] != STATUS_PENDING:
                break
            if status[1] & 1:
                self._empty_in()
            self._clock.sleep(CHECK_EVERY_S)

    def _empty_in(self) -> None:
        """Read until a short packet ends what the instrument still had to say, a whole message at most."""
        with suppress(usb.core.USBTimeoutError):
            for _ in range(ceil(MAX_MESSAGE / self._packet)):
                if len(self._device.read(self._in, self._packet, self._timeout_ms)) < self._packet:
                    break

    @contextmanager
    def _mapped(self, asked: str, abort: Callable[[], None] | None = None) -> Iterator[None]:
        """Turn every failure of the USB library into one of ours; abort a transfer that came too late."""
        try:
            yield
        except usb.core.USBTimeoutError as problem:
            late = LinkError(
                self.name,
                asked,
                f"no answer came in {self._timeout_ms / 1e3:g} s",
                "Check that it is powered; the command may be unknown to it.",
            )
            if abort is not None:
                try:
                    with self._mapped("abort the transfer"):
                        abort()
                except DeviceError as failure:
                    late.add_note(str(failure))
            raise late from problem
        except usb.core.USBError as problem:
            raise self._broken(asked, problem) from problem

    def _broken(self, asked: str, problem: usb.core.USBError) -> LinkError:
        what, remedy = {
            errno.ENODEV: ("it was unplugged", "Plug it in again and connect again."),
            errno.EACCES: ("permission was denied", "On Linux, add a udev rule for its USB identifiers."),
            errno.EBUSY: ("another program uses it", "Close the other program."),
            errno.EPIPE: ("it stalled", "The command may be unknown to it; connect again."),
        }.get(problem.errno, (f"the connection broke: {problem}", "Check the cable and connect again."))
        return LinkError(self.name, asked, what, remedy)

    def _nonsense(self, asked: str, answered: str) -> ProtocolError:
        return ProtocolError(
            self.name, asked, answered, "Connect again; check that it is a USBTMC instrument."
        )
