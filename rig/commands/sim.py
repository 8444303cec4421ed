"""``rig sim``: the simulated bench by itself."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands import completing
from rig.commands.options import (
    BUILT_IN,
    AsJson,
    Grid,
    Place,
    Rotate,
    Scale,
    Spacing,
    above_zero,
    config_option,
)
from rig.commands.results import require_free, told_if_stopped

#: Narrowest bin that is rendered: a thousandth of the finest of any timing instrument.
LEAST_BIN_S = 1e-15

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            autocompletion=completing.scenes,
            help="Name of a built-in scene, or a mesh file.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT.h5", help="The scan file to make.")],
    config: Annotated[
        Path | None, config_option("The simulated rig. [dim]\\[default: built-in][/dim]")
    ] = None,
    bounces: Annotated[
        int | None,
        typer.Option(min=3, max=5, help="Bounces of light to follow: 3, 4 or 5. [dim]\\[default: 3][/dim]"),
    ] = None,
    place: Place = None,
    rotate: Rotate = None,
    scale: Scale = None,
    grid: Grid = None,
    spacing: Spacing = None,
    lasers: Annotated[
        str | None,
        typer.Option(
            metavar="COLSxROWS",
            help="Laser spots of an exhaustive capture, each combined with all --pixels. "
            "[dim]\\[default: none][/dim]",
        ),
    ] = None,
    pixels: Annotated[
        str | None,
        typer.Option(
            metavar="COLSxROWS",
            help="Pixels that see the wall, --spacing apart, for each of --lasers, which are spread over "
            "the same wall. [dim]\\[default: the rig's][/dim]",
        ),
    ] = None,
    roughness: Annotated[
        float | None,
        typer.Option(
            min=0.05, max=1, help="Roughness of all surfaces; 1 is matt. [dim]\\[default: each its own][/dim]"
        ),
    ] = None,
    gloss: Annotated[
        Gloss | None,
        typer.Option(help="Model of all glossy surfaces. [dim]\\[default: each its own][/dim]"),
    ] = None,
    bin_width: Annotated[
        str | None, typer.Option(metavar="TIME", help="Width of a bin. [dim]\\[default: 4ps][/dim]")
    ] = None,
    bins: Annotated[
        int | None, typer.Option(min=1, max=10_000_000, help="Number of bins. [dim]\\[default: 15000][/dim]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Render what a scan of a hidden scene gives on average: no noise, no gate, no instrument.

    Time zero is the pulse on the wall. The values are expected photons in the configuration's exposure.

    [bold]Examples[/bold]

      # the whole wall, three bounces
      rig sim render office office.h5
      rig sim render letters letters.h5 --bounces 5 --grid 60x44 --spacing 3cm
      # every laser spot with every pixel
      rig sim render letters all.h5 --lasers 16x16 --pixels 64x64 --spacing 2cm --bin-width 32ps --bins 512
    """
    import time

    import numpy as np

    from rig.bench.placed import looked_at
    from rig.bench.render import TimeAxis, render_each_with_each
    from rig.bench.render import render as rendered
    from rig.commands import console
    from rig.devices.kinds import time_axis
    from rig.errors import UsageError
    from rig.model import asked
    from rig.model.config import load
    from rig.model.quantities import parse, show_bytes, show_duration

    simulation: dict[str, object] = {"scene": scene, "bounces": bounces, "roughness": roughness}
    simulation |= {"gloss": gloss, **asked.placement(place, rotate, scale)}
    if config and not load(config).simulated:
        raise UsageError(
            f"{config} has real devices; give the configuration of a simulated rig, or --config {BUILT_IN}"
        )
    rig_config = asked.configuration(config, None, simulation)
    if bool(lasers) != bool(pixels) or (lasers and grid):
        raise UsageError(
            "an exhaustive capture needs both --lasers and --pixels, and no --grid; e.g. --lasers 16x16 "
            "--pixels 64x64"
        )
    plan = asked.plan(rig_config, grid=grid, spacing=spacing)
    sides_m = plan.spots_m, np.array([channel.spot_m for channel in rig_config.channels])
    if lasers and pixels:
        spacing_m = parse(spacing, "length") if spacing else rig_config.scan.spacing_m
        sides_m = exhaustive_spots_m(lasers, pixels, spacing_m)
    usual_bins, usual_width_s = time_axis(rig_config)
    axis = TimeAxis(bins or usual_bins, _bin_width_s(bin_width, usual_width_s))
    require_free([out])
    hidden = looked_at(rig_config, *sides_m, (0.0, axis.bins * axis.bin_width_s))
    if hidden:
        console.say(hidden.words)
        for sentence in hidden.warnings:
            console.warn(sentence)
    began_s = time.monotonic()
    with told_if_stopped([out]), console.Working(f"rendering {scene}") as progress:
        if lasers:
            positions = len(sides_m[0]) * len(sides_m[1])
            photons = render_each_with_each(*sides_m, rig_config, axis, out, progress)
        else:
            positions, photons = len(plan), rendered(plan, rig_config, axis, out, progress)
    took_s = time.monotonic() - began_s
    if as_json:
        result = {"file": str(out), "positions": positions, "bins": axis.bins, "expected": photons}
        console.print_json({**result, "took_s": round(took_s, 2)})
        return
    console.print_facts(
        str(out),
        {
            "positions": f"{positions:,}, {axis.bins:,} bins each",
            "expected": f"{photons:,.0f} photons",
            "size": show_bytes(out.stat().st_size),
            "took": show_duration(took_s),
        },
    )


def exhaustive_spots_m(lasers: str, pixels: str, spacing_m: float) -> "tuple[NDArray, NDArray]":
    """Read the options --lasers and --pixels: spots of both, spread over the same wall, its middle at zero.

    Raises
    ------
    rig.errors.UsageError
        If one is no grid.
    """
    from rig.bench.render import even_grid
    from rig.model.asked import columns_and_rows

    columns, rows = columns_and_rows(pixels)
    wall_m = columns * spacing_m, rows * spacing_m
    return even_grid(*columns_and_rows(lasers), *wall_m), even_grid(columns, rows, *wall_m)


def _bin_width_s(text: str | None, usual_s: float) -> float:
    """Read --bin-width; light of a scene is rendered in bins that an instrument could have."""
    from rig.errors import UsageError

    if text is None:
        return usual_s
    width_s = above_zero("--bin-width", text, "time")
    if width_s < LEAST_BIN_S:
        raise UsageError(f"--bin-width {text}: bins are {LEAST_BIN_S * 1e15:g} fs wide or more, e.g. 4ps")
    return width_s
