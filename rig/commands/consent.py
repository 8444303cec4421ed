"""What is asked before a laser emits that can harm: that a person wants it, and that no trip is open."""

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import MEANWHILE

if TYPE_CHECKING:
    from rig.model.config import RigConfig

Yes = Annotated[
    bool,
    typer.Option(
        "--yes", "-y", rich_help_panel=MEANWHILE, help="Switch a real laser on without asking first."
    ),
]

#: Where nobody can answer, so long is waited before there is light.
COUNTDOWN_S = 5


def require_consent(config: "RigConfig", *, yes: bool) -> None:
    """Return when the laser may be lit: a simulated one at once, a real one when a person wants it.

    Raises
    ------
    RefusedError
        If a trip was not acknowledged, or the person says no.
    """
    from rich.prompt import Confirm

    from rig.commands import console
    from rig.errors import RefusedError
    from rig.light.state import require_no_trip
    from rig.light.words import light_in_words

    for sentence in config.unverified:
        console.warn(sentence)
    if config.simulated:
        return
    require_no_trip(config)
    what = light_in_words(config)
    if yes:
        console.announce(f"This lights {what}.")
    elif sys.stdin.isatty():
        console.announce(f"This lights {what}. Goggles on, doors closed, nobody in the path of the beam?")
        if not Confirm.ask("Light it", console=console.err, default=False):
            raise RefusedError("the laser was not switched on, as you answered")
    else:
        console.announce(
            f"This lights {what} in {COUNTDOWN_S} s; Ctrl-C prevents it; with --yes there is no wait."
        )
        for left in range(COUNTDOWN_S, 0, -1):
            console.announce(f"{left} ...")
            time.sleep(1.0)
