"""``rig list``: the scans of a folder."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson
from rig.commands.results import Force, require_free, told_if_stopped


def list_(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with the scans.")] = Path(),
    sheet: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png", help="Also draw them: counts over the wall, and the image if there is one."
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """List the scans of a folder, a line each, the newest last; a damaged file is named on its line.

    [bold]Examples[/bold]

      # scans of this folder
      rig list
      rig list runs --sheet runs.png
    """
    from rig.commands import console
    from rig.show.catalogue import HEADER, catalogue

    if sheet is not None:
        require_free([sheet], force=force)
    found = catalogue(folder)
    if sheet is not None:
        from rig.show.endings import check_picture
        from rig.show.thumbnails import save_sheet

        check_picture(sheet)
        with told_if_stopped([sheet]), console.Working("drawing") as working:
            left_out = save_sheet(found, sheet, working)
        if left_out:
            console.warn(f"{sheet} has the newest scans; {left_out} older ones are left out")
    if as_json:
        damaged = [{"file": str(one.path), "problem": one.problem} for one in found if one.problem]
        console.print_json(
            {
                "folder": str(folder),
                "scans": [one.document for one in found if not one.problem],
                "damaged": damaged,
                "sheet": str(sheet) if sheet else None,
            }
        )
        return
    if not found:
        console.say(f"{folder} holds no scans")
        return
    console.print_table(HEADER, [one.row() for one in found], words=("scan", "status", "purpose"))
