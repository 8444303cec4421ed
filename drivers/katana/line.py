"""The conversation with a Katana laser: settings written, asked for, and verified."""

from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import ProtocolError, RefusedError
from drivers.katana.dialects import Dialect, parse_emission, parse_refusal, parse_value
from drivers.lines.serial import SerialLine

#: Time given to a complaint about a setting; a byte takes 0.26 ms at 38400 baud. It is unconfirmed whether
#: a setting that is accepted is answered at all, so that nothing can be waited for.
COMPLAINT_S = 0.05

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
        self._line = SerialLine(
            address, device="laser", baudrate=38400, terminator=b"\n", timeout_s=timeout_s
        )
        self._clock = clock
        self.name = self._line.name
        self.open = self._line.open
        self.close = self._line.close

    def write(self, command: str) -> str:
        """Send a setting and return the complaint that it gave, if any."""
        self._line.tell(command)
        self._clock.sleep(COMPLAINT_S)
        said = self._line.pending()
        return said if parse_refusal(said) is not None else ""

    def emission(self, dialect: Dialect) -> bool:
        """Ask whether the laser emits."""
        return bool(self._ask(dialect.emission, parse_emission))

    def get(self, name: str) -> float:
        """Ask for a number."""
        return self._ask(name, lambda text: parse_value(name, text))

    def set(self, name: str, value: str, *, expected: float, within: float) -> None:
        """Write a setting and verify by reading it back.

        Raises
        ------
        RefusedError
            The laser complained, or kept something further than ``within`` from ``expected``.
        """
        asked = f"set {name}={value}"
        if complaint := self.write(f"{name}={value}"):
            raise self.complained(asked, complaint)
        kept = self.get(name)
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

    def _ask(self, name: str, parse: Callable[[str], float | None]) -> float:
        """Ask ``name?`` and return what ``parse`` finds in the answer, past any other lines."""
        asked, heard = f"answer '{name}?'", ""
        self._line.tell(f"{name}?")
        for _ in range(MAX_LINES):
            line = self._line.receive(asked).decode("ascii", "backslashreplace")
            value = parse(line)
            if value is not None:
                return value
            heard += line + "\n"
            if parse_refusal(line) is not None:
                raise self.complained(asked, heard)
        self._line.lost_step()
        raise ProtocolError(self.name, asked, f"{heard!r} came", "Check the cable; ask again.")
