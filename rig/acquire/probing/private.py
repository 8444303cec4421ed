"""Leaving personal details out of what is written for others: each becomes a placeholder, always the same."""

import getpass
import re
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rig.devices.probing.asking import Exchange
from rig.model.config import RigConfig

#: Keys of a configuration that say where something is, and what it is called.
_ADDRESSES = frozenset({"address", "addresses", "library", "folder", "file"})
#: In text of devices and of ours, what follows these words is a serial number.
_SERIAL = re.compile(
    r"(?i)\b(?:s/?n|serial(?:[ _](?:no|number))?)\b[\s.:=#]*['\"]?([A-Za-z0-9][A-Za-z0-9-]{2,})"
)
#: Absolute paths of POSIX and Windows, and addresses of computers; not what only looks so, as 10/12 does.
_PATH = re.compile(r"(?<![\w:/.])(?:~?(?:/[\w.@+-]+){2,}|[A-Za-z]:\\[\w.@+\\ -]+)")
_HOST = re.compile(r"\b\d{1,3}(?:\.\d{1,3}){3}\b")
#: What is shorter tells nobody apart, and is part of everything; what is a little longer is replaced only as
#: a word of its own.
_SHORTEST, _SHORT = 2, 4


class Placeholders:
    """Puts placeholders in the place of what was learned to be private.

    All has to be learned before anything is written, since a serial number may come up before the answer that
    tells it as one.
    """

    def __init__(self) -> None:
        self._known: dict[str, str] = {}
        self._count: dict[str, int] = {}

    def learn(self, kind: str, text: str | None) -> None:
        """Remember something private, e.g. a ``serial``; what was remembered keeps its placeholder."""
        text = (text or "").strip()
        if len(text) >= _SHORTEST and text not in self._known:
            self._count[kind] = self._count.get(kind, 0) + 1
            self._known[text] = f"<{kind} {self._count[kind]}>"

    def learn_computer(self) -> None:
        """Remember user, home and name of this computer."""
        with suppress(OSError, KeyError):  # a user without a name
            self.learn("user", getpass.getuser())
        with suppress(RuntimeError):
            self.learn("path", str(Path.home()))
            self.learn("user", Path.home().name)
        name = socket.gethostname()
        self.learn("host", name)
        self.learn("host", name.partition(".")[0])

    def learn_configuration(self, config: RigConfig) -> None:
        """Remember all addresses and serial numbers of a configuration, and the rig's name."""
        self.learn("rig", config.name)
        for key, value in _texts(config.model_dump(mode="json")):
            if key in _ADDRESSES:
                self.learn("path", value)
            elif key == "serial":
                self.learn("serial", value)

    def learn_answer(self, exchange: Exchange) -> None:
        """Remember what an answer tells of the one device that gave it."""
        said = exchange.answer or ""
        for word in _serial_numbers(exchange):
            self.learn("serial", word)
        if exchange.question == "*IDN?" and said.count(",") >= 2:  # maker, model, serial number, firmware
            self.learn("serial", said.split(",")[2])
        self._learn_all(said, {"serial": _SERIAL, "path": _PATH})  # four numbers are a version there
        self.learn_text(exchange.problem)

    def learn_text(self, text: str) -> None:
        """Remember serial numbers, paths and hosts that a text of ours tells as such."""
        self._learn_all(text, {"serial": _SERIAL, "path": _PATH, "host": _HOST})

    def _learn_all(self, text: str, patterns: dict[str, re.Pattern[str]]) -> None:
        for kind, pattern in patterns.items():
            for found in pattern.finditer(text):
                self.learn(kind, found[pattern.groups])

    def hidden(self, text: str, written: Callable[[str], str] = str) -> str:
        """Return a text with placeholders; what is between them as ``written`` writes it."""
        if not self._known:
            return written(text)
        pieces = self._pattern().split(text)
        return "".join(
            self._known[piece] if number % 2 else written(piece) for number, piece in enumerate(pieces)
        )

    def of_serial(self, exchange: Exchange) -> str:
        """Return the placeholder of a serial number that was asked for."""
        return next((self._known.get(word, "<serial>") for word in _serial_numbers(exchange)), "<serial>")

    def _pattern(self) -> re.Pattern[str]:
        longest_first = sorted(self._known, key=len, reverse=True)
        return re.compile("(" + "|".join(map(self._found_as, longest_first)) + ")")

    def _found_as(self, text: str) -> str:
        """Return a pattern that finds a text; what is short, or a name, only where it is a word."""
        is_name = self._known[text].startswith(("<user", "<host"))
        word = rf"(?<!\w){re.escape(text)}(?!\w)"
        return word if is_name or len(text) < _SHORT else re.escape(text)


def _serial_numbers(exchange: Exchange) -> list[str]:
    """Return the words of an answer that are serial numbers; none where it says that there is none."""
    words = re.findall(r"[A-Za-z0-9-]{2,}", (exchange.answer or "") if exchange.private else "")
    return [word for word in words if any(one.isdigit() for one in word)]


def _texts(table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return all texts of nested tables with their keys."""
    for key, value in table.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Mapping):
                yield from _texts(one)
            elif isinstance(one, str):
                yield key, one
