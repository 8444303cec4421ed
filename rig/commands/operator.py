"""The person at a real rig, asked through the terminal."""

import sys

from rich.prompt import Prompt

from rig.commands import console
from rig.devices import Galvo, Preparation
from rig.errors import UsageError


class ConsoleOperator:
    """Asks the person at the rig and waits for Enter."""

    def prepare(self, preparation: Preparation) -> None:
        """Ask for a preparation.

        Raises
        ------
        UsageError
            If nobody can answer.
        """
        _ask(f"{preparation.value}. Then press Enter")

    def aim_at(self, galvo: Galvo, mark_m: tuple[float, float]) -> tuple[float, float]:
        """Let the person type angles until the beam is on the mark."""
        angles = (0.0, 0.0)
        console.say(f"Steer the beam onto the mark at x = {mark_m[0]:g} m, y = {mark_m[1]:g} m.")
        while True:
            text = _ask("Optical angles 'x y' in degrees, or Enter when the beam is on the mark")
            if not text.strip():
                return angles
            try:
                x_deg, y_deg = map(float, text.split())
            except ValueError:
                console.say(f"'{text}' is not two numbers, e.g. 3.25 -1.5")
                continue
            angles = (x_deg * 0.017453292519943295, y_deg * 0.017453292519943295)
            galvo.point(*angles)


def _ask(question: str) -> str:
    if not sys.stdin.isatty():
        raise UsageError(f"somebody has to be at the rig: '{question}'. Run this in a terminal")
    return Prompt.ask(question, console=console.err, default="", show_default=False)
