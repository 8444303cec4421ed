"""pyserial's handler for ``noise://NAME``: a port that answers each line with the next bytes of a list."""

from serial.serialutil import SerialBase

answers: dict[str, list[bytes]] = {}


class Serial(SerialBase):
    def open(self) -> None:
        self._answers = answers[str(self.port).removeprefix("noise://")]
        self._came = bytearray()
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    @property
    def in_waiting(self) -> int:
        return len(self._came)

    def read(self, size: int = 1) -> bytes:
        data = bytes(self._came[:size])
        del self._came[:size]
        return data

    def write(self, data: bytes) -> int:
        # a setting of the laser, name=value, is taken without an answer
        if self._answers and not (data.endswith(b"\n") and b"=" in data and not data.startswith(b"XY")):
            self._came += self._answers.pop(0)
        return len(data)

    def _reconfigure_port(self) -> None:
        pass
