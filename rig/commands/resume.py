"""``rig resume``: take up an interrupted scan."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.consent import Yes
from rig.commands.options import VARIABLE, AsJson, Live, Until, Web, chosen, usual_configuration


def resume(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file that was interrupted.")],
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            metavar="FILE",
            callback=chosen,
            help=f"The rig. [dim]\\[default: the simulated one if the scan was simulated, or else that of "
            f"{VARIABLE}][/dim]",
        ),
    ] = None,
    until: Until = None,
    live: Live = False,
    web: Web = None,
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Go on with an interrupted scan where it stopped, with the plan and the settings that its file holds.

    The devices must be those that the scan began with, and set the same. Which devices are opened, and their
    limits, is said by the rig's configuration and never by the file. Photons that the file holds are never
    touched. With --until the scan is judged as by 'rig scan', by what the file holds and what comes; its time
    counts from the first new exposure.
    """
    from rig.acquire import acquisition
    from rig.acquire.preflight import check
    from rig.commands import console
    from rig.commands.consent import require_consent
    from rig.commands.operator import ConsoleOperator
    from rig.commands.running import Onlookers, ending, page_at, run
    from rig.model.config import load

    plan, state = acquisition.interrupted(scan, load(config) if config else None, usual_configuration)
    check(plan, state, scan.parent)
    page = page_at(web)
    require_consent(state.config, yes=yes)
    if plan.endless:
        console.say(f"{scan} has no last frame: it goes on until it is stopped.")
    # of this rig's configuration: what a file holds says nobody
    end, notify = ending(until, plan, scan) if until else None, state.config.notify

    def resumed(watch: acquisition.Watch) -> acquisition.ScanResult:
        return acquisition.resume(plan, state, scan, watch, ConsoleOperator(watch.should_stop, yes=yes))

    run(resumed, plan, scan, as_json, config, Onlookers(end, live, web=page, notify=notify))
