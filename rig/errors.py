"""What can go wrong in the application, with the exit code of each.

    RigError                 exit 1  (never raised itself)
    ├── UsageError           exit 2  the command line or a quantity is wrong
    ├── ConfigError          exit 2  the configuration file is wrong
    ├── RefusedError         exit 4  a limit, disk space or safety forbids it; nothing was started
    │   └── DoubtError       exit 4  the rig is not as it was: what was measured last may be wrong
    │       └── LightLostError   the laser went dark, or was put out, and nobody had asked for it
    ├── CalibrationError     exit 5  a measurement does not allow a calibration; nothing was stored
    ├── DataFileError        exit 5  a file is damaged, foreign, or lacks what is needed
    └── InterruptedScanError exit 6  the scan was stopped; what was measured is safe in the file

Device failures are `drivers.errors.DeviceError` (exit 3) and `drivers.errors.LimitError` (exit 4).
Each message names the thing, what was asked, what came back and what to do about it.
"""

import os
import re
import shlex
import stat
import subprocess
import sys
from pathlib import Path


class RigError(Exception):
    """Any failure that a person can mend."""

    exit_code = 1


class UsageError(RigError):
    """Raised when a command or a quantity cannot be understood."""

    exit_code = 2


class ConfigError(RigError):
    """Raised when a configuration file is missing, unreadable or has a wrong key or value."""

    exit_code = 2


class RefusedError(RigError):
    """Raised when a limit, the disk space or safety forbids what was asked, before anything is started."""

    exit_code = 4


class DoubtError(RefusedError):
    """Raised when the rig is no longer as it was: what was measured since the last look may be wrong."""


class LightLostError(DoubtError):
    """Raised when there is no light any more although nobody had asked for its end."""


class DataFileError(RigError):
    """Raised when a data file is damaged, foreign, or lacks what is needed."""

    exit_code = 5


class InterruptedScanError(RigError):
    """Raised when a scan was stopped before its end; the file keeps all that was measured."""

    exit_code = 6


class CalibrationError(RigError):
    """Raised when what was measured does not allow a calibration; nothing is stored."""

    exit_code = 5


def printable(text: str) -> str:
    r"""Return text without control characters: those but line ends, and halves of characters, as escapes.

    A file may be called anything; its name in a message must not steer the terminal.
    """
    return "".join(one if one == "\n" or one.isprintable() else _escaped(one) for one in text)


def in_a_line(text: str) -> str:
    """Return text as `printable`, with line ends as escapes, too: a name out of a file stays in its line."""
    return printable(text).replace("\n", "\\n")


def no_file(path: Path, remedy: str = "check the name") -> str:
    """Return what there is in place of a file that is to be read, and what to do."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return f"{path} does not exist; {remedy}"
    except (OSError, ValueError) as problem:
        return f"{path} cannot be read ({reason(problem)}); {remedy}"
    if stat.S_ISDIR(mode):
        return f"{path} is a folder, not a file; {remedy}"
    return f"{path} is a pipe or a device, not a file; {remedy}"


def refuse_folder(path: Path, asked: str = "") -> None:
    """Refuse the name of a folder for a file that is to be written, as ``asked`` by an option: UsageError."""
    if os.path.isdir(path):  # also of names that no file can have
        raise UsageError(f"{asked}{path} is a folder; give the name of a file in it, e.g. {path / 'NAME'}")


def reason(problem: Exception) -> str:
    """Return why the system refused a file, in its words, without the name of the file.

    HDF5 wraps them in its own.
    """
    if told := re.search(r"errno = (\d+)", str(problem)):
        return os.strerror(int(told[1]))
    said = (isinstance(problem, OSError) and problem.strerror) or str(problem)
    return said.splitlines()[0] if said else type(problem).__name__


def in_shell(*words: object) -> str:
    """Return a command as it is typed: words with blanks or signs of the shell are quoted.

    A path that begins with a dash is written so that it is not taken for an option.
    """
    texts = [
        os.path.join(os.curdir, word) if isinstance(word, Path) and str(word).startswith("-") else str(word)
        for word in words
    ]
    return subprocess.list2cmdline(texts) if os.name == "nt" else shlex.join(texts)


def command_line() -> str:
    """Return the command that runs, as it is typed; empty where another program uses this one."""
    program = Path(sys.argv[0] if sys.argv else "")
    if program.stem not in ("rig", "rig-script") and program.parts[-2:] != ("rig", "__main__.py"):
        return ""
    return in_shell("rig", *sys.argv[1:])


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
