"""``rig import``: read what others measured."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import AsJson
from rig.commands.results import require_free, told_if_stopped


def import_(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="A file from another lab or program.")],
    target: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="The scan file to write.")],
    bin_width: Annotated[
        str | None, typer.Option(metavar="TIME", help="Width of a bin, if the file does not contain it.")
    ] = None,
    wall_size: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Side of the scanned square, if the file does not contain it."),
    ] = None,
    time_origin: Annotated[
        str | None,
        typer.Option(metavar="wall|laser", help="What time zero is, if the file does not contain it."),
    ] = None,
    fade_from: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Time before which the record holds light of the wall itself."),
    ] = None,
    tof: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Time of flight to each position (tofgrid). [dim]\\[default: tof.mat beside FILE][/dim]",
        ),
    ] = None,
    bounces: Annotated[
        str | None,
        typer.Option(
            metavar="N,N", help="Which bounces to add up, counted from 1. [dim]\\[default: all][/dim]"
        ),
    ] = None,
    depth_pitch: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Length of one depth index, if the wall is not flat."),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(metavar="COLSxROWS", help="Points of the scan, if the file holds only photons."),
    ] = None,
    spacing: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Distance between the spots of that grid.")
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS,AXIS",
            help="Direction along a line, then from line to line: x,y or, against an axis, -y,x. "
            "[dim]\\[default: x,y][/dim]",
        ),
    ] = None,
    snake: Annotated[bool, typer.Option("--snake", help="Every other line runs backwards.")] = False,
    detector: Annotated[
        str | None,
        typer.Option(metavar="confocal|X,Y", help="Where the detector looks, e.g. 10cm,0cm."),
    ] = None,
    places: Annotated[
        Path | None, typer.Option(metavar="SCAN.h5", help="Use the positions of this scan instead of --grid.")
    ] = None,
    point_marker: Annotated[
        int | None, typer.Option(metavar="1-4", help="Number of the marker at which a point starts.")
    ] = None,
    line_marker: Annotated[
        int | None, typer.Option(metavar="1-4", help="Number of the marker at which a line starts.")
    ] = None,
    time_zero: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="When the pulse is on the wall, in the instrument's time."),
    ] = None,
    input_: Annotated[
        int | None, typer.Option("--input", metavar="N", help="Input of the instrument, counted from 0.")
    ] = None,
    estimate: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME", help="Estimate time-origin, bin-width or wall-size from the data itself."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    r"""Turn a file from another lab into a scan file; the layout is detected by content.

    [bold]Examples[/bold]

      # O'Toole 2018
      rig import data_s_u.mat su.h5 --bin-width 4ps --fade-from 2.4ns
      # a TAL file
      rig import capture.hdf5 scan.h5
      # Liu 2023
      rig import sub_Sig.mat nt.h5 --bin-width 32ps --wall-size 1m \
        --depth-pitch 1cm
      # Lindell 2019
      rig import meas_10min.mat bike.h5 --tof tof.mat --bin-width 32ps \
        --wall-size 2m
      # PicoQuant
      rig import scan.ptu a.h5 --grid 64x64 --spacing 1cm --point-marker 1 \
        --detector confocal
    """
    from rig.commands import console
    from rig.errors import in_shell
    from rig.importers import import_scan
    from rig.model.asked import columns_and_rows
    from rig.model.quantities import parse

    require_free([target])
    with told_if_stopped([target]):
        report = import_scan(
            source,
            target,
            bin_width_s=parse(bin_width, "time") if bin_width else None,
            wall_size_m=parse(wall_size, "length") if wall_size else None,
            time_origin=time_origin,
            fade_from_s=parse(fade_from, "time") if fade_from else None,
            delays=tof,
            bounces=_numbers(bounces) if bounces else None,
            depth_pitch_m=parse(depth_pitch, "length") if depth_pitch else None,
            grid=columns_and_rows(grid) if grid else None,
            spacing_m=parse(spacing, "length") if spacing else None,
            order=order,
            snake=snake or None,
            detector=_spot(detector) if detector else None,
            places=places,
            point_marker=point_marker,
            line_marker=line_marker,
            time_zero_s=parse(time_zero, "time") if time_zero else None,
            input=input_,
            estimate=[name.strip() for name in estimate.split(",")] if estimate else (),
        )
    if as_json:
        console.print_json({"file": str(target), **vars(report)})
        return
    console.print_facts(
        str(target),
        {
            "layout": report.layout,
            "positions": f"{report.positions:,}",
            "bins": f"{report.bins:,}",
            "time zero": {"wall": "the pulse on the wall", "laser": "the pulse leaves the laser"}[
                report.time_origin
            ],
            "assumed": "\n".join(f"- {line}" for line in report.assumed) or "nothing",
        },
    )
    console.say(f"Next: {in_shell('rig', 'recon', target)}")


def _numbers(text: str) -> tuple[int, ...]:
    from rig.errors import UsageError

    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 10 for part in parts):
        raise UsageError(f"'{text}' is not a list of bounces; write numbers from 1, e.g. --bounces 2,3")
    return tuple(int(part) for part in parts)


def _spot(text: str) -> str | tuple[float, float]:
    from rig.errors import UsageError
    from rig.model.quantities import parse

    if text == "confocal":
        return text
    parts = text.split(",")
    if len(parts) != 2:
        raise UsageError(f"--detector '{text}': write confocal, or x and y of its spot, e.g. 10cm,0cm")
    return parse(parts[0], "length"), parse(parts[1], "length")
