"""``rig report``: a scan and its image on one page."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson
from rig.commands.results import Force, names, told_if_stopped


def report(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file.")],
    volume: Annotated[
        Path | None,
        typer.Argument(
            metavar="VOLUME.h5", help="Its image. [dim]\\[default: SCAN-volume.h5, if it exists][/dim]"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE.html", help="The page. [dim]\\[default: SCAN-report.html][/dim]"
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write one page about a scan and its image, for a browser.

    It has plan, settings, calibrations, counts, rates, warnings, pictures, and how to do it again. It is one
    file, without scripts, to be kept, sent, or printed.

    [bold]Examples[/bold]

      rig report scan.h5
      rig report scan.h5 scan-2-volume.h5 --out tuesday.html
    """
    from rig.commands import console
    from rig.files.scan import ScanFile
    from rig.files.volume import read_volume
    from rig.image.picture import picture
    from rig.model.quantities import show_bytes
    from rig.show.report import Imaged, save_report

    page = names(scan, {"page": "-report.html"}, {"page": out}, force=force)["page"]
    usual = scan.with_name(f"{scan.stem}-volume.h5")
    volume = volume or (usual if usual.is_file() else None)
    with told_if_stopped([page]), console.Working("writing the page"), ScanFile(scan) as found:
        image = Imaged(volume, picture(read_volume(volume))) if volume else None
        doubts = save_report(page, found, image)
    for sentence in doubts:
        console.warn(sentence)
    result = {"page": str(page), "scan": str(scan), "volume": str(volume) if volume else None}
    if as_json:
        console.print_json({**result, "doubts": doubts})
        return
    size = show_bytes(page.stat().st_size)
    console.print_facts(str(page), {"scan": str(scan), "image": str(volume or "none"), "size": size})
