"""What passed at the wire while devices were asked, with times; written without private details.

As text it has the form of the transcripts in ``tests/protocol/transcripts``: ``>`` to the device, ``<`` from
it, with Python's escapes, in hexadecimal on USB; a comment behind each line.
"""

import json
import time
from collections.abc import Iterator
from ctypes import Array, c_char
from dataclasses import dataclass, field
from typing import Any, Literal

from rig.acquire.probing.private import Placeholders
from rig.devices.probing.asking import Exchange


@dataclass
class Passed:
    """Bytes that passed one way, or a call.

    Attributes
    ----------
    wire, way
        What it was.
    at_s, until_s
        When the first and the last of it passed, since the beginning.
    data
        The bytes as text, one character each; of a call, what it looks like.
    request
        Of a control request on USB, what was asked.
    """

    wire: Literal["serial", "usb", "library"]
    way: Literal["sent", "received", "call"]
    at_s: float
    until_s: float
    data: str
    request: tuple[int, ...] = ()

    def written(self, hidden: Placeholders) -> str:
        """Return it as text: escaped, on USB in hexadecimal."""
        if self.wire == "usb":
            return hidden.hidden(self.data, lambda text: f" {text.encode('latin-1').hex(' ')} ").strip()
        if self.wire == "library":
            return hidden.hidden(self.data)
        return hidden.hidden(self.data, lambda text: text.encode("unicode_escape").decode("ascii"))


@dataclass
class Asked:
    """A question with all that passed for it.

    Attributes
    ----------
    passed
        In its order.
    exchange
        The question and its answer; None for what passed when the line was opened or closed.
    """

    passed: list[Passed] = field(default_factory=list)
    exchange: Exchange | None = None


@dataclass
class DeviceTranscript:
    """What passed between the program and one device.

    Attributes
    ----------
    section, kind
        The device, as of a configuration.
    asked
        Questions in their order.
    failure
        Why it could not be asked, or not to the end.
    unknown
        Whether no questions are known for its kind.
    """

    section: str
    kind: str
    asked: list[Asked] = field(default_factory=list)
    failure: str = ""
    unknown: bool = False

    @property
    def exchanges(self) -> list[Exchange]:
        """All questions and answers."""
        return [one.exchange for one in self.asked if one.exchange is not None]


class Recorder:
    """Hears what passes on one device's wire; see `drivers.lines.listening.Listener`.

    Parameters
    ----------
    into
        Where it is kept.
    began_s
        Monotonic time of the beginning.
    """

    def __init__(self, into: DeviceTranscript, began_s: float) -> None:
        self._into = into
        self._began_s = began_s
        self._passed: list[Passed] = []

    def serial(self, sent: bool, data: bytes) -> None:
        """Keep bytes; those of one direction belong together until the other has its turn."""
        way: Literal["sent", "received"] = "sent" if sent else "received"
        text, now_s = data.decode("latin-1"), self._now_s()
        if self._passed and self._passed[-1].way == way:
            self._passed[-1].data += text
            self._passed[-1].until_s = now_s
        else:
            self._passed.append(Passed("serial", way, now_s, now_s, text))

    def usb(self, sent: bool, data: bytes, request: tuple[int, ...] = ()) -> None:
        """Keep a transfer."""
        now_s = self._now_s()
        way: Literal["sent", "received"] = "sent" if sent else "received"
        self._passed.append(Passed("usb", way, now_s, now_s, data.decode("latin-1"), request))

    def call(self, name: str, arguments: tuple[Any, ...], answer: object) -> None:
        """Keep a call."""
        now_s = self._now_s()
        told = ", ".join(_plain(one) for one in arguments)
        self._passed.append(Passed("library", "call", now_s, now_s, f"{name}({told}) -> {answer}"))

    def exchanged(self, exchange: Exchange | None) -> None:
        """Keep what a question gave, with all that passed since the one before."""
        if self._passed or exchange is not None:
            self._into.asked.append(Asked(self._passed, exchange))
        self._passed = []

    def _now_s(self) -> float:
        return time.monotonic() - self._began_s


def _plain(argument: Any) -> str:
    """Return an argument of a C function as it was when the function had returned."""
    value = getattr(argument, "_obj", argument)  # byref() keeps its object there
    if isinstance(value, Array):
        return repr(value.value.decode("latin-1")) if value._type_ is c_char else "..."
    return str(getattr(value, "value", value))


def text_lines(devices: list[DeviceTranscript], hidden: Placeholders) -> Iterator[str]:
    """Return the transcript for people."""
    for device in devices:
        yield ""
        yield f"# ---- {device.section}, kind {device.kind} ----"
        for asked in device.asked:
            yield ""
            yield f"# {_told(asked.exchange, hidden)}"
            private = asked.exchange is not None and asked.exchange.private
            for one in asked.passed:
                yield f"{_line(one, hidden, asked.exchange if private else None):<60} # {one.at_s:.4f} s"
        if device.unknown:
            yield "# no questions are known for this kind"
        if device.failure:
            yield f"# failed: {hidden.hidden(device.failure)}"


def _told(exchange: Exchange | None, hidden: Placeholders) -> str:
    if exchange is None:
        return "opening or closing"
    return f"{exchange.question}: {answer_of(exchange, hidden)}"


def answer_of(exchange: Exchange, hidden: Placeholders) -> str:
    """Return an answer on one line, without private details."""
    if exchange.answer is None:
        return f"no answer ({hidden.hidden(exchange.problem)})"
    if exchange.private:
        return hidden.of_serial(exchange)
    return hidden.hidden(exchange.answer).encode("unicode_escape").decode("ascii")


def _line(one: Passed, hidden: Placeholders, private: Exchange | None) -> str:
    written = _written(one, hidden, private)
    if one.request:
        kind, number, value, index, length = one.request
        return f"control {kind:02X} {number:02X} {value:04X} {index:04X} {length:X} -> {written}"
    return f"{ {'sent': '>', 'received': '<', 'call': 'call'}[one.way] } {written}"


def _written(one: Passed, hidden: Placeholders, private: Exchange | None) -> str:
    """Return what passed; of a serial number that was asked for no byte is left, its checksum neither."""
    if private is not None and one.way == "received":
        return hidden.of_serial(private)
    return one.written(hidden)


def json_lines(devices: list[DeviceTranscript], hidden: Placeholders) -> Iterator[str]:
    """Return the transcript for programs: an object a line."""
    for device in devices:
        of = {"device": device.section, "kind": device.kind}
        for asked in device.asked:
            exchange = asked.exchange
            private = exchange if exchange is not None and exchange.private else None
            question = exchange.question if exchange is not None else None
            for one in asked.passed:
                times = {"at_s": round(one.at_s, 6), "until_s": round(one.until_s, 6)}
                said = {"wire": one.wire, "data": _written(one, hidden, private)}
                request = {"request": one.request} if one.request else {}
                yield json.dumps({one.way: question, **of, **times, **said, **request})
            if exchange is not None:
                answer = None if exchange.answer is None else answer_of(exchange, hidden)
                told = {"answer": answer, "problem": hidden.hidden(exchange.problem)}
                yield json.dumps({"asked": question, **of, **told})
        if device.failure:
            yield json.dumps({"failed": hidden.hidden(device.failure), **of})
