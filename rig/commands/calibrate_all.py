"""``rig calibrate all``: one calibration after the other, each with what those before it found."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.calibrate import ROUTINES, Method
from rig.commands.calibrate_run import Keep, calibrated, configuration
from rig.commands.consent import Yes
from rig.commands.options import AsJson, Config, Seed

if TYPE_CHECKING:
    from rig.model.config import RigConfig


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
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Measure everything, in the order in which one builds on another.

    What this rig or computer lacks something for is left out, and said: the mirror by cameras where there are
    none, or no OpenCV. It stops at the first calibration that fails; those before it are stored. Each can be
    measured alone with other options, see its own help.
    """
    from rig.commands import console
    from rig.commands.consent import require_consent
    from rig.commands.notify import announce, failed

    rig_config = configuration(config, seed)
    require_consent(rig_config, yes=yes)
    folder = str(rig_config.calibration.folder)
    try:
        found = _one_after_the_other(rig_config, keep, without_cameras=without_cameras, yes=yes)
    except Exception as error:
        announce(rig_config.notify, failed(error, file=folder))
        raise
    if as_json:
        console.print_json(found)
    else:
        console.print_facts(
            f"{rig_config.name}: calibrated, {folder}",
            {kind: f"{one['found']}\n{one['picture']}" for kind, one in found.items()},
        )
    sentence = f"{folder}: complete, {len(found)} calibrations of {rig_config.name}"
    told = {"file": folder, "status": "complete", "calibrations": found, "sentence": sentence}
    announce(rig_config.notify, told)


def _one_after_the_other(
    rig_config: "RigConfig", keep: Path | None, *, without_cameras: bool, yes: bool
) -> dict[str, dict[str, str]]:
    """Measure and store all; return for each where it is, and what was found."""
    from rig.commands import console
    from rig.errors import RigError
    from rig.model.calibrations.headlines import headline
    from rig.model.calibrations.kinds import KINDS

    options = {"galvo": {"method": Method.FLIGHT}} if without_cameras else {}
    kinds, found = list(KINDS), {}
    for number, kind in enumerate(kinds, 1):
        console.say(f"{number}/{len(kinds)} {kind}")
        routine = ROUTINES[kind](**options.get(kind, {}))
        if reason := routine.lacking(rig_config):
            console.say(f"    left out: {reason}")
            continue
        try:
            result = calibrated(routine, rig_config, None, keep, yes=yes)
        except RigError as error:
            left = f"\nNot measured because of this: {', '.join(kinds[number:])}" if kinds[number:] else ""
            raise type(error)(f"{kind}: {error}{left}") from None
        console.say(f"    {headline(result.calibration)}")
        found[kind] = {
            "file": str(result.path),
            "picture": str(result.picture),
            "found": headline(result.calibration),
        }
    return found
