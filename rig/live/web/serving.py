"""The page of a scan that is under way: what is known of it, served, and the wish to stop it, handed on."""

import time
from typing import Any

from rig.live.messages import Begun, say
from rig.live.showing import Known
from rig.live.web.address import Address
from rig.live.web.document import Beside, Document
from rig.live.web.server import Server, Site


class Serving:
    """Serves what is known of a scan.

    Parameters
    ----------
    known
        What there is to show.
    begun
        What was known before.
    address
        Where the page is to be served.

    Attributes
    ----------
    address
        Where it is served.

    Raises
    ------
    OSError
        If nothing can be served there.
    """

    def __init__(self, known: Known, begun: Begun, address: Address) -> None:
        self.show(known, begun)
        self._stop_asked_s: float | None = None
        listening = address.listening()
        self.address = address.at(listening.getsockname()[1])
        self._server = Server(Site(self.address, self._now, None if begun.reads else self._stop), listening)

    def show(self, known: Known, begun: Begun) -> None:
        """Show this from now on."""
        self._shown = known, Document(begun, known.state.subject)

    def _now(self) -> dict[str, Any]:
        known, document = self._shown
        return document.of(known.state.seen(), Beside(known.heard_s, self._stop_asked_s))

    def _stop(self, who: str) -> bool:
        """Ask the program that scans to stop; return whether there is a scan to be stopped."""
        seen = self._shown[0].state.seen()
        if seen.ended is not None or seen.lost:
            return False
        if self._stop_asked_s is None:
            self._stop_asked_s = time.time()
            say(f"stop {who}")
        return True

    def end(self) -> None:
        """End it, after those who are looking have seen the end."""
        self._server.end()


def serving(known: Known, begun: Begun) -> Serving | None:
    """Serve the page that is wanted; None where none is, or where that fails, which is told."""
    if begun.web is None:
        return None
    try:
        served = Serving(known, begun, begun.web)
        say(f"serving {served.address.port}")
        return served
    except OSError as error:
        say(f"trouble no page can be served at {begun.web.host}:{begun.web.port} ({error.strerror})")
        return None
