"""Running an attack: many inputs against one reader, each the same in every run, each timed.

A reader may take an input or refuse it with one of its own errors. Anything else is a finding: another
exception, more than `LONGEST_S` for one input, more than `MOST_BYTES` of memory gained.
"""

import resource
import signal
import sys
import time
import traceback
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

LONGEST_S = 10
MOST_BYTES = 10**9
_TOO_LONG = f"took more than {LONGEST_S} s"
_PROJECT = Path(__file__).parents[2]
_STATM, _CLEAR_REFS = Path("/proc/self/statm"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Attack:
    """One reader, and what it is given.

    Attributes
    ----------
    name
        Of the reader.
    make
        Makes an input from a source of random numbers.
    read
        Reads it.
    allowed
        The errors with which it may be refused.
    first
        Inputs that come first, in order; those made from random numbers have the numbers after them.
    """

    name: str
    make: Callable[[Random], Any]
    read: Callable[[Any], object]
    allowed: tuple[type[BaseException], ...]
    first: Callable[[], Sequence[Any]] = tuple

    def given(self, number: int) -> Any:
        """Return the input of a number."""
        first = self.first()
        return first[number] if number < len(first) else self.make(Random(f"{self.name} {number}"))


@dataclass(frozen=True)
class Finding:
    """What must not be: the input's number, where it happened and what."""

    number: int
    what: str
    shown: str


class TooLongError(BaseException):
    """Raised where a reader takes too long; no `Exception`, so that nobody catches it on its way."""


def attack(
    one: Attack, number: int, first: int = 0, tell: Callable[[Finding], object] = lambda _: None
) -> list[Finding]:
    """Give a reader so many inputs; tell and return the first finding of each kind."""
    found: dict[str, Finding] = {}
    for index in range(first, first + number):
        given = one.given(index)
        what = refused_badly(one, given)
        if what and what not in found:
            found[what] = Finding(index, what, repr(given)[:300])
            tell(found[what])
    return list(found.values())


def refused_badly(one: Attack, given: Any) -> str:
    """Give a reader one input; return what it did that it must not, empty where all is well.

    What takes too long is read once more: a computer that stood still meanwhile is no fault of the reader.
    """
    what = _read_badly(one, given)
    return _read_badly(one, given) if what.startswith(_TOO_LONG) else what


def _read_badly(one: Attack, given: Any) -> str:
    _forget_peak()
    before = _peak_bytes()
    try:
        with _limited():
            one.read(given)
    except one.allowed:
        pass
    except TooLongError:
        return f"{_TOO_LONG} {_place(sys.exc_info()[2])}"
    except Exception as error:
        return f"{type(error).__name__} {_place(error.__traceback__)}: {str(error)[:80]!r}"
    gained = _peak_bytes() - before
    return f"took {gained >> 20} MiB of memory" if gained > MOST_BYTES else ""


@contextmanager
def _limited() -> Iterator[None]:
    began_s, busy_s = time.monotonic(), time.process_time()

    def too_long(*_: object) -> None:
        computed_s, took_s = time.process_time() - busy_s, time.monotonic() - began_s
        if (
            computed_s > LONGEST_S / 2 or took_s > 5 * LONGEST_S
        ):  # else the computer is busy with other things
            raise TooLongError
        signal.setitimer(signal.ITIMER_REAL, LONGEST_S)

    before = signal.signal(signal.SIGALRM, too_long)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    if _STATM.exists():  # address space is not memory: libraries and threads may claim more than they use
        now = int(_STATM.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + 3 * MOST_BYTES, limits[1]))
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _forget_peak() -> None:
    """Let the peak begin anew, where Linux can: an input must not hide behind the peak of one before it."""
    with suppress(OSError):
        _CLEAR_REFS.write_text("5", encoding="ascii")


def _peak_bytes() -> int:
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _place(trace: Any) -> str:
    """Return the innermost line of the program itself."""
    ours = [
        frame
        for frame in traceback.extract_tb(trace)
        if frame.filename.startswith(str(_PROJECT)) and "/tests/" not in frame.filename
    ]
    return (
        f"at {Path(ours[-1].filename).relative_to(_PROJECT)}:{ours[-1].lineno}" if ours else "in the attack"
    )


def main(attacks: tuple[Attack, ...]) -> None:
    """Run attacks from the command line; exit with 1 where something was found."""
    parser = ArgumentParser(description="Give readers many spoiled inputs, and say what must not be.")
    parser.add_argument(
        "names", nargs="*", help="readers, by default all: " + ", ".join(a.name for a in attacks)
    )
    parser.add_argument("--number", type=int, default=1000, help="inputs for each reader")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    given = parser.parse_args()
    total = 0
    for one in attacks:
        if given.names and one.name not in given.names:
            continue
        began_s = time.monotonic()
        found = attack(one, given.number, given.first, _tell)
        took_s = time.monotonic() - began_s
        print(f"{one.name}: {given.number} inputs, {len(found)} findings, {took_s:.0f} s", flush=True)
        total += len(found)
    sys.exit(total > 0)


def _tell(finding: Finding) -> None:
    print(f"  {finding.number}: {finding.what}\n      {finding.shown}", flush=True)
