"""``rig info``: what a file is."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson


def info(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A scan, volume, calibration, configuration, or another program's file."
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Say what a file is: from when, by what rig, with what plan, settings and calibrations, how it ended.

    A scan that another program writes is told as far as it is; a file of another program is named for what
    'rig import' recognises it as.

    [bold]Examples[/bold]

      rig info scan.h5
      rig info scan-volume.h5 --json
      rig info lab.toml
    """
    from rig.commands import console
    from rig.show.about import about

    found = about(file)
    if as_json:
        console.print_json(found.document)
    else:
        console.print_facts(str(file), found.facts)
