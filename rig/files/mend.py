"""A scan file made anew from its journal: for reading beside it, or in its place."""

import io
import os
import shutil
import tempfile
from pathlib import Path

import h5py
import numpy as np

from rig.atomic import appearing
from rig.errors import DataFileError, RefusedError, in_shell, reason
from rig.files import content, forms
from rig.files.content import Note
from rig.files.journal import Chunk, Journal, Kind, Record, journal_of, sync_folder
from rig.files.opened import hdf5_file

#: What is left free on the disk, so that a file can always be closed in order.
RESERVE_BYTES = 16 * 2**20


def open_journal(path: Path, *, alone: bool) -> Journal | None:
    """Open the journal of a scan file, or return None where there is none, or it holds nothing of use.

    A journal stands for its file only from the record `Kind.BEGUN` on; before, the file itself is whole.

    Raises
    ------
    DataFileError
        If it is asked for alone and another program writes it, or it cannot be read.
    """
    if not os.path.exists(journal_of(path)):
        return None
    try:
        journal = Journal(journal_of(path), alone=alone)
        if any(record.kind is Kind.BEGUN for record in list(journal.records())):
            return journal
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DataFileError(f"cannot read {journal_of(path)}: {error.strerror}; check permissions") from None
    if alone:
        journal.remove()
    journal.close()
    return None


def head_of(file: h5py.File) -> bytes:
    """Return an HDF5 file with all that a scan file holds but photons, byte by byte."""
    # in memory, since an image of the file itself would hold its photons
    with io.BytesIO() as memory:
        with h5py.File(memory, "w") as head:
            head.attrs.update(file.attrs)
            for name in file:
                if name != "transients":
                    file.copy(name, head)
            _copy_without_photons(file, head)
        return memory.getvalue()


def _copy_without_photons(file: h5py.File, head: h5py.File) -> None:
    old, new, form = file["transients"], head.create_group("transients"), forms.of_file(file)
    new.attrs.update(old.attrs)
    for name in old:
        if name not in form.DATASETS:
            old.copy(name, new)
    form.copy_empty(old, new)
    new["done"][:] = False
    new["live_time_s"][:] = np.nan


def rebuild(journal: Journal, target: Path) -> None:
    """Make a scan file from its journal.

    Raises
    ------
    OSError, RuntimeError
        If it cannot be written.
    """
    records = list(journal.records())
    (head,) = [record for record in records if record.kind is Kind.HEAD]
    target.write_bytes(journal.payload(head))
    with content.written(target) as file:
        _grow(file, journal, records)
        form, measured = forms.of_file(file)(file), 0
        for record, rows in _measured(journal, records):
            chunk = Chunk.from_bytes(journal.payload(record))
            form.restore(chunk, rows)
            content.mark(file, chunk.first, chunk.live_time_s[:rows])
            measured = chunk.first + rows
        form.finish(measured)
        for record in records:
            _apply(file, record.kind, journal, record)
    with target.open("rb+") as written:
        os.fsync(written.fileno())


def outline(journal: Journal) -> h5py.File:
    """Return a scan file in memory with all that its journal says beside photons: quick, whatever its size.

    Steps are marked as measured, and their photons are not there.
    """
    records = list(journal.records())
    file = _head(journal, records)
    for record, rows in _measured(journal, records):
        first, every = Chunk.place(journal.payload(record, Chunk.PLACE_BYTES))
        begin = journal.payload(record, Chunk.PLACE_BYTES + 4 * every)
        content.mark(file, first, np.frombuffer(begin[Chunk.PLACE_BYTES :], "<f4")[:rows])
    for record in records:
        _apply(file, record.kind, journal, record)
    return file


def beginning(journal: Journal) -> h5py.File:
    """Return a scan file in memory with all that its journal says before the first photon."""
    return _head(journal, list(journal.records()))


def _head(journal: Journal, records: list[Record]) -> h5py.File:
    (head,) = [record for record in records if record.kind is Kind.HEAD]
    file = h5py.File(io.BytesIO(journal.payload(head)), "r+")
    _grow(file, journal, records)
    return file


def _grow(file: h5py.File, journal: Journal, records: list[Record]) -> None:
    """Give a file the steps of the longest plan that its journal has."""
    if grown := [record for record in records if record.kind is Kind.GROWN]:
        try:
            content.grow(file, journal.said(grown[-1]))
        except (ArithmeticError, AttributeError, KeyError, LookupError, TypeError, ValueError) as error:
            raise DataFileError(
                f"{journal.path} holds an impossible record of added frames: {error}. It is damaged: "
                "copy it again "
                "from where it came from"
            ) from error


def _measured(journal: Journal, records: list[Record]) -> list[tuple[Record, int]]:
    """Return the chunks that count, in the order of their steps, and how many steps of each are measured.

    A chunk takes the place of all from its first step on, and a withdrawal that of all from its step on.
    """
    kept: list[tuple[int, int, Record]] = []
    for record in records:
        if record.kind is Kind.CHUNK:
            first, rows = Chunk.place(journal.payload(record, Chunk.PLACE_BYTES))
        elif record.kind is Kind.WITHDRAWN:
            first, rows = journal.said(record), 0
        else:
            continue
        while kept and kept[-1][0] >= first:
            kept.pop()
        if kept:
            start, before, one = kept.pop()
            kept.append((start, min(before, first - start), one))
        if rows:
            kept.append((first, rows, record))
    return [(record, rows) for _, rows, record in kept]


def _apply(file: h5py.File, kind: Kind, journal: Journal, record: Record) -> None:
    if kind is Kind.BEGUN:
        if resumed := journal.said(record):
            content.reopen(file, resumed)
    elif kind is Kind.DEVICES:
        content.write_devices(file, **journal.said(record))
    elif kind is Kind.EVENT:
        row, note = journal.said(record)
        content.write_event(file, row, Note(**note))
    elif kind is Kind.STOP:
        content.write_stop(file, journal.said(record))


def replace(journal: Journal, path: Path) -> None:
    """Put a file made from the journal in the place of a scan file; it changes at once or not at all.

    Raises
    ------
    RefusedError
        If there is no room for it; nothing was touched.
    OSError, RuntimeError
        If it cannot be written; nothing was touched.
    """
    require_room(path, journal.end)
    with appearing(path) as partial:
        rebuild(journal, partial)
    sync_folder(path)


def require_room(path: Path, size: int) -> None:
    """Raise RefusedError unless a file of ``size`` bytes, and the reserve, have room beside ``path``."""
    free = shutil.disk_usage(path.absolute().parent).free
    if free < size + RESERVE_BYTES:
        raise RefusedError(
            f"{path} was not changed: to go on safely, {(size + RESERVE_BYTES) / 1e6:.0f} MB have to be free "
            f"on its disk, and {free / 1e6:.0f} MB are. Free some space, and try again"
        )


def keep_as_it_is(path: Path, target: Path) -> bool:
    """Make a file of what is in a scan's journal now, while the scan goes on; return whether there is one.

    Raises
    ------
    DataFileError
        If it cannot be read, or there is no room for the file.
    """
    journal = open_journal(path, alone=False)
    if journal is None:
        return False
    try:
        rebuild(journal, target)
    except (OSError, RuntimeError) as error:
        raise DataFileError(
            f"cannot keep what {path} holds now as {target}: {reason(error)}; "
            "check free space and permissions"
        ) from error
    finally:
        journal.close()
    return True


def for_reading(journal: Journal, path: Path) -> h5py.File:
    """Return a file made from the journal, in a temporary place that goes with it.

    Raises
    ------
    DataFileError
        If there is no room for it.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="rig-mended-", ignore_cleanup_errors=True) as folder:
            mended = Path(folder) / path.name
            rebuild(journal, mended)
            # the open file outlives its name, where the system allows that
            return hdf5_file(mended, "r")
    except (OSError, RuntimeError) as error:
        raise DataFileError(
            f"cannot repair {path} from its journal in {tempfile.gettempdir()}: {reason(error)}. "
            "Free some space there, or set TMPDIR to another folder, "
            f"or continue with {in_shell('rig', 'resume', path)}"
        ) from error
