"""``rig calibrate all``: one calibration after the other, each with what those before it found."""

from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.calibrate_run import AsJson, Config, Keep, Seed, calibrated, configuration

if TYPE_CHECKING:
    from rig.calibrate.routine import Routine


def all_(
    config: Config = None,
    seed: Seed = None,
    keep: Keep = None,
    without_cameras: Annotated[
        bool,
        typer.Option(
            "--without-cameras", help="Calibrate the galvo by times of flight and marks on the wall."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure everything, in the order in which one builds on another.

    It stops at the first calibration that fails; those before it are stored. Each can be measured alone with
    other options, see its own help.
    """
    from rig.commands import console
    from rig.errors import RigError
    from rig.model.calibrations.headlines import headline

    rig_config = configuration(config, seed)
    routines = _routines(without_cameras)
    found = {}
    for number, routine in enumerate(routines):
        console.say(f"{number + 1}/{len(routines)} {routine.kind}")
        try:
            result = calibrated(routine, rig_config, None, keep)
        except RigError as error:
            left = ", ".join(each.kind for each in routines[number + 1 :])
            raise type(error)(
                f"{routine.kind}: {error}" + (f"\nNot measured because of it: {left}" if left else "")
            ) from None
        console.say(f"    {headline(result.calibration)}")
        found[routine.kind] = result
    if as_json:
        console.print_json(
            {
                kind: {
                    "file": str(result.path),
                    "picture": str(result.picture),
                    "found": headline(result.calibration),
                }
                for kind, result in found.items()
            }
        )
        return
    console.print_facts(
        f"{rig_config.name}: calibrated, {rig_config.calibration.folder}",
        {kind: f"{headline(result.calibration)}\n{result.picture}" for kind, result in found.items()},
    )


def _routines(without_cameras: bool) -> "list[Routine]":
    """Return all routines with their usual options, in the order of `rig.model.calibrations.kinds.KINDS`."""
    from rig.calibrate.dark import DarkRoutine
    from rig.calibrate.dnl import DnlRoutine
    from rig.calibrate.galvo.flight import FlightRoutine
    from rig.calibrate.galvo.routine import CameraRoutine
    from rig.calibrate.gate import GateRoutine
    from rig.calibrate.irf import ResponseRoutine
    from rig.calibrate.time_zero import TimeZeroRoutine
    from rig.model.calibrations.kinds import KINDS

    galvo: Routine = FlightRoutine() if without_cameras else CameraRoutine()
    usual: list[Routine] = [
        galvo,
        TimeZeroRoutine(),
        ResponseRoutine(),
        DarkRoutine(),
        GateRoutine(),
        DnlRoutine(),
    ]
    return sorted(usual, key=lambda routine: list(KINDS).index(routine.kind))
