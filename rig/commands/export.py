"""``rig export``: write a scan or a volume for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson


def export(
    source: Annotated[
        Path, typer.Argument(metavar="SCAN.h5|VOLUME.h5", help="A scan or volume file of this program.")
    ],
    target: Annotated[
        Path, typer.Argument(metavar="FILE", help="The file to write; its ending names the layout.")
    ],
    as_json: AsJson = False,
) -> None:
    """Write a scan or a volume for other programs; the layout follows the ending.

    A volume: .npz (NumPy), .mat (MATLAB v5), .vti (VTK, ParaView), .tif (a page for each plane, ImageJ).
    A scan: .hdf5 (TAL, for y-tal), .mat (MATLAB v5).

    [bold]Examples[/bold]

      rig export scan-volume.h5 letters.vti      for ParaView, in metres

      rig export scan.h5 letters.hdf5            for y-tal
    """
    from rig.commands import console
    from rig.exporters import export

    layout = export(source, target)
    size_bytes = target.stat().st_size
    if as_json:
        console.print_json({"file": str(target), "layout": layout, "bytes": size_bytes})
    else:
        console.print_facts(str(target), {"layout": layout, "size": f"{size_bytes / 1e6:.3g} MB"})
