"""The person at a real rig, asked through the terminal."""

import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from math import radians

from rich.prompt import Prompt

from rig.commands import console
from rig.errors import InterruptedScanError, RefusedError, UsageError
from rig.model.devices import Board, Galvo, Preparation, Request
from rig.model.quantities import show_length

#: Where nobody is asked, so long is waited for a laser to fall silent that somebody should switch off.
SILENCE_S = 30.0


class ConsoleOperator:
    """Asks the person at the rig and waits for the answer.

    Parameters
    ----------
    stop
        Whether a stop was asked for; a question ends then, unless it is urgent.
    yes
        Whether ``--yes`` answers for what is set by hand. It never says that a laser is off.
    """

    def __init__(self, stop: Callable[[], object] = lambda: False, *, yes: bool = False) -> None:
        self._prepared = Preparation.MEASURE
        self._stop = stop
        self._yes = yes

    def set_by_hand(self, wanted: Request, meanwhile: Callable[[], bool] = lambda: False) -> str:
        """Ask for something to be set by hand; return who says that it is, and when.

        Raises
        ------
        RefusedError
            If the person says that it is not.
        UsageError
            If nobody can answer.
        InterruptedScanError
            If a stop is asked for meanwhile.
        """
        if wanted.urgent:
            console.shout(wanted.words)
        if self._yes:
            return self._answered_by_option(wanted, meanwhile)
        stop = (lambda: False) if wanted.urgent else self._stop
        while True:
            said = _ask(f"{wanted.words}. Done? (y/n)", meanwhile, stop, "--yes answers in scripts")
            if said is None:
                return f"seen by the program at {_now()}"
            if said.strip().lower() in ("y", "yes"):
                return f"a person, at {_now()}"
            if said.strip().lower() in ("n", "no"):
                raise RefusedError(f"you answered no to this: {wanted.words}")

    def tell(self, words: str) -> None:
        """Tell the person something that must not be missed."""
        console.warn(words)

    def _answered_by_option(self, wanted: Request, meanwhile: Callable[[], bool]) -> str:
        if not wanted.urgent:
            console.announce(f"{wanted.words}: assumed to be done (--yes).")
            return f"--yes, at {_now()}, not by a person"
        until_s = time.monotonic() + SILENCE_S
        while time.monotonic() < until_s:
            if meanwhile():
                return f"seen by the program at {_now()}"
            time.sleep(0.1)
        raise UsageError(f"no person was asked about this (--yes): {wanted.words}")

    def prepare(self, preparation: Preparation) -> None:
        """Ask for a preparation, unless it was the last that was asked for; at first all is as for a scan.

        Raises
        ------
        UsageError
            If nobody can answer.
        """
        if preparation is not self._prepared:
            _ask(f"{preparation.words}. Then press Enter", stop=self._stop)
            self._prepared = preparation

    def show_board(self, board: Board, mark_m: tuple[float, float] | None) -> None:
        """Ask for the board to be held somewhere."""
        what = f"board of {board.columns} x {board.rows} inner corners at {show_length(board.square_m)}"
        where = "freely in front of the cameras, tilted, at a new place, and keep it still"
        if mark_m is not None:
            where = (
                "flat on the wall: the first inner corner (the lower left one, "
                f"with a black square to the right of it and above it) at x = {show_length(mark_m[0])}, "
                f"y = {show_length(mark_m[1])}, the columns "
                "along x"
            )
        _ask(f"Hold the {what} {where}. Then press Enter", stop=self._stop)

    def aim_at(
        self, galvo: Galvo, mark_m: tuple[float, float], meanwhile: Callable[[], None]
    ) -> tuple[float, float]:
        """Let the person type angles until the beam is on the mark."""
        angles = (0.0, 0.0)
        console.announce(f"Steer the beam onto the mark at x = {mark_m[0]:g} m, y = {mark_m[1]:g} m.")
        asked = "Optical angles 'x y' in degrees, or Enter when the beam is on the mark"
        while True:
            text = _ask(asked, meanwhile) or ""
            if not text.strip():
                return angles
            try:
                x_deg, y_deg = map(float, text.split())
            except ValueError:
                console.announce(f"'{text}' is not two numbers, e.g. 3.25 -1.5")
                continue
            angles = (radians(x_deg), radians(y_deg))
            galvo.point(*angles)


def _ask(
    question: str,
    meanwhile: Callable[[], object] = lambda: None,
    stop: Callable[[], object] = lambda: False,
    otherwise: str = "",
) -> str | None:
    """Return what the person types; None if ``meanwhile``, called until then, returns True. It may raise."""
    hint = f"Run this in a terminal{', or ' if otherwise else ''}{otherwise}"
    if not sys.stdin.isatty():
        raise UsageError(f"a person must be at the rig: '{question}'. {hint}")
    typed: list[str] = []

    def ask() -> None:
        with suppress(EOFError, OSError, ValueError):  # nobody is there any more
            typed.append(Prompt.ask(question, console=console.err, default="", show_default=False))

    with console.aside():
        person = threading.Thread(target=ask, daemon=True)
        person.start()
        while person.is_alive():
            if meanwhile() is True:
                return None
            if stop():
                raise InterruptedScanError(f"stopped at the question '{question}'")
            person.join(0.1)
    if not typed:
        raise UsageError(f"there was no answer to: '{question}'. {hint}")
    return typed[0]


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="seconds")
