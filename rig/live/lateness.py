"""How long after the last photon its pictures are there, measured where they are drawn."""

from rig.live.state import Seen, Subject
from rig.model.quantities import show_duration


class Lateness:
    """Notes when pictures of all positions are there first.

    Times are those of the computer's clock, which both programs share. The last photon's is when the scan had
    it, put to its position.

    Parameters
    ----------
    subject
        What is known of the scan.
    """

    def __init__(self, subject: Subject) -> None:
        self._pairs = subject.steps * subject.channels  # of several frames no picture has so many
        self._coarse_s: float | None = None
        self._last_s: float | None = None

    def drawn(self, seen: Seen, now_s: float) -> None:
        """Take that what was seen has been drawn and written."""
        if seen.picture is None or seen.picture.positions < self._pairs:
            return
        if not seen.final:
            self._coarse_s = self._coarse_s or now_s - seen.newest_s
        else:
            self._last_s = self._last_s or now_s - seen.newest_s

    @property
    def words(self) -> str:
        """What was found, as a sentence; empty if there was no picture of all positions."""
        if self._last_s is None:
            return ""
        coarse = f"coarse after {show_duration(self._coarse_s)}, " if self._coarse_s else ""
        return f"the last photon was seen in its pictures: {coarse}fine after {show_duration(self._last_s)}"
