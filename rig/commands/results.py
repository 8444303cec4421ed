"""Names of the files that a verb makes: nothing is overwritten that nobody asked to be.

A name that a person gives is not overwritten without ``--force``. A name that the program chooses is one
that is free: what a verb makes in one run has one number, ``scan-2.png`` beside ``scan-2-volume.h5``. Scans
are measured, and nothing that is made of them replaces one, whatever was asked. See
``docs/decisions/0023-nothing-is-overwritten.md``.
"""

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import RESULTS
from rig.errors import DataFileError, UsageError, no_file, reason, refuse_folder

#: Longest name of a result, in bytes: what is written beside it first has a longer one, of 255 at most.
LONGEST_NAME = 200

Force = Annotated[
    bool,
    typer.Option(
        "--force", rich_help_panel=RESULTS, help="Replace files that have these names; never a scan."
    ),
]


def names(
    source: Path,
    endings: Mapping[str, str],
    given: Mapping[str, Path | None] | None = None,
    *,
    force: bool = False,
) -> dict[str, Path]:
    """Return where the results of one run go.

    Parameters
    ----------
    source
        What they are made of; results that nobody named lie beside it.
    endings
        For each result that has a name of the program's, what follows the source's own name in it.
    given
        What a person named; these may have no ending above.
    force
        Whether files that are there are replaced: then names have no numbers.

    Raises
    ------
    UsageError
        If a name that was given is taken, or is that of a scan.
    DataFileError
        If the source is a folder's name and no file's.
    """
    if not source.name:
        raise DataFileError(no_file(source))
    named = {what: path for what, path in (given or {}).items() if path is not None}
    require_free(named.values(), force=force)
    wanted = {what: ending for what, ending in endings.items() if what not in named}
    for number in count(1):
        stem = source.stem if number == 1 else f"{source.stem}-{number}"
        chosen = {what: source.with_name(f"{stem}{ending}") for what, ending in wanted.items()}
        if force or not any(map(os.path.lexists, chosen.values())):
            break
    require_free(chosen.values(), force=force)
    return {**chosen, **named}


def require_free(paths: Iterable[Path], *, force: bool | None = None) -> None:
    """Refuse names of results that are taken, given twice, or where nothing can be written.

    With ``force`` names of scans alone are taken. None: the verb has no such option.

    Raises
    ------
    UsageError
        If there is one.
    """
    from rig.files.taken import is_scan

    paths = list(paths)
    if twice := {str(path) for path in paths if paths.count(path) > 1}:
        raise UsageError(f"{', '.join(twice)} is the name of two results; give each its own name")
    for path in paths:
        if not _is_there(path):
            _require_folder(path)
            continue
        refuse_folder(path)
        if not force:
            otherwise = "move it away" if force is None else "replace it with --force"
            raise UsageError(f"{path} exists and is not overwritten; give another name, or {otherwise}")
        if is_scan(path):
            raise UsageError(f"{path} is a scan, which --force does not replace; give another name")


def _is_there(path: Path) -> bool:
    """Return whether there is something of this name; raises where there can be nothing of it."""
    if len(os.fsencode(path.name)) > LONGEST_NAME:
        raise UsageError(f"{path}: a result's name has at most {LONGEST_NAME} bytes; give a shorter one")
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as problem:
        raise UsageError(f"cannot write {path} ({reason(problem)}); give another name") from None
    return True


def _require_folder(path: Path) -> None:
    """Refuse a folder in which no file can be made, before anything is computed for it."""
    if not path.parent.is_dir():
        raise UsageError(f"cannot write {path}: the folder {path.parent} does not exist; create it first")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as problem:
        raise UsageError(
            f"cannot write {path}: {path.parent} cannot hold new files ({reason(problem)}); "
            "choose another folder"
        ) from None


@contextmanager
def told_if_stopped(results: Iterable[Path]) -> Iterator[None]:
    """Say at Ctrl-C which results are there: each appears whole or not at all."""
    before = {path: _state(path) for path in results}
    from rig.commands import console

    try:
        yield
        for path in before:
            if path.is_file():
                console.detail(f"wrote {path}, {path.stat().st_size:,} bytes")
    except KeyboardInterrupt:
        whole = [str(path) for path, state in before.items() if _state(path) not in (None, state)]
        left = f"{', '.join(whole)} exists and is complete" if whole else "no file was written or changed"
        console.announce(f"Stopped before its end: {left}.")
        raise


def _state(path: Path) -> tuple[int, int] | None:
    """Return what tells one file of a name from the next."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_ino, stat.st_mtime_ns
