"""What all simulated lasers have beside their language: a key, an interlock, and light that obeys both."""

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware


class LaserHead(LineFirmware):
    """A laser as bytes in and bytes out; commands end with a line feed.

    Parameters
    ----------
    bench
        Its light is switched and dimmed.
    longest
        Longest command in bytes.

    Attributes
    ----------
    garble_answers, drop_answers
        So many of the next answers arrive with a flipped bit, or are lost.
    emission_stuck
        Whether emission no longer follows the commands.
    """

    def __init__(self, bench: Bench, *, longest: int = 64) -> None:
        super().__init__(terminator=b"\n", longest=longest)
        self.drop_answers = 0
        self.garble_answers = 0
        self.emission_stuck = False
        self._bench = bench
        self._key_on = True
        self._interlock_closed = True

    def turn_key(self, on: bool) -> None:
        """Turn the key switch; turning it off ends emission, turning it on does not begin it."""
        self._key_on = on
        if not on:
            self._bench.change_light(emitting=False)

    def close_interlock(self, closed: bool) -> None:
        """Close or open the interlock; opening it ends emission, closing it does not begin it."""
        self._interlock_closed = closed
        if not closed:
            self._bench.change_light(emitting=False)

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command."""
        sent = self.obey(line)
        if sent and self.drop_answers:
            self.drop_answers -= 1
            return b""
        if sent and self.garble_answers:
            self.garble_answers -= 1
            return bytes(byte ^ 0x40 if byte != 0x0A else byte for byte in sent)
        return sent

    def obey(self, line: bytes) -> bytes:
        """Do what a command says, and return what is answered, terminators included."""
        raise NotImplementedError

    def switch_light(self, on: bool) -> None:
        """Follow an emission command, as far as key and interlock let it."""
        if not self.emission_stuck:
            self._bench.change_light(emitting=on and self._key_on and self._interlock_closed)
