"""From scan events to the scan file."""

from rig.engine import Ended, Event, LineDone, PositionDone, RatesChecked
from rig.files.scan_writer import ScanWriter


class Recorder:
    """A consumer of scan events that streams histograms to a file.

    Each line of the grid is on disk before the next begins; the closing record tells how the scan ended.

    Parameters
    ----------
    writer
        The open scan file.
    """

    def __init__(self, writer: ScanWriter) -> None:
        self._writer = writer
        self._warnings: dict[str, None] = {}  # a set that keeps its order

    def __call__(self, event: Event) -> None:
        """Record what belongs in the file."""
        match event:
            case RatesChecked(warnings=warnings):
                self._note(warnings)
            case PositionDone(exposure=exposure):
                self._note(exposure.warnings)
                self._writer.append(exposure.counts, exposure.live_time_s)
            case LineDone():
                self._writer.checkpoint()
            case Ended(outcome=outcome, reason=reason):
                self._writer.close(outcome.value, reason, list(self._warnings))

    def _note(self, warnings: tuple[str, ...]) -> None:
        self._warnings.update(dict.fromkeys(warnings))
