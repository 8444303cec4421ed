"""The conversation with a SuperK mainboard: registers read and written."""

from drivers.clock import Clock
from drivers.errors import LinkError, ProtocolError, RefusedError
from drivers.lines.serial import SerialLine
from drivers.nkt.registers import MAINBOARD
from drivers.nkt.telegram import END, Kind, Telegram, TelegramError, decoded, encoded

BAUD = 115200

#: The computer's addresses, one for each question in turn, so that a late answer names an earlier question.
HOSTS = range(0xA1, 0x100)

#: A question without a good answer is asked again: published drivers find one in some hundred unanswered.
TRIES = 3
#: Time that a busy module is given.
BUSY_S = 0.05
#: Telegrams that may come before the answer.
MAX_LATE = 16


class NktBus:
    """Registers over the laser's serial line.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    timeout_s
        Longest wait for one answer.
    """

    def __init__(self, address: str, *, clock: Clock, timeout_s: float) -> None:
        self._line = SerialLine(
            address, device="laser", baudrate=BAUD, terminator=bytes([END]), timeout_s=timeout_s
        )
        self._clock = clock
        self._asked = 0
        self.name = self._line.name
        self.open = self._line.open
        self.close = self._line.close

    def read(self, register: int) -> int:
        """Return the number that a register holds.

        Raises
        ------
        RefusedError
            The laser has no such register.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        data = self.read_bytes(register)
        if not data:
            raise ProtocolError(
                self.name, f"read register {register:02X}", "the register is empty", "Ask again."
            )
        return int.from_bytes(data, "little")

    def read_bytes(self, register: int) -> bytes:
        """Return what a register holds; raises as `read`."""
        return self._exchange(Kind.READ, register, b"", TRIES).data

    def write(self, register: int, number: int, size: int = 1, *, tries: int = TRIES) -> None:
        """Write a number of ``size`` bytes into a register; raises as `read`."""
        self._exchange(Kind.WRITE, register, number.to_bytes(size, "little"), tries)

    def set(self, register: int, number: int, size: int = 1) -> None:
        """Write a number and verify by reading it back.

        Raises
        ------
        RefusedError
            The laser kept another number, or does not take it.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        self.write(register, number, size)
        kept = self.read(register)
        if kept != number:
            raise RefusedError(
                self.name,
                f"set register {register:02X} to {number}",
                f"it kept {kept}",
                "Check the laser's front panel and limits.",
            )

    def _exchange(self, kind: Kind, register: int, data: bytes, tries: int) -> Telegram:
        asked = f"{kind.name.lower()} register {register:02X}"
        for left in reversed(range(tries)):
            try:
                reply = self._ask(kind, register, data, asked)
            except (LinkError, ProtocolError):
                if not left:
                    raise
                continue
            if reply.kind == (Kind.DATAGRAM if kind is Kind.READ else Kind.ACK):
                return reply
            if reply.kind == Kind.NACK:
                raise RefusedError(
                    self.name,
                    asked,
                    "it is not possible, or not allowed now",
                    "Look this register up in the manual.",
                )
            self._clock.sleep(BUSY_S)
        raise ProtocolError(
            self.name, asked, f"telegrams of type {reply.kind} came", "Check the cable; ask again."
        )

    def _ask(self, kind: Kind, register: int, data: bytes, asked: str) -> Telegram:
        """Ask once, and return the answer to this question, past late answers to others."""
        host = HOSTS[self._asked % len(HOSTS)]
        self._asked += 1
        self._line.send(encoded(Telegram(MAINBOARD, host, kind, register, data)))
        for _ in range(MAX_LATE):
            line = self._line.receive(asked)
            try:
                reply = decoded(line)
            except TelegramError as problem:
                self._line.lost_step()
                raise ProtocolError(
                    self.name,
                    asked,
                    f"{line!r} came: {problem}",
                    f"Check that the line runs at {BAUD} baud, 8N1, and that a SuperK laser is connected.",
                ) from None
            if (reply.destination, reply.source) == (MAINBOARD, host):
                self._line.lost_step()
                raise ProtocolError(
                    self.name, asked, "the request itself came back", "Switch the echo of the adapter off."
                )
            if (reply.destination, reply.source, reply.register) == (host, MAINBOARD, register):
                return reply
        self._line.lost_step()
        raise ProtocolError(self.name, asked, "only answers to other requests came", "Ask again.")
