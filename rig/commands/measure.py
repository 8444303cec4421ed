"""``rig measure``: numbers for an image."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands import completing
from rig.commands.options import AsJson


def measure(
    volume: Annotated[Path, typer.Argument(metavar="VOLUME.h5", help="A volume, as 'rig recon' writes it.")],
    truth: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|scene:NAME",
            autocompletion=completing.truths,
            help="The true scene: a depth map (.npz, or HDF5 with the group truth), another volume, "
            "a mesh (.obj, .ply, .stl), a simulated scan, or a scene of the simulator.",
        ),
    ] = None,
    scan: Annotated[
        Path | None,
        typer.Option(
            metavar="SCAN.h5",
            help="The wall, for the formulas of resolution. "
            "[dim]\\[default: the volume's own, if beside it][/dim]",
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1,
            help="Fraction of the greatest intensity above which a pixel counts. [dim]\\[default: "
            "as imaged][/dim]",
        ),
    ] = None,
    falloff: Annotated[
        float,
        typer.Option(
            metavar="POWER", min=0, max=10, help="Power of depth that undoes the fall-off of intensity."
        ),
    ] = 4.0,
    as_json: AsJson = False,
) -> None:
    """Measure an image: width of its brightest point, contrast, noise; with a truth, overlap and depth error.

    [bold]Examples[/bold]

      # resolution beside its theory
      rig measure scan-volume.h5
      # a simulated scan against its scene
      rig measure scan-volume.h5 --truth scene:letters --json
      # a mesh in metres, in the wall's frame
      rig measure volume.h5 --truth object.ply
    """
    from rig.commands import console
    from rig.files import read_volume
    from rig.image.measures import measure, wall_of
    from rig.image.truth import true_depth

    image = read_volume(volume)
    truth_m = true_depth(truth, image.x_m, image.y_m) if truth else None
    wall = wall_of(image, volume, scan)
    found = measure(image, truth_m, wall, threshold=threshold, falloff=falloff)
    if as_json:
        console.print_json({"volume": str(volume), "truth": truth, **found.document})
    else:
        console.print_facts(str(volume), found.summary())
