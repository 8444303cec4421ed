"""A scan file that another program writes, read as it grows: what is new since the last look, and no more."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.files import forms, mend
from rig.files.content import Note
from rig.files.journal import Chunk, Journal, Kind, Record, journal_of
from rig.files.outline import ScanOutline
from rig.files.scan import ScanFile
from rig.model.plan import ScanPlan


@dataclass(frozen=True)
class Steps:
    """Steps that follow one another, with their photons.

    Attributes
    ----------
    first
        The first of them.
    photon_bins, of_pair
        (photons,) bin of each photon, and (steps * channels,) how many each step and channel has.
    live_time_s
        (steps,) how long each was measured.
    """

    first: int
    photon_bins: NDArray[np.unsignedinteger]
    of_pair: NDArray[np.int64]
    live_time_s: NDArray[np.float32]


@dataclass(frozen=True)
class Unread:
    """Steps from ``first`` until before ``stop`` that the closed file has and that were not given."""

    first: int
    stop: int


@dataclass(frozen=True)
class Closed:
    """The end of the file, for now: nobody writes it any more.

    Attributes
    ----------
    status, reason
        How the scan ended, as `ScanOutline` has it.
    steps_done
        How many steps are measured.
    """

    status: str
    reason: str
    steps_done: int


News = Steps | Unread | Note | ScanPlan | Closed


class ScanBeginning(ScanFile):
    """A scan file as it was before its first photon, quick to open whatever it holds."""

    def _open_mended(self, journal: Journal) -> h5py.File:
        return mend.beginning(journal)

    def unpacked(self, chunk: Chunk, first: int) -> tuple[NDArray[np.unsignedinteger], NDArray[np.int64]]:
        """Return the photons of a chunk of its journal, from a step on (`rig.files.form`)."""
        return forms.of_file(self._file).unpacked(self._file["transients"], chunk, first)


class Resumption:
    """Sees whether a scan file that was closed is written again; it takes no lock that a program could miss.

    Parameters
    ----------
    path
        The scan file, which nobody writes now.
    """

    def __init__(self, path: Path) -> None:
        self._journal = journal_of(path)
        self._before = self._stamp()

    @property
    def begun(self) -> bool:
        """Whether something was written since.

        Who resumes a scan locks its journal first, and writes then: a journal with new records is locked.
        """
        now = self._stamp()
        return now is not None and now != self._before

    def _stamp(self) -> tuple[int, int, int] | None:
        """Return what differs when the journal is another, or longer; None where it has no records."""
        try:
            stat = self._journal.stat()
        except OSError:
            return None
        return (stat.st_ino, stat.st_size, stat.st_mtime_ns) if stat.st_size else None


class Following:
    """Reads what is new in a scan file; it changes nothing, and holds nobody up.

    Parameters
    ----------
    path
        The scan file.

    Attributes
    ----------
    scan
        What it says before its photons.

    Raises
    ------
    rig.errors.DataFileError
        If it is no scan file, or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.scan = ScanBeginning(path)
        self._path = path
        self._place = 0  # in the journal, up to which it was read
        self._given = 0  # steps
        self._measured = 0  # steps, without those that were taken back
        self._notes: dict[int, Note] = {}  # by row, as they were given
        self._stop: dict[str, object] | None = None  # the closing record
        self._kept: Journal | None = None  # open since the last look; a journal that grows takes no lock
        self._longest = self.scan.steps

    def news(self) -> Iterator[News]:
        """Yield what is new; after `Closed` there is no more.

        Raises
        ------
        rig.errors.DataFileError
            If the file has become unreadable.
        """
        kept = self._kept
        try:
            journal = Journal(journal_of(self._path), alone=False)
        except FileNotFoundError:
            if kept is None:
                yield from self._of_closed()
                return
            journal, over = kept, True  # its name is gone, since the file is closed; all is in it still
        else:
            over = not journal.growing
            if kept is not None:
                kept.close()
        self._kept = journal
        for record in journal.records(self._place):
            self._place = record.start + record.length
            yield from self._of(journal, record)
        if over:
            self.close()
            said = self._stop or {"status": "interrupted", "reason": "it has no closing record"}
            yield Closed(str(said["status"]), str(said["reason"]), self._measured)

    def close(self) -> None:
        """Let go of the file."""
        self.scan.close()
        if self._kept is not None:
            self._kept.close()

    def _of(self, journal: Journal, record: Record) -> Iterator[News]:
        match record.kind:
            case Kind.CHUNK:
                chunk = Chunk.from_bytes(journal.payload(record))
                stop, first = chunk.first + len(chunk.live_time_s), max(chunk.first, self._given)
                self._measured = stop
                if stop > first:  # a chunk that was not full comes again with more steps
                    photons, of_pair = self.scan.unpacked(chunk, first)
                    self._given = stop
                    yield Steps(first, photons, of_pair, chunk.live_time_s[first - chunk.first :])
            case Kind.WITHDRAWN:
                self._measured = journal.said(record)
            case Kind.BEGUN:
                self._stop = None  # it was resumed
            case Kind.STOP:
                self._stop = journal.said(record)
            case Kind.EVENT:
                row, said = journal.said(record)
                yield from self._of_note(row, Note(**said))
            case Kind.GROWN:
                plan = ScanPlan.from_json(journal.said(record), self._path)
                if len(plan) > self._longest:
                    self._longest = len(plan)
                    yield plan

    def _of_note(self, row: int, note: Note) -> Iterator[Note]:
        if self._notes.get(row) != note:
            self._notes[row] = note
            yield note

    def _of_closed(self) -> Iterator[News]:
        """Yield what a file says that was closed before the first look."""
        with ScanOutline(self._path) as scan:
            if scan.growing:  # it was resumed just now: the next look finds its journal
                return
            for row, note in enumerate(scan.events):
                yield from self._of_note(row, note)
            measured = int(np.count_nonzero(scan.marked))
            if measured:
                yield Unread(0, measured)
            yield Closed(scan.status, scan.reason, measured)
