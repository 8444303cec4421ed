"""A page of a scan file that another program writes: the file is followed, and what is known of it served."""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

from rig.errors import UsageError, in_shell
from rig.live.feed import folder_of
from rig.live.follow import Follower
from rig.live.messages import Begun, Message, Next
from rig.live.process import WAITING, Worker, lower_priority
from rig.live.web.address import Address
from rig.live.web.serving import Serving

#: How long an image that is being made may take at the end.
ENDING_S = 10.0


class Watching:
    """Follows a scan file and serves its page, while it is entered.

    Parameters
    ----------
    scan
        The scan file.
    address
        Where the page is served.
    tell
        Called with what did not go well, a sentence each.

    Raises
    ------
    rig.errors.DataFileError
        If it is no scan file, or damaged.
    rig.errors.UsageError
        If it has no plan, or the page cannot be served.
    """

    def __init__(self, scan: Path, address: Address, tell: Callable[[str], None]) -> None:
        lower_priority()  # the scan may run on the same computer
        self._follower = Follower(scan)
        then = Next(in_shell("rig", "resume", scan), in_shell("rig", "recon", scan))
        self._begun = Begun(
            self._follower.description,
            scan,
            folder_of(scan),
            window=False,
            web=address,
            then=then,
            reads=True,
        )
        self._inbox: queue.Queue[Message | None] = queue.Queue(WAITING)
        self._tell, self._over = tell, threading.Event()
        self._worker = Worker(self._begun, self._inbox, self._hear)
        try:
            self._serving = Serving(self._worker, self._begun, address)
        except OSError as error:
            raise UsageError(
                f"no page can be served at {address.host}:{address.port} ({error.strerror}); give another "
                "port, --web HOST:PORT"
            ) from None

        self._following, self._working = (
            threading.Thread(target=what, daemon=True) for what in (self._follow, self._worker.run)
        )

    def __enter__(self) -> Self:
        self._following.start()
        self._working.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._worker.leave()
        self._serving.end()
        self._working.join(ENDING_S)
        while self._following.is_alive():  # it may wait for room in the inbox
            with suppress(queue.Empty):
                self._inbox.get(timeout=0.1)

    def _follow(self) -> None:
        self._follower.run(self._inbox, self._over)
        if self._follower.trouble:
            self._tell(self._follower.trouble)

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
