"""``rig laser``: put the light out, say what is known of it, and acknowledge a trip."""

import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson, config_option

if TYPE_CHECKING:
    from rig.model.config import RigConfig

laser = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")

ThisRig = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE", help="The rig. [dim]\\[default: all that are lit from here][/dim]"
    ),
]


@laser.callback()
def _laser() -> None:
    """Put the laser's light out, also while a scan runs; see what is known of it."""


@laser.command("off")
def off(config: ThisRig = None, as_json: AsJson = False) -> None:
    """Put the light out, now, also while a scan or a calibration runs; that one ends and keeps its data.

    Without --config, every laser that a program on this computer has in its hands goes dark, whatever
    RIG_CONFIG names. With it, the laser of that rig is opened and made dark if no program has it.
    """
    from rig.commands import console
    from rig.errors import RefusedError
    from rig.model.config import load

    done = _darkened(load(config) if config else None)
    if as_json:
        console.print_json({"lasers": done})
    else:
        for one in done:
            if one["dark"]:
                console.announce(f"{one['rig']}: the laser at {one['laser']} is dark.")
        if not done:
            console.announce(
                "No program on this computer controls a laser. To switch one off anyway: --config FILE"
            )
    if still := [str(one["laser"]) for one in done if not one["dark"]]:
        raise RefusedError(
            f"treat the laser at {', '.join(still)} as EMITTING: turn its key off by hand, now"
        )


def _darkened(rig: "RigConfig | None") -> list[dict[str, object]]:
    """Put out all lasers that programs have, or the one of a rig; return what came of it."""
    from rig.errors import RefusedError
    from rig.light.state import watchmen
    from rig.light.switch import switch_off

    done: list[dict[str, object]] = []
    for one in watchmen():
        if rig is None or one.laser == rig.light_place:
            dark = switch_off(one)
            if dark is not None:  # else it is gone, and has put its light out before
                done.append({"rig": one.rig, "laser": one.laser, "dark": dark})
    if rig is not None and not done:
        if rig.simulated:
            raise RefusedError(f"{rig.name} is simulated: its laser ends with the program that simulates it")
        done.append({"rig": rig.name, "laser": rig.light_place, "dark": _made_dark(rig)})
    return done


def _made_dark(rig: "RigConfig") -> bool:
    """Make a laser dark that no program has, and say how it was found."""
    from drivers.errors import DeviceError
    from rig.commands import console
    from rig.errors import RigError
    from rig.light.dark import make_dark

    try:
        console.announce(make_dark(rig))
    except (DeviceError, RigError) as found:  # a port that is not there, too: nobody knows of the light then
        console.announce(str(found))
        return False
    return True


@laser.command("status")
def status(as_json: AsJson = False) -> None:
    """Say which programs on this computer have a laser in their hands, and which trips are open."""
    from rig.commands import console
    from rig.light.state import trips
    from rig.light.switch import present

    guards = [{"rig": one.rig, "laser": one.laser, "guard": one.pid} for one in present()]
    open_trips = [{"rig": one.rig, "when": one.when, "reason": one.reason} for one in trips()]
    if as_json:
        console.print_json({"guards": guards, "trips": open_trips})
        return
    for guard in guards:
        console.announce(
            f"{guard['rig']}: the laser at {guard['laser']} is guarded by process {guard['guard']}"
        )
    for trip in open_trips:
        console.announce(f"{trip['rig']}: trip at {trip['when']}, not acknowledged: {trip['reason']}")
    if not guards and not open_trips:
        console.announce("No program on this computer controls a laser, and no trip is open.")


@laser.command("acknowledge")
def acknowledge(
    config: Annotated[Path, config_option("The rig that tripped.")],
) -> None:
    """Say, as a person who has looked at the rig, that it may be lit again after a trip.

    A word has to be typed that is new each time, at a terminal: no script does it.
    """
    from rich.prompt import Prompt

    from rig.commands import console
    from rig.errors import RefusedError, UsageError
    from rig.light.state import forget_trip, trip_of
    from rig.model.config import built_in, load

    rig = load(config) if config else built_in()
    trip = trip_of(rig)
    if trip is None:
        console.announce(f"No trip of {rig.name} is open.")
        return
    if not sys.stdin.isatty():
        raise UsageError("a trip is acknowledged by a person at a terminal, not by a script")
    word = "".join(secrets.choice("abcdefghjkmnpqrstuvwxyz") for _ in range(5))
    console.announce(f"Trip of {trip.rig} at {trip.when}: {trip.reason}")
    if Prompt.ask(f"You have checked the rig, and it is in order. Type {word}", console=console.err) != word:
        raise RefusedError("that was a different word: the trip stays open")
    forget_trip(rig)
    console.announce("Acknowledged: the laser may be switched on again.")
