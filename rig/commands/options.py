"""Options that several verbs have, said once."""

import os
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rig.model.config import RigConfig

#: Names the configuration that is used where none is given.
VARIABLE = "RIG_CONFIG"
#: What is given in place of a file to use the built-in rig, whatever the variable says.
BUILT_IN = "simulated"


def chosen(context: typer.Context, path: Path | None) -> Path | None:
    """Return the file of a configuration, None for the built-in rig; say so if the variable names it."""
    source = context.get_parameter_source("config")
    if path is not None and source is not None and source.name == "ENVIRONMENT":
        _say_variable(path)
    return None if str(path) == BUILT_IN else path


def config_option(words: str) -> Any:
    """Return the option ``--config`` of a verb that the variable answers for, with these words of help."""
    return typer.Option("--config", "-c", metavar="FILE", envvar=VARIABLE, callback=chosen, help=words)


def usual_configuration() -> "RigConfig | None":
    """Return the configuration that the variable names, and say so; None if it names none, or the built-in.

    Raises
    ------
    rig.errors.ConfigError
        If it is wrong.
    """
    from rig.model.config import load

    named = os.environ.get(VARIABLE)
    if not named or named == BUILT_IN:
        return None
    _say_variable(Path(named))
    return load(Path(named))


def _say_variable(path: Path) -> None:
    from rig.commands import console

    console.say(f"Configuration: {path} (named by {VARIABLE}; --config FILE, or {BUILT_IN}, for another one)")


Config = Annotated[
    Path | None,
    config_option(f"The rig; '{BUILT_IN}', or without it, the built-in simulated rig."),
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
