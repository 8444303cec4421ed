"""How much is said on stderr, and the log of it: ``--quiet``, ``--verbose`` and ``--log`` of every verb."""

import os
import stat
import sys
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from rig.errors import UsageError, in_shell, printable, reason, refuse_folder


class Voice:
    """What a person wants to hear, and where it is kept.

    Attributes
    ----------
    quiet
        Whether results, errors, and what concerns the light are all that is said.
    verbose
        Whether each step is said, too, with its time.
    documented
        Whether the one document of ``--json`` was printed.
    """

    def __init__(self) -> None:
        self.documented = False
        self.quiet = False
        self.verbose = False
        self._began_s = time.monotonic()
        self._log: IO[str] | None = None

    def begin(self) -> None:
        """Begin with a new command: nothing of the last one holds."""
        self.__init__()  # type: ignore[misc]

    def choose(self, *, quiet: bool = False, verbose: bool = False) -> None:
        """Be quiet, or verbose.

        Raises
        ------
        UsageError
            If both are wanted.
        """
        self.quiet, self.verbose = self.quiet or quiet, self.verbose or verbose
        if self.quiet and self.verbose:
            raise UsageError("--quiet and --verbose contradict each other; give one of them")

    @property
    def elapsed_s(self) -> float:
        """Seconds since the command began."""
        return time.monotonic() - self._began_s

    def keep_in(self, path: Path) -> None:
        """Append what is said to a log, from now on.

        Raises
        ------
        UsageError
            If it cannot be written, or is a file of something else.
        """
        _require_log(path)
        try:
            self._log = path.open("a", buffering=1, encoding="utf-8")
            self._log.write(f"{_now()} command: {in_shell('rig', *map(printable, sys.argv[1:]))}\n")
        except OSError as problem:
            self._close()
            raise UsageError(
                f"--log {path}: cannot be written ({problem.strerror}); give a file in a folder that exists"
            ) from None

    def note(self, kind: str, text: str) -> None:
        """Write to the log, if there is one; one that is full by now stops nothing."""
        if self._log is not None:
            with suppress(OSError, ValueError):
                for line in printable(text).splitlines():
                    self._log.write(f"{_now()} {kind}: {line}\n")

    def end(self, code: int) -> None:
        """Say how the command ended, and close the log."""
        how = f"exit code {code} after {self.elapsed_s:.3f} s"
        self.note("end", how)
        if self.verbose:
            print(f"{self.elapsed_s:8.3f} s  exit code {code}", file=sys.stderr)
        self._close()

    def _close(self) -> None:
        log, self._log = self._log, None
        if log is not None:
            with suppress(OSError):
                log.close()


#: That of the command that runs.
voice = Voice()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _require_log(path: Path) -> None:
    """Refuse what is no log: lines at the end of a scan would spoil it, and a pipe is waited for."""
    refuse_folder(path, "--log ")
    try:
        mode = os.stat(path).st_mode
        foreign = not stat.S_ISCHR(mode) and (not stat.S_ISREG(mode) or not _is_log(path))
    except FileNotFoundError:
        return
    except (OSError, ValueError) as problem:
        raise UsageError(f"--log {path}: cannot be written ({reason(problem)}); give another name") from None
    if foreign:
        raise UsageError(f"--log {path}: exists and is not a log of this program; give another name")


def _is_log(path: Path) -> bool:
    """Return whether a file is empty, or its first line begins with a time and what is said first."""
    with path.open("rb") as file:
        first = file.read(64)
    if not first:
        return True
    when, _, rest = first.partition(b" ")
    with suppress(ValueError):
        datetime.fromisoformat(when.decode("ascii"))
        return rest.startswith(b"command: ")
    return False
