"""The person at a real rig, asked through the terminal."""

import sys
import threading
from collections.abc import Callable
from math import radians

from rich.prompt import Prompt

from rig.commands import console
from rig.errors import UsageError
from rig.model.devices import Board, Galvo, Preparation
from rig.model.quantities import show_length


class ConsoleOperator:
    """Asks the person at the rig and waits for Enter."""

    def __init__(self) -> None:
        self._prepared = Preparation.MEASURE

    def prepare(self, preparation: Preparation) -> None:
        """Ask for a preparation, unless it was the last that was asked for; at first all is as for a scan.

        Raises
        ------
        UsageError
            If nobody can answer.
        """
        if preparation is not self._prepared:
            _ask(f"{preparation.words}. Then press Enter")
            self._prepared = preparation

    def show_board(self, board: Board, mark_m: tuple[float, float] | None) -> None:
        """Ask for the board to be held somewhere."""
        what = f"board of {board.columns} x {board.rows} inner corners at {show_length(board.square_m)}"
        where = "freely before the cameras, tilted, in another place than before, and hold it still"
        if mark_m is not None:
            where = (
                "flat on the wall: the first inner corner (the one in the lower left, the square right and "
                f"up of it black) at x = {show_length(mark_m[0])}, y = {show_length(mark_m[1])}, the columns "
                "along x"
            )
        _ask(f"Hold the {what} {where}. Then press Enter")

    def aim_at(
        self, galvo: Galvo, mark_m: tuple[float, float], meanwhile: Callable[[], None]
    ) -> tuple[float, float]:
        """Let the person type angles until the beam is on the mark."""
        angles = (0.0, 0.0)
        console.say(f"Steer the beam onto the mark at x = {mark_m[0]:g} m, y = {mark_m[1]:g} m.")
        while True:
            text = _ask("Optical angles 'x y' in degrees, or Enter when the beam is on the mark", meanwhile)
            if not text.strip():
                return angles
            try:
                x_deg, y_deg = map(float, text.split())
            except ValueError:
                console.say(f"'{text}' is not two numbers, e.g. 3.25 -1.5")
                continue
            angles = (radians(x_deg), radians(y_deg))
            galvo.point(*angles)


def _ask(question: str, meanwhile: Callable[[], None] = lambda: None) -> str:
    """Return what the person types; ``meanwhile`` is called until then, and may raise."""
    if not sys.stdin.isatty():
        raise UsageError(f"somebody has to be at the rig: '{question}'. Run this in a terminal")
    typed: list[str] = []

    def ask() -> None:
        typed.append(Prompt.ask(question, console=console.err, default="", show_default=False))

    person = threading.Thread(target=ask, daemon=True)
    person.start()
    while person.is_alive():
        meanwhile()
        person.join(0.1)
    if not typed:
        raise UsageError(f"nobody answered: '{question}'. Run this in a terminal")
    return typed[0]
