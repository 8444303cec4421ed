"""``rig export``: write a scan or a volume for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson
from rig.commands.results import Force, require_free, told_if_stopped


def export(
    source: Annotated[
        Path, typer.Argument(metavar="SCAN.h5|VOLUME.h5", help="A scan or volume file of this program.")
    ],
    target: Annotated[
        Path, typer.Argument(metavar="FILE", help="The file to write; its ending names the layout.")
    ],
    rectified: Annotated[
        bool,
        typer.Option(
            "--rectified",
            help="Store rectified time: zero is when the pulse is on the wall, for all positions.",
        ),
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a scan or a volume for other programs; the layout follows the ending.

    A volume: .npz (NumPy), .mat (MATLAB v5), .vti (VTK, ParaView), .tif (a page for each plane, ImageJ),
    .html (a page for any browser), .ply and .glb (the surface as triangles).
    A scan: .hdf5 (TAL, for y-tal), .mat (MATLAB v5), .ptu (PicoQuant's records, with markers).

    [bold]Examples[/bold]

      # for ParaView, in metres
      rig export scan-volume.h5 letters.vti
      # turned by hand in any browser
      rig export scan-volume.h5 letters.html
      # for y-tal
      rig export scan.h5 letters.hdf5
      # for programs that cannot take path delays
      rig export scan.h5 letters.hdf5 --rectified
    """
    from rig.commands import console
    from rig.exporters import export
    from rig.model.quantities import show_bytes

    require_free([target], force=force)
    with told_if_stopped([target]):
        layout = export(source, target, rectified, console.warn, replace=force)
    size_bytes = target.stat().st_size
    if as_json:
        console.print_json({"file": str(target), "layout": layout, "bytes": size_bytes})
    else:
        facts = {"layout": layout, "size": show_bytes(size_bytes)}
        if rectified:
            facts["time"] = "starts when the pulse is on the wall; earlier counts are left out"
        console.print_facts(str(target), facts)
