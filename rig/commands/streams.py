"""Output streams whose loss ends nothing: a full disk, a reader that went away, a terminal that was closed.

A scan must not end because nobody reads its messages. What cannot be told is dropped; the work goes on, and
the exit code is that of the work.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EPIPE
from typing import IO, Any, TextIO, cast


class Dropping:
    """A text stream in front of another one: what that does not take is dropped.

    Parameters
    ----------
    stream
        Where text goes; None drops all of it.

    Attributes
    ----------
    lost
        Why text was dropped first; None where none was, or where its reader had gone, who wants no more.
    """

    def __init__(self, stream: IO[str] | None) -> None:
        self._stream = stream
        self.lost: Exception | None = None

    def write(self, text: str) -> int:
        """Write text; characters that the stream cannot encode are written as escapes."""
        if not isinstance(text, str):
            raise TypeError(f"text is written here, not {type(text).__name__}")
        if self._stream is not None:
            try:
                self._write(text)
            except (OSError, ValueError) as problem:  # ValueError: it is closed
                self._lose(problem)
        return len(text)

    def flush(self) -> None:
        """Send on what is kept back."""
        if self._stream is not None:
            try:
                self._stream.flush()
            except (OSError, ValueError) as problem:
                self._lose(problem)

    def isatty(self) -> bool:
        """Return whether a person looks on."""
        with suppress(OSError, ValueError):
            return self._stream is not None and self._stream.isatty()
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def give_up(self) -> None:
        """Flush; what cannot be flushed goes nowhere, or the interpreter would fail on it at its end."""
        if self._stream is None:
            return
        try:
            self._stream.flush()
        except (OSError, ValueError) as problem:
            self._lose(problem)
            with suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)

    def _write(self, text: str) -> None:
        stream = cast("TextIO", self._stream)
        try:
            stream.write(text)
        except UnicodeEncodeError:  # such as a file name that is not UTF-8
            encoding = stream.encoding or "utf-8"
            stream.write(text.encode(encoding, "backslashreplace").decode(encoding))

    def _lose(self, problem: Exception) -> None:
        if not (isinstance(problem, OSError) and problem.errno == EPIPE):
            self.lost = self.lost or problem


@contextmanager
def dropping() -> Iterator[Dropping]:
    """Put streams whose loss ends nothing in the place of stdout and stderr, and give that for stdout."""
    _occupy_standard_files()
    before = sys.stdout, sys.stderr
    out, err = Dropping(before[0]), Dropping(before[1])
    sys.stdout, sys.stderr = cast("Any", out), cast("Any", err)
    try:
        yield out
    finally:
        out.give_up()
        err.give_up()
        sys.stdout, sys.stderr = before


def _occupy_standard_files() -> None:
    """Open what was closed before the start, or a data file would get its number, and messages into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            with suppress(OSError):
                os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
