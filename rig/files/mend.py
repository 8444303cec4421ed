"""A scan file made anew from its journal: for reading beside it, or in its place."""

import io
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from rig.atomic import appearing
from rig.errors import DataFileError, RefusedError
from rig.files import content
from rig.files.content import Note
from rig.files.journal import Chunk, Journal, Kind, Record, journal_of, sync_folder

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
            _copy_without_counts(file["transients"], head.create_group("transients"))
        return memory.getvalue()


def _copy_without_counts(old: h5py.Group, new: h5py.Group) -> None:
    new.attrs.update(old.attrs)
    for name in old:
        if name != "counts":
            old.copy(name, new)
    counts = old["counts"]
    empty = new.create_dataset(
        "counts",
        counts.shape,
        counts.dtype,
        chunks=counts.chunks,
        compression=counts.compression,
        compression_opts=counts.compression_opts,
        shuffle=counts.shuffle,
    )
    empty.attrs.update(counts.attrs)
    new["done"][:] = False
    new["live_time_s"][:] = np.nan


def chunks_of(file: h5py.File, measured: int) -> Iterator[Chunk]:
    """Yield the first ``measured`` steps of a scan file as they are stored."""
    counts, live_time_s = file["transients/counts"], file["transients/live_time_s"][:measured]
    for first in range(0, measured, counts.chunks[0]):
        _, packed = counts.id.read_direct_chunk((first, *(0 for _ in counts.shape[1:])))
        yield Chunk(first, live_time_s[first : first + counts.chunks[0]], packed)


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
        for record, rows in _measured(journal, records).values():
            chunk = Chunk.from_bytes(journal.payload(record))
            content.write_counts(file, chunk)
            content.mark(file, chunk.first, chunk.live_time_s[:rows])
        for record in records:
            _apply(file, record.kind, journal, record)
    with target.open("rb+") as written:
        os.fsync(written.fileno())


def _measured(journal: Journal, records: list[Record]) -> dict[int, tuple[Record, int]]:
    """Return the newest record of each chunk by its first step, and how many of its steps are measured."""
    newest: dict[int, tuple[Record, int]] = {}
    for record in records:
        if record.kind is Kind.CHUNK:
            first, rows = Chunk.place(journal.payload(record, Chunk.PLACE_BYTES))
            newest[first] = record, rows
        elif record.kind is Kind.WITHDRAWN:
            first = journal.said(record)
            newest = {
                start: (one, min(rows, first - start))
                for start, (one, rows) in newest.items()
                if start < first
            }
    return newest


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
            f"{path} was not touched: to go on safely, {(size + RESERVE_BYTES) / 1e6:.0f} MB have to be free "
            f"on its disk, and {free / 1e6:.0f} MB are. Free some space, and try again"
        )


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
            return h5py.File(mended, "r")
    except (OSError, RuntimeError) as error:
        raise DataFileError(
            f"cannot mend {path} from its journal in {tempfile.gettempdir()}: {error}. Free some space "
            f"there, or set TMPDIR to another folder, or go on with rig resume {path}"
        ) from error
