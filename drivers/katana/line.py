"""The conversation with a Katana laser: settings written, asked for, and verified."""

from collections.abc import Callable
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import LinkError, ProtocolError, RefusedError
from drivers.katana.dialects import parse_refusal, parse_value
from drivers.lines.serial import SerialLine

T = TypeVar("T", bound=float)
#: Finds the value of a named setting in an answer, or None.
Parser = Callable[[str, str], T | None]

BAUD = 38400

#: So long the answer to a setting is waited for; a line takes 5 ms. Published drivers read one, so that one
#: comes; what it says is UNCONFIRMED, and a laser that gives none is right as well.
SETTING_S = 0.1
POLL_S = 0.01

#: Between two questions that must agree: a late answer to an earlier question has come by then.
BETWEEN_ANSWERS_S = 0.05

#: An answer may follow other lines; after so many without it, it is not going to come.
MAX_LINES = 8

#: Error number that means: the key switch is off.
KEY_SWITCH_OFF = 100


class KatanaLine:
    """Named settings over the laser's serial line.

    Parameters
    ----------
    address
        Serial address, e.g. ``/dev/ttyUSB0``.
    clock
        The time to wait by.
    timeout_s
        Longest wait for one answer.
    """

    def __init__(self, address: str, *, clock: Clock, timeout_s: float) -> None:
        self._line = SerialLine(address, device="laser", baudrate=BAUD, terminator=b"\n", timeout_s=timeout_s)
        self._clock = clock
        self.name = self._line.name
        self.open = self._line.open
        self.close = self._line.close

    def write(self, command: str) -> str:
        """Send a setting, read what it is answered, and return the complaint that it gave, if any.

        Nothing else in the answer is believed: it may be no more than an echo.
        """
        self._line.tell(command)
        said = self._line.pending()
        until_s = self._clock.now_s() + SETTING_S
        while not _has_whole_line(said) and self._clock.now_s() < until_s:
            self._clock.sleep(POLL_S)
            said += self._line.pending()
        return said if parse_refusal(said) is not None else ""

    def ask(self, name: str, parse: Parser[T]) -> T:
        """Ask ``name?`` and return what ``parse`` finds in the answer, past any other lines.

        Raises
        ------
        RefusedError
            The laser complained.
        LinkError, ProtocolError
            No answer, or none that makes sense.
        """
        asked, heard = f"answer '{name}?'", ""
        self._line.tell(f"{name}?")
        for _ in range(MAX_LINES):
            try:
                line = self._line.receive(asked).decode("ascii", "backslashreplace")
            except LinkError:
                if not heard.strip():
                    raise
                break  # what came says more than that no more came
            value = parse(name, line)
            if value is not None:
                return value
            heard += line + "\n"
            if line.strip() == f"{name}?":
                break
            if parse_refusal(line) is not None:
                raise self.complained(asked, heard)
        self._line.lost_step()
        raise ProtocolError(self.name, asked, f"{heard!r} came", remedy(heard))

    def answers(self, name: str, parse: Parser[T], *, enough: T | None = None) -> list[T]:
        """Ask ``name?`` twice, and return all answers that came; only one if the first is ``enough``.

        The answer to an earlier command may have been late, and have been taken for the first. Each command
        is answered once, so that the second answer is at least as young as the first question.

        Raises
        ------
        RefusedError, LinkError, ProtocolError
            See `ask`.
        """
        first = self.ask(name, parse)
        if first == enough:
            return [first]
        self._clock.sleep(BETWEEN_ANSWERS_S)
        came = [parse(name, line) for line in self._line.pending().split("\n")]
        late: list[T] = [value for value in came if value is not None]
        return [first, *late, self.ask(name, parse)]

    def agreed(self, name: str, parse: Parser[T], *, enough: T | None = None) -> T:
        """Return the `answers` if they are alike.

        Raises
        ------
        ProtocolError
            They differ.
        RefusedError, LinkError, ProtocolError
            See `ask`.
        """
        said = self.answers(name, parse, enough=enough)
        if any(value != said[0] for value in said):
            self._line.lost_step()
            raise ProtocolError(
                self.name,
                f"give the same answer to '{name}?' twice",
                f"{', then '.join(f'{value:g}' for value in said)} came",
                "Check the cable; ask again.",
            )
        return said[0]

    def set(
        self, name: str, value: str, *, expected: float, within: float, parse: Parser[float] = parse_value
    ) -> None:
        """Write a setting and verify by reading it back twice.

        Raises
        ------
        RefusedError
            The laser complained, or kept something further than ``within`` from ``expected``.
        """
        asked = f"set {name}={value}"
        if complaint := self.write(f"{name}={value}"):
            raise self.complained(asked, complaint)
        kept = self.agreed(name, parse)
        if abs(kept - expected) > within:
            raise RefusedError(
                self.name, asked, f"it kept {name}={kept:g}", "Check the laser's front panel and limits."
            )

    def complained(self, asked: str, complaint: str) -> RefusedError:
        """Return the error for an answer that holds an ``(Error n)``."""
        key_off = parse_refusal(complaint) == KEY_SWITCH_OFF
        return RefusedError(
            self.name,
            asked,
            f"{complaint.strip()!r} came",
            "Turn the key switch on." if key_off else "Look the number up in the laser's manual.",
        )


def remedy(heard: str) -> str:
    """Return what to do about something that came in place of an answer."""
    if any(word.endswith("?") and word[:-1].isidentifier() for word in heard.split()):
        return "It returns what is sent to it: switch the echo of laser or adapter off."
    if "\\x" in heard or not all(one.isprintable() or one.isspace() for one in heard):
        return f"This is not text: the line speed is wrong; the laser needs {BAUD} baud, 8N1."
    return f"Check power and cable, and that the line runs at {BAUD} baud, 8N1; ask again."


def _has_whole_line(said: str) -> bool:
    return any(line.strip() for line in said.split("\n")[:-1])
