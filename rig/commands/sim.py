"""``rig sim``: the simulated bench by itself."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import BUILT_IN, AsJson, Grid, Spacing, config_option
from rig.commands.results import told_if_stopped

sim = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")


class Gloss(StrEnum):
    """Models of glossy surfaces."""

    ward = "ward"
    ggx = "ggx"


@sim.callback()
def _sim() -> None:
    """Use the simulated bench by itself."""


@sim.command("render")
def render(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="Name of a built-in scene, or a mesh file.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.h5", help="The scan file to make.")],
    config: Annotated[Path | None, config_option("The simulated rig. [dim]\\[built-in][/dim]")] = None,
    bounces: Annotated[
        int | None, typer.Option(min=3, max=5, help="Bounces of light to follow: 3, 4 or 5. [dim]\\[3][/dim]")
    ] = None,
    grid: Grid = None,
    spacing: Spacing = None,
    roughness: Annotated[
        float | None,
        typer.Option(min=0.05, max=1, help="Of all surfaces, 1 is matt. [dim]\\[each its own][/dim]"),
    ] = None,
    gloss: Annotated[
        Gloss | None,
        typer.Option(help="Model of all glossy surfaces. [dim]\\[each its own][/dim]"),
    ] = None,
    bin_width: Annotated[
        str | None, typer.Option(metavar="TIME", help="Width of a bin. [dim]\\[4ps][/dim]")
    ] = None,
    bins: Annotated[int | None, typer.Option(min=1, help="Number of bins. [dim]\\[15000][/dim]")] = None,
    as_json: AsJson = False,
) -> None:
    """Render what a scan of a hidden scene gives on average: no noise, no gate, no instrument.

    Time zero is the pulse on the wall. The values are expected photons in the configuration's exposure.

    [bold]Examples[/bold]

      rig sim render office office.h5                                 the whole wall, three bounces

      rig sim render letters letters.h5 --bounces 5 --grid 60x44 --spacing 3cm --bin-width 16ps --bins 4000
    """
    import time

    from rig.bench.render import TimeAxis
    from rig.bench.render import render as rendered
    from rig.commands import console
    from rig.commands.scan import columns_and_rows
    from rig.devices.kinds import time_axis
    from rig.errors import UsageError
    from rig.model.config import built_in_with, load
    from rig.model.plan import ScanPlan
    from rig.model.quantities import parse, show_duration

    simulation = {"scene": scene, "bounces": bounces, "roughness": roughness, "gloss": gloss}
    changes = {"simulation": {name: value for name, value in simulation.items() if value is not None}}
    if config and not load(config).simulated:
        raise UsageError(
            f"{config} names real devices; give the configuration of a simulated rig, or --config {BUILT_IN}"
        )
    rig_config = load(config, changes) if config else built_in_with(changes)
    columns, rows = columns_and_rows(grid) if grid else (None, None)
    plan = ScanPlan.grid(
        rig_config,
        columns=columns,
        rows=rows,
        spacing_m=parse(spacing, "length") if spacing else None,
    )
    usual_bins, usual_width_s = time_axis(rig_config)
    axis = TimeAxis(bins or usual_bins, parse(bin_width, "time") if bin_width else usual_width_s)
    began_s = time.monotonic()
    with told_if_stopped([out]), console.Working(f"rendering {scene}") as progress:
        photons = rendered(plan, rig_config, axis, out, progress)
    took_s = time.monotonic() - began_s
    if as_json:
        result = {"file": str(out), "positions": len(plan), "bins": axis.bins, "expected": photons}
        console.print_json({**result, "took_s": round(took_s, 2)})
        return
    console.print_facts(
        str(out),
        {
            "positions": f"{len(plan):,}, {axis.bins:,} bins each",
            "expected": f"{photons:,.0f} photons",
            "size": f"{out.stat().st_size / 1e6:.1f} MB",
            "took": show_duration(took_s),
        },
    )
