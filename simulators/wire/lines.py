"""Firmware that takes a line and answers with lines: the buffer that all such devices share."""


class LineFirmware:
    """Cuts what arrives into lines and hands each to `answer`.

    Parameters
    ----------
    terminator
        Ends a command.
    longest
        Longest command in bytes, its terminator included; a longer one is junk.

    Attributes
    ----------
    output
        What has been sent and not yet read.
    """

    def __init__(self, *, terminator: bytes, longest: int) -> None:
        self.output = bytearray()
        self._terminator = terminator
        self._longest = longest
        self._input = bytearray()

    def receive(self, data: bytes) -> None:
        """Take bytes from the wire and answer every command that they complete."""
        self._input += data
        while (end := self._input.find(self._terminator)) >= 0:
            after = end + len(self._terminator)
            line = bytes(self._input[:end])
            del self._input[:after]
            self.output += self.answer(line) if after <= self._longest else self.junk()
        if len(self._input) > self._longest:
            self._input.clear()
            self.output += self.junk()

    def answer(self, line: bytes) -> bytes:
        """Return the answer to one command, terminators included."""
        raise NotImplementedError

    def junk(self) -> bytes:
        """Return the answer to something that is no command."""
        raise NotImplementedError
