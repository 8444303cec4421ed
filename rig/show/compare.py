"""A sheet of the images that several methods made of one capture."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.model.colours import DEPTH_COLOURS, NO_SURFACE
from rig.show.saving import DPI
from rig.show.sheet import COLOURS, side_m
from rig.show.volume import WIDTH_PX, depth_range, draw_front

#: Methods beside one another.
MOST = 4
#: Inches around the pictures: for labels, titles and bars; and of a line of text.
LEFT, RIGHT, TOP, BOTTOM, GAP, TITLE, LABEL, LINE = 0.8, 1.15, 0.85, 0.2, 0.3, 0.35, 0.55, 0.18

#: Colours of the front view and of the depth map, and what they mean.
COLOURS_OF = (COLOURS, DEPTH_COLOURS)
LABELS = ("amplitude / maximum", "depth z (m)")
#: Without a truth, the colours of depth go from this percentile of all maps to that one.
MOST_PERCENT = (2, 98)


@dataclass(frozen=True)
class Column:
    """A method's images, one above the other.

    Attributes
    ----------
    title
        The method.
    front
        (y, x) front view from 0 to 1; None where there is none, as of a truth.
    depth_m
        (y, x) depth of the surface, NaN where nothing is; None where it was not made.
    lines
        Numbers, for beneath.
    """

    title: str
    front: NDArray | None
    depth_m: NDArray | None
    lines: tuple[str, ...] = ()


def comparison_figure(
    columns: Sequence[Column], x_m: NDArray, y_m: NDArray, heading: str, parameters: str
) -> Figure:
    """Draw front view and depth map of each method, all with the same axes and the same colours.

    Parameters
    ----------
    columns
        In their order; one without a front view is a truth, and gives the range of depths.
    x_m, y_m
        Pixel centres of all images.
    heading, parameters
        First and second line.
    """
    beside = ceil(len(columns) / ceil(len(columns) / MOST))
    rows = ceil(len(columns) / beside)
    width = WIDTH_PX / DPI
    wide = (width - LEFT - RIGHT - (beside - 1) * GAP) / beside
    tall = wide * min(2.0, side_m(y_m) / side_m(x_m))
    block = TITLE + 2 * tall + GAP / 2 + LABEL + LINE * max(len(one.lines) for one in columns)
    height = TOP + rows * block + BOTTOM
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    scales = Normalize(0.0, 1.0), Normalize(*_depths(columns))
    drawn: dict[int, ScalarMappable] = {}
    for number, one in enumerate(columns):
        line, place = divmod(number, beside)
        x, y = LEFT + place * (wide + GAP), height - TOP - line * block - TITLE - tall
        for below, image in enumerate((one.front, one.depth_m)):
            if image is None:
                continue
            axes = _axes(figure, x, y - below * (tall + GAP / 2), wide, tall)
            axes.set_facecolor(NO_SURFACE)
            drawn[below] = draw_front(axes, image, x_m, y_m, COLOURS_OF[below], scales[below])
            if place > 0:
                axes.set_ylabel("")
                axes.set_yticklabels([])
            if below == 0:
                axes.set_xlabel("")
                axes.set_xticklabels([])
        top = y + tall if one.front is not None else y - GAP / 2
        figure.text((x + wide / 2) / width, (top + 0.1) / height, one.title, size=12, ha="center")
        under = y - tall - GAP / 2 - LABEL
        figure.text(x / width, under / height, "\n".join(one.lines), size=9, va="top")
    for below, colours in drawn.items():
        bar_y = height - TOP - TITLE - tall - below * (tall + GAP / 2)
        bar = _axes(figure, width - RIGHT + 0.2, bar_y, 0.16, tall)
        figure.colorbar(colours, cax=bar, label=LABELS[below])
    for text, inches, style in ((heading, 0.32, "bold"), (parameters, 0.58, "normal")):
        figure.text(0.5, 1 - inches / height, text, size=13, weight=style, ha="center")
    return figure


def _axes(figure: Figure, x: float, y: float, wide: float, tall: float) -> Axes:
    """Add axes at a place in inches."""
    width, height = figure.get_size_inches()
    return figure.add_axes((x / width, y / height, wide / width, tall / height))


def _depths(columns: Sequence[Column]) -> tuple[float, float]:
    """Return the range of the colours of depth: the truth's where there is one, or that of most pixels."""
    truths = [one for one in columns if one.front is None]
    maps = [one.depth_m.ravel() for one in truths or columns if one.depth_m is not None]
    found = np.concatenate([one[np.isfinite(one)] for one in maps] or [np.zeros(0)])
    if len(found) == 0:
        return depth_range(np.array([1.0]))
    return depth_range(found if truths else np.percentile(found, MOST_PERCENT))
