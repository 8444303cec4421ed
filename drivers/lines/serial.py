"""Lines of text over a serial port: one command out, one answer back, and in step again after garbage."""

import errno
import os
from types import TracebackType
from typing import NoReturn

import serial
from serial.serialutil import Timeout

from drivers.errors import DeviceNotFoundError, LinkError
from drivers.lines.listening import tapped_port

#: No answer of the devices here is longer; more bytes without a terminator are garbage.
MAX_LINE_BYTES = 4096

#: After something went wrong, at most this many pieces of garbage are thrown away before giving up.
MAX_GARBAGE = 16


class SerialLine:
    """A line-oriented conversation over `serial.serial_for_url`.

    Parameters
    ----------
    address
        Anything that pyserial opens: ``/dev/ttyACM0``, ``COM3``, ``socket://host:port``, ...
    device
        What is expected there, for messages, e.g. ``"steering mirror"``.
    baudrate
        Line speed; 8 data bits, no parity, 1 stop bit, no flow control.
    terminator
        Ends every command and every answer.
    timeout_s
        Longest wait for a whole answer, and for a command to leave.
    """

    def __init__(
        self, address: str, *, device: str, baudrate: int, terminator: bytes, timeout_s: float
    ) -> None:
        self.name = f"{device} at {address}"
        self._address = address
        self._baudrate = baudrate
        self._terminator = terminator
        self._timeout_s = timeout_s
        self._port: serial.SerialBase | None = None
        self._unread = bytearray()
        self._in_step = True

    def open(self) -> None:
        """Open the port.

        Raises
        ------
        DeviceNotFoundError
            Nothing is at the address.
        LinkError
            The port exists but cannot be used: permissions, or another program uses it.
        """
        try:
            port = serial.serial_for_url(
                self._address,
                baudrate=self._baudrate,
                timeout=self._timeout_s,
                write_timeout=self._timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError) as problem:
            raise cannot_open(self.name, problem) from problem
        self._port = tapped_port(port)
        self._in_step = True

    def close(self) -> None:
        """Close the port; safe to call at any time."""
        if self._port is None:
            return
        try:
            with self._mapped("close the port") as port:
                port.close()
        finally:
            self._port = None

    def send(self, message: bytes) -> None:
        """Throw away what was left unread, then send ``message`` as it is.

        Raises
        ------
        LinkError
            The wire broke, or the device does not take the bytes.
        """
        with self._mapped(f"send {message!r}") as port:
            self._unread.clear()
            if not self._in_step:
                self._drain(port)
            elif port.in_waiting:
                port.read(port.in_waiting)
            port.write(message)

    def receive(self, asked: str, terminator: bytes | None = None) -> bytes:
        """Return one answer without its terminator.

        Parameters
        ----------
        asked
            The question, for messages.
        terminator
            Ends this answer, where it is another one than usual.

        Raises
        ------
        LinkError
            The wire broke, or no whole answer came in time.
        """
        ends = terminator or self._terminator
        late = Timeout(self._timeout_s)  # so that a device that trickles bytes cannot hold us for ever
        with self._mapped(asked) as port:
            while ends not in self._unread and len(self._unread) < MAX_LINE_BYTES:
                piece = port.read(port.in_waiting or 1)
                self._unread += piece
                if not piece or late.expired():
                    break
        line, ended, rest = self._unread.partition(ends)
        if ended:
            self._unread = rest
            return bytes(line)
        self.lost_step()
        came = f"only {bytes(line)!r} came" if line else "no answer came"
        raise LinkError(
            self.name,
            asked,
            f"{came} in {self._timeout_s:g} s",
            "Check that the device is powered and that no other program talks to it.",
        )

    def ask(self, command: str) -> str:
        """Send a command and return its answer, both without terminator.

        Raises
        ------
        LinkError
            See `send` and `receive`.
        """
        self.send(command.encode("ascii") + self._terminator)
        return self.receive(f"answer {command!r}").decode("ascii", "backslashreplace")

    def tell(self, command: str) -> None:
        """Send a command that may stay unanswered."""
        self.send(command.encode("ascii") + self._terminator)

    def pending(self) -> str:
        """Return, without waiting, what has come and was not asked for."""
        with self._mapped("read what is pending") as port:
            self._unread += port.read(port.in_waiting)
        text = self._unread.decode("ascii", "backslashreplace")
        self._unread.clear()
        return text

    def lost_step(self) -> None:
        """Remember that answers may come late: the line must fall silent before the next command."""
        self._in_step = False

    def _drain(self, port: serial.SerialBase) -> None:
        """Read until nothing comes for one timeout."""
        for _ in range(MAX_GARBAGE):
            if not port.read(MAX_LINE_BYTES):
                self._in_step = True
                return
        raise LinkError(
            self.name,
            "stop sending",
            "it sends without being asked",
            "Check the line speed, and that this is the right device; switch it off and on.",
        )

    def _mapped(self, asked: str) -> "_Mapped":
        """Give the open port, and turn every failure of the serial library into a `LinkError`."""
        if self._port is None:
            raise LinkError(self.name, asked, "the port is not open", "Use the device inside its with block.")
        return _Mapped(self, self._port, asked)

    def broken(self, asked: str, problem: OSError) -> NoReturn:
        """Raise what a failure of the port means."""
        self.lost_step()
        if isinstance(problem, serial.SerialTimeoutException):
            raise LinkError(
                self.name,
                asked,
                "it did not accept the bytes in time",
                "Check cable, flow control and power.",
            ) from problem
        raise LinkError(
            self.name, asked, f"the connection broke: {problem}", "Check the cable and plug it in again."
        ) from problem


def cannot_open(name: str, problem: OSError | ValueError) -> DeviceNotFoundError | LinkError:
    """Return what it means that pyserial cannot open the port of a device, whose name has its address."""
    asked = "open the port"
    said = problem, problem.__context__  # pyserial repeats what the system said, with its number or without
    codes = [one.errno for one in said if isinstance(one, OSError) and one.errno]
    code = codes[0] if codes else None
    if code in (errno.EACCES, errno.EPERM):
        return LinkError(
            name, asked, "permission was denied", "On Linux, join the group of the port (dialout)."
        )
    if code in (errno.EBUSY, errno.EAGAIN):
        return LinkError(name, asked, "another program uses it", "Close the other program.")
    why = "" if code == errno.ENOENT else f" ({os.strerror(code) if code else problem})"
    return DeviceNotFoundError(
        name, asked, f"there is no such port{why}", "Check power, cable and the address in the configuration."
    )


class _Mapped:
    """Maps failures of a port; a class, since a generator costs more than the rest of a simulated answer."""

    __slots__ = ("_asked", "_line", "_port")

    def __init__(self, line: SerialLine, port: serial.SerialBase, asked: str) -> None:
        self._line, self._port, self._asked = line, port, asked

    def __enter__(self) -> serial.SerialBase:
        return self._port

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(problem, OSError):  # SerialException is one
            self._line.broken(self._asked, problem)
