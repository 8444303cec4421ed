"""Where the panels of a volume's picture are: to one scale in metres, and the sheet filled.

Front and side view share y, front and top view share x, as in a technical drawing. The maps, of depth and of
confidence, stand below the side view or in a column of their own: whichever leaves less of the sheet empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

#: Width of a picture [inches]; panels above one another are at most so high together.
WIDTH, TALLEST = 15.0, 15.0
#: Inches around the panels for labels, titles, bars and the caption; and between them.
LEFT, RIGHT, TOP, BOTTOM, ROW_GAP, COLUMN_GAP = 0.8, 1.15, 1.05, 1.05, 0.95, 0.85
#: Width of a bar, its distance from its panel, and what it takes between columns [inches].
BAR, BAR_GAP, BAR_ROOM = 0.16, 0.2, 1.0
#: Least side of a panel [inches]: in a smaller one, labels would lie upon one another.
LEAST = 1.5


@dataclass(frozen=True)
class Box:
    """A rectangle on the sheet [inches], from its lower left corner."""

    x: float
    y: float
    wide: float
    high: float

    def bar(self) -> "Box":
        """Return where the bar of its colours is, to its right."""
        return Box(self.x + self.wide + BAR_GAP, self.y, BAR, self.high)


@dataclass(frozen=True)
class Layout:
    """A sheet.

    Attributes
    ----------
    height
        Of the sheet [inches]; its width is `WIDTH`.
    boxes
        Its panels, by name.
    filled
        Part of the sheet that the panels fill, margins and gaps not counted.
    """

    height: float
    boxes: dict[str, Box]
    filled: float


def arranged(wide_m: float, high_m: float, deep_m: float, maps: Sequence[str]) -> Layout:
    """Return the arrangement that fills most of its sheet.

    Parameters
    ----------
    wide_m, high_m, deep_m
        Sides of the volume, edge to edge; a depth of 0 for a single plane, which has neither side nor top
        view.
    maps
        Names of the maps, each as wide and high as the front view.
    """
    sides_m = {"side": (deep_m, high_m), "top": (wide_m, deep_m)}
    sides_m |= dict.fromkeys(("front", *maps), (wide_m, high_m))
    if deep_m == 0:
        return _sheet([["front"], *([name] for name in maps)], sides_m)
    below, beside = [["front", "top"], ["side", *maps]], [["front", "top"], ["side"], list(maps)]
    choices = [_sheet([column for column in columns if column], sides_m) for columns in (below, beside)]
    return max(choices, key=lambda layout: layout.filled)


def _sheet(columns: Sequence[Sequence[str]], sides_m: dict[str, tuple[float, float]]) -> Layout:
    """Lay out columns of panels, all from the same top; there is a bar beside all but front and top view."""
    gaps = [COLUMN_GAP + (0.0 if "top" in column else BAR_ROOM) for column in columns]
    room = WIDTH - LEFT - RIGHT - sum(gaps[:-1])
    widths_m = [max(sides_m[name][0] for name in column) for column in columns]
    scale = scale_to(room, widths_m)
    for column in columns:
        tall = TALLEST - ROW_GAP * (len(column) - 1)
        scale = min(scale, scale_to(tall, [sides_m[name][1] for name in column]))

    def inches(side_m: float) -> float:
        return max(side_m * scale, LEAST)

    heights = [[inches(sides_m[name][1]) for name in column] for column in columns]
    height = TOP + max(sum(column) + ROW_GAP * (len(column) - 1) for column in heights) + BOTTOM
    spare = room - sum(map(inches, widths_m))
    boxes, x = {}, LEFT + max(0.0, spare / 2)
    for column, width_m, gap in zip(columns, widths_m, gaps, strict=True):
        y = height - TOP
        for name in column:
            wide, high = map(inches, sides_m[name])
            y -= high
            boxes[name] = Box(x, y, wide, high)
            y -= ROW_GAP
        x += inches(width_m) + gap
    panels = sum(box.wide * box.high for box in boxes.values())
    return Layout(height, boxes, panels / (sum(map(inches, widths_m)) * max(map(sum, heights))))


def scale_to(room: float, sides_m: Sequence[float]) -> float:
    """Return the inches a metre at which sides fill a length [inches], the shortest not below `LEAST`."""
    longest_first = sorted(sides_m, reverse=True)
    scale = 0.0
    for count in range(len(longest_first), 0, -1):
        rest = room - LEAST * (len(longest_first) - count)
        scale = rest / sum(longest_first[:count])
        if longest_first[count - 1] * scale >= LEAST:
            break
    return scale
