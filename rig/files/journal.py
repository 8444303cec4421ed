"""The journal beside a scan file that is being written: what is on disk, whatever becomes of the HDF5 file.

HDF5 cannot promise that: a kill, a full disk or a power cut in the middle of its writes may leave it torn,
and nobody can tell where. So all that a scan file holds goes to ``SCAN.h5.journal`` first, as records that
are only ever appended: a record counts if it is whole and all before it are. The journal alone is enough to
make the scan file anew (`rig.files.mend`); when that was closed and read back, the journal goes.

A record is `MAGIC`, its kind, the length of what follows, a CRC-32 of kind, length and payload, the payload.
"""

import json
import os
import struct
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError

if sys.platform == "win32":

    def _flock(descriptor: int, alone: bool) -> None:
        """Lock nothing: there the HDF5 file's own lock has to do."""

else:
    import fcntl

    def _flock(descriptor: int, alone: bool) -> None:
        """Lock a file, or only try whether it could be read alone; raise BlockingIOError if it is locked."""
        fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        if not alone:
            fcntl.flock(descriptor, fcntl.LOCK_UN)


#: One who looks at a scan tries the lock of its journal: for so long it is asked for again, so often.
READ_S, AGAIN_S = 0.5, 0.02
MAGIC = b"rigJ"
_HEADER = struct.Struct("<4sBQI")
_PLACE = struct.Struct("<QI")


class Kind(IntEnum):
    """What a record holds."""

    HEAD = 1  #: an HDF5 file without photons, byte by byte
    CHUNK = 2  #: a `Chunk`
    BEGUN = 3  #: JSON: the journal holds all that the scan file held, and stands for it from here on
    DEVICES = 4  #: JSON: what the devices said before a pass
    EVENT = 5  #: JSON: a row of the table of events, and which
    WITHDRAWN = 6  #: JSON: the step from which on all are taken back
    STOP = 7  #: JSON: the closing record
    GROWN = 8  #: JSON: a longer plan, with more frames


@dataclass(frozen=True)
class Chunk:
    """Steps as they lie in a chunk of the scan file.

    Attributes
    ----------
    first
        The chunk's first step.
    live_time_s
        (n,) measurement times; the chunk's first n steps are measured.
    packed
        The chunk, shuffled and deflated; its other steps mean nothing.
    """

    PLACE_BYTES: ClassVar[int] = _PLACE.size

    first: int
    live_time_s: NDArray[np.float32]
    packed: bytes

    def to_bytes(self) -> bytes:
        """Return the payload of a record."""
        live = np.asarray(self.live_time_s, "<f4")
        return _PLACE.pack(self.first, len(live)) + live.tobytes() + self.packed

    @classmethod
    def from_bytes(cls, payload: bytes) -> Self:
        """Read the payload of a record."""
        first, rows = cls.place(payload)
        start = _PLACE.size + 4 * rows
        return cls(first, np.frombuffer(payload[_PLACE.size : start], "<f4"), payload[start:])

    @staticmethod
    def place(payload: bytes) -> tuple[int, int]:
        """Return the first step of a payload, and how many are measured; `PLACE_BYTES` of it are enough."""
        first, rows = _PLACE.unpack_from(payload)
        return first, rows


@dataclass(frozen=True)
class Record:
    """Where a record's payload lies in the journal."""

    kind: Kind
    start: int
    length: int


def journal_of(path: Path) -> Path:
    """Return the name of the journal of a scan file."""
    return path.parent / f"{path.name}.journal"


def has_journal(path: Path) -> bool:
    """Return whether a scan file has one: it is written, or was not closed. No name is too long to ask."""
    return os.path.exists(journal_of(path))


class Journal:
    """An open journal; while it is written, it is locked against other writers.

    Parameters
    ----------
    path
        The journal's name.
    new
        Make it, and write; else read what is there.
    alone
        Whether to write, which one program may do at a time. Else it is read, without a lock, so that who
        looks keeps nobody from going on: a record is never changed once it is whole.

    Attributes
    ----------
    growing
        Whether another program wrote it when it was opened.

    Raises
    ------
    UsageError
        If it is to be made and is there already.
    DataFileError
        If it is to be held alone, and another program writes it.
    OSError
        If it cannot be opened or made.
    """

    def __init__(self, path: Path, *, new: bool = False, alone: bool = True) -> None:
        self._descriptor: int | None = None
        self.path = path
        self.end = 0
        self.growing = False
        create = os.O_RDWR | os.O_CREAT | os.O_EXCL
        flags = (create if new else os.O_RDWR if alone else os.O_RDONLY) | getattr(os, "O_BINARY", 0)
        try:
            self._descriptor = os.open(path, flags, 0o666)
        except FileExistsError:
            raise UsageError(
                f"{path} exists: it holds the measured data of a scan file of this name, "
                "and is not overwritten; give another name, or move it away"
            ) from None
        self._lock(alone)

    def _lock(self, alone: bool) -> None:
        refused_s = time.monotonic() + READ_S
        while True:
            try:
                _flock(self.descriptor, alone)
                return
            except BlockingIOError:
                if not alone:
                    self.growing = True
                    return
                if time.monotonic() > refused_s:
                    break
            except OSError:
                return  # a file system without locks
            time.sleep(AGAIN_S)
        self.close()
        scan = str(self.path).removesuffix(".journal")
        raise DataFileError(f"{scan} is being written by another program; wait until it has ended")

    @property
    def descriptor(self) -> int:
        """The system's handle of the file."""
        assert self._descriptor is not None, "the journal is closed"
        return self._descriptor

    def add(self, kind: Kind, payload: bytes) -> None:
        """Append a record; `sync` makes it permanent.

        Raises
        ------
        OSError
            If it could not be written; the records before it stay.
        """
        record = memoryview(_header(kind, payload) + payload)
        written = 0
        # an exception between any two of these lines leaves a torn record, over which the next one is written
        while written < len(record):
            os.lseek(self.descriptor, self.end + written, os.SEEK_SET)
            written += os.write(self.descriptor, record[written:])
        self.end += len(record)

    def say(self, kind: Kind, what: Any) -> None:
        """Append a record in JSON; numpy's numbers are written as plain ones."""
        self.add(kind, json.dumps(what, default=lambda value: value.tolist()).encode())

    def sync(self) -> None:
        """Make sure that all records are on disk and nothing after them."""
        if os.fstat(self.descriptor).st_size > self.end:
            os.ftruncate(self.descriptor, self.end)
        os.fsync(self.descriptor)

    def records(self, start: int = 0) -> Iterator[Record]:
        """Yield the whole records in order, up to the first that is not; `end` is then where they end.

        Parameters
        ----------
        start
            Where to begin: the end of a record.
        """
        self.end = start
        size = os.fstat(self.descriptor).st_size
        while self.end + _HEADER.size <= size:
            header = self._bytes(self.end, _HEADER.size)
            magic, kind, length, _ = _HEADER.unpack(header)
            if magic != MAGIC or kind not in set(Kind) or self.end + _HEADER.size + length > size:
                return
            record = Record(Kind(kind), self.end + _HEADER.size, length)
            if _header(record.kind, self.payload(record)) != header:
                return
            yield record
            self.end = record.start + length

    def payload(self, record: Record, most: int | None = None) -> bytes:
        """Return what a record holds, or its first ``most`` bytes."""
        return self._bytes(record.start, record.length if most is None else most)

    def _bytes(self, start: int, length: int) -> bytes:
        os.lseek(self.descriptor, start, os.SEEK_SET)
        parts = []
        while length and (part := os.read(self.descriptor, length)):
            parts.append(part)
            length -= len(part)
        return b"".join(parts)

    def said(self, record: Record) -> Any:
        """Return what a record in JSON says."""
        return json.loads(self.payload(record))

    @property
    def torn_bytes(self) -> int:
        """How many bytes follow the last whole record."""
        return os.fstat(self.descriptor).st_size - self.end

    def remove(self) -> None:
        """Close it and take it away, unless another file has its name now."""
        with suppress(OSError):
            if name := present_name(self.path, self.descriptor):
                name.unlink()
                sync_folder(name)
        self.close()

    def close(self) -> None:
        """Close it; it stays beside the scan file."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    def __del__(self) -> None:
        self.close()


def _header(kind: Kind, payload: bytes) -> bytes:
    checked = zlib.crc32(payload, zlib.crc32(struct.pack("<BQ", kind, len(payload))))
    return _HEADER.pack(MAGIC, kind, len(payload), checked)


def present_name(path: Path, descriptor: int) -> Path | None:
    """Return the name of an open file: ``path``, or where it is now; None if deleted, or not to be found."""
    opened = os.fstat(descriptor)
    names = [path]
    with suppress(OSError):
        names.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")))
    for name in names:
        with suppress(OSError):
            if os.path.samestat(os.stat(name), opened):
                return name
    return None


def sync_folder(path: Path) -> None:
    """Make names that came or went beside ``path`` permanent, where the system can do that."""
    with suppress(OSError):
        descriptor = os.open(path.absolute().parent, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
