"""A scan file that another program writes, as messages: what a live view shows that only reads."""

import queue
import threading
import time
from collections.abc import Iterator
from datetime import datetime
from math import nan
from pathlib import Path

import numpy as np

from rig.acquire.events import Ended, Grown, LightChanged, Noticed, Outcome
from rig.errors import RigError, UsageError, in_shell
from rig.files.content import Note
from rig.files.description import ScanDescription
from rig.files.following import Closed, Following, News, Steps, Unread
from rig.files.scan import ScanFile
from rig.live.messages import Block, Gap, Message
from rig.model.plan import ScanPlan

#: The file is looked at so often.
LOOK_S = 1.0


class Follower:
    """Puts what is new in a scan file into an inbox, until nobody writes the file any more.

    Parameters
    ----------
    path
        The scan file.

    Attributes
    ----------
    description
        What it says before its photons.

    Raises
    ------
    rig.errors.DataFileError
        If it is no scan file, or damaged.
    rig.errors.UsageError
        If it has no plan, as of an import.
    """

    def __init__(self, path: Path) -> None:
        self._following = Following(path)
        if self._following.scan.plan is None:
            self.close()
            raise UsageError(
                f"{path} does not hold a scan plan: there is nothing to watch. "
                f"{in_shell('rig', 'report', path)} shows what it holds"
            )
        self.description = described(self._following.scan)
        self._steps = self.description.steps
        self.trouble = ""

    def close(self) -> None:
        """Let go of the file."""
        self._following.close()

    def run(self, inbox: "queue.Queue[Message | None]", stop: threading.Event) -> None:
        """Look again and again, until the end; the inbox gets None then."""
        when_s = nan  # what is there at first was measured earlier
        try:
            while not (stop.is_set() or self._look(inbox, when_s)):
                stop.wait(LOOK_S)
                when_s = time.time()
        except (RigError, OSError) as error:
            self.trouble = f"the file can no longer be read: {error}"
        finally:
            self.close()
            inbox.put(None)

    def _look(self, inbox: "queue.Queue[Message | None]", when_s: float) -> bool:
        """Put into the inbox what is new; return whether the scan is over."""
        for news in self._following.news():
            for message in self._messages(news, when_s):
                inbox.put(message)
            if isinstance(news, Closed):
                return True
        return False

    def _messages(self, news: News, when_s: float) -> Iterator[Message]:
        match news:
            case Steps():
                offset = np.concatenate([[0], np.cumsum(news.of_pair)])
                live_s = news.live_time_s.astype(np.float64)
                yield Block(news.first, offset, news.photon_bins, live_s, when_s)
            case Unread(first=first, stop=stop):
                yield Gap(first, stop)
            case Note():
                yield _noted(news)
            case ScanPlan():
                yield Grown(news)
            case Closed(status=status, reason=reason, steps_done=done):
                yield Ended(Outcome(status), done, reason)


def _noted(note: Note) -> LightChanged | Noticed:
    light = LightChanged.from_words(note.sentence) if note.kind == "light" else None
    if light is not None:
        return light
    try:
        when_s = datetime.fromisoformat(note.utc).timestamp()
    except ValueError:
        when_s = nan
    return Noticed(note.sentence, note.first, note.last, note.kind, when_s)


def described(scan: ScanFile) -> ScanDescription:
    """Return what a scan file says before its photons."""
    return ScanDescription(
        laser_m=scan.laser_m,
        detector_m=scan.detector_m,
        bins=scan.bins,
        bin_width_s=scan.bin_width_s,
        first_bin_s=scan.first_bin_s,
        delays=scan.delays,
        delay_s=scan.delay_s,
        channels=scan.channels,
        plan=scan.plan,
        state=scan.state,
        simulated=scan.simulated,
        command=scan.command,
        fade_from_s=scan.fade_from_s,
        gate_start_s=scan.gate_start_s,
        gate_stop_s=scan.gate_stop_s,
        instrument_response_s=scan.instrument_response_s,
        tagged=scan.tagged,
    )
