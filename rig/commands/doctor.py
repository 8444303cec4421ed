"""``rig doctor``: what is installed and connected."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson


def doctor(
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", "-c", metavar="FILE", help="The rig; without it the built-in simulated rig."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Tell what is installed and connected, what is missing, and what to do.

    Looks only: nothing moves, nothing emits, no byte is sent to a port; rig devices probe asks the devices.
    Exit code 3 if something is missing.
    """
    from rig.acquire.doctor import examine
    from rig.commands import console
    from rig.model.config import built_in, load

    findings = examine(load(config) if config else built_in(), Path())
    if as_json:
        console.print_json({"findings": [vars(finding) for finding in findings]})
    else:
        console.print_findings(findings)
    if any(finding.verdict == "missing" for finding in findings):
        raise typer.Exit(3)
