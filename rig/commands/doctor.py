"""``rig doctor``: what is installed and connected."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson, Config


def doctor(
    config: Config = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Folder where scans will be written. [dim]\\[default: here][/dim]",
        ),
    ] = Path(),
    as_json: AsJson = False,
) -> None:
    """Say what is installed and connected, what is missing, and what to do.

    Looks only: nothing moves, nothing emits, no byte is sent to a device; rig devices probe asks them. A file
    is written to the folder for scans for a moment, to know how fast it is. Exit code 3 if something is
    missing that this rig needs.
    """
    from rig.commands import console
    from rig.errors import UsageError
    from rig.model.config import built_in, load
    from rig.setup.doctor import examine

    if not out.is_dir():
        raise UsageError(f"{out} is not a folder: create it first, or give another --out")
    found = examine(load(config) if config else built_in(), out)
    if as_json:
        console.print_json(
            {
                "headline": found.headline,
                "missing": found.count("missing"),
                "warnings": found.count("warning"),
                "findings": [
                    {"check": name, **vars(finding)}
                    for name, findings in found.findings.items()
                    for finding in findings
                ],
            }
        )
    else:
        console.print_findings(found.headline, [one for each in found.findings.values() for one in each])
    if found.count("missing"):
        raise typer.Exit(3)
