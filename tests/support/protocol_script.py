"""pyserial's handler for ``script://NAME``: a port whose far end is a transcript."""

from serial.serialutil import SerialBase

from support.wire_script import Script

scripts: dict[str, Script] = {}


class Serial(SerialBase):
    def open(self) -> None:
        self._script = scripts[str(self.port).removeprefix("script://")]
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    @property
    def in_waiting(self) -> int:
        return len(self._script.answers)

    def read(self, size: int = 1) -> bytes:
        data = bytes(self._script.answers[:size])
        del self._script.answers[:size]
        return data

    def write(self, data: bytes) -> int:
        self._script.sent(bytes(data))
        return len(data)

    def _reconfigure_port(self) -> None:
        pass
