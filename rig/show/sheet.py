"""Front views side by side: the planes of a photo camera, the frames of a transient camera."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from recon.capture import C_M_PER_S
from rig.files.volume import Volume
from rig.model.colours import AMPLITUDE_COLOURS, LIGHT_COLOURS
from rig.model.quantities import show_length
from rig.show.saving import DPI
from rig.show.volume import WIDTH_PX, draw_front, say_nothing_seen, write_around

#: Pictures in a row, and in a sheet.
COLUMNS, MOST = 4, 12
#: Part of all light of a video that may come before its first frame shown, and after its last.
UNSEEN = 0.01
COLOURS = AMPLITUDE_COLOURS


def refocus_figure(volume: Volume) -> Figure:
    """Draw planes of a photo camera's volume as a strip, each to its own maximum."""
    chosen = _spread(len(volume.z_m))
    amplitudes = np.sqrt(np.maximum(volume.intensity[chosen], 0))
    largest = amplitudes.max(axis=(1, 2), keepdims=True)
    return sheet(
        amplitudes / np.where(largest > 0, largest, 1),
        [f"focused at {show_length(z_m)}" for z_m in volume.z_m[chosen]],
        volume,
        "amplitude / maximum of the plane",
    )


def frames_figure(volume: Volume, compensation: str = "") -> Figure:
    """Draw frames of a transient camera's video as a contact sheet, all to one scale.

    Frames are taken evenly between the first and the last in which there is light.
    `compensation` says what the intensity was multiplied with against its fall-off, for the label.
    """
    shown = lit(volume)
    assert shown.t_s is not None
    chosen = _spread(len(shown.t_s))
    titles = [stamp(t_s, shown) for t_s in shown.t_s[chosen]]
    images, label = video_amplitude(shown)[chosen], video_label(compensation)
    return sheet(images, titles, shown, label, colours=film_colours(shown))


def lit(volume: Volume, margin: int = 0) -> Volume:
    """Return a video from its first frame with light to its last, and some before and after.

    The sum of light over pixels and frames decides: a single bright pixel, or noise that is everywhere, is
    little of it.

    Parameters
    ----------
    volume
        The video.
    margin
        Frames without light that are kept at either end.
    """
    assert volume.t_s is not None
    light = np.cumsum(
        np.maximum(volume.intensity, 0).reshape(len(volume.t_s), -1).sum(axis=1, dtype=np.float64)
    )
    if not light[-1] > 0:
        return volume
    first, last = np.searchsorted(light, [UNSEEN * light[-1], (1 - UNSEEN) * light[-1]])
    kept = slice(max(0, int(first) - margin), int(last) + 1 + margin)
    return replace(volume, intensity=volume.intensity[kept], t_s=volume.t_s[kept])


def film_colours(volume: Volume) -> str | Colormap:
    """Return the colours of a video: of light on its way, white where none is; of a scan, as of an image."""
    return COLOURS if volume.parameters.get("each_frame") else LIGHT_COLOURS


def outline(axes: Axes, volume: Volume) -> None:
    """Draw around what the image found, so that a viewer sees where light will come to."""
    if volume.depth_m is None or min(volume.depth_m.shape) < 2:
        return
    found = np.isfinite(volume.depth_m)
    if found.any() and not found.all():
        axes.contour(volume.x_m, volume.y_m, found, levels=[0.5], colors="0.55", linewidths=0.8)


def video_amplitude(volume: Volume) -> NDArray[np.float32]:
    """Return the (t, y, x) amplitude of a video, its largest value 1."""
    intensity = volume.intensity.max(axis=1) if volume.intensity.ndim == 4 else volume.intensity
    amplitude = np.sqrt(np.maximum(intensity, 0))
    largest = amplitude.max()
    return amplitude / largest if largest > 0 else amplitude


def video_label(compensation: str) -> str:
    """Say what the colours of a video mean."""
    return "amplitude / maximum of the video" + (f",\nintensity times {compensation}" if compensation else "")


def stamp(time_s: float, volume: Volume) -> str:
    """Write a moment: when a frame began, or a time after the flash and how far light has gone since."""
    if volume.parameters.get("each_frame"):
        return f"{time_s:.2f} s"
    return f"{time_s * 1e9:.2f} ns = {time_s * C_M_PER_S:.2f} m"


def sheet(
    images: NDArray,
    titles: Sequence[str],
    volume: Volume,
    label: str,
    columns: int = COLUMNS,
    colours: str | Colormap = COLOURS,
) -> Figure:
    """Draw front views in rows, to one scale of colour from 0 to 1.

    Parameters
    ----------
    images
        (n, ny, nx) values from 0 to 1.
    titles
        One for each.
    volume
        Axes, and what the heading tells.
    label
        What the colours mean.
    columns
        Pictures in a row.
    colours
        Of 0 to 1.
    """
    columns = min(columns, len(images))
    rows = ceil(len(images) / columns)
    # inches around the pictures, for labels, titles and the bar
    left, right, bottom, top, gap_x, gap_y = 0.8, 1.2, 1.0, 1.05, 0.25, 0.45
    width = WIDTH_PX / DPI
    wide = (width - left - right - (columns - 1) * gap_x) / columns
    wide = min(wide, width / 3)
    tall = wide * min(2.0, side_m(volume.y_m) / side_m(volume.x_m))
    height = bottom + top + rows * tall + (rows - 1) * gap_y
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    scale = Normalize(0.0, 1.0)
    for number, (image, title) in enumerate(zip(images, titles, strict=True)):
        row, column = divmod(number, columns)
        x = left + column * (wide + gap_x)
        y = height - top - tall - row * (tall + gap_y)
        axes = figure.add_axes((x / width, y / height, wide / width, tall / height))
        drawn = draw_front(axes, image, volume.x_m, volume.y_m, colours, scale)
        outline(axes, volume)
        axes.set_title(title, size=11)
        if column > 0:
            axes.set_ylabel("")
            axes.set_yticklabels([])
        if number + columns < len(images):
            axes.set_xlabel("")
            axes.set_xticklabels([])
    bar_x = left + columns * wide + (columns - 1) * gap_x + 0.2
    bar = figure.add_axes((bar_x / width, (height - top - tall) / height, 0.16 / width, tall / height))
    figure.colorbar(drawn, cax=bar, label=label)
    say_nothing_seen(volume, figure.axes[:1])
    write_around(figure, volume)
    return figure


def _spread(count: int) -> NDArray[np.intp]:
    """Choose at most `MOST` of so many, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(np.intp))


def side_m(centres_m: NDArray) -> float:
    """Return the length of an axis, from edge to edge of its outermost pixels."""
    pitch_m = centres_m[1] - centres_m[0] if len(centres_m) > 1 else 0.02
    return float(centres_m[-1] - centres_m[0] + pitch_m)
