"""pyserial's handler for ``noise://NAME``: a port whose answers are a table, good or spoiled.

A question is what comes before ``=``, ``?`` or the line's end; its answers come in turn, the last for ever.
"""

import re

from serial.serialutil import SerialBase

answers: dict[str, dict[str, list[bytes]]] = {}


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
        question = re.match(rb"[^=\r\n]*", data).group().decode("latin-1")
        self._came += next_answer(self._answers, question)
        return len(data)

    def _reconfigure_port(self) -> None:
        pass


def next_answer(table: dict[str, list[bytes]], question: str) -> bytes:
    """Return the next answer to a question; nothing where it has none."""
    said = table.get(question, [b""])
    return said.pop(0) if len(said) > 1 else said[0]
