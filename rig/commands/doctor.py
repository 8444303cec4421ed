"""``rig doctor``: what is installed and connected."""

from pathlib import Path

import typer

from rig.commands.options import AsJson, Config


def doctor(
    config: Config = None,
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
