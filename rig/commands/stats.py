"""``rig stats``: the photon statistics of scans."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson

if TYPE_CHECKING:
    from rig.show.statistics import Statistics


def stats(
    scans: Annotated[list[Path], typer.Argument(metavar="SCAN.h5...", help="Scan files.")],
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="TIME",
            help="Count only photons from this time after the pulse is on the wall. "
            "[dim]\\[default: 3.332ns, bin 833][/dim]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report the photon statistics of scans, as the paper's Table 1 does.

    [bold]Examples[/bold]

      rig stats scan.h5
      rig stats office-*.h5 --json
    """
    from rig.commands import console
    from rig.errors import DataFileError, UsageError
    from rig.files.scan import ScanFile
    from rig.model.quantities import parse
    from rig.show.statistics import FIRST_USEFUL_S, tally

    from_s = parse(start, "time") if start else FIRST_USEFUL_S
    found = {}
    for path in scans:
        with ScanFile(path) as scan:
            console.warn_of(scan)
            try:
                found[str(path)] = tally(scan.capture(), from_s).statistics
            except DataFileError as error:
                where = f"{path}: --from {start}" if start else str(path)
                raise (UsageError if start else DataFileError)(f"{where}: {error}") from None
    if as_json:
        console.print_json({"scans": [{"file": name, **s.as_dict()} for name, s in found.items()]})
        return
    header = ("scan", "photons", "photons/bin", "max. bin", "photons/position", "positions")
    console.print_table(header, [_row(name, statistics) for name, statistics in found.items()])
    console.say(
        f"Counted in bins that begin {from_s * 1e9:.4g} ns after the pulse on the wall, or later: all "
        "photons, their mean over all these bins of all measured positions, the largest count of one bin, "
        "and the mean over positions."
    )


def _row(name: str, found: "Statistics") -> tuple[str, ...]:
    return (
        name,
        f"{found.photons:,.0f}",
        f"{found.per_bin:.3g}",
        f"{found.largest:,.6g}",
        f"{found.per_position:,.0f}",
        f"{found.positions:,}",
    )
