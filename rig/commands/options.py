"""Options that several verbs have, said once."""

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE", help="The rig; without it the built-in simulated rig is used."
    ),
]
Grid = Annotated[
    str | None, typer.Option(metavar="COLSxROWS", help="Positions along x and y. [dim]\\[180x130][/dim]")
]
Spacing = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Distance between positions. [dim]\\[1cm][/dim]")
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the simulated photons. [dim]\\[0][/dim]")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")]
