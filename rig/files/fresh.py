"""New HDF5 files, whatever becomes of their disk.

HDF5 cannot close a file whose disk refuses what it writes: it crashes later, at whatever it does next. So it
writes to a file that takes everything; what the disk refused is raised when HDF5 is done.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import h5py


class FreshFile(h5py.File):
    """A new HDF5 file, to be filled and closed; a context manager.

    Parameters
    ----------
    path
        Where; what has this name is overwritten.

    Raises
    ------
    OSError
        When it is left, if the disk refused anything.
    """

    def __init__(self, path: Path) -> None:
        self._disk = _TakesAll(path)
        try:
            super().__init__(self._disk, "w")
        except BaseException:
            self._disk.close()
            raise

    def require_taken(self) -> None:
        """Raise OSError if the disk refused anything until now."""
        if self._disk.refused is not None:
            raise self._disk.refused

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            super().__exit__(kind, error, trace)
        finally:
            self._disk.close()
        if kind is None or issubclass(kind, Exception):  # Ctrl-C is not turned into another end
            self.require_taken()


class _TakesAll(io.FileIO):
    """A file that takes everything; after the first refusal of the disk it keeps nothing more.

    Attributes
    ----------
    refused
        Why the disk refused something; None while it has not.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self.refused: OSError | None = None

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        """Write all of it."""
        left = whole = memoryview(data).cast("B")
        with self._trying():
            while left and self.refused is None:
                left = left[super().write(left) :]
        return len(whole)

    def truncate(self, size: int | None = None) -> int:
        """Set the size."""
        with self._trying():
            if self.refused is None:
                return super().truncate(size)
        return size or 0

    @contextmanager
    def _trying(self) -> Iterator[None]:
        try:
            yield
        except OSError as refused:
            self.refused = refused
