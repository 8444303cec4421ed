"""``rig recon``: image a scan."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rig.reconstruct import Result


class Solver(StrEnum):
    """How the image is computed."""

    RSD = "rsd"
    BACKPROJECTION = "backprojection"


class Device(StrEnum):
    """Where it is computed."""

    CPU = "cpu"
    CUDA = "cuda"


class Camera(StrEnum):
    """What the virtual camera does."""

    CONFOCAL = "confocal"


def recon(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file.")],
    camera: Annotated[Camera, typer.Option(help="What the virtual camera does.")] = Camera.CONFOCAL,
    solver: Annotated[
        Solver, typer.Option(help="rsd: quick, any geometry. backprojection: the slow reference.")
    ] = Solver.RSD,
    wavelength: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Of the virtual wave. [dim]\\[4 x spacing][/dim]")
    ] = None,
    cycles: Annotated[float, typer.Option(min=2, help="Length of the virtual pulse, in wavelengths.")] = 6.0,
    depth: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO:STEP",
            help="Depths to image, e.g. 0.5m:3m:2cm. [dim]\\[the record's reach][/dim]",
        ),
    ] = None,
    width: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Width of the volume. [dim]\\[the wall's][/dim]")
    ] = None,
    height: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="Height of the volume. [dim]\\[the wall's][/dim]")
    ] = None,
    voxel: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Voxel side across. [dim]\\[the wall's spacing][/dim]"),
    ] = None,
    fade_from: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Ignore light that comes earlier than this after the pulse is on the wall."
        ),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="BYTES", help="Most memory for imaging, e.g. 2GB. [dim]\\[what is quickest][/dim]"
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help="Where the rsd solver computes.")] = Device.CPU,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="VOLUME.h5", help="The volume. [dim]\\[SCAN-volume.h5][/dim]"),
    ] = None,
    image: Annotated[
        Path | None, typer.Option(metavar="PICTURE.png", help="The picture. [dim]\\[SCAN.png][/dim]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON document.")] = False,
) -> None:
    """Image what is hidden, from a scan.

    [bold]Examples[/bold]

      rig recon scan.h5                                everything chosen by the program, and said

      rig recon scan.h5 --wavelength 4cm --depth 0.5m:2m:1cm --image letters.png

      rig recon scan.h5 --solver backprojection --voxel 4cm    the slow independent reference
    """
    from rig.commands import console
    from rig.quantities import parse
    from rig.reconstruct import Request, reconstruct

    def length(text: str | None) -> float | None:
        return parse(text, "length") if text else None

    request = Request(
        solver=solver.value,
        wavelength_m=length(wavelength),
        cycles=cycles,
        depth_m=_depths(depth) if depth else None,
        width_m=length(width),
        height_m=length(height),
        voxel_m=length(voxel),
        fade_from_s=parse(fade_from, "time") if fade_from else None,
        memory_bytes=int(parse(memory, "memory")) if memory else None,
        device=device.value,
    )
    volume = out or scan.with_name(f"{scan.stem}-volume.h5")
    picture = image or scan.with_suffix(".png")
    with console.Working("imaging") as working:
        result = reconstruct(scan, request, volume, picture, working)
    _show(result, volume, picture, as_json)


def _depths(text: str) -> tuple[float, float, float]:
    from rig.errors import UsageError
    from rig.quantities import parse

    parts = text.split(":")
    if len(parts) != 3:
        raise UsageError(
            f"'{text}' is not a range of depths; write from, to and step, e.g. --depth 0.5m:3m:2cm"
        )
    start_m, stop_m, step_m = (parse(part, "length") for part in parts)
    if not (0 < start_m <= stop_m and step_m > 0):
        raise UsageError(
            f"'{text}': depths begin in front of the wall (above 0) and go away from it in steps above 0"
        )
    return start_m, stop_m, step_m


def _show(result: "Result", volume: Path, picture: Path, as_json: bool) -> None:
    from rig.commands import console

    if as_json:
        console.print_json({"volume": str(volume), "picture": str(picture), **result.as_dict()})
        return
    for sentence in result.warnings:
        console.warn(sentence)
    console.print_facts(str(picture), {**result.summary(), "volume": str(volume)})
