"""Writing a scan file so that nothing measured is lost, and nothing wrong is taken for measured."""

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.atomic import appearing, refusals_told
from rig.errors import DataFileError, UsageError, in_shell, reason
from rig.files import content, forms, mend
from rig.files.blocks import read
from rig.files.content import Note, let_go
from rig.files.description import ScanDescription, Settings
from rig.files.form_counts import CountForm
from rig.files.form_photons import PhotonForm
from rig.files.journal import Chunk, Journal, Kind, journal_of, present_name, sync_folder
from rig.files.mend import RESERVE_BYTES
from rig.files.opened import hdf5_file
from rig.files.start import start_of, utc_now
from rig.model.plan import ScanPlan

Status = Literal["complete", "interrupted", "failed"]


class ScanWriter:
    """Appends steps to a scan file, in the order of acquisition.

    All goes to a journal beside the file first (`rig.files.journal`), and is permanent after `checkpoint`:
    the journal can then be read after a kill, a full disk or a power cut. The HDF5 file follows, so that
    other programs can read it at any time: whole chunks as they fill, and at checkpoints, after a flush, the
    marks of their steps. `close` completes it, reads it back, and takes the journal away.

    An exception may come between any two lines here. So nothing is counted as written before it is, and what
    is written twice is written the same. After a write that failed nothing more is written: HDF5 cannot tell
    what of it reached the disk. The journal can, and stays.

    Use as a context manager; leaving it without `close` records how: complete if all positions were appended,
    interrupted if not, failed if an exception passed through.
    """

    def __init__(self, path: Path, file: h5py.File, journal: Journal | None) -> None:
        """Take over an open scan file and its journal. Use `create` or `resume` instead."""
        self.path = path
        self._file: h5py.File | None = file
        self._journal = journal
        self._form = forms.of_file(file)(file)
        self._held = content.datasets(file)
        self.steps = self._form.steps
        self._live = np.full(self.steps, np.nan, "<f4")
        self.appended = 0
        self._journaled = self._written = self._marked = 0  # steps: in the journal, in the HDF5 file, marked
        self._notes: list[Note] = []
        self._newest: dict[tuple[str, str], int] = {}  # kind and sentence: the newest row that says it
        self._unsaid: set[int] = set()  # rows of notes that the journal does not hold as they are
        self.safe = 0  # steps that are on disk, whatever happens now
        self._broken = False
        self._lost = ""  # what became of the files, if somebody moved or deleted them
        self._saved_as: Path | None = None  # where a deleted file is saved

    @classmethod
    def create(cls, path: str | Path, description: ScanDescription, *, journaled: bool = True) -> Self:
        """Create a new scan file.

        Parameters
        ----------
        path, description
            Where, and all that is known before the first photon.
        journaled
            Whether a journal keeps what was measured; not needed for a file that can be made again (`whole`),
            whose failures are OSErrors.

        Raises
        ------
        UsageError
            If the file or its journal exists, or cannot be created where it was asked for, or if it would be
            larger than any that is read.
        """
        path = Path(path)
        description.require_readable(path)
        if os.path.exists(journal_of(path)):  # which says no, too, of a name that is too long
            raise UsageError(
                f"{journal_of(path)} exists: it holds the measured data of a scan file of this name. "
                f"Continue with {in_shell('rig', 'resume', path)}, or move it away"
            )
        head = start_of(description)
        try:
            with path.open("xb") as new:
                new.write(head)
        except FileExistsError:
            raise UsageError(
                f"{path} exists and is not overwritten; give another name, or move the file away"
            ) from None
        except OSError as error:
            with suppress(OSError):
                path.unlink()
            raise _not_created(path, error, journaled=journaled) from None
        journal = None
        try:
            if journaled:
                journal = Journal(journal_of(path), new=True)
                _begin(journal, head)
            return cls(path, hdf5_file(path, "r+"), journal)
        except BaseException as error:
            if journal is not None:
                journal.remove()
            path.unlink()
            if isinstance(error, OSError | RuntimeError):
                raise _not_created(path, error, journaled=journaled) from None
            raise

    @classmethod
    @contextmanager
    def whole(cls, target: Path, description: ScanDescription) -> Iterator[Self]:
        """Write a file that can be made again: it has no journal, and appears whole or not at all.

        Raises
        ------
        UsageError
            If its folder does not exist, or it would be larger than any file that is read.
        DataFileError
            If it cannot be written.
        """
        description.require_readable(target)
        with (
            refusals_told(target),
            appearing(target, replaces=False) as partial,
            cls.create(partial, description, journaled=False) as writer,
        ):
            yield writer

    @classmethod
    def resume(cls, path: str | Path) -> Self:
        """Open an interrupted scan file; `appended` says how many positions it holds.

        Raises
        ------
        UsageError
            If the scan is complete already.
        DataFileError
            If the file is not a scan file of this program, or is damaged.
        """
        path = Path(path)
        finish(path)
        journal = mend.open_journal(path, alone=True) or _journal_of(path)
        try:
            with _named(path, "repair"):
                mend.require_room(path, journal.end)
                journal.say(Kind.BEGUN, utc_now())
                journal.sync()
                mend.replace(journal, path)
            with _named(path, "open"):
                file = hdf5_file(path, "r+")
            with _named(path, "read"):
                writer = cls(path, file, journal)
                writer._take_up()
                return writer
        except BaseException:
            journal.close()
            raise

    def _take_up(self) -> None:
        """Read back what is there."""
        assert self._file is not None
        done = read(self._file["transients/done"])
        measured = int(np.count_nonzero(done))
        self._live[:measured] = read(self._file["transients/live_time_s"], slice(measured))
        written = self._form.take_up(measured)
        self._notes = content.read_events(self._file)
        self._newest = {(note.kind, note.sentence): row for row, note in enumerate(self._notes)}
        self.appended = self._journaled = self._marked = self.safe = measured
        self._written = written
        self._unmark()

    @property
    def tagged(self) -> bool:
        """Whether the file holds the bin of each photon rather than histograms."""
        return isinstance(self._form, PhotonForm)

    def append(self, counts: NDArray, live_time_s: float = float("nan")) -> None:
        """Add the next step, counted; a time-tagged file takes its photons in the order of their bins.

        Parameters
        ----------
        counts
            (channels, bins) photons, or (bins,) of the only channel; copied.
        live_time_s
            Measurement time of this step, NaN where unknown.

        Raises
        ------
        ValueError
            If the shape or type does not fit, or all steps are there already.
        DataFileError
            If the file cannot be written, e.g. on a full disk; nothing more will be written then.
        """
        self._make_room()
        self._form.put(self.appended, counts)
        self._live[self.appended] = live_time_s
        self.appended += 1

    def append_photons(
        self, photon_bins: NDArray, of_channel: NDArray, live_time_s: float = float("nan")
    ) -> None:
        """Add the next step, photon by photon, to a time-tagged file.

        Parameters
        ----------
        photon_bins
            (photons,) bin of each photon, channel after channel; copied.
        of_channel
            (channels,) how many of them each channel has.
        live_time_s
            Measurement time of this step, NaN where unknown.

        Raises
        ------
        ValueError
            If shape, type or a bin does not fit, all steps are there already, or the file is of histograms.
        DataFileError
            If the file cannot be written, e.g. on a full disk; nothing more will be written then.
        """
        if not isinstance(self._form, PhotonForm):
            raise ValueError(f"{self.path} holds histograms: it accepts counts, not photons")
        self._make_room()
        self._form.put_photons(self.appended, photon_bins, of_channel)
        self._live[self.appended] = live_time_s
        self.appended += 1

    def extend(self, counts: NDArray) -> None:
        """Add further steps, counted, at once; how long they were measured is not known.

        Parameters
        ----------
        counts
            (steps, channels, bins) photons; copied.

        Raises
        ------
        ValueError
            If the shape or type does not fit, there are too many, or the file holds the bin of each photon.
        DataFileError
            If the file cannot be written; nothing more will be written then.
        """
        if not isinstance(self._form, CountForm) or counts.shape[1:] != self._form.shape:
            raise ValueError(f"{self.path} does not accept counts of shape {counts.shape}")
        while len(counts):
            self._make_room()
            taken = self._form.put_several(self.appended, counts)
            self.appended += taken
            counts = counts[taken:]

    def _make_room(self) -> None:
        """Write what is gathered if it is enough, so that a further step can come."""
        if self.appended == self.steps:
            raise ValueError(f"{self.path} already has all its {self.steps} steps")
        if self._form.full(self.appended):
            self._require_space()
            self._keep()
            self._form.turn(self.appended)

    def grow(self, plan: ScanPlan) -> None:
        """Take more frames, of a plan that goes on until it is stopped.

        Raises
        ------
        ValueError
            If the file was not made for such a plan.
        DataFileError
            If the file cannot be written.
        """
        assert self._file is not None
        if not isinstance(self._form, PhotonForm) or not self._form.grows:
            raise ValueError(f"{self.path} was made for {self.steps} steps: it cannot grow")
        said = plan.model_dump_json()
        broken, self._broken = self._broken, True  # a file that has grown in part is made from the journal
        with self._writing():
            if self._journal is not None:
                self._journal.say(Kind.GROWN, said)
                self._journal.sync()
            content.grow(self._file, said)
            self._file.flush()
            self._form.grow()
            self._live = np.append(self._live, np.full(self._form.steps - self.steps, np.nan, "<f4"))
            self.steps = self._form.steps
        self._broken = broken

    def note(self, sentence: str, first: int, last: int, kind: str = "warning") -> None:
        """Note what happened at some steps; it is kept with the next checkpoint.

        The same sentence about the steps that follow extends the note that is there.

        Parameters
        ----------
        sentence
            What happened, in words.
        first, last
            The steps that it concerns.
        kind
            ``warning``, or what else it is.
        """
        row = self._newest.get((kind, sentence), len(self._notes))
        if row < len(self._notes):
            note = self._notes[row]
            if note.first <= first <= note.last + 1:
                self._unsaid.add(row)
                self._notes[row] = replace(note, last=max(last, note.last))
                return
            row = len(self._notes)
        self._unsaid.add(row)  # before: a note that is there is written
        self._notes.append(Note(utc_now(), first, last, kind, sentence))
        self._newest[kind, sentence] = row

    def record_devices(self, devices: Mapping[str, Settings], pass_index: int = 0) -> None:
        """Write what each device says of itself and its settings before a pass, in place of what was there.

        Raises
        ------
        DataFileError
            If the file cannot be written.
        """
        assert self._file is not None
        said = {name: dict(settings) for name, settings in devices.items()}
        with self._writing():
            if self._journal is not None:
                self._journal.say(Kind.DEVICES, {"devices": said, "pass_index": pass_index})
                self._journal.sync()
            content.write_devices(self._file, devices, pass_index)
            self._file.flush()

    def keep_cut(self, step: int, counts: NDArray, live_time_s: float) -> None:
        """Keep what an exposure counted that was cut short; it does not count as measured.

        Raises
        ------
        DataFileError
            If the file cannot be written.
        """
        assert self._file is not None
        with self._writing():
            content.write_cut(self._file, step, np.reshape(counts, self._form.shape), live_time_s)
            self._file.flush()

    def withdraw(self, first: int) -> None:
        """Take back the steps from ``first`` on, because they turned out not to be trusted.

        Raises
        ------
        DataFileError
            If the file cannot be written.
        """
        if first >= self.appended or self._broken:
            return
        with self._writing():
            gathered, written = self._form.before(first)
            journaled, written = min(self._journaled, first), min(self._written, written)
            # one statement without a call in it: no exception comes between its parts
            self.appended, self._form.at, self._journaled, self._written = (
                first, gathered, journaled, written
            )  # fmt: skip
            if self._journal is not None:
                self._journal.say(Kind.WITHDRAWN, first)
                self._journal.sync()
            self._unmark()

    def _unmark(self) -> None:
        """Take back the marks of what is not, or no longer, in the HDF5 file."""
        assert self._file is not None
        if self._marked > self._written:
            content.unmark(self._file, self._written)
            self._file.flush()
            self._marked = self._written

    def checkpoint(self) -> None:
        """Make all that was appended and noted permanent.

        Raises
        ------
        DataFileError
            If the file cannot be written, its disk is nearly full, or somebody moved or deleted it.
        """
        if self._journaled != self.appended or self._unsaid:
            self._require_space()
            self._look_for_files()
            if self._lost:
                raise DataFileError(self._lost)
            self._save()

    def _save(self, *, last: bool = False) -> None:
        """Write what is new: to the journal; when that is on disk, to the HDF5 file."""
        assert self._file is not None
        self._keep(last=last)
        with self._writing():
            self._unmark()
            if self._journal is not None:
                self._journal.sync()
            self.safe = self.appended
            self._file.flush()
            if self._marked < self._written:
                content.mark(self._file, self._marked, self._live[self._marked : self._written])
            for row, note in self._news():
                content.write_event(self._file, row, note)
            self._file.flush()
            self._marked = self._written
            self._unsaid.clear()

    def _keep(self, *, last: bool = False) -> None:
        """Write notes and steps to the journal, and to the HDF5 file what of it is whole, or the last.

        Notes go first: what was noted of a step is never lost while its counts are there.
        """
        assert self._file is not None
        with self._writing():
            if self._journal is not None:
                for row, note in self._news():
                    self._journal.say(Kind.EVENT, (row, asdict(note)))
            due = self._form.due(self._written, self.appended, last=last)
            if self._journaled == self.appended and not due:
                return
            chunk = self._form.packed(self._journaled, self.appended, self._live)
            if self._journal is not None and self._journaled < self.appended:
                self._journal.add(Kind.CHUNK, chunk.to_bytes())
            self._journaled = self.appended
            if due:
                self._written = self._form.write(chunk, self._written, self.appended, last=last)

    def _news(self) -> list[tuple[int, Note]]:
        """Return the notes that are new or longer since the last checkpoint, with their rows."""
        return [(row, self._notes[row]) for row in sorted(self._unsaid) if row < len(self._notes)]

    def close(self, status: Status, reason: str = "", warnings: Sequence[str] = ()) -> None:
        """Write what is left and the closing record, close the file, and read it back.

        Parameters
        ----------
        status, reason
            How the run ended, and why in words.
        warnings
            What went less than well, as plain sentences; noted of the last step.

        Raises
        ------
        DataFileError
            If the file cannot be written, or is not what was written. The journal stays then.
        """
        if self._file is None:
            return
        whole = False
        try:
            self._look_for_files()
            if not self._broken:
                for sentence in warnings:
                    self.note(sentence, max(self.appended - 1, 0), max(self.appended - 1, 0))
                self._save(last=True)
                self._stop(status, reason)
                whole = True
        finally:
            self._shut(whole)

    def _stop(self, status: Status, reason: str) -> None:
        assert self._file is not None
        sentences = dict.fromkeys(note.sentence for note in self._notes if note.kind == "warning")
        said = {
            "status": status,
            "reason": reason,
            "stopped": utc_now(),
            "photons": self._form.photons(self.appended),
            "warnings": json.dumps(list(sentences)),
        }
        with self._writing():
            if self._journal is not None:
                self._journal.say(Kind.STOP, said)
                self._journal.sync()
            content.write_stop(self._file, said)
            self._file.flush()

    def _shut(self, whole: bool) -> None:
        """Close the files; the journal goes if all was written to the HDF5 file, and can be read there."""
        file, self._file = self._file, None
        journal, self._journal = self._journal, None
        try:
            if file is not None:
                self._close_file(file, journaled=journal is not None)
            if journal is not None and whole:
                if self._saved_as is None:
                    self._read_back()
                else:
                    with _named(self._saved_as, "write"), appearing(self._saved_as) as partial:
                        mend.rebuild(journal, partial)
                journal.remove()
        finally:
            if journal is not None:
                journal.close()

    def _close_file(self, file: h5py.File, *, journaled: bool) -> None:
        if self._broken:
            let_go(file)
        elif journaled:
            with _named(self.path, "close"):
                file.close()
        else:
            with self._writing():
                file.close()

    def _read_back(self) -> None:
        """Make the closed file permanent, and raise DataFileError unless it holds what was measured."""
        with _named(self.path, "write"), self.path.open("rb+") as closed:
            os.fsync(closed.fileno())
        with _named(self.path, "read back"), hdf5_file(self.path, "r") as file:
            marked = file["transients/done"][()]
            right = marked[: self.appended].all() and not marked[self.appended :].any()
            if not right or self._form.altered(file, self._form.sums).any():
                raise DataFileError(
                    f"{self.path} differs from what was written to it: its disk may be failing. "
                    "All that was measured "
                    f"is in {journal_of(self.path)}. Copy both to another disk; rig reads them together"
                )

    def _require_space(self) -> None:
        """Raise while there is still room to close the file in order."""
        free = shutil.disk_usage(self.path.absolute().parent).free
        if free < RESERVE_BYTES + self._form.room_bytes:
            raise DataFileError(
                f"the disk of {self.path} has only {free / 1e6:.0f} MB free: the scan ends here, what was "
                "measured is in the file. Free some space, and continue with rig resume"
            )

    def _look_for_files(self) -> None:
        """Notice whether somebody moved or deleted the files, and note where the data will be.

        An open file does not feel it: without this look all would go to where nobody finds it.
        """
        if self._file is None or self._journal is None or self._lost:
            return
        now = present_name(self.path, self._file.id.get_vfd_handle())
        if now is None:
            self._saved_as = _fresh_name(self.path, "saved")
            self._lost = (
                f"{self.path} was deleted while the scan ran: the scan ends here. What was measured is saved "
                f"as {self._saved_as}; continue with {in_shell('rig', 'resume', self._saved_as)}"
            )
        elif now != self.path:
            self._lost = (
                f"{self.path} was moved to {now} while the scan ran: the scan ends here. What was measured "
                f"is there; continue with {in_shell('rig', 'resume', now)}"
            )
            self.path = now
        elif present_name(self._journal.path, self._journal.descriptor) != self._journal.path:
            self._lost = (
                f"{self._journal.path} was moved or deleted while the scan ran: "
                "without it the data are not safe, and the scan ends here. "
                f"What was measured is in {self.path}; continue with "
                f"{in_shell('rig', 'resume', self.path)}"
            )

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write to the files; a failure is told by its name, and is the last thing that is tried."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._broken = True
            if self._journal is None:
                raise OSError(reason(error)) from error
            raise DataFileError(
                f"cannot write {self.path}: {reason(error)}. Writing has stopped; its first "
                f"{self.safe} of {self.steps} positions are safe. Check free space, "
                f"quota and permissions, and continue with {in_shell('rig', 'resume', self.path)}"
            ) from error
        except Exception:
            self._broken = True
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            self.close("failed", f"{type(error).__name__}: {error}")
        elif self.appended == self.steps:
            self.close("complete", "all positions measured")
        else:
            self.close("interrupted", "closed before the last position")


def finish(path: Path) -> None:
    """Complete a scan file whose program ended after the closing record, but before the file was closed.

    Raises
    ------
    DataFileError
        If another program writes it, or it cannot be written.
    RefusedError
        If there is no room for it; nothing was touched.
    """
    journal = mend.open_journal(path, alone=True)
    if journal is None:
        return
    try:
        if list(journal.records())[-1].kind is Kind.STOP:
            with _named(path, "repair"):
                mend.replace(journal, path)
            journal.remove()
    finally:
        journal.close()


def _not_created(path: Path, error: OSError | RuntimeError, *, journaled: bool) -> Exception:
    why = reason(error)
    return UsageError(f"cannot create {path}: {why}") if journaled else OSError(why)


def _begin(journal: Journal, head: bytes, chunks: Iterable[Chunk] = (), notes: Sequence[Note] = ()) -> None:
    """Put into a new journal all that a scan file holds; from then on the journal stands for it."""
    journal.add(Kind.HEAD, head)
    for chunk in chunks:
        journal.add(Kind.CHUNK, chunk.to_bytes())
    for row, note in enumerate(notes):
        journal.say(Kind.EVENT, (row, asdict(note)))
    journal.say(Kind.BEGUN, "")
    journal.sync()
    sync_folder(journal.path)


def _journal_of(path: Path) -> Journal:
    """Make the journal of a closed scan file, or of one of an older program; the file is not touched.

    Raises
    ------
    UsageError
        If the scan is complete.
    DataFileError
        If the file is not a scan file of this program, or is damaged.
    RefusedError
        If there is no room for it.
    """
    from rig.files.scan import ScanFile

    with ScanFile(path) as scan:
        if scan.status == "complete" and scan.done.all():
            raise UsageError(f"{path} is complete: there is nothing to resume")
        measured = scan.steps if scan.done.all() else int(scan.done.argmin())
        beyond = scan.done[measured:].any()
        warnings = scan.warnings
    with _named(path, "read"), hdf5_file(path, "r") as file:
        if not forms.written_here(file):
            raise DataFileError(f"{path} cannot be resumed: it was not written by a scan of this program")
        notes = content.read_events(file)
        if not notes:  # an older program did not write where warnings were
            notes = [Note(utc_now(), 0, max(measured - 1, 0), "warning", sentence) for sentence in warnings]
        mend.require_room(path, 3 * path.stat().st_size)
        if beyond:
            aside = _fresh_name(path, "as-found")
            shutil.copy2(path, aside)
            told = (
                f"{path.name} was changed after it was measured; the new measurement replaces the "
                f"changed part, and the file as it was found is kept as {aside.name}"
            )
            notes.append(Note(utc_now(), measured, scan.steps - 1, "warning", told))
        journal = Journal(journal_of(path), new=True)
        try:
            _begin(journal, mend.head_of(file), forms.of_file(file).chunks(file, measured), notes)
        except BaseException:
            journal.remove()
            raise
    return journal


@contextmanager
def _named(path: Path, what: str) -> Iterator[None]:
    """Turn a failure of the file system or of HDF5 into an error that names the file."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise DataFileError(
            f"cannot {what} {path}: {reason(error)}; check free space and permissions. "
            "What was saved before is still in the file"
        ) from error


def _fresh_name(path: Path, what: str) -> Path:
    """Return a name like ``path`` that nothing has; in the working folder if its own is gone."""
    folder = path.absolute().parent
    folder = folder if folder.is_dir() else Path.cwd()
    names = (f"{path.stem}-{what}{number or ''}{path.suffix}" for number in count())
    return next(folder / name for name in names if not (folder / name).exists())
