"""``rig recon``: image a scan."""

import gc
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recon import registry
from rig.commands.options import COMPUTER, RESULTS, AsJson, Cluster
from rig.commands.results import Force, names, told_if_stopped

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rig.image.reconstruct import Elsewhere
    from rig.image.request import Request
    from rig.image.result import Result


class Solver(StrEnum):
    """How the image is computed."""

    vars().update({name: name for name in registry.SOLVERS})


class Device(StrEnum):
    """Where it is computed."""

    CPU = "cpu"
    CUDA = "cuda"


class Camera(StrEnum):
    """What the virtual camera does."""

    vars().update({name: name for name in registry.CAMERAS})


#: Objects that are made before garbage is looked for among them. Libraries and pictures make a million that
#: stay; looking at them every 700 takes half a second in all.
SELDOM = 200_000
VOLUME, LIGHT, VIDEO = "Volume", "Light that counts", "Video"
_CAMERA, _SOLVER = Camera("confocal"), Solver("rsd")
_WITH_SNR, _BOUNDED = " and ".join(registry.taking("snr")), " and ".join(registry.BOUNDED)


class Over(StrEnum):
    """How the depths of a video are put into one picture."""

    SURFACE = "surface"
    MAX = "max"
    SUM = "sum"


def recon(
    scan: Annotated[Path, typer.Argument(metavar="SCAN.h5", help="A scan file.")],
    camera: Annotated[Camera, typer.Option(help=registry.cameras_help())] = _CAMERA,
    solver: Annotated[Solver, typer.Option(help=registry.solvers_help())] = _SOLVER,
    wavelength: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Wavelength of the virtual wave. [dim]\\[default: by spacing and response][/dim]",
        ),
    ] = None,
    cycles: Annotated[
        float | None,
        typer.Option(
            metavar="NUMBER", help="Length of the virtual pulse, in wavelengths. [dim]\\[default: 2][/dim]"
        ),
    ] = None,
    depth: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VOLUME,
            metavar="FROM:TO:STEP",
            help="Depths to image, e.g. 0.5m:3m:2cm. [dim]\\[default: the record's reach][/dim]",
        ),
    ] = None,
    width: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VOLUME,
            metavar="LENGTH",
            help="Width of the volume. [dim]\\[default: the wall's][/dim]",
        ),
    ] = None,
    height: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VOLUME,
            metavar="LENGTH",
            help="Height of the volume. [dim]\\[default: the wall's][/dim]",
        ),
    ] = None,
    voxel: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VOLUME,
            metavar="LENGTH",
            help="Voxel side across. [dim]\\[default: the wall's spacing][/dim]",
        ),
    ] = None,
    fade_from: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=LIGHT,
            metavar="TIME",
            help="Ignore light that comes earlier than this after the pulse is on the wall.",
        ),
    ] = None,
    snr: Annotated[
        float | None,
        typer.Option(
            metavar="RATIO",
            help=f"Ratio of signal to noise power, for {_WITH_SNR} only. [dim]\\[default: 0.8][/dim]",
        ),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=COMPUTER,
            metavar="BYTES",
            help=f"Largest memory for imaging, e.g. 2GB, for {_BOUNDED}. "
            "[dim]\\[default: for the quickest way][/dim]",
        ),
    ] = None,
    device: Annotated[
        Device, typer.Option(rich_help_panel=COMPUTER, help="Device on which the rsd solver computes.")
    ] = Device.CPU,
    cluster: Cluster = None,
    calibrations: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=LIGHT,
            metavar="FOLDER",
            help="Use the newest calibrations of this folder instead of those that the scan used.",
        ),
    ] = None,
    even_bins: Annotated[
        bool,
        typer.Option(
            "--even-bins", rich_help_panel=LIGHT, help="Divide counts by the calibrated widths of the bins."
        ),
    ] = False,
    frames: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VIDEO,
            metavar="FROM:TO:STEP",
            help="Moments of the video, e.g. 2ns:20ns:0.2ns. [dim]\\[default: the light's way][/dim]",
        ),
    ] = None,
    each_frame: Annotated[
        bool,
        typer.Option(
            "--each-frame",
            rich_help_panel=VIDEO,
            help="Image each frame of a scan separately: for a moving object.",
        ),
    ] = False,
    fresh_to: Annotated[
        str | None,
        typer.Option(
            rich_help_panel=VIDEO,
            metavar="DEPTH",
            help="Average frames: one frame more for each time that a voxel is this deep. "
            "[dim]\\[default: never][/dim]",
        ),
    ] = None,
    relight: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Light only one hidden point, e.g. 10cm,0cm,1m; for exhaustive captures.",
        ),
    ] = None,
    over: Annotated[
        Over | None,
        typer.Option(
            rich_help_panel=VIDEO, help="What a video shows of the depths. [dim]\\[default: surface][/dim]"
        ),
    ] = None,
    all_depths: Annotated[
        bool,
        typer.Option(
            "--all-depths", rich_help_panel=VIDEO, help="Store the video of every voxel, (t, z, y, x)."
        ),
    ] = False,
    video: Annotated[
        Path | None,
        typer.Option(rich_help_panel=VIDEO, metavar="FILE.gif", help="The video; .mp4 needs ffmpeg."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            rich_help_panel=RESULTS,
            metavar="VOLUME.h5",
            help="The volume. [dim]\\[default: SCAN-volume.h5, SCAN-2-volume.h5 ...][/dim]",
        ),
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=RESULTS,
            metavar="PICTURE.png",
            help="The picture. [dim]\\[default: SCAN.png, SCAN-2.png ...][/dim]",
        ),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=RESULTS,
            metavar="FILE.html",
            help="A web page with the volume in 3-D, which can be turned by hand.",
        ),
    ] = None,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="A quick, coarse picture to try wavelength and depth: SCAN-preview.png, "
            "which is replaced each time; no volume is written. The next preview is quicker.",
        ),
    ] = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Show what it would need: voxels, memory, time; compute nothing."),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Also compute images that take more than ten minutes.")
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Image what is hidden, from a scan.

    [bold]Examples[/bold]

      # everything chosen by the program
      rig recon scan.h5
      rig recon scan.h5 --wavelength 4cm --depth 0.5m:2m:1cm
      # a quick look, again and again
      rig recon scan.h5 --preview --wavelength 8cm
      # to be turned in any browser
      rig recon scan.h5 --page letters.html
      rig recon scan.h5 --camera photo --depth 0.8m:1.6m:10cm
      rig recon scan.h5 --camera transient --video flash.gif
      rig recon scan.h5 --each-frame --video moving.gif
      rig recon all.h5 --relight 10cm,0cm,1m --camera transient --video relit.gif
      # an earlier method, to compare with
      rig recon scan.h5 --solver lct
      # what it would take, and on workers
      rig recon scan.h5 --voxel 2mm --dry-run
      rig recon scan.h5 --voxel 2mm --cluster local:4

    Nothing is overwritten: a second image of the same scan is scan-2-volume.h5, its picture scan-2.png.
    """
    gc.set_threshold(SELDOM)
    from rig.commands import console
    from rig.image.asked import asked
    from rig.image.drawing import Drawing
    from rig.image.reconstruct import reconstruct
    from rig.show.endings import check_picture

    request = asked(
        camera=camera.value,
        solver=solver.value,
        wavelength=wavelength,
        cycles=cycles,
        depth=depth,
        frames=frames,
        over=over.value if over else None,
        all_depths=all_depths,
        width=width,
        height=height,
        voxel=voxel,
        fade_from=fade_from,
        snr=snr,
        memory=memory,
        device=device.value,
        calibrations=calibrations,
        even_bins=even_bins,
        each_frame=each_frame,
        fresh_to=fresh_to,
        relight=relight,
        however_long=yes,
    )
    if dry_run:
        _say_what_it_takes(scan, request, cluster, as_json)
        return
    if preview:
        _preview(scan, request, {"--out": out, "--page": page, "--video": video}, image, force, as_json)
        return
    given = {"volume": out, "picture": image, "video": video, "page": page}
    files = names(scan, {"volume": "-volume.h5", "picture": ".png"}, given, force=force)
    check_picture(files["picture"])
    with (
        told_if_stopped(files.values()),
        Drawing(files["picture"]) as drawing,
        _elsewhere(scan, cluster, request) as crew,
        console.Working("imaging") as working,
    ):
        result = reconstruct(scan, request, files["volume"], drawing, working, video, page, crew)
    _show(result, files, as_json)


def _preview(
    scan: Path,
    request: "Request",
    others: dict[str, Path | None],
    image: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    from rig.commands import console
    from rig.errors import UsageError
    from rig.image.drawing import Drawing
    from rig.image.preview import preview
    from rig.show.endings import check_picture

    if given := [option for option, path in others.items() if path is not None]:
        raise UsageError(f"a preview is only a picture: leave {' and '.join(given)} out, or --preview")
    # the one result that is replaced unasked: its own name says that it is no result
    files = names(scan, {"picture": "-preview.png"}, {"picture": image}, force=force or image is None)
    check_picture(files["picture"])
    with (
        told_if_stopped(files.values()),
        Drawing(files["picture"]) as drawing,
        console.Working("previewing") as working,
    ):
        result = preview(scan, request, drawing, working)
    _show(result, files, as_json)


def _say_what_it_takes(scan: Path, request: "Request", cluster: str | None, as_json: bool) -> None:
    """Print what imaging would take; refuse what would be refused."""
    from rig.commands import console
    from rig.image.forecast import forecasted, require_possible

    found = forecasted(scan, request, _workers(cluster) if cluster else None)
    bounded = request.memory_bytes is not None
    if as_json:
        require_possible(found, bounded=bounded, however_long=request.however_long)
        console.print_json({"scan": str(scan), **found.as_dict()})
        return
    console.print_facts(str(scan), found.summary())
    require_possible(found, bounded=bounded, however_long=request.however_long)


def _workers(cluster: str) -> int:
    """Return how many workers an address has."""
    from rig.cluster.joined import joined, local_workers

    number = local_workers(cluster)
    if number is not None:
        return number
    with joined(cluster) as client:
        return sum(client.nthreads().values())


@contextmanager
def _elsewhere(scan: Path, cluster: str | None, request: "Request") -> "Iterator[Elsewhere | None]":
    """Join a cluster, if one was named."""
    if cluster is None:
        yield None
        return
    from rig.cluster.joined import joined, local_workers
    from rig.files.inspection import inspect
    from rig.image.request import check_elsewhere

    local_workers(cluster)
    check_elsewhere(request)
    if scan.is_file():
        inspect(scan)  # a copy of this process does it in milliseconds, as long as no thread of dask runs
    with joined(cluster) as client:
        from rig.cluster.imaging import Crew

        yield Crew(client, request.memory_bytes)


def _show(result: "Result", files: dict[str, Path], as_json: bool) -> None:
    from rig.commands import console

    if as_json:
        console.print_json({**{what: str(path) for what, path in files.items()}, **result.as_dict()})
        return
    for sentence in result.warnings:
        console.warn(sentence)
    others = {what: str(path) for what, path in files.items() if what != "picture"}
    console.print_facts(str(files["picture"]), {**result.summary(), **others})
