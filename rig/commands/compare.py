"""``rig compare``: all methods that apply, on the same capture."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands import completing
from rig.commands.options import AsJson
from rig.commands.results import Force, names, require_free, told_if_stopped

if TYPE_CHECKING:
    from rig.image.compare.found import Comparison

#: Endings that make --out a picture; else it is a folder.
_PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff")


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Scans, or files of other labs that can be read without options."
        ),
    ],
    truth: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|scene:NAME",
            autocompletion=completing.truths,
            help="The true scene, as in 'rig measure'. [dim]\\[default: from the file][/dim]",
        ),
    ] = None,
    wavelength: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Wavelength, which sets the resolution of all methods. [dim]\\[default: "
            "as 'rig recon'][/dim]",
        ),
    ] = None,
    depth: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO:STEP",
            help="Depths to image. [dim]\\[default: the record's reach, an eighth of the wavelength][/dim]",
        ),
    ] = None,
    voxel: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH", help="Voxel side across. [dim]\\[default: about half the wavelength][/dim]"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER|SHEET.png",
            help="The sheet, or a folder for sheets and all volumes. "
            "[dim]\\[default: FILE-compare.png][/dim]",
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Image a capture by all methods that apply, at the same resolution, and measure the images alike.

    The sheet shows front view and depth map of each method. Back-projection takes time: about a nanosecond
    of one core for each voxel and position, three times.

    [bold]Examples[/bold]

      # a simulated scan knows its truth
      rig compare scan.h5
      # a sheet each, one table, all volumes
      rig compare su.h5 exit.h5 --out compared
      rig compare night.h5 --depth 0.8m:1.8m:5mm --truth object.ply
    """
    from rig.commands import console
    from rig.image.asked import asked
    from rig.image.compare.methods import compare as compared
    from rig.image.compare.subject import check_comparable

    request = asked(wavelength=wavelength, depth=depth, voxel=voxel)
    for file in files:
        check_comparable(file, console.warn)
    sheets, keep = _places(files, out, force)
    found = []
    for file, sheet in zip(files, sheets, strict=True):
        with told_if_stopped(sheets), console.Working(f"comparing {file.name}") as working:
            found.append(compared(file, request, sheet, truth=truth, keep=keep, progress=working))
        _warn(found[-1])
    if as_json:
        console.print_json({"comparisons": [one.as_dict() for one in found]})
    else:
        _show(found)


def _places(files: list[Path], out: Path | None, force: bool) -> tuple[list[Path], Path | None]:
    """Return where each file's sheet goes, and the folder for volumes if they are kept."""
    from rig.errors import UsageError, reason
    from rig.image.compare.methods import volumes_of

    if out is None:
        return [names(file, {"sheet": "-compare.png"}, force=force)["sheet"] for file in files], None
    if out.suffix.lower() in _PICTURES and not out.is_dir():
        if len(files) > 1:
            raise UsageError(
                f"{out} is one sheet, but each of {len(files)} files needs its own; give a folder"
            )
        if not out.parent.is_dir():
            raise UsageError(f"cannot write {out}: the folder {out.parent} does not exist; create it first")
        require_free([out], force=force)
        return [out], None
    stems = [file.stem for file in files]
    if twice := {stem for stem in stems if stems.count(stem) > 1}:
        raise UsageError(
            f"two files are called {', '.join(twice)}: their sheets would have the same name; rename one"
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot create the folder {out} ({reason(error)}); name another, or a .png"
        ) from error
    sheets = [out / f"{stem}-compare.png" for stem in stems]
    require_free([*sheets, *(path for file in files for path in volumes_of(file, out).values())], force=force)
    return sheets, out


def _warn(found: "Comparison") -> None:
    """Warn of what no method can image."""
    from recon.defaults import on_one_line
    from rig.commands import console

    for sentence in on_one_line(found.work.capture):
        console.warn(f"{found.file}: {sentence}")


def _show(found: "list[Comparison]") -> None:
    from rig.commands import console
    from rig.image.compare.found import HEADS, NOTHING, row

    rows: list[tuple[str, dict[str, str]]] = []
    for one in found:
        if len(found) > 1:
            rows.append((str(one.file), {}))
        for method in one.methods:
            mark = ": not applicable" if method.reason else " *" if method.approximate else ""
            rows.append((method.method + mark, {} if method.reason else row(method)))
    heads = [head for head in HEADS if any(cells.get(head, NOTHING) != NOTHING for _, cells in rows)]
    console.print_table(
        ("method", *heads), [(name, *(cells.get(head, "") for head in heads)) for name, cells in rows]
    )
    for one in found:
        console.say(f"{one.sheet}: {one.summary()}")
        for method in one.methods:
            for sentence in (method.reason, *method.notes):
                if sentence:
                    console.say(f"{one.file}, {method.method}: {sentence}")
