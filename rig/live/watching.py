"""A page of a scan file that another program writes: the file is followed, and what is known of it served."""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

from rig.errors import RigError, UsageError, in_shell
from rig.files.following import Resumption
from rig.live.feed import folder_of
from rig.live.follow import LOOK_S, Follower
from rig.live.messages import Begun, Message, Next
from rig.live.process import WAITING, Worker, lower_priority
from rig.live.web.address import Address
from rig.live.web.serving import Serving

#: How long an image that is being made may take at the end.
ENDING_S = 10.0


class _Run:
    """A scan from when it is looked at until nobody writes its file: it is followed, and images are made."""

    def __init__(self, scan: Path, address: Address, tell: Callable[[str], None]) -> None:
        self.follower = Follower(scan)
        then = Next(in_shell("rig", "resume", scan), in_shell("rig", "recon", scan))
        self.begun = Begun(
            self.follower.description,
            scan,
            folder_of(scan),
            window=False,
            web=address,
            then=then,
            reads=True,
        )
        self.inbox: queue.Queue[Message | None] = queue.Queue(WAITING)
        self.worker = Worker(self.begun, self.inbox, tell)
        self._working = threading.Thread(target=self.worker.run, daemon=True)

    def follow(self, over: threading.Event) -> None:
        """Follow the file, until nobody writes it or there is another end."""
        self._working.start()
        self.follower.run(self.inbox, over)

    def leave(self) -> None:
        """Make no more images."""
        self.worker.leave()

    def end(self) -> None:
        """Wait for its end."""
        if self._working.is_alive():
            self._working.join(ENDING_S)


class Watching:
    """Follows a scan file and serves its page, while it is entered; also a scan that is resumed meanwhile.

    Parameters
    ----------
    scan
        The scan file.
    address
        Where the page is to be served.
    tell
        Called with what did not go well, a sentence each.

    Attributes
    ----------
    address
        Where it is served.

    Raises
    ------
    rig.errors.DataFileError
        If it is no scan file, or damaged.
    rig.errors.UsageError
        If it has no plan, or the page cannot be served.
    """

    def __init__(self, scan: Path, address: Address, tell: Callable[[str], None]) -> None:
        lower_priority()  # the scan may run on the same computer
        self._scan = scan
        self._tell, self._over = tell, threading.Event()
        self._run = _Run(scan, address, self._hear)
        try:
            self._serving = Serving(self._run.worker, self._run.begun, address)
        except OSError as error:
            raise UsageError(
                f"no page can be served at {address.host}:{address.port} ({error.strerror}); give another "
                "port, --web HOST:PORT"
            ) from None
        self.address = self._serving.address
        self._following = threading.Thread(target=self._follow, daemon=True)

    def __enter__(self) -> Self:
        self._following.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._run.leave()
        self._serving.end()
        while self._following.is_alive():  # it may wait for room in the inbox
            with suppress(queue.Empty):
                self._run.inbox.get(timeout=0.1)
        self._run.end()

    def _follow(self) -> None:
        """Follow the file from run to run."""
        while True:
            self._run.follow(self._over)
            if self._run.follower.trouble:
                self._tell(self._run.follower.trouble)
                return
            resumed = self._next()
            if resumed is None:
                return
            self._run.leave()  # its last image is no longer wanted
            self._run = resumed
            self._serving.show(resumed.worker, resumed.begun)

    def _next(self) -> _Run | None:
        """Wait until the scan is resumed; None where somebody ends this before."""
        resumption = Resumption(self._scan)
        while not self._over.wait(LOOK_S):
            if resumption.begun:
                with suppress(RigError, OSError):  # it has only just begun to write
                    return _Run(self._scan, self.address, self._hear)
        return None

    def _hear(self, line: str) -> None:
        word, _, rest = line.partition(" ")
        if word == "trouble":
            self._tell(rest)

    def stop(self) -> None:
        """End it soon; from any thread, or a signal."""
        self._over.set()

    def wait(self) -> None:
        """Wait until somebody ends it."""
        while not self._over.wait(0.5):  # in short pieces, so that signals are obeyed on all systems
            pass
