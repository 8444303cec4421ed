"""A sheet of small pictures of scans: counts over the wall, and the image where there is one."""

from collections.abc import Callable, Sequence
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from recon.depth import compensate_falloff
from rig.errors import DataFileError, printable
from rig.files.scan import ScanFile
from rig.files.volume import is_volume, outline_volume, read_volume
from rig.show.catalogue import Entry
from rig.show.saving import DPI, save
from rig.show.sheet import COLOURS, video_amplitude
from rig.show.volume import WIDTH_PX, draw_front, say_across
from rig.show.wall import counts_of_spots, draw_counts

#: Scans beside one another; and the newest so many of a folder are drawn.
COLUMNS, MOST = 3, 60
#: Inches: of a row, of the margin above it for two lines, and between pictures.
_ROW, _LINES, _GAP = 1.9, 0.62, 0.12
#: The pictures of depths are made even by this power of the depth, where the volume does not say another.
_FALLOFF = 4.0
#: Letters of a line above a pair of pictures.
_LETTERS = 62


def save_sheet(entries: Sequence[Entry], path: Path, progress: Callable[[float], None]) -> int:
    """Draw the newest scans of a folder on one sheet, and save it.

    Returns
    -------
    How many older ones are left out.

    Raises
    ------
    DataFileError
        If the picture cannot be written.
    """
    shown = list(entries[-MOST:])
    volumes = _volumes(shown)
    rows = max(1, ceil(len(shown) / COLUMNS))
    width, height = WIDTH_PX / DPI, rows * (_ROW + _LINES) + 2 * _GAP
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    cell = (width - _GAP) / COLUMNS
    for number, entry in enumerate(shown):
        row, column = divmod(number, COLUMNS)
        left, top = _GAP + column * cell, height - _GAP - row * (_ROW + _LINES)
        for line, style, down in zip(_lines(entry), ("bold", "normal"), (0.18, 0.42), strict=True):
            figure.text(left / width, 1 - (height - top + down) / height, line, size=9, weight=style)
        bottom, wide = top - _LINES - _ROW + _GAP, (cell - 3 * _GAP) / 2
        pair = [
            figure.add_axes(
                ((left + k * (wide + _GAP)) / width, bottom / height, wide / width, (_ROW - _GAP) / height)
            )
            for k in (0, 1)
        ]
        _draw(pair, entry, volumes.get(entry.path.name))
        progress((number + 1) / len(shown))
    save(figure, path)
    return len(entries) - len(shown)


def _lines(entry: Entry) -> tuple[str, str]:
    """Return what stands above a scan's pictures."""
    date, name, positions, exposure, _, status, purpose = map(printable, entry.row())
    facts = [f"{positions} positions" if positions else "", exposure, status, purpose]
    return f"{name}   {date}"[:_LETTERS], ", ".join(filter(None, facts))[:_LETTERS]


def _draw(pair: list[Axes], entry: Entry, volume: Path | None) -> None:
    for axes in pair:
        axes.set(xticks=[], yticks=[])
    if entry.problem:
        say_across(pair[0], "damaged")
    else:
        _draw_wall(pair[0], entry.path)
    if volume is None or entry.problem:
        pair[1].set_axis_off()
    else:
        _draw_image(pair[1], volume)
    for axes in pair:
        axes.set(xticks=[], yticks=[], xlabel="", ylabel="")


def _draw_wall(axes: Axes, path: Path) -> None:
    try:
        with ScanFile(path) as scan:
            photons = scan.photons_of_steps()
            if np.isfinite(photons).any():
                draw_counts(axes, *counts_of_spots(scan.laser_m, photons))
            else:
                say_across(axes, "nothing yet")
    except DataFileError:  # what an outline does not see
        say_across(axes, "damaged")


def _draw_image(axes: Axes, path: Path) -> None:
    try:
        volume = read_volume(path)
    except DataFileError:
        say_across(axes, "damaged")
        return
    if volume.t_s is not None:
        front = video_amplitude(volume).max(axis=0)
    else:
        power = float(volume.parameters.get("falloff_power", _FALLOFF))
        front = compensate_falloff(volume.intensity, volume.z_m, power).max(axis=0)
        front = np.sqrt(np.maximum(front, 0))
    draw_front(axes, front, volume.x_m, volume.y_m, COLOURS)


def _volumes(entries: Sequence[Entry]) -> dict[str, Path]:
    """Return the newest volume of each scan among the files beside it, by the scan's name."""
    found: dict[str, tuple[str, Path]] = {}
    for folder in dict.fromkeys(entry.path.parent for entry in entries):
        for path in sorted(folder.glob("*.h5")):
            if not is_volume(path):
                continue
            try:
                said = outline_volume(path)
            except DataFileError:
                continue
            found[said.scan] = max(found.get(said.scan, ("", path)), (said.created, path))
    return {name: path for name, (_, path) in found.items()}
