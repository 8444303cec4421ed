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
        "--yes", "-y", rich_help_panel=MEANWHILE, help="Light a real laser without a question before."
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

    for sentence in config.unverified:
        console.warn(sentence)
    if config.simulated:
        return
    require_no_trip(config)
    laser = config.laser
    what = (
        f"the laser of {config.name} at {config.light_place}: {laser.power_in_words}, "
        f"{laser.repetition_hz / 1e6:g} MHz"
    )
    if yes:
        console.announce(f"This lights {what}.")
    elif sys.stdin.isatty():
        console.announce(f"This lights {what}. Goggles on, doors closed, nobody in the beam's way?")
        if not Confirm.ask("Light it", console=console.err, default=False):
            raise RefusedError("the laser was not lit, as you said")
    else:
        console.announce(f"This lights {what} in {COUNTDOWN_S} s; Ctrl-C prevents it, --yes does not wait.")
        for left in range(COUNTDOWN_S, 0, -1):
            console.announce(f"{left} ...")
            time.sleep(1.0)


def require_no_trip(config: "RigConfig") -> None:
    """Raise while a trip of the rig was not acknowledged.

    Raises
    ------
    RefusedError
        If there is one.
    """
    from rig.errors import RefusedError
    from rig.light.state import trip_of

    if trip := trip_of(config):
        raise RefusedError(
            f"at {trip.when} the light of {trip.rig} was lost: {trip.reason.removesuffix('.')}. Go and look "
            "at the rig; when all is in order, a person says so with: rig laser acknowledge --config FILE"
        )
