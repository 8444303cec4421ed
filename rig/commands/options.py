"""Options that several verbs have, said once."""

import os
import re
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from rig.model import UNTIL_STOPPED

#: The panel of a verb's help that has the options of all verbs.
EVERY = "Of every verb"
#: Panels that several verbs have.
WHAT, NOTES, RESULTS, MEANWHILE = "What is measured", "Notes in the file", "Results", "Meanwhile"
COMPUTER = "Computer"
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

    console.say(
        f"Configuration: {path} (named by {VARIABLE}; use --config FILE or --config {BUILT_IN} for "
        "another one)"
    )


Config = Annotated[
    Path | None,
    config_option(f"The rig; '{BUILT_IN}', or without it, the built-in simulated rig."),
]
Grid = Annotated[
    str | None,
    typer.Option(metavar="COLSxROWS", help="Positions along x and y. [dim]\\[default: 180x130][/dim]"),
]


class Order(Enum):
    """Orders in which positions are visited; the value is the command's word."""

    RASTER = "raster"
    UNIDIRECTIONAL = "unidirectional"
    PROGRESSIVE = "progressive"
    RANDOM = "random"


class Mode(Enum):
    """How the mirror goes through the positions; the value is the plan's word, too."""

    STEP = "step"
    CONTINUOUS = "continuous"


Spacing = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Distance between positions. [dim]\\[default: 1cm][/dim]")
]
Place = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="The middle of a mesh, e.g. 0cm,0cm,1.2m. [dim]\\[default: as it stands][/dim]",
    ),
]
Rotate = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Turn a mesh about x, then y, then z, e.g. 0deg,90deg,0deg."),
]
Scale = Annotated[
    float | None,
    typer.Option(min=0, help="Scale a mesh, e.g. by 0.001 from millimetres. [dim]\\[default: 1][/dim]"),
]
#: What is meant by ``--web`` alone; and what, after it, is an address: it ends with a port, or is a number.
HERE, _ADDRESS = "127.0.0.1", re.compile(r"\S*:\d+|\d+(\.\d+){3}|localhost")
Frames = Annotated[
    str | None,
    typer.Option(
        metavar=f"N|{UNTIL_STOPPED}",
        help="How often the whole grid is scanned, for a video; or one frame after the other until "
        "Ctrl-C or a RULE of --until. [dim]\\[default: 1][/dim]",
    ),
]
Until = Annotated[
    str | None,
    typer.Option(
        metavar="RULE",
        help="End when the picture no longer changes ('likeness 0.99'), is clear ('contrast 30'), "
        "or after 'time 60s'; rig resume continues.",
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(metavar="N", min=0, help="Seed of the simulated photons. [dim]\\[default: 0][/dim]"),
]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        rich_help_panel=MEANWHILE,
        help="Show the scan while it runs: counts, rates, light, live image; in a window where there is a "
        "display, and as pictures in SCAN-live/.",
    ),
]
Web = Annotated[
    str | None,
    typer.Option(
        "--web",
        metavar="[HOST:PORT]",
        help="Show the scan as a page in a browser, on this computer; or, with an address, on others, too, "
        "which then need the token that is printed. [dim]\\[default: 127.0.0.1:8642][/dim]",
    ),
]
Ptu = Annotated[
    bool,
    typer.Option(
        "--ptu",
        rich_help_panel=RESULTS,
        help="Also keep the timing instrument's records in SCAN.ptu; only for continuous scans.",
    ),
]
Operator = Annotated[
    str | None, typer.Option(rich_help_panel=NOTES, metavar="NAME", help="Who measures; kept in the file.")
]
Sample = Annotated[
    str | None,
    typer.Option(
        rich_help_panel=NOTES, metavar="TEXT", help="What is measured: the hidden object, the wall."
    ),
]
Purpose = Annotated[
    str | None,
    typer.Option(rich_help_panel=NOTES, metavar="TEXT", help="What the scan is for; rig list shows it."),
]
Note = Annotated[str | None, typer.Option(rich_help_panel=NOTES, metavar="TEXT", help="Other notes.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        rich_help_panel=COMPUTER,
        metavar="ADDRESS",
        help="Compute on workers: local:4, tcp://HOST:8786 or a scheduler's FILE.json. "
        "[dim]\\[default: this process][/dim]",
    ),
]
AsJson = Annotated[
    bool,
    typer.Option("--json", rich_help_panel=EVERY, help="Print the result as one JSON document."),
]


def above_zero(option: str, text: str, kind: str) -> float:
    """Read a quantity of an option that has to be above zero.

    Raises
    ------
    rig.errors.UsageError
        If it is no such quantity, or not above zero.
    """
    from rig.errors import UsageError
    from rig.model.quantities import KINDS, parse

    try:
        value = parse(text, kind)
    except UsageError as error:
        raise UsageError(f"{option}: {error}") from None
    if value <= 0:
        raise UsageError(f"{option} {text}: is not above zero; write a {kind} such as {KINDS[kind][1]}")
    return value


class WithWeb(TyperCommand):
    """A command whose option ``--web`` may stand alone, or be followed by an address."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read what was typed."""
        return super().parse_args(ctx, self.with_address(args))

    @staticmethod
    def with_address(args: list[str]) -> list[str]:
        """Return what was typed, with the address of this computer where ``--web`` has none."""
        given, rest = list(args), []
        while given and given[0] != "--":
            word = given.pop(0)
            alone = word == "--web" and not (given and _ADDRESS.fullmatch(given[0]))
            rest.append(f"--web={HERE}" if alone else word)
        return rest + given
