"""One program at a time has a rig: scans and calibrations alike.

The lock is the system's own, on a file: it is gone with the program that holds it, so that none is left.
What the file says is only for people.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from rig.errors import RefusedError, command_line, reason
from rig.light.state import folder, key, now
from rig.model.config import RigConfig


@contextmanager
def locked(config: RigConfig) -> Iterator[None]:
    """Have a rig alone.

    Raises
    ------
    RefusedError
        If another program uses it, which is named; or where nothing can be locked.
    """
    path = folder() / f"rig-{key(config)}.lock"
    with path.open("ab+", buffering=0) as file:
        try:
            free = _lock(file)
        except OSError as error:
            raise RefusedError(
                f"cannot have {config.name} alone: {path} cannot be locked ({reason(error)}). Set RIG_STATE "
                "to a folder on a disk of this computer, the same for all who use the rig"
            ) from None
        if not free:
            holder = _holder(path)
            raise RefusedError(
                f"{config.name} is in use by {holder}. Wait until it has ended, or stop it; "
                "rig laser off switches its light off"
            )
        with suppress(OSError):  # a full disk; the lock holds without words, too
            _write(file, f"{command_line() or 'a Python program'!r}, process {os.getpid()}, since {now()}")
        try:
            yield
        finally:
            with suppress(OSError):
                _write(file, "")


def _write(file: IO[bytes], words: str) -> None:
    file.truncate(0)
    file.write(words.encode(errors="backslashreplace"))


def _holder(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(encoding="utf-8", errors="replace") or "another program"
    return "another program"


if sys.platform == "win32":
    import msvcrt

    #: Bytes that are locked lie far behind the text, so that others can read it.
    _BEYOND = 1 << 20

    def _lock(file: IO[bytes]) -> bool:
        file.seek(_BEYOND)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError:
            return False
        return True

else:
    import fcntl

    def _lock(file: IO[bytes]) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
