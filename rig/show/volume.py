"""Pictures of a reconstructed volume, as the virtual camera on the wall sees the scene."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rig.atomic import appearing
from rig.errors import DataFileError, UsageError
from rig.files.volume import Volume
from rig.model.quantities import show_length

#: Width of a picture [pixels].
WIDTH_PX = 1500
DPI = 100
_AMPLITUDE_COLOURS = "inferno"
DEPTH_COLOURS = "viridis"
_CONFIDENCE_COLOURS = "gray"
NO_SURFACE = "0.82"  # neutral grey: no colour of the depth scale
#: Least range of the depth colours [m]: below it they would show the voxels' steps as relief.
_LEAST_DEPTHS_M = 0.1
_X_LABEL = "x (m), as seen from the wall"
#: Largest height of a panel by its width, so that a tall scene does not become a tower.
_TALLEST = 2.0


def draw_front(
    axes: Axes,
    image: NDArray,
    x_m: NDArray,
    y_m: NDArray,
    colours: str,
    scale: Normalize | None = None,
) -> ScalarMappable:
    """Draw a (ny, nx) image as the virtual camera sees it: y up, and x growing to the left.

    The camera looks out of the wall along +z, so what is at +x is on its left. All front views come from
    here.

    Parameters
    ----------
    axes
        Where to draw.
    image
        (ny, nx) values at x_m and y_m, both ascending; NaN stays background.
    x_m, y_m
        Pixel centres.
    colours, scale
        Colour map and its range.
    """
    drawn = _draw(axes, image, x_m, y_m, colours, scale)
    axes.invert_xaxis()
    axes.set_xlabel(_X_LABEL)
    axes.set_ylabel("y (m)")
    return drawn


def volume_figure(volume: Volume, title: str = "", compensation: str = "") -> Figure:
    """Draw the maximum projections of a volume, and its depth map.

    Parameters
    ----------
    volume
        The volume; of a transient camera's volume, the brightest moment of each voxel is shown.
    title
        First line; a second line tells the parameters that the volume names.
    compensation
        What the intensity was multiplied with against its fall-off with depth, e.g. ``"z^2"``; for the label.

    Returns
    -------
    Figure of front, top and side view and, where the volume has them, depth map and confidence.
    """
    amplitude = _amplitude(volume)
    scale = Normalize(0.0, 1.0)
    figure, panels = _panels(volume)
    front = draw_front(
        panels["front"], amplitude.max(axis=0), volume.x_m, volume.y_m, _AMPLITUDE_COLOURS, scale
    )
    panels["front"].set_title("front: maximum over depth")
    if "side" in panels:
        side, top = amplitude.max(axis=2).T, amplitude.max(axis=1)
        _draw(panels["side"], side, volume.z_m, volume.y_m, _AMPLITUDE_COLOURS, scale)
        panels["side"].set(title="side: maximum over x", xlabel="depth z (m)", ylabel="y (m)")
        _draw(panels["top"], top, volume.x_m, volume.z_m, _AMPLITUDE_COLOURS, scale)
        panels["top"].invert_xaxis()
        panels["top"].set(title="top: maximum over y", xlabel=_X_LABEL, ylabel="depth z (m)")
    label = "amplitude / maximum" + (f", intensity times {compensation}" if compensation else "")
    figure.colorbar(front, cax=panels["amplitude bar"], label=label)
    if volume.depth_m is not None:
        panels["depth"].set_facecolor(NO_SURFACE)
        found = np.isfinite(volume.depth_m)
        depths = Normalize(*depth_range(volume.depth_m[found] if found.any() else volume.z_m))
        drawn = draw_front(panels["depth"], volume.depth_m, volume.x_m, volume.y_m, DEPTH_COLOURS, depths)
        panels["depth"].set_title("depth of the surface (grey: none)")
        figure.colorbar(drawn, cax=panels["depth bar"], label="depth z (m)")
    if volume.confidence is not None and "confidence" in panels:
        sure = draw_front(
            panels["confidence"], volume.confidence, volume.x_m, volume.y_m, _CONFIDENCE_COLOURS, scale
        )
        panels["confidence"].set_title("confidence that it is not noise")
        figure.colorbar(sure, cax=panels["confidence bar"], label="probability")
    if not volume.parameters.get("signal", True):
        for name in ("front", "depth"):
            if name in panels:
                say_across(panels[name], "no signal above noise")
    for line, inches, style in (
        (title or volume.scan, 0.32, "bold"),
        (parameters_line(volume), 0.58, "normal"),
    ):
        figure.text(0.5, 1 - inches / figure.get_figheight(), line, size=13, weight=style, ha="center")
    return figure


def parameters_line(volume: Volume) -> str:
    """Return the parameters that a reader asks for first, as far as the volume names them."""
    told = []
    for key, value in volume.parameters.items():
        if key in {"camera", "solver"}:
            told.append(str(value))
        elif key == "wavelength_m" and isinstance(value, int | float):
            told.append(f"wavelength {show_length(value)}")
        elif key == "cycles":
            told.append(f"{value:g} cycles")
        elif key == "estimated":
            told += [f"estimated: {words}" for words in value]
    return ", ".join(told)


def check_picture(path: Path) -> None:
    """Raise UsageError, before anything is computed, unless a picture can be written by this ending."""
    known = sorted(FigureCanvasAgg.get_supported_filetypes())
    if path.suffix.lower().removeprefix(".") not in known:
        raise UsageError(f"{path} is no picture's name: the endings are .{', .'.join(known)}")


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as a picture; its format follows the ending. It appears whole or not at all.

    Raises
    ------
    DataFileError
        If the picture cannot be written, or its format is not known.
    """
    path = Path(path)
    try:
        with appearing(path) as partial:
            figure.savefig(partial, dpi=DPI)
    except (OSError, ValueError) as error:
        raise DataFileError(f"cannot write the picture {path}: {error}") from error


def say_across(axes: Axes, words: str) -> None:
    """Write across a panel what must not be overlooked."""
    axes.text(
        0.5,
        0.5,
        words,
        transform=axes.transAxes,
        ha="center",
        va="center",
        size=15,
        weight="bold",
        bbox={"facecolor": "white", "edgecolor": "black"},
    )


def _amplitude(volume: Volume) -> NDArray[np.float32]:
    """Return the (nz, ny, nx) amplitude sqrt(I), largest value 1."""
    intensity = volume.intensity
    if intensity.ndim == 4:
        intensity = intensity.max(axis=0)
    elif volume.t_s is not None:
        intensity = intensity.max(axis=0)[None]
    amplitude = np.sqrt(np.maximum(intensity, 0))
    largest = amplitude.max()
    return amplitude / largest if largest > 0 else amplitude


def depth_range(depths_m: NDArray) -> tuple[float, float]:
    """Return the range of the colours of depths, all finite and one at least."""
    low, high = float(np.min(depths_m)), float(np.max(depths_m))
    middle = (low + high) / 2
    half = max((high - low) / 2, _LEAST_DEPTHS_M / 2)
    return middle - half, middle + half


def _draw(
    axes: Axes, image: NDArray, right_m: NDArray, up_m: NDArray, colours: str, scale: Normalize | None
) -> ScalarMappable:
    """Draw an (up, right) image with the axes' metres at the pixels' centres."""
    extent = (*_edges(right_m), *_edges(up_m))
    drawn = axes.imshow(
        image,
        origin="lower",
        extent=extent,
        cmap=colours,
        norm=scale,
        interpolation="nearest",
        aspect="equal",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return drawn


def _edges(centres_m: NDArray) -> tuple[float, float]:
    """Return the outer edges of evenly spaced pixels."""
    half_m = (centres_m[-1] - centres_m[0]) / (2 * (len(centres_m) - 1)) if len(centres_m) > 1 else 0.01
    return float(centres_m[0] - half_m), float(centres_m[-1] + half_m)


def _panels(volume: Volume) -> tuple[Figure, dict[str, Axes]]:
    """Lay out the panels, all to one scale in metres: front and side share y, front and top share x."""
    (left_m, right_m), (low_m, high_m), (near_m, far_m) = map(_edges, (volume.x_m, volume.y_m, volume.z_m))
    flat = len(volume.z_m) == 1
    wide_m, high_m, deep_m = right_m - left_m, high_m - low_m, 0.0 if flat else far_m - near_m
    depth = volume.depth_m is not None
    maps = 0 if not depth else 1 if volume.confidence is None or flat else 2
    second_column_m = max(deep_m, wide_m if depth else 0.0)
    # inches around the panels, for labels, titles and bars
    left, right, bottom, top, gap, between, bar = 0.8, 1.15, 0.65, 1.05, 0.85, 0.95, 0.16
    if flat:
        gap, between = gap + 1.0, 0.0  # the bar of the amplitude stands between the columns
    width = WIDTH_PX / DPI
    scale = (width - left - gap - right) / (wide_m + second_column_m)
    scale = min(scale, _TALLEST * width / 2 / (high_m + (0.0 if flat else max(deep_m, maps * high_m))))
    second_row = 0.0 if flat else max(deep_m * scale, maps * high_m * scale + (maps - 1) * between)
    height = bottom + second_row + between + high_m * scale + top
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    x0 = left + (width - left - gap - right - (wide_m + second_column_m) * scale) / 2
    x1 = x0 + wide_m * scale + gap
    row_top = bottom + second_row
    y0 = row_top + between

    def panel(x: float, y: float, panel_wide: float, panel_high: float) -> Axes:
        return figure.add_axes((x / width, y / height, panel_wide / width, panel_high / height))

    panels = {"front": panel(x0, y0, wide_m * scale, high_m * scale)}
    if not flat:
        panels["side"] = panel(x1, y0, deep_m * scale, high_m * scale)
        panels["top"] = panel(x0, row_top - deep_m * scale, wide_m * scale, deep_m * scale)
    bar_x = x0 + wide_m * scale if flat else x1 + deep_m * scale
    panels["amplitude bar"] = panel(bar_x + 0.2, y0, bar, high_m * scale)
    if depth:
        y = y0 if flat else row_top - high_m * scale
        panels["depth"] = panel(x1, y, wide_m * scale, high_m * scale)
        panels["depth bar"] = panel(x1 + wide_m * scale + 0.2, y, bar, high_m * scale)
    if maps > 1:
        y -= high_m * scale + between
        panels["confidence"] = panel(x1, y, wide_m * scale, high_m * scale)
        panels["confidence bar"] = panel(x1 + wide_m * scale + 0.2, y, bar, high_m * scale)
    return figure, panels
