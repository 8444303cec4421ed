"""The command line as a whole: its help, its version, its verbs."""

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import typer
from typer.main import get_command

import rig
from rig.commands.align import align
from rig.commands.batch import batch
from rig.commands.calibrate import calibrate
from rig.commands.calibrate_all import all_ as calibrate_all
from rig.commands.calibrate_show import show as show_calibrations
from rig.commands.compare import compare
from rig.commands.config import config
from rig.commands.devices import devices
from rig.commands.doctor import doctor
from rig.commands.export import export
from rig.commands.importing import import_
from rig.commands.info import info
from rig.commands.init import init
from rig.commands.laser import laser
from rig.commands.listing import list_
from rig.commands.measure import measure
from rig.commands.options import AsJson, WithWeb
from rig.commands.plot import plot
from rig.commands.recon import recon
from rig.commands.report import report
from rig.commands.resume import resume
from rig.commands.scan import scan
from rig.commands.serve import serve
from rig.commands.sim import sim
from rig.commands.stats import stats
from rig.commands.verbs import Log, Quiet, Verbose, Verbs, alike
from rig.commands.watch import watch

_HELP = """Look around a corner: scan a relay wall with a pulsed laser and a single-photon detector,
and image what is hidden.

Exit codes: 0 done; 1 a defect in rig; 2 usage or configuration; 3 device; 4 refused by a limit or \
for safety; 5 invalid data file; 6 stopped, the measured data are safe; 130 stopped by Ctrl-C.

Start with README.md; docs/command-line.md explains units, streams, --json and completion.
"""

app = typer.Typer(
    name="rig",
    help=_HELP,
    no_args_is_help=True,
    cls=Verbs,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rig {rig.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    log: Log = None,
) -> None:
    pass


def version(as_json: AsJson = False) -> None:
    """Say which version this is."""
    if as_json:
        from rig.commands import console

        console.print_json({"version": rig.__version__})
    else:
        typer.echo(f"rig {rig.__version__}")


app.command("scan", cls=WithWeb)(scan)
app.command("resume", cls=WithWeb)(resume)
app.command("watch", cls=WithWeb)(watch)
app.command("align")(align)
app.command("recon")(recon)
app.command("batch")(batch)
calibrate.command("all")(calibrate_all)
calibrate.command("show")(show_calibrations)
app.add_typer(calibrate, name="calibrate")
app.command("measure")(measure)
app.command("compare")(compare)
app.command("stats")(stats)
app.command("info")(info)
app.command("list")(list_)
app.command("report")(report)
app.command("plot")(plot)
app.command("import")(import_)
app.command("export")(export)
app.command("init")(init)
app.command("doctor")(doctor)
app.add_typer(config, name="config")
sim.command("serve")(serve)
app.add_typer(devices, name="devices")
app.add_typer(laser, name="laser")
app.add_typer(sim, name="sim")
app.command("version")(version)
alike(app)


@cache
def command() -> Callable[..., Any]:
    """Return what parses and runs a command line; all verbs are made into it once."""
    return get_command(app)
