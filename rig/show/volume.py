"""Pictures of a reconstructed volume, as the virtual camera on the wall sees the scene."""

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rig.files.volume import Volume
from rig.files.words import caption, parameters_line
from rig.model.colours import AMPLITUDE_COLOURS, DEPTH_COLOURS, NO_SURFACE
from rig.show.layout import WIDTH, Box, arranged
from rig.show.saving import DPI

#: Width of a picture [pixels].
WIDTH_PX = round(WIDTH * DPI)
#: Confidence in steps: noise has all values below the first one alike, and would be drawn as a pattern.
CONFIDENCE_STEPS = (0.0, 0.95, 0.99, 0.999, 1.0)
CONFIDENCE_COLOURS = ListedColormap(["0.15", "0.4", "0.65", "0.94"], name="confidence")
#: Side and top view end where all beyond is fainter than this part of the maximum, and so many metres after;
#: they are at least this part of the front view's longer side deep, so that they can be drawn to scale.
_BLACK, _MARGIN_M, _LEAST_DEEP = 0.05, 0.1, 0.4
#: Least range of the depth colours [m]: below it they would show the voxels' steps as relief.
_LEAST_DEPTHS_M = 0.1
#: The arrow says where x grows to.
X_LABEL = "\N{LEFTWARDS ARROW} x (m), as seen from the wall"
Z_LABEL = "depth z (m)"
#: Letters of a panel's title in an inch; and of a caption in a line, and lines.
_LETTERS_PER_INCH, _CAPTION_LETTERS, _CAPTION_LINES = 14, 190, 3


def draw_front(
    axes: Axes,
    image: NDArray,
    x_m: NDArray,
    y_m: NDArray,
    colours: str | Colormap,
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
    axes.xaxis.set_inverted(True)
    axes.set_xlabel(X_LABEL)
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
    amplitude, scale = _amplitude(volume), Normalize(0.0, 1.0)
    deep = lit_depths(amplitude, volume.z_m, _LEAST_DEEP * max(np.ptp(volume.x_m), np.ptp(volume.y_m)))
    figure, panels = _panels(volume, volume.z_m[deep])
    axes = panels["front"]
    drawn = draw_front(axes, amplitude.max(axis=0), volume.x_m, volume.y_m, AMPLITUDE_COLOURS, scale)
    axes.set_title("front: maximum over depth")
    if "side" in panels:
        _draw_views(panels, amplitude[deep], replace(volume, z_m=volume.z_m[deep]), scale)
        _say_what_is_black(panels["top"], volume.z_m, deep)
    label = "amplitude / maximum" + (f",\nintensity times {compensation}" if compensation else "")
    figure.colorbar(drawn, cax=panels["side bar" if "side" in panels else "front bar"], label=label)
    if volume.depth_m is not None:
        panels["depth"].set_facecolor(NO_SURFACE)
        found = np.isfinite(volume.depth_m)
        depths = Normalize(*depth_range(volume.depth_m[found] if found.any() else volume.z_m))
        drawn = draw_front(panels["depth"], volume.depth_m, volume.x_m, volume.y_m, DEPTH_COLOURS, depths)
        panels["depth"].set_title("depth of the surface (blank: none)")
        figure.colorbar(drawn, cax=panels["depth bar"], label=Z_LABEL)
    if volume.confidence is not None and "confidence" in panels:
        axes, steps = panels["confidence"], BoundaryNorm(CONFIDENCE_STEPS, CONFIDENCE_COLOURS.N, clip=True)
        drawn = draw_front(axes, volume.confidence, volume.x_m, volume.y_m, CONFIDENCE_COLOURS, steps)
        axes.set_title("confidence that it is not noise")
        bar = figure.colorbar(drawn, cax=panels["confidence bar"], label="probability", spacing="uniform")
        bar.set_ticks(CONFIDENCE_STEPS, labels=[f"{step:g}" for step in CONFIDENCE_STEPS])
    for name in ("front", "side", "top", "depth", "confidence"):
        if name in panels:
            _fit(figure, panels[name], name)
    say_nothing_seen(volume, [panels[name] for name in ("front", "depth") if name in panels])
    write_around(figure, volume, title)
    return figure


def _draw_views(panels: dict[str, Axes], amplitude: NDArray, volume: Volume, scale: Normalize) -> None:
    """Draw side and top view."""
    _draw(panels["side"], amplitude.max(axis=2).T, volume.z_m, volume.y_m, AMPLITUDE_COLOURS, scale)
    panels["side"].set(title="side: maximum over x", xlabel=Z_LABEL, ylabel="y (m)")
    _draw(panels["top"], amplitude.max(axis=1), volume.x_m, volume.z_m, AMPLITUDE_COLOURS, scale)
    panels["top"].invert_xaxis()
    panels["top"].set(title="top: maximum over y", xlabel=X_LABEL, ylabel=Z_LABEL)


def _say_what_is_black(axes: Axes, z_m: NDArray, shown: slice) -> None:
    """Write on the black margin of the top view which depths were imaged, where it does not show all."""
    near, far = shown.start > 0, shown.stop < len(z_m)
    if near or far:
        axes.text(
            0.02,
            0.98 if far else 0.02,
            f"imaged {z_m[0]:.2f} to {z_m[-1]:.2f} m: black beyond",
            transform=axes.transAxes,
            va="top" if far else "bottom",
            color="0.75",
            size=8,
        )


def _fit(figure: Figure, axes: Axes, name: str) -> None:
    """Fit letters to a small panel; a panel that would be too small to read is stretched, and says so."""
    width, height = figure.get_size_inches()
    box = axes.get_position(original=True)
    wide, high = box.width * width, box.height * height
    across_m, up_m = (abs(high - low) for low, high in (axes.get_xlim(), axes.get_ylim()))
    title = axes.get_title()
    if abs(wide / high / (across_m / up_m) - 1) > 0.01:
        axes.set_aspect("auto")
        title = f"{name}, not to scale"
    axes.set_title(textwrap.fill(title, int(_LETTERS_PER_INCH * wide)), size=12 if wide > 3 else 9)
    axes.xaxis.label.set_fontsize(min(10.0, 4.4 * wide))
    for axis, inches in ((axes.xaxis, wide), (axes.yaxis, high)):
        axis.set_major_locator(MaxNLocator(min(6, int(inches / 0.6)), steps=[1, 2, 5, 10]))


def write_around(figure: Figure, volume: Volume, title: str = "") -> None:
    """Write above a figure what it shows and how it was made, and below it where it comes from."""
    height = figure.get_figheight()
    heading = ((title or volume.scan, 0.32, "bold"), (parameters_line(volume), 0.58, "normal"))
    for line, inches, style in heading:
        figure.text(0.5, 1 - inches / height, line, size=13, weight=style, ha="center")
    lines = textwrap.wrap(caption(volume), _CAPTION_LETTERS, max_lines=_CAPTION_LINES, placeholder=" …")
    if lines:
        words = "\n".join(lines)
        figure.text(0.5, 0.1 / height, words, size=9, color="0.25", ha="center", va="bottom", linespacing=1.3)


def say_nothing_seen(volume: Volume, panels: Sequence[Axes]) -> None:
    """Write across panels that they show noise alone, if the volume says so."""
    if not volume.parameters.get("signal", True):
        for axes in panels:
            say_across(axes, "no signal above noise")


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


def lit_depths(amplitude: NDArray[np.float32], z_m: NDArray, least_m: float = 0.0) -> slice:
    """Return which depths side and top view show: all but those that would be black, at either end.

    Parameters
    ----------
    amplitude
        (nz, ny, nx), largest value 1, or all zero.
    z_m
        (nz,) depths.
    least_m
        Depth from end to end that is kept, where the volume is so deep.
    """
    lit = np.flatnonzero(amplitude.max(axis=(1, 2)) > _BLACK)
    if len(lit) == 0:
        return slice(0, len(z_m))
    middle_m = (z_m[lit[0]] + z_m[lit[-1]]) / 2
    half_m = max((z_m[lit[-1]] - z_m[lit[0]]) / 2 + _MARGIN_M, least_m / 2)
    near = np.searchsorted(z_m, min(middle_m - half_m, z_m[-1] - 2 * half_m))
    far = np.searchsorted(z_m, max(middle_m + half_m, z_m[0] + 2 * half_m), side="right")
    return slice(int(near), int(far))


def depth_range(depths_m: NDArray) -> tuple[float, float]:
    """Return the range of the colours of depths, all finite and one at least."""
    low, high = float(np.min(depths_m)), float(np.max(depths_m))
    middle = (low + high) / 2
    half = max((high - low) / 2, _LEAST_DEPTHS_M / 2)
    return middle - half, middle + half


def _draw(
    axes: Axes,
    image: NDArray,
    right_m: NDArray,
    up_m: NDArray,
    colours: str | Colormap,
    scale: Normalize | None,
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


def _panels(volume: Volume, deep_m: NDArray) -> tuple[Figure, dict[str, Axes]]:
    """Make the sheet, and the axes of its panels and their bars by name; the views show depths `deep_m`."""
    sides_m = [np.ptp(_edges(axis)) for axis in (volume.x_m, volume.y_m, deep_m)]
    flat = len(volume.z_m) == 1
    maps = ["depth"] if volume.depth_m is not None else []
    if maps and volume.confidence is not None and not flat:
        maps.append("confidence")
    layout = arranged(sides_m[0], sides_m[1], 0.0 if flat else sides_m[2], maps)
    figure = Figure(figsize=(WIDTH, layout.height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)

    def axes(box: Box) -> Axes:
        shares = (box.x / WIDTH, box.y / layout.height, box.wide / WIDTH, box.high / layout.height)
        return figure.add_axes(shares)

    panels = {name: axes(box) for name, box in layout.boxes.items()}
    with_bars = ["front" if flat else "side", *maps]
    return figure, panels | {f"{name} bar": axes(layout.boxes[name].bar()) for name in with_bars}
