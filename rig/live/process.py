"""The process that shows a scan which is under way: ``python -m rig.live.process``, in a session of its own.

It reads messages from its standard input (`rig.live.messages`), and says on its standard output, a line
each, ``trouble WHY`` where something does not go well, ``fact WORDS`` for what is worth telling, ``serving
PORT`` when its page can be seen, ``stop WHO`` when somebody asks there for the end of the scan, and
``pictured`` when the last picture is there. Three threads share its work: one reads messages; one keeps the
state, and makes images between two messages; one draws. A fourth serves the page, where one is wanted.
"""

import os
import pickle
import queue
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from recon.accumulate import Coming, GrowingPicture, Picture
from recon.errors import ReconError
from recon.glance import Glance
from recon.window import Window
from rig.errors import RigError
from rig.files.scan import ScanFile
from rig.live.film import Filming
from rig.live.messages import Begun, Block, Message, say
from rig.live.state import LiveState, Subject
from rig.model.photons import photons_in

if TYPE_CHECKING:
    from rig.live.web.serving import Serving

#: Lower priority than anything that scans.
NICENESS = 10
#: Messages that wait here at most; all others wait where they come from.
WAITING = 64
#: A live image is made so often at most, and begins after this part of the time that the one before took.
PICTURE_S, REST = 1.0, 0.25
#: What was left out is read from the scan file so often, and so many steps at once.
CATCH_UP_S, STEPS_AT_ONCE = 60.0, 64


class Growing:
    """The live image of a scan of one frame: coarse while photons come, made of all positions at the end.

    Parameters
    ----------
    subject
        What is known of the scan.

    Attributes
    ----------
    least_s
        Time between two images, at least.
    title
        What the newest image is of.
    """

    least_s = PICTURE_S

    def __init__(self, subject: Subject) -> None:
        ends = tuple(subject.channels * end for end in subject.rounds)
        scan = Coming(subject.capture, ends, Window(start_s=subject.fade_from_s), subject.response_s)
        self._channels, self._steps = subject.channels, subject.steps
        self._coarse, self._full = Glance(scan), GrowingPicture(scan)
        self.title = ""

    @property
    def whole(self) -> bool:
        """Whether all positions have arrived, so that no photons will come."""
        return self._coarse.positions == self._channels * self._steps

    def add(self, block: Block) -> bool:
        """Add the photons of a block; return whether there is something new to image."""
        for one in (self._coarse, self._full):
            one.add_photons(block.first * self._channels, block.offset, block.photon_bins)
        return True

    def picture(self) -> Picture:
        """Make a coarse image of what has arrived."""
        picture = self._coarse.picture()
        self.title = self._of("live", picture)
        return picture

    def last(self, steps: int) -> Picture | None:
        """Make the image of all positions, with the wavelength for all of them; None if there are none."""
        if not self._full.positions:
            return None
        picture = self._full.picture()
        self.title = self._of("last", picture)
        return picture

    def trusts(self, steps: int) -> bool:
        """Return whether it holds the photons of no more steps than these."""
        return self._coarse.positions <= self._channels * steps

    def _of(self, which: str, picture: Picture) -> str:
        pairs = "positions" if self._channels == 1 else "pairs"
        return f"{which} image of {picture.positions:,} {pairs}"


class Worker:
    """Keeps the state of a scan, and makes its live images.

    Parameters
    ----------
    begun
        What is known before.
    inbox
        Messages; None after the last.
    tell
        Takes lines as the program that scans does, of what went well or not.

    Attributes
    ----------
    done
        Whether the last image is there, and no more will come.
    news
        Set where there is something that is worth drawing at once.
    heard_s
        Seconds since 1970 at which the newest message came.
    """

    def __init__(
        self, begun: Begun, inbox: "queue.Queue[Message | None]", tell: Callable[[str], None] = say
    ) -> None:
        self._begun, self._inbox, self._tell = begun, inbox, tell
        self.state = LiveState(Subject.of(begun.scan.name, begun.description))
        self._imaging: Growing | Filming | None = None
        self._fresh = False  # photons that no image shows yet
        self._next_s = self._took_s = 0.0  # when the next image is due, and how long the newest took
        self._caught_up_s = -CATCH_UP_S
        self._left = False
        self.done = False
        self.news = threading.Event()
        self.heard_s = time.time()

    def run(self) -> None:
        """Work until the scan is over and its last image is made."""
        try:
            self._begin_imaging()
            while self._work():
                pass
            if not self._left:
                self._end()
        except Exception as error:
            self._tell(f"trouble it failed ({type(error).__name__}: {error})")
        finally:
            self.done = True
            self.news.set()

    def leave(self) -> None:
        """End soon, without a last image: nobody wants to see it."""
        self._left = True

    def _begin_imaging(self) -> None:
        subject, begun = self.state.subject, self._begun
        try:
            if subject.frames > 1:
                self._imaging = Filming(
                    subject, begun.film, None if begun.reads else begun.folder, self._tell
                )
            else:
                self._imaging = Growing(subject)
        except (ReconError, ValueError) as error:
            self._tell(f"trouble no live image can be made ({error}); all else is shown")

    def _work(self) -> bool:
        """Take a message if there is one, or make an image if it is time for one; False after the last."""
        if self._left:
            return False
        wait_s = max(0.0, min(0.5, self._next_s - time.monotonic())) if self._fresh else 0.5
        try:
            message = self._inbox.get(timeout=wait_s)
        except queue.Empty:
            self._spare()
        else:
            if message is None:
                return False
            self.heard_s = time.time()
            self._take(message)
        behind_s = 0.0 if self._inbox.empty() else self._took_s  # then half of the time is for photons
        whole = self._imaging is not None and self._imaging.whole
        if self._fresh and (whole or time.monotonic() >= self._next_s + behind_s):
            self._picture()
            if whole:  # no photons will come: what the scan does to its end need not be waited for
                self.news.set()
                self._last_picture(self.state.subject.steps)
                if self._inbox.empty():  # otherwise it is drawn with what the scan has said meanwhile
                    self.news.set()
        return True

    def _spare(self) -> None:
        """Read from the scan file what was left out, when there is nothing else to do."""
        if self.state.missing.any() and time.monotonic() - self._caught_up_s > CATCH_UP_S:
            self._catch_up()
            self._caught_up_s = time.monotonic()

    def _take(self, message: Message) -> None:
        self.state(message)
        if isinstance(message, Block) and self._imaging is not None:
            self._fresh |= self._imaging.add(message)

    def _picture(self) -> None:
        assert self._imaging is not None
        began_s = time.monotonic()
        picture = self._imaging.picture()
        self.state.show(picture, self._imaging.title)
        self._took_s = time.monotonic() - began_s
        self._fresh = False
        self._next_s = began_s + max(self._imaging.least_s, (1 + REST) * self._took_s)

    def _catch_up(self) -> None:
        """Read what was measured and not sent from the scan file, as far as it is there."""
        with suppress(RigError, OSError), ScanFile(self._begun.scan) as scan:
            there = np.flatnonzero(self.state.missing & scan.done)
            for steps in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1):
                for first in range(0, len(steps), STEPS_AT_ONCE):
                    some = steps[first : first + STEPS_AT_ONCE]
                    self._take(block_of(scan, range(int(some[0]), int(some[-1]) + 1)))

    def _end(self) -> None:
        """Make the last image, of all that was measured and can be trusted."""
        self.state.lose()
        ended = self.state.seen().ended
        trusted = self.state.subject.steps if ended is None else ended.steps_done
        if isinstance(self._imaging, Growing) and not self._imaging.trusts(trusted):
            self._imaging, self._fresh = Growing(self.state.subject), True  # steps were taken back
            self.state.forget_photons()
        self._catch_up()
        if self._fresh or not self.state.seen().final:
            self._last_picture(trusted)

    def _last_picture(self, trusted: int) -> None:
        """Make the last image, of so many steps."""
        if self._imaging is None:
            return
        picture = self._imaging.last(trusted)
        if picture is not None:
            self.state.show(picture, self._imaging.title, final=True)
            self._fresh = False


def block_of(scan: ScanFile, steps: range) -> Block:
    """Read the photons of some steps from a scan file."""
    counts = scan.counts(steps)
    photons, of_row = photons_in(counts.reshape(-1, counts.shape[-1]))
    offset = np.concatenate([[0], np.cumsum(of_row)])
    live_s = scan.live_time_s[steps.start : steps.stop].astype(np.float64)
    return Block(steps.start, offset, photons, live_s, float("nan"))


def read(source: BinaryIO, inbox: "queue.Queue[Message | None]") -> None:
    """Read messages until there are no more."""
    with suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            inbox.put(pickle.load(source))
    inbox.put(None)


def lower_priority() -> None:
    """Let a scan on the same computer go before."""
    if sys.platform != "win32":
        with suppress(OSError):
            os.nice(NICENESS)


def main() -> None:
    """Show a scan until it is over, and the person has closed the window if there is one."""
    lower_priority()
    source = sys.stdin.buffer
    begun = pickle.load(source)
    from rig.live.showing import Showing

    inbox: queue.Queue[Message | None] = queue.Queue(WAITING)
    worker = Worker(begun, inbox)
    threading.Thread(target=read, args=(source, inbox), daemon=True).start()
    threading.Thread(target=worker.run, daemon=True).start()
    page = _page(worker, begun)
    Showing(worker, begun).run()
    if page is not None:
        page.end()


def _page(worker: Worker, begun: Begun) -> "Serving | None":
    """Serve the page that is wanted, if one is."""
    if begun.web is None:
        return None
    from rig.live.web.serving import serving

    return serving(worker, begun)


if __name__ == "__main__":
    main()
