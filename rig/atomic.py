"""Files that appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from glob import escape
from itertools import count
from pathlib import Path

from rig.errors import DataFileError, UsageError, reason


@contextmanager
def appearing(path: Path, *, replaces: bool = True) -> Iterator[Path]:
    """Give a name beside ``path`` to write to; it becomes ``path`` if the block ends well, and goes if not.

    Parameters
    ----------
    path
        The name.
    replaces
        Whether it replaces what has this name then. If not, it is given another name.

    Raises
    ------
    UsageError
        If the folder does not exist; or, when all is written, if it was given another name.
    """
    if not path.parent.is_dir():
        raise UsageError(f"cannot write {path}: the folder {path.parent} does not exist; create it first")
    partial = path.with_name(_partial(path.stem, str(os.getpid()), path.suffix))
    try:
        yield partial
        if replaces:
            os.replace(partial, path)
        else:
            _name(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _name(partial: Path, path: Path) -> None:
    """Name a file, without replacing another that has this name."""
    for number in count(1):
        name = path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        try:
            os.link(partial, name)
        except FileExistsError:
            continue
        except OSError:  # as on a file system that has no links
            if os.path.lexists(name):
                continue
            os.replace(partial, name)
        break
    if name != path:
        raise UsageError(f"{path} is there already, and is not overwritten: this result is {name}")


@contextmanager
def refusals_told(path: Path, what: str = "") -> Iterator[None]:
    """Turn what the system refuses while a file is written into a `DataFileError` that names it.

    What it refuses of a file with another name, as of one that is read meanwhile, is left as it is.
    """
    try:
        yield
    except OSError as error:
        if not _is_of(path, error):
            raise
        raise DataFileError(
            f"cannot write {what}{path}: {reason(error)}; check free space and permissions"
        ) from error


def _is_of(path: Path, error: OSError) -> bool:
    """Return whether a refusal is of this file, or of what becomes it; without a name: of an open file."""
    if not isinstance(error.filename, str | bytes | os.PathLike):
        return True
    name = Path(os.fsdecode(error.filename)).name
    return name == path.name or fnmatchcase(name, _pattern(path))


def remove_unfinished(path: Path) -> None:
    """Remove what programs that were killed began to write for this name; none may write it now."""
    for left in path.parent.glob(_pattern(path)):
        left.unlink(missing_ok=True)


def _pattern(path: Path) -> str:
    """Return what matches the names of files that are to become this one."""
    return _partial(escape(path.stem), "*", escape(path.suffix))


def _partial(stem: str, process: str, suffix: str) -> str:
    """Return a name whose ending is the file's, since some writers choose the format by it."""
    return f".{stem}.{process}.part{suffix}"
