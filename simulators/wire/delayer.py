"""What all simulated gate delayers share: a line that may fail, and the bench's gate that follows the box."""

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware


class DelayerFirmware(LineFirmware):
    """A gate delayer as bytes in and bytes out, between the laser's sync and the detector's gate input.

    The bench's gate opens when the delayer's pulse comes, and not at all while none does. Not simulated: that
    a box which is still busy leaves triggers out.

    Parameters
    ----------
    bench
        Its gate is moved.
    insertion_delay_s
        What box and cables add to the delay that is set.
    terminator, longest
        See `LineFirmware`.

    Attributes
    ----------
    garble_answers, drop_answers
        So many of the next answers arrive with a flipped bit, or are lost.
    """

    def __init__(self, bench: Bench, *, insertion_delay_s: float, terminator: bytes, longest: int) -> None:
        super().__init__(terminator=terminator, longest=longest)
        self.drop_answers = 0
        self.garble_answers = 0
        self._bench = bench
        self._insertion_delay_s = insertion_delay_s

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command."""
        sent = self.obey(line)
        if sent and self.drop_answers:
            self.drop_answers -= 1
            return b""
        if sent and self.garble_answers:
            self.garble_answers -= 1
            return bytes(byte ^ 0x40 if byte not in b"\r\n" else byte for byte in sent)
        return sent

    def obey(self, line: bytes) -> bytes:
        """Do what a command says, and return what is answered, terminators included."""
        raise NotImplementedError

    def move_gate(self, *, on: bool, delay_s: float, every: int = 1) -> None:
        """Let the gate open a delay after each sync pulse, or after the first of so many, or never."""
        wanted: dict[str, bool | float] = {"triggered": on}
        if on:
            wanted |= {"gate_delay_s": self._insertion_delay_s + delay_s, "gate_every": every}
        changed = {name: value for name, value in wanted.items() if getattr(self._bench.light, name) != value}
        if changed:
            self._bench.change_light(**changed)
