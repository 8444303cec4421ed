"""The mainboard of a SuperK laser with a pulse picker, lighting the bench.

Source: the vendor's SDK manual as published drivers quote it: telegrams, registers of module type 0x60, the
interlock's states, the watchdog. UNCONFIRMED, and so choices made here: an order to emit with an open
interlock is acknowledged, and no light comes; any telegram counts for the watchdog; damaged telegrams are
answered as CRC errors. The watchdog acts when the laser is spoken to again: nothing runs here by itself.
"""

from collections.abc import Callable

from simulators.bench import Bench
from simulators.wire.laser_head import LaserHead

#: Address of the mainboard, and its type.
ADDRESS, TYPE = 0x0F, 0x60

_NACK, _CRC_ERROR, _ACK, _READ, _WRITE, _DATAGRAM = 0, 1, 3, 4, 5, 8


def checksum(data: bytes) -> int:
    """Return the CRC-CCITT of some bytes, bit by bit: polynomial 0x1021, from 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
            crc &= 0xFFFF
    return crc


def framed(body: bytes) -> bytes:
    """Return destination, source, type, register and data as they go over the line."""
    whole = bytearray(body) + checksum(body).to_bytes(2, "big")
    for special in (0x5E, 0x0D, 0x0A):  # the escape itself is first, or it would be escaped twice
        whole = whole.replace(bytes([special]), bytes([0x5E, special + 0x40]))
    return b"\r" + bytes(whole) + b"\n"


def unframed(line: bytes) -> bytes:
    """Return what came before an end, from its last start on, with its CRC."""
    whole = line[line.rfind(b"\r") + 1 :]
    for special in (0x0A, 0x0D, 0x5E):
        whole = whole.replace(bytes([0x5E, special + 0x40]), bytes([special]))
    return whole


class NktMainboard(LaserHead):
    """A SuperK laser as bytes in and bytes out.

    Parameters
    ----------
    bench
        Its light is switched and dimmed.
    oscillator_hz
        Pulses a second that come to the pulse picker.

    Attributes
    ----------
    mode
        Operating mode: 0 constant current, 1 constant power, others take their level from elsewhere.
    """

    def __init__(self, bench: Bench, *, oscillator_hz: float = 80e6) -> None:
        super().__init__(bench, longest=512)
        self.mode = 1
        self._oscillator_hz = oscillator_hz
        self._levels = {0x37: 0, 0x38: 0}
        self._picked = 1
        self._watchdog_s = 0
        self._waits_for_reset = False
        self._heard_s = bench.clock.now_s()
        self._apply()

    def close_interlock(self, closed: bool) -> None:
        """Close or open the interlock; a closed one waits for its reset before there may be light."""
        self._waits_for_reset |= closed and not self._interlock_closed
        super().close_interlock(closed)

    def turn_key(self, on: bool) -> None:
        """Turn the key switch, which is part of the interlock."""
        self._waits_for_reset |= on and not self._key_on
        super().turn_key(on)

    def reset_interlock(self) -> None:
        """Reset the interlock at the front panel."""
        self._waits_for_reset = False

    def junk(self) -> bytes:
        """Answer nothing to what is no telegram."""
        return b""

    def obey(self, line: bytes) -> bytes:
        """Do what a telegram says, and return the answer."""
        whole = unframed(line)
        if len(whole) < 6 or whole[0] != ADDRESS:
            return b""
        self._watch()
        destination, source, kind, register = whole[:4]
        if checksum(whole):
            return framed(bytes([source, destination, _CRC_ERROR, register]))
        data: bytes | None = None
        if kind == _READ:
            answer, data = _DATAGRAM, self._read(register)
        elif kind == _WRITE:
            answer, data = _ACK, self._write(register, int.from_bytes(whole[4:-2], "little"))
        if data is None:
            answer, data = _NACK, b""
        return framed(bytes([source, destination, answer, register]) + data)

    def _watch(self) -> None:
        """End emission if nobody has spoken for too long."""
        now_s = self._bench.clock.now_s()
        if self._watchdog_s and now_s - self._heard_s > self._watchdog_s and self._bench.light.emitting:
            self.switch_light(False)
        self._heard_s = now_s

    def _read(self, register: int) -> bytes | None:
        emitting = self._bench.light.emitting
        readers: dict[int, Callable[[], bytes]] = {
            0x30: lambda: bytes([3 if emitting else 0]),
            0x31: lambda: self.mode.to_bytes(2, "little"),
            0x32: lambda: bytes(self._interlock()),
            0x34: lambda: self._picked.to_bytes(1 if self._picked < 256 else 2, "little"),
            0x36: lambda: bytes([self._watchdog_s]),
            0x61: lambda: bytes([TYPE]),
            0x65: lambda: b"SIM0001\0",
            0x66: lambda: self._status().to_bytes(2, "little"),
        }
        if register in self._levels:
            return self._levels[register].to_bytes(2, "little")
        return readers[register]() if register in readers else None

    def _write(self, register: int, number: int) -> bytes | None:
        """Write a register; return what is answered, None where it is not possible."""
        if register == 0x30 and number in (0, 3):
            self.switch_light(number == 3 and not self._waits_for_reset)
        elif register == 0x32 and number:
            self.reset_interlock()
        elif register == 0x34 and 1 <= number <= 0xFFFF:
            self._picked = number
        elif register == 0x36 and number <= 0xFF:
            self._watchdog_s = number
        elif register in self._levels and number <= 1000:
            self._levels[register] = number
        else:
            return None
        self._apply()
        return b""

    def _interlock(self) -> tuple[int, int]:
        """Return the low and the high byte of the interlock's register."""
        if not self._key_on:
            return 0, 1
        if not self._interlock_closed:
            return 0, 2
        return (1 if self._waits_for_reset else 2), 0

    def _status(self) -> int:
        closed = self._interlock()[0] == 2
        return int(self._bench.light.emitting) | (not closed) << 1 | (self._interlock()[0] == 0) << 3

    def _apply(self) -> None:
        level = self._levels[0x37 if self.mode == 1 else 0x38]
        self._bench.change_light(power=level / 1000, repetition_hz=self._oscillator_hz / self._picked)
