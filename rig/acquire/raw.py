"""The timing instrument's records, kept beside the scan file as they come."""

from pathlib import Path
from types import TracebackType
from typing import Self

from rig.acquire.abilities import tagging_of
from rig.acquire.events import Ended, Event, Recorded
from rig.files.description import ScanDescription
from rig.files.records import PtuRecorder


class RawRecords:
    """A consumer of scan events that writes records to a ``.ptu`` file, if there is to be one.

    Use as a context manager.

    Parameters
    ----------
    path
        The file; None for none.
    description
        The scan.
    first
        The step with which it goes on.

    Raises
    ------
    rig.errors.UsageError
        If the file exists, or cannot be created.
    """

    def __init__(self, path: Path | None, description: ScanDescription, first: int = 0) -> None:
        self._recorder = None if path is None else _recorder(path, description, first)
        self._told = False

    def __call__(self, event: Event) -> None:
        """Write what was recorded."""
        if self._recorder is None:
            return
        match event:
            case Recorded(words=words, step=step):
                self._recorder.add(words, step)
            case Ended(steps_done=steps):
                self._recorder.close(steps)

    def problem(self) -> str:
        """Return why the records ended before the scan, once; else nothing."""
        if self._recorder is None or self._told or not self._recorder.problem:
            return ""
        self._told = True
        return self._recorder.problem

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._recorder is not None:
            self._recorder.close(None)


def _recorder(path: Path, description: ScanDescription, first: int) -> PtuRecorder:
    if description.state is None:
        return PtuRecorder(path, description, first)
    config = description.state.config
    return PtuRecorder(path, description, first, recorded_by=tagging_of(config).recorded_by(config.tcspc))
