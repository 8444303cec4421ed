"""Options that several verbs have, said once."""

from enum import Enum
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


class Order(Enum):
    """Orders in which positions are visited; the value is the command's word."""

    RASTER = "raster"
    UNIDIRECTIONAL = "unidirectional"
    PROGRESSIVE = "progressive"
    RANDOM = "random"

    @property
    def in_plan(self) -> str:
        """The plan's word: its raster is a snake, lines alternate in direction."""
        return "snake" if self is Order.RASTER else self.value


class Mode(Enum):
    """How the mirror goes through the positions; the value is the plan's word, too."""

    STEP = "step"
    CONTINUOUS = "continuous"


Spacing = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Distance between positions. [dim]\\[1cm][/dim]")
]
#: What is said in place of a number of frames.
UNTIL_STOPPED = "until-stopped"
Frames = Annotated[
    str | None,
    typer.Option(
        metavar=f"N|{UNTIL_STOPPED}",
        help="How often the whole grid is scanned, for a video; or frame after frame until Ctrl-C, or a RULE "
        "of --until. [dim]\\[1][/dim]",
    ),
]
Until = Annotated[
    str | None,
    typer.Option(
        metavar="RULE",
        help="End when the picture stays as it is ('likeness 0.99'), is clear ('contrast 30'), or after "
        "'time 60s'; rig resume goes on.",
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the simulated photons. [dim]\\[0][/dim]")]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Show the scan while it runs: counts, rates, light, live image; in a window where there is a "
        "display, and as pictures in SCAN-live/.",
    ),
]
Ptu = Annotated[
    bool,
    typer.Option(
        "--ptu",
        help="Keep the timing instrument's records, too, in SCAN.ptu; only a continuous scan has them.",
    ),
]
Operator = Annotated[str | None, typer.Option(metavar="NAME", help="Who measures; kept in the file.")]
Sample = Annotated[
    str | None, typer.Option(metavar="TEXT", help="What is measured: the hidden object, the wall.")
]
Purpose = Annotated[str | None, typer.Option(metavar="TEXT", help="What the scan is for; rig list shows it.")]
Note = Annotated[str | None, typer.Option(metavar="TEXT", help="What else is worth keeping.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Compute on workers: local:4, tcp://HOST:8786 or a scheduler's FILE.json. "
        "[dim]\\[this process][/dim]",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")]
