"""The timing instrument's records as they come, kept beside the scan file."""

from pathlib import Path

from rig.acquire.events import Ended, Event, Recorded
from rig.errors import UsageError
from rig.files.description import ScanDescription
from rig.files.records import PtuRecorder


class RawRecords:
    """A consumer of scan events that writes a ``.ptu``; whatever becomes of it, the scan goes on.

    Parameters
    ----------
    path
        The file, which must not exist.

    Attributes
    ----------
    problem
        Why it is not whole; empty if it is.
    """

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise UsageError(f"{path} exists and is not overwritten; move it away, or leave --ptu out")
        self.path = path
        self.problem = ""
        self._description: ScanDescription | None = None
        self._recorder: PtuRecorder | None = None

    def begun(self, description: ScanDescription) -> None:
        """Take what is known before the first photon."""
        self._description = description

    def __call__(self, event: Event) -> None:
        """Take an event."""
        match event:
            case Recorded(words=words, step=step):
                if self._recorder is None and step is not None:
                    self._begin(step)
                if self._recorder is not None:
                    self._recorder.add(words, step)
            case Ended(steps_done=steps) if self._recorder is not None:
                self._recorder.close(steps)
                self.problem = self._recorder.problem

    def _begin(self, first: int) -> None:
        assert self._description is not None
        try:
            self._recorder = PtuRecorder(self.path, self._description, first)
        except UsageError as error:  # somebody made such a file meanwhile, or the disk is full
            self.problem, self._description = str(error), None
