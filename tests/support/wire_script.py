"""Byte-level transcripts: what the manuals say goes over the wire, one line of a text file for each piece.

    > START\\r\\n    # host to device, with Python's escapes; the comment says where the fact comes from
    < OK\\r\\n       # device to host
    . 20 ms        # time passes

In USB transcripts all is hexadecimal: ``> 01 01 FE ...`` and ``< ...`` are bulk transfers, and
``control A1 07 0000 0001 18 -> 01`` is a class request (request type, request, value, index, length).
"""

from dataclasses import dataclass, field
from pathlib import Path

TRANSCRIPTS = Path(__file__).parents[1] / "protocol" / "transcripts"


@dataclass(frozen=True)
class Step:
    kind: str
    data: bytes = b""
    control: tuple[int, ...] = ()
    pause_s: float = 0.0


def read_transcript(name: str, *, words: dict[str, str] | None = None) -> list[Step]:
    """Read a transcript; ``words`` makes it a hexadecimal one, and says what its words stand for."""
    steps = []
    for number, line in enumerate((TRANSCRIPTS / name).read_text().splitlines(), 1):
        text, _, source = line.partition(" # ")
        if not text or text.startswith("#"):
            continue
        assert source.strip(), f"{name}:{number} does not say where it comes from"
        kind, _, rest = text.strip().partition(" ")
        rest = rest.strip()
        if kind == ".":
            amount, unit = rest.split()
            assert unit == "ms"
            steps.append(Step(kind, pause_s=float(amount) / 1e3))
        elif kind == "control":
            asked, _, answer = rest.partition("->")
            for word, number_text in (words or {}).items():
                asked = asked.replace(word, number_text)
            steps.append(Step(kind, bytes.fromhex(answer), control=tuple(int(n, 16) for n in asked.split())))
        else:
            assert kind in "<>"
            data = bytes.fromhex(rest) if words else rest.encode().decode("unicode_escape").encode("latin1")
            steps.append(Step(kind, data))
    return steps


@dataclass
class Script:
    """A wire that knows in advance what must be said on it; any difference is remembered and raised."""

    steps: list[Step]
    wrong: str = ""
    answers: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self._collect()

    def sent(self, data: bytes) -> None:
        expected = self.steps.pop(0).data if self.steps else b""
        if data != expected:
            self.wrong = self.wrong or f"sent {data!r} instead of {expected!r}"
            raise AssertionError(self.wrong)
        self._collect()

    def finish(self) -> None:
        assert not self.wrong, self.wrong
        assert not self.steps, f"never sent: {self.steps[0]}"

    def _collect(self) -> None:
        while self.steps and self.steps[0].kind in "<.":
            self.answers += self.steps.pop(0).data


class StepClock:
    """Time that passes only by waiting."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s
