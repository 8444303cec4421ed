"""Writing a scan file so that a killed program loses little and leaves nothing wrong."""

import json
import os
import shutil
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from math import prod
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError, UsageError
from rig.files.description import ScanDescription, Settings
from rig.files.layout import SCAN
from rig.files.salvage import salvage
from rig.files.start import COMPRESSION, utc_now, write_start

#: What is left free on the disk, so that a file can always be closed in order.
RESERVE_BYTES = 16 * 2**20
#: By what a file must be able to grow, beside its chunks: marks, index and closing record.
GROWTH_BYTES = 2**20

Status = Literal["complete", "interrupted", "failed"]


class ScanWriter:
    """Appends steps to a scan file, in the order of acquisition.

    Whole chunks go to the file as they fill. `checkpoint` makes all that was appended permanent: first the
    counts, then, after a flush, the marks that say they are there. So a reader of a killed file finds no mark
    without its counts. A chunk that is still partial at a checkpoint is written too, and rewritten when it is
    full; its marks are taken back before that, since a half rewritten chunk cannot be read.

    An exception may come between any two lines here, a second Ctrl-C for one. So nothing is counted before
    it is there: the buffer keeps its chunk until that was written, and marks are taken to be in the file from
    before they are written until after they are taken back. After a write that failed nothing more is
    written: HDF5 cannot tell what of it reached the disk.

    Use as a context manager; leaving it without `close` records how: complete if all positions were appended,
    interrupted if not, failed if an exception passed through.
    """

    def __init__(self, path: Path, file: h5py.File) -> None:
        """Take over an open scan file. Use `create` or `resume` instead."""
        self.path = path
        self._file: h5py.File | None = file
        self._counts = file["transients/counts"]
        self._done = file["transients/done"]
        self._live_time_s = file["transients/live_time_s"]
        self.steps, *self._shape = self._counts.shape  # in version 1 there is no axis of channels
        done = self._done[()]
        self.appended = int(done.argmin()) if not done.all() else self.steps
        self._marked = self._maybe_marked = self.appended
        self._photons = np.zeros(self.steps)
        self._buffer = np.zeros((self._counts.chunks[0], *self._shape), self._counts.dtype)
        self._first = 0  # step of the buffer's first row
        self._live = np.full(self.steps, np.nan, "<f4")
        self._broken = False

    @classmethod
    def create(cls, path: str | Path, description: ScanDescription) -> Self:
        """Create a new scan file.

        Raises
        ------
        UsageError
            If the file exists, or cannot be created where it was asked for.
        """
        path = Path(path)
        try:
            file = h5py.File(path, "x")
        except FileExistsError:
            raise UsageError(
                f"{path} exists and is not overwritten; give another name, or move the file away"
            ) from None
        except OSError as error:
            raise UsageError(f"cannot create {path}: {_reason(error)}") from None
        try:
            write_start(file, description)
            file.flush()
            return cls(path, file)
        except BaseException:
            file.close()
            path.unlink()
            raise

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
        from rig.files.scan import ScanFile

        path = Path(path)
        with ScanFile(path) as scan:
            if scan.status == "complete":
                raise UsageError(f"{path} is complete: there is nothing to resume")
        with _named(path, "open"), h5py.File(path, "r") as file:
            ours, closed = _written_here(file), "stop" in file
        if not ours:
            raise DataFileError(f"{path} cannot be resumed: it was not written by a scan of this program")
        if not closed:
            with _named(path, "repair"):
                salvage(path)
        with _named(path, "open"):
            file = h5py.File(path, "r+")
        with _named(path, "read"):
            writer = cls(path, file)
            writer._take_up()
            return writer

    def _take_up(self) -> None:
        """Read back what was there, mark the partial chunk as not done, and remove the closing record."""
        assert self._file is not None
        size = len(self._buffer)
        self._first = self.appended - self.appended % size
        self._buffer[: self.appended - self._first] = self._counts[self._first : self.appended]
        self._live[: self.appended] = self._live_time_s[: self.appended]
        for first in range(0, self.appended, size):
            rows = slice(first, min(first + size, self.appended))
            self._photons[rows] = (
                self._counts[rows].reshape(rows.stop - rows.start, -1).sum(axis=1, dtype=float)
            )
        self._unmark_from(self._first)
        self._file.pop("stop", None)
        start_attributes = self._file["start"].attrs
        resumed = json.loads(start_attributes.get("resumed", "[]"))
        start_attributes["resumed"] = json.dumps([*resumed, utc_now()])
        self._file.flush()

    def append(self, counts: NDArray, live_time_s: float = float("nan")) -> None:
        """Add the next step.

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
        if self.appended == self.steps:
            raise ValueError(f"{self.path} has all its {self.steps} steps")
        shape = tuple(self._shape)
        alone = prod(shape[:-1]) == 1
        if np.shape(counts) != shape and not (alone and np.shape(counts) in {shape[-1:], (1, *shape[-1:])}):
            raise ValueError(f"counts must be {shape}, not {np.shape(counts)}")
        if self.appended - self._first == len(self._buffer):
            self._require_space()
            self._write_chunk()
            self._first = self.appended
        np.copyto(self._buffer[self.appended - self._first], np.reshape(counts, shape))
        self._live[self.appended] = live_time_s
        self._photons[self.appended] = np.sum(
            counts, dtype=np.float64 if self._buffer.dtype.kind == "f" else np.uint64
        )
        self.appended += 1

    def record_devices(self, devices: Mapping[str, Settings], pass_index: int = 0) -> None:
        """Write what each device says of itself and its settings before a pass, in place of what was there.

        Raises
        ------
        DataFileError
            If the file cannot be written.
        """
        assert self._file is not None
        with self._writing():
            if pass_index:
                group = self._file.require_group("passes").require_group(str(pass_index))
                group.attrs.update({name: json.dumps(dict(said)) for name, said in devices.items()})
            else:
                for name, settings in devices.items():
                    self._file["devices"].require_group(name).attrs.update(settings)
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
            self._unmark_from(first)
            self._live[first:] = np.nan
            self._live_time_s[first:] = np.nan
            if first < self._first:
                size = len(self._buffer)
                kept = first // size * size
                self._buffer[:] = self._counts[kept : kept + size]
                self._first = kept
            self.appended = first

    def checkpoint(self) -> None:
        """Make all that was appended permanent: counts, flush, marks, flush.

        Raises
        ------
        DataFileError
            If the file cannot be written, or its disk is nearly full.
        """
        if self._marked != self.appended:
            self._require_space()
            self._save()

    def _save(self) -> None:
        if self._marked == self.appended:
            return
        assert self._file is not None
        self._write_chunk()
        with self._writing():
            new = slice(self._marked, self.appended)
            self._live_time_s[new] = self._live[new]
            self._file.flush()
            self._maybe_marked = self.appended
            self._done[new] = True
            self._file.flush()
            self._marked = self.appended

    def close(self, status: Status, reason: str = "", warnings: Sequence[str] = ()) -> None:
        """Write what is left and the closing record, and close the file.

        Parameters
        ----------
        status, reason
            How the run ended, and why in words.
        warnings
            What went less than well, as plain sentences.

        Raises
        ------
        DataFileError
            If the file cannot be written.
        """
        if self._file is None:
            return
        try:
            if not self._broken:
                self._save()
                with self._writing():
                    stop = self._file.require_group("stop")
                    stop.attrs["description"] = SCAN["/stop"].what
                    stop.attrs["status"] = status
                    stop.attrs["reason"] = reason
                    stop.attrs["stopped"] = utc_now()
                    stop.attrs["photons"] = float(self._photons[: self.appended].sum())
                    stop.attrs["warnings"] = json.dumps(list(warnings))
        finally:
            file, self._file = self._file, None
            with _named(self.path, "close"):
                file.close()

    def _write_chunk(self) -> None:
        """Write the buffer as the chunk that holds the newest position.

        Shuffled and deflated here rather than by HDF5's own filters, to the same bytes: nearly half the time.
        """
        self._buffer[self.appended - self._first :] = 0
        itemsize = self._buffer.itemsize
        shuffled = np.ascontiguousarray(self._buffer.view(np.uint8).reshape(-1, itemsize).T)
        packed = zlib.compress(shuffled.data, COMPRESSION)
        with self._writing():
            self._unmark_from(self._first)
            self._counts.id.write_direct_chunk((self._first, *(0 for _ in self._shape)), packed)

    def _unmark_from(self, position: int) -> None:
        assert self._file is not None
        if self._maybe_marked > position:
            self._marked = min(self._marked, position)
            self._done[position : self._maybe_marked] = False
            self._file.flush()
            self._maybe_marked = position

    def _require_space(self) -> None:
        """Raise while there is still room to close the file in order: HDF5 does not survive a full disk."""
        free = shutil.disk_usage(self.path.parent).free
        if free < RESERVE_BYTES + 4 * self._buffer.nbytes:
            raise DataFileError(
                f"the disk of {self.path} has only {free / 1e6:.0f} MB free: the scan ends here, what was "
                "measured is in the file. Free some space, and go on with rig resume"
            )
        if hasattr(os, "posix_fallocate"):
            self._try_to_grow(GROWTH_BYTES + 4 * self._buffer.nbytes)

    def _try_to_grow(self, more_bytes: int) -> None:
        """Make the file longer for a moment: a quota, or a limit on its size, is not in the free space."""
        assert self._file is not None
        handle = self._file.id.get_vfd_handle()
        size = os.fstat(handle).st_size
        try:
            os.posix_fallocate(handle, size, more_bytes)
            os.ftruncate(handle, size)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(handle, size)
            raise DataFileError(
                f"{self.path} may not grow beyond its {size / 1e6:.1f} MB ({error.strerror}): the scan ends "
                "here, what was measured is in the file. Free some space or raise the quota, and go on with "
                "rig resume"
            ) from error

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write to the file; a failure is told by its name, and is the last thing that is tried."""
        try:
            with _named(self.path, "write"):
                yield
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


def _written_here(file: h5py.File) -> bool:
    """Return whether the counts are stored as `ScanWriter` stores them, so that it can add chunks."""
    transients = file["transients"]
    if not ({"counts", "done", "live_time_s"} <= set(transients) and "start" in file):
        return False
    counts = transients["counts"]
    own_filters = counts.compression == "gzip" and counts.shuffle and not counts.fletcher32
    return own_filters and counts.scaleoffset is None and counts.chunks[1:] == counts.shape[1:]


@contextmanager
def _named(path: Path, what: str) -> Iterator[None]:
    """Turn a failure of the file system or of HDF5 into an error that names the file."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise DataFileError(
            f"cannot {what} {path}: {_reason(error)}; check free space and permissions. "
            "What was saved before is still in the file"
        ) from error


def _reason(error: BaseException) -> str:
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    return str(error).splitlines()[0] if str(error) else type(error).__name__
