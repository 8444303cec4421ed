"""``rig recon``: image a scan."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import AsJson

if TYPE_CHECKING:
    from rig.image.result import Result


class Solver(StrEnum):
    """How the image is computed."""

    RSD = "rsd"
    FRESNEL = "fresnel"
    DIRECT = "direct"
    BACKPROJECTION = "backprojection"
    BP = "bp"
    LAPLACIAN_FBP = "laplacian-fbp"
    LOG_FBP = "log-fbp"
    LCT = "lct"
    FK = "fk"


class Device(StrEnum):
    """Where it is computed."""

    CPU = "cpu"
    CUDA = "cuda"


class Camera(StrEnum):
    """What the virtual camera does."""

    CONFOCAL = "confocal"
    PHOTO = "photo"
    TRANSIENT = "transient"


class Over(StrEnum):
    """How the depths of a video are put into one picture."""

    SURFACE = "surface"
    MAX = "max"
    SUM = "sum"


def recon(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file.")],
    camera: Annotated[
        Camera,
        typer.Option(
            help="confocal: the 3-D image. photo: one wavelength, refocused plane by plane. "
            "transient: a video of a flash."
        ),
    ] = Camera.CONFOCAL,
    solver: Annotated[
        Solver,
        typer.Option(
            help="rsd: quick, exact, any geometry. fresnel: paraxial, for far scenes. direct: the defining "
            "sum, very slow. backprojection: in the time domain, slow. The others are earlier methods, to "
            "compare with: bp, laplacian-fbp and log-fbp for any geometry, lct and fk for confocal grids."
        ),
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
    snr: Annotated[
        float | None,
        typer.Option(metavar="RATIO", help="Signal to noise power, for lct only. [dim]\\[0.8][/dim]"),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="BYTES",
            help="Most memory for imaging, e.g. 2GB, for rsd and fresnel. [dim]\\[what is quickest][/dim]",
        ),
    ] = None,
    device: Annotated[Device, typer.Option(help="Where the rsd solver computes images.")] = Device.CPU,
    calibrations: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Use the newest calibrations of this folder instead of those that the scan was taken with.",
        ),
    ] = None,
    even_bins: Annotated[
        bool, typer.Option("--even-bins", help="Divide counts by the calibrated widths of the bins.")
    ] = False,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO:STEP",
            help="Moments of the video, e.g. 2ns:20ns:0.2ns. [dim]\\[the light's way][/dim]",
        ),
    ] = None,
    over: Annotated[Over, typer.Option(help="What a video shows of all depths.")] = Over.SURFACE,
    all_depths: Annotated[
        bool, typer.Option("--all-depths", help="Store the video of every voxel, (t, z, y, x).")
    ] = False,
    video: Annotated[
        Path | None, typer.Option(metavar="FILE.gif", help="The video; .mp4 needs ffmpeg.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="VOLUME.h5", help="The volume. [dim]\\[SCAN-volume.h5][/dim]"),
    ] = None,
    image: Annotated[
        Path | None, typer.Option(metavar="PICTURE.png", help="The picture. [dim]\\[SCAN.png][/dim]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Image what is hidden, from a scan.

    [bold]Examples[/bold]

      rig recon scan.h5                    everything chosen by the program

      rig recon scan.h5 --wavelength 4cm --depth 0.5m:2m:1cm

      rig recon scan.h5 --camera photo --depth 0.8m:1.6m:10cm

      rig recon scan.h5 --camera transient --video flash.gif

      rig recon scan.h5 --solver lct       an earlier method, to compare with
    """
    from rig.commands import console
    from rig.image.reconstruct import Request, reconstruct
    from rig.model.quantities import parse

    def length(text: str | None) -> float | None:
        return parse(text, "length") if text else None

    request = Request(
        camera=camera.value,
        solver=solver.value,
        wavelength_m=length(wavelength),
        cycles=cycles,
        depth_m=_depths(depth) if depth else None,
        frames_s=_range(frames, "time", "--frames 2ns:20ns:0.2ns") if frames else None,
        over=over.value,
        all_depths=all_depths,
        width_m=length(width),
        height_m=length(height),
        voxel_m=length(voxel),
        fade_from_s=parse(fade_from, "time") if fade_from else None,
        snr=snr,
        memory_bytes=int(parse(memory, "memory")) if memory else None,
        device=device.value,
        calibrations=calibrations,
        even_bins=even_bins,
    )
    volume = out or scan.with_name(f"{scan.stem}-volume.h5")
    picture = image or scan.with_suffix(".png")
    with console.Working("imaging") as working:
        result = reconstruct(scan, request, volume, picture, working, video)
    _show(result, volume, picture, video, as_json)


def _range(text: str, kind: str, example: str) -> tuple[float, float, float]:
    from rig.errors import UsageError
    from rig.model.quantities import parse

    parts = text.split(":")
    if len(parts) != 3:
        raise UsageError(f"'{text}' is not a range; write from, to and step, e.g. {example}")
    start, stop, step = (parse(part, kind) for part in parts)
    return start, stop, step


def _depths(text: str) -> tuple[float, float, float]:
    from rig.errors import UsageError

    start_m, stop_m, step_m = _range(text, "length", "--depth 0.5m:3m:2cm")
    if not (0 < start_m <= stop_m and step_m > 0):
        raise UsageError(
            f"'{text}': depths begin in front of the wall (above 0) and go away from it in steps above 0"
        )
    return start_m, stop_m, step_m


def _show(result: "Result", volume: Path, picture: Path, video: Path | None, as_json: bool) -> None:
    from rig.commands import console

    if as_json:
        files = {"volume": str(volume), "picture": str(picture)} | ({"video": str(video)} if video else {})
        console.print_json({**files, **result.as_dict()})
        return
    for sentence in result.warnings:
        console.warn(sentence)
    facts = {**result.summary(), "volume": str(volume)}
    console.print_facts(str(picture), facts | ({"video": str(video)} if video else {}))
