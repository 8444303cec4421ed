"""pyserial's handler for ``script://NAME``: a port whose far end is a transcript."""

from contextlib import contextmanager

import serial
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


@contextmanager
def playing(monkeypatch, steps):
    """Play steps at an address, and hold the driver to all of them."""
    monkeypatch.setattr(serial, "protocol_handler_packages", ["serial.urlhandler", "support"])
    script = Script(list(steps))
    scripts["wire"] = script
    yield "script://wire"
    script.finish()
