"""A shutter on an output of a serial port: no bytes, two outputs, and two inputs that tell where it is."""

from simulators.bench import Bench


class PortShutter:
    """A shutter that a serial port's RTS or DTR moves, in the bench's beam.

    Parameters
    ----------
    bench
        Its light is kept in.
    line
        ``rts`` or ``dtr``.
    opens_high
        Whether it is open at the high level.

    Attributes
    ----------
    output
        Bytes for the reader: there are none.
    stuck
        Whether it no longer moves.
    """

    def __init__(self, bench: Bench, *, line: str = "rts", opens_high: bool = True) -> None:
        self.output = bytearray()
        self.stuck = False
        self._bench = bench
        self._line = line
        self._opens_high = opens_high

    def receive(self, data: bytes) -> None:
        """Take bytes, which mean nothing."""

    def drive(self, line: str, level: bool) -> None:
        """Take the level of one of the port's outputs."""
        if line == self._line and not self.stuck:
            self._bench.change_light(shuttered=level != self._opens_high)

    def sense(self, line: str) -> bool:
        """Return the level of one of the port's inputs: that at which the shutter stands."""
        return self._bench.light.shuttered != self._opens_high
