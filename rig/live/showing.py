"""Where a scan that is under way is drawn: into pictures in a folder, and a window if somebody would look."""

import os
import shutil
import sys
import time
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Protocol

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.atomic import appearing
from rig.errors import DataFileError, UsageError
from rig.live.figure import DPI, LiveFigure
from rig.live.lateness import Lateness
from rig.live.messages import Begun, say
from rig.live.state import LiveState, Seen
from rig.show.saving import save

#: The figure is drawn so often at most, and after this many times what drawing it took.
DRAWN_S, REST = 1.0, 2.0
#: A window is looked after so often.
PUMP_S = 0.05
#: A picture with the time it belongs to is kept so often at most, and so often in all at most.
DATED_S, DATED_MOST = 10.0, 100
#: The picture that is replaced.
NEWEST = "now.png"
#: Windows that matplotlib knows, in the order in which they are tried.
WINDOWS = ("macosx", "qtagg", "tkagg", "gtk4agg", "gtk3agg", "wxagg")


class News(Protocol):
    """Something that can be waited for."""

    def wait(self, timeout: float) -> bool:
        """Wait until it is there, or for so many seconds; return whether it is."""
        ...

    def clear(self) -> None:
        """Take it as seen."""
        ...


class Known(Protocol):
    """What is known of a scan, and news of it (`rig.live.process.Worker`)."""

    state: LiveState
    done: bool
    heard_s: float

    @property
    def news(self) -> News:
        """What is worth drawing at once."""
        ...


class Showing:
    """Draws the state of a scan until the scan is over.

    Parameters
    ----------
    known
        What there is to show.
    begun
        Where pictures go, and whether there is to be a window.
    """

    def __init__(self, known: Known, begun: Begun) -> None:
        self._known, self._folder = known, begun.folder
        self._lateness = Lateness(known.state.subject)
        planned_s = begun.description.plan.exposure_total_s if begun.description.plan else 0.0
        self._dated_s = max(DATED_S, planned_s / DATED_MOST)
        self._next_dated_s, self._kept = time.monotonic() + self._dated_s, 0
        self._window = _window() if begun.window else None
        if self._window is None:
            figure = Figure(dpi=DPI)
            FigureCanvasAgg(figure)
        else:
            figure = self._window
        self._live = LiveFigure(figure, known.state.subject)
        figure.canvas.mpl_connect("close_event", lambda event: self._close())
        self._failed = False

    def run(self) -> None:
        """Draw until the last image is drawn; then until the person closes the window, if there is one."""
        if self._window is not None:
            self._window.show()
        while not self._known.done:
            began_s = time.monotonic()
            self._draw(self._known.state.seen())
            took_s = time.monotonic() - began_s
            self._wait(max(DRAWN_S - took_s, REST * took_s))
        self._draw(self._known.state.seen(), last=True)
        if words := self._lateness.words:
            say(f"fact {words}")
        say("pictured")
        while self._window is not None:
            self._wait(1.0)

    def _draw(self, seen: Seen, *, last: bool = False) -> None:
        self._live.update(seen)
        if self._window is not None:
            self._window.canvas.draw_idle()
        if not self._write(self._folder / NEWEST):
            return
        self._lateness.drawn(seen, time.time())
        if last or time.monotonic() >= self._next_dated_s:
            self._kept += 1
            if self._kept % DATED_MOST == 0:  # of a scan that takes longer than was planned
                self._dated_s *= 2
            self._next_dated_s = time.monotonic() + self._dated_s
            self._keep(self._folder / f"{datetime.now():%Y%m%d-%H%M%S}.png")

    def _keep(self, path: Path) -> None:
        """Keep the newest picture under another name."""
        with suppress(OSError), appearing(path) as partial:
            shutil.copyfile(self._folder / NEWEST, partial)

    def _write(self, path: Path) -> bool:
        """Write the picture, and return whether it is there; one that is missed is told once."""
        try:
            self._folder.mkdir(exist_ok=True)
            save(self._live.figure, path)
            return True
        except (DataFileError, UsageError, OSError) as error:
            if not self._failed:
                say(f"trouble {error}; pictures are left out")
            self._failed = True
            return False

    def _wait(self, duration_s: float) -> None:
        """Wait for a while, or until there are news, and look after the window meanwhile."""
        until_s = time.monotonic() + duration_s
        if self._window is None:
            self._known.news.wait(duration_s)
            self._known.news.clear()
            return
        while self._window is not None and time.monotonic() < until_s:
            try:
                self._window.canvas.flush_events()
            except Exception:  # each kit has its own for a window that is gone
                self._close()
            if self._known.news.wait(PUMP_S):
                self._known.news.clear()
                return

    def _close(self) -> None:
        """Go on without a window."""
        if self._window is not None and not self._known.done:
            say(f"trouble its window was closed; pictures are still written to {self._folder}")
        self._window = None


def _window() -> Figure | None:
    """Open a window's figure, or return None where there is no display, or nothing that opens one."""
    displays = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not displays:
        return None
    import matplotlib.pyplot as plt

    for name in WINDOWS:
        try:
            plt.switch_backend(name)
            return plt.figure(num="rig scan", dpi=DPI)
        except Exception:  # each kit fails in its own way where it is not installed or finds no display
            continue
    return None
