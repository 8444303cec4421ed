"""``rig resume``: take up an interrupted scan."""

from pathlib import Path
from typing import Annotated

import typer


def resume(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file that was interrupted.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")] = False,
) -> None:
    """Take up an interrupted scan where it stopped, with the plan and the settings that its file holds.

    The devices must be those that the scan began with. Photons that the file holds are never touched.
    """
    from rig import acquisition
    from rig.calibration import use
    from rig.commands.running import run

    plan, config = acquisition.interrupted(scan)
    plan.check(config, scan.parent, use.choose(config).pointing(config))
    run(lambda watch: acquisition.resume(plan, config, scan, watch), plan, scan, as_json)
