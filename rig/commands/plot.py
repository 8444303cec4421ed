"""``rig plot``: pictures of scans and volumes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson
from rig.commands.results import Force, names, told_if_stopped

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="A scan, a volume, or several scans to compare.")
    ],
    image: Annotated[
        Path | None,
        typer.Option(metavar="PICTURE.png", help="The picture. [dim]\\[default: FILE-plot.png][/dim]"),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Draw the raw data of scans, or the projections of a volume.

    A scan is drawn as one image of all its counts, and as the histograms of three positions: that with the
    most photons, the median one, and that with the largest bin, until 99.5 % of their photons have come. Of
    several scans these are compared.

    [bold]Examples[/bold]

      rig plot scan.h5
      rig plot office-10ms.h5 office-5ms.h5 office-1ms.h5 --image compared.png
    """
    from rig.commands import console
    from rig.show.endings import check_picture
    from rig.show.saving import save

    picture = names(files[0], {"picture": "-plot.png"}, {"picture": image}, force=force)["picture"]
    check_picture(picture)
    with told_if_stopped([picture]), console.Working("drawing"):
        save(_figure(files), picture)
    if as_json:
        console.print_json({"picture": str(picture), "files": [str(path) for path in files]})
    else:
        console.print_facts(str(picture), {"of": ", ".join(map(str, files))})


def _figure(files: list[Path]) -> "Figure":
    from rig.commands import console
    from rig.errors import UsageError, printable
    from rig.files.scan import ScanFile
    from rig.files.volume import is_volume, read_volume
    from rig.show.raw import comparison_figure, raw_view, scan_figure
    from rig.show.volume import volume_figure

    volumes = [path for path in files if is_volume(path)]
    if volumes and len(files) > 1:
        raise UsageError(f"{volumes[0]} is a volume: only scans are compared; plot each volume alone")
    if volumes:
        return volume_figure(read_volume(files[0]), printable(files[0].name))
    if len(files) == 1:
        with ScanFile(files[0]) as scan:
            console.warn_of(scan)
            return scan_figure(printable(files[0].name), scan.capture())
    views = []
    for path in files:
        with ScanFile(path) as scan:
            console.warn_of(scan)
            views.append(raw_view(printable(path.name), scan.capture()))
    return comparison_figure(views)
